/* Vector of doubles that fills one vector register. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX__)
#define LANES 4
#else
#define LANES 2
#endif

typedef double lane __attribute__((vector_size(8 * LANES)));
typedef double loose __attribute__((vector_size(8 * LANES), aligned(8)));
typedef long long mask __attribute__((vector_size(8 * LANES)));

const int lanes = LANES;

/* Memory for a whole number of lanes. */
#ifdef _WIN32
#include <malloc.h>
#define allocate(bytes) _aligned_malloc(bytes, sizeof(lane))
#define release(memory) _aligned_free(memory)
#else
#define allocate(bytes) aligned_alloc(sizeof(lane), bytes)
#define release(memory) free(memory)
#endif

static inline lane absolute(lane x) { return (lane)((mask)x & 0x7fffffffffffffffLL); }

static inline lane chosen(mask m, lane x, lane y) { return (lane)(((mask)x & m) | ((mask)y & ~m)); }

static inline lane larger(lane a, lane b) { return chosen(a > b, a, b); }

static inline lane root(lane x) {
    lane r;
    for (int l = 0; l < LANES; l++) r[l] = sqrt(x[l]);
    return r;
}

static inline int any(mask m) {
    long long found = 0;
    for (int l = 0; l < LANES; l++) found |= m[l];
    return found != 0;
}

/* Functions used by formulas: x where the mask is true and 0 elsewhere, and functions of one or two numbers. */
static inline lane where(mask m, lane x) { return (lane)((mask)x & m); }

static inline lane call_1(double (*f)(double), lane x) {
    lane r;
    for (int l = 0; l < LANES; l++) r[l] = f(x[l]);
    return r;
}

static inline lane call_2(double (*f)(double, double), lane x, lane y) {
    lane r;
    for (int l = 0; l < LANES; l++) r[l] = f(x[l], y[l]);
    return r;
}
