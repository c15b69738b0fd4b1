/* Values of curves at phases that lie evenly in each of their steps. */

#define AHEAD 512                  /* numbers that are read while memory delivers one */

/* One curve at so many samples of each step, and up to LANES - 1 numbers behind the last. c: (steps, terms), lowest power
   first. powers: of theta at the samples, (terms, wide); what is behind the samples is read up to whole lanes. */
static inline __attribute__((always_inline)) void
at_samples(const double *c, const int terms, long steps, long samples, const double *powers, long wide, double *to) {
    /* What the lanes of a step's last samples hold beyond these is overwritten by samples of the next steps: those before
       come later. */
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
