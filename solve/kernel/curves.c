/* Differences between two curves at phases that are evenly spaced in the steps of both.

   The mathematics is that of certify/comparison.py. COARSE, FINE: numbers of powers of theta per step. */

#include "lane.h"
#include "samples.h"

#define MOST 8                     /* largest number of samples per step, and of LANES */

typedef struct {
    long steps, samples;           /* samples: per step */
    const double *coefficients;    /* (curves, steps, powers), lowest power first */
    const double *powers;          /* (powers, MOST): powers of theta at the samples */
} side;

typedef struct {
    long curves;
    side coarse, fine;
    double *apart, *largest;       /* (curves): largest moduli of the differences and of the fine curve */
} problem;

/* Values of one curve at its samples, followed by MOST zeros. */
static inline __attribute__((always_inline)) void values(const side *s, const int D, long curve, double *to) {
    at_samples(s->coefficients + curve * s->steps * D, D, s->steps, s->samples, s->powers, MOST, to);
    memset(to + s->steps * s->samples, 0, MOST * sizeof(double));
}

static double largest_of(lane values) {
    double found = values[0];
    for (int l = 1; l < LANES; l++) found = fmax(found, values[l]);
    return found;
}

/* Compare all curves. Returns 1 if memory is insufficient, otherwise 0. */
int differences(const problem *p) {
    const long count = p->fine.steps * p->fine.samples;
    double *coarse = malloc(2 * (count + MOST) * sizeof(double)), *fine = coarse + count + MOST;
    if (!coarse) return 1;
    for (long curve = 0; curve < p->curves; curve++) {
        lane apart = {0}, largest = {0};
        values(&p->coarse, COARSE, curve, coarse);
        values(&p->fine, FINE, curve, fine);
        for (long k = 0; k < count; k += LANES) {
            const lane q = *(const loose *)(fine + k);
            apart = larger(apart, absolute(*(const loose *)(coarse + k) - q));
            largest = larger(largest, absolute(q));
        }
        p->apart[curve] = largest_of(apart), p->largest[curve] = largest_of(largest);
    }
    free(coarse);
    return 0;
}
