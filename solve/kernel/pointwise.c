/* Formulas at the same phases for many points, LANES points at a time.

   FORMULAS: file with `void formulas(const lane *const *in, lane *out)`, whose inputs are phase, speed and parameters.
   OUTPUTS: number of formulas. PARAMETERS: number of their parameters. */

#include "lane.h"
#include FORMULAS

typedef struct {
    long points, phases;
    const double *phase;           /* (phases) */
    const double *speeds;          /* (points) */
    const double *parameters;      /* (points, PARAMETERS) */
    double *values;                /* (points, phases, OUTPUTS) */
} problem;

void pointwise(const problem *p) {
    const lane none = {0};
    for (long start = 0; start < p->points; start += LANES) {
        const long left = p->points - start, filled = left < LANES ? left : LANES;
        lane speed, parameters[PARAMETERS + 1], out[OUTPUTS];
        for (int l = 0; l < LANES; l++) {
            const long at = start + (l < filled ? l : filled - 1);
            speed[l] = p->speeds[at];
            for (int k = 0; k < PARAMETERS; k++) parameters[k][l] = p->parameters[at * PARAMETERS + k];
        }
        for (long k = 0; k < p->phases; k++) {
            const lane phase = none + p->phase[k];
            const lane *const in[] = {&phase, &speed, parameters};
            formulas(in, out);
            for (long l = 0; l < filled; l++)
                for (int i = 0; i < OUTPUTS; i++) p->values[((start + l) * p->phases + k) * OUTPUTS + i] = out[i][l];
        }
    }
}
