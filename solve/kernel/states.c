/* Formulas at phases of one point, each with a state of its own, LANES of them side by side.

   FORMULAS: a file with `void formulas(const lane *const *in, lane *out)`, of phase, speed, three vectors of N
   numbers and parameters. OUTPUTS: formulas, PARAMETERS: their parameters. */

#include "lane.h"
#include FORMULAS

typedef struct {
    long phases;
    double speed;
    const double *phase;           /* (phases) */
    const double *states;          /* (3, N, phases) */
    const double *parameters;      /* (PARAMETERS) */
    double *values;                /* (phases, OUTPUTS) */
} problem;

void at_states(const problem *p) {
    const lane none = {0};
    lane parameters[PARAMETERS + 1], out[OUTPUTS];
    for (int k = 0; k < PARAMETERS; k++) parameters[k] = none + p->parameters[k];
    for (long start = 0; start < p->phases; start += LANES) {
        const long left = p->phases - start, filled = left < LANES ? left : LANES;
        lane phase, speed = none + p->speed, states[3 * N];
        for (long l = 0; l < LANES; l++) {
            const long at = start + (l < filled ? l : filled - 1);
            phase[l] = p->phase[at];
            for (int i = 0; i < 3 * N; i++) states[i][l] = p->states[i * p->phases + at];
        }
        const lane *const in[] = {&phase, &speed, states, states + N, states + 2 * N, parameters};
        formulas(in, out);
        for (long l = 0; l < filled; l++)
            for (int i = 0; i < OUTPUTS; i++) p->values[(start + l) * OUTPUTS + i] = out[i][l];
    }
}
