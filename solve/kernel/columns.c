/* Formulas of columns of numbers, LANES columns side by side.

   FORMULAS: a file with `void formulas(const lane *const *in, lane *out)`. INPUTS: inputs that each column has
   of its own, ROWS: numbers in all of them; behind these comes one of SHARED numbers, the same for all columns.
   OUTPUTS: numbers that the formulas give. */

#include "lane.h"
#include FORMULAS

typedef struct {
    long columns;                  /* a multiple of LANES */
    const int *first;              /* (INPUTS): the rows at which the inputs begin */
    const double *given;           /* (ROWS, columns) */
    const double *shared;          /* (SHARED) */
    double *values;                /* (OUTPUTS, columns) */
} problem;

void columns(const problem *p) {
    const lane none = {0};
    lane rows[ROWS], shared[SHARED + 1], out[OUTPUTS];
    const lane *in[INPUTS + 1];
    for (int i = 0; i < INPUTS; i++) in[i] = rows + p->first[i];
    in[INPUTS] = shared;
    for (int k = 0; k < SHARED; k++) shared[k] = none + p->shared[k];
    for (long at = 0; at < p->columns; at += LANES) {
        for (int k = 0; k < ROWS; k++) rows[k] = *(const loose *)(p->given + k * p->columns + at);
        formulas(in, out);
        for (int k = 0; k < OUTPUTS; k++) *(loose *)(p->values + k * p->columns + at) = out[k];
    }
}
