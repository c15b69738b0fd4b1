/* Values of curves at phases that are evenly spaced in each step. */

#define AHEAD 512                  /* prefetch distance: numbers that are read while memory delivers one */

/* Values of one curve at the samples of each step; up to LANES - 1 numbers after the last value are also written.
   c: (steps, terms), lowest power first. powers: (terms, wide), powers of theta at the samples; values after the samples
   are read up to a whole number of lanes. */
static inline __attribute__((always_inline)) void
at_samples(const double *c, const int terms, long steps, long samples, const double *powers, long wide, double *to) {
    /* The lanes with the last samples of a step also write values after these samples. The next steps overwrite them. */
    for (long j = (samples - 1) / LANES * LANES; j >= 0; j -= LANES) {
        lane power[terms];
        for (int d = 0; d < terms; d++) power[d] = *(const loose *)(powers + d * wide + j);
        for (long k = 0; k < steps; k++) {
            __builtin_prefetch(c + k * terms + AHEAD);
            lane q = c[k * terms] * power[0];
            for (int d = 1; d < terms; d++) q += c[k * terms + d] * power[d];
            *(loose *)(to + k * samples + j) = q;
        }
    }
}
