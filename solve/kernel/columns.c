/* Formulas for columns of inputs, LANES columns at a time.

   FORMULAS: file with `void formulas(const lane *const *in, lane *out)`. INPUTS: number of inputs that differ between
   columns. ROWS: number of rows of these inputs. The last input has SHARED rows and is the same for all columns.
   OUTPUTS: number of results of the formulas. */

#include "lane.h"
#include FORMULAS

typedef struct {
    long columns;                  /* number of columns, a multiple of LANES */
    const int *first;              /* (INPUTS): first row of each input */
    const double *given;           /* (ROWS, columns) */
    const double *shared;          /* (SHARED) */
    double *values;                /* (OUTPUTS, columns), or (OUTPUTS, sums) for weighted sums */
    long sums;                     /* number of weighted sums per output; 0 for values */
    const int *row;                /* (OUTPUTS): row of weights for each output */
    const double *weights;         /* (rows, sums, columns) */
} problem;

/* Evaluate groups of columns one after another. `take` stores or sums the outputs. */
static inline __attribute__((always_inline)) void
each(const problem *p, lane *kept, void (*take)(const problem *, long, const lane *, lane *)) {
    const lane none = {0};
    lane rows[ROWS], shared[SHARED + 1], out[OUTPUTS];
    const lane *in[INPUTS + 1];
    for (int i = 0; i < INPUTS; i++) in[i] = rows + p->first[i];
    in[INPUTS] = shared;
    for (int k = 0; k < SHARED; k++) shared[k] = none + p->shared[k];
    for (long at = 0; at < p->columns; at += LANES) {
        for (int k = 0; k < ROWS; k++) rows[k] = *(const loose *)(p->given + k * p->columns + at);
        formulas(in, out);
        take(p, at, out, kept);
    }
}

static void store(const problem *p, long at, const lane *out, lane *kept) {
    (void)kept;
    for (int k = 0; k < OUTPUTS; k++) *(loose *)(p->values + k * p->columns + at) = out[k];
}

static void add(const problem *p, long at, const lane *out, lane *kept) {
    for (int k = 0; k < OUTPUTS; k++) {
        const double *weights = p->weights + p->row[k] * p->sums * p->columns + at;
        for (long j = 0; j < p->sums; j++) kept[k * p->sums + j] += out[k] * *(const loose *)(weights + j * p->columns);
    }
}

void columns(const problem *p) { each(p, 0, store); }

/* Returns 1 if memory is available. */
int sums(const problem *p) {
    const size_t size = OUTPUTS * p->sums * sizeof(lane);
    lane *kept = allocate(size);
    if (!kept) return 0;
    memset(kept, 0, size);
    each(p, kept, add);
    for (long k = 0; k < OUTPUTS * p->sums; k++) {
        p->values[k] = 0.0;
        for (int l = 0; l < LANES; l++) p->values[k] += kept[k][l];
    }
    release(kept);
    return 1;
}
