/* Figures over one turn of curves and of formulas of these, for many points, LANES phases of one side by side.

   The mathematics is that of period/quantities.py. FORMULAS: a file with `void formulas(const lane *const *in,
   lane *out)`, of phase, speed, q, q', q'' by time and parameters; or none, for the curves alone. N: coordinates,
   D: powers of theta in a step, OUTPUTS: formulas, PARAMETERS: their parameters. */

#include "lane.h"

#define FIGURES 7

static inline lane chosen(mask m, lane x, lane y) { return (lane)(((mask)x & m) | ((mask)y & ~m)); }

#ifdef FORMULAS
#include FORMULAS
#endif

typedef struct {
    long points, steps, samples;   /* samples: of a step */
    int wanted, zooms, around;     /* quantities; narrowings of an extremum, and phases of each */
    double period;
    const int *quantity;           /* (wanted): coordinates, and behind them formulas */
    const double *curves;          /* (points, N, steps, D), lowest power first */
    const double *speeds;          /* (points) */
    const double *parameters;      /* (points, PARAMETERS) */
    const double *parts;           /* (around), from -1 to 1 */
    double *figures;               /* (points, wanted, FIGURES): max, min, max_abs, mean, max_phase, min_phase, rms */
} problem;

/* What a point has: its curves, from the first step on, and numbers. */
typedef struct {
    const double *curves;
    lane speed, parameters[PARAMETERS + 1];
} point;

/* Powers of theta of coordinates from `first` to `last` in steps. */
static void load(const problem *p, const point *at, const long *step, int first, int last, lane *c) {
    for (int i = first; i < last; i++)
        for (int l = 0; l < LANES; l++) {
            const double *from = at->curves + (i * p->steps + step[l]) * D;
            for (int d = 0; d < D; d++) c[i * D + d][l] = from[d];
        }
}

/* Their q, and where formulas need them q' and q'' by time, at theta. */
static void states(const problem *p, const point *at, const lane *powers, lane theta, int first, int last, lane *x) {
    const double rate = p->steps / p->period;
    for (int i = first; i < last; i++) {
        const lane *c = powers + i * D;
        lane q = c[D - 1], v = {0}, a = {0};
        for (int d = D - 2; d >= 0; d--) {
            if (OUTPUTS) {
                a = a * theta + v;
                v = v * theta + q;
            }
            q = q * theta + c[d];
        }
        x[i] = q;
        if (OUTPUTS) {
            x[N + i] = rate * at->speed * v;
            x[2 * N + i] = 2.0 * rate * rate * at->speed * at->speed * a;
        }
    }
}

static void evaluate(const point *at, lane phase, const lane *x, lane *y) {
#ifdef FORMULAS
    const lane *const in[] = {&phase, &at->speed, x, x + N, x + 2 * N, at->parameters};
    formulas(in, y);
#endif
}

/* A phase within the first turn. */
static inline double turned(const problem *p, double phase) {
    if (phase >= 0.0 && phase < p->period) return phase;
    const double within = fmod(phase, p->period);
    return within < 0.0 ? within + p->period : within;
}

/* A quantity at phases of any turn. */
static lane value(const problem *p, const point *at, int quantity, lane phase) {
    lane c[N * D], x[3 * N], y[OUTPUTS + 1], theta;
    const int first = quantity < N ? quantity : 0, last = quantity < N ? quantity + 1 : N;
    long step[LANES];
    for (int l = 0; l < LANES; l++) {
        const double place = turned(p, phase[l]) * (p->steps / p->period);
        step[l] = (long)place < p->steps ? (long)place : p->steps - 1;
        theta[l] = place - step[l];
    }
    load(p, at, step, first, last, c);
    states(p, at, c, theta, first, last, x);
    if (quantity < N) return x[quantity];
    evaluate(at, phase, x, y);
    return y[quantity - N];
}

/* The largest maximum of sign times a quantity next to a sample, and its phase. */
static void extreme(const problem *p, const point *at, int quantity, double sign, double *centre, double *highest) {
    double width = p->period / (p->steps * p->samples);
    for (int zoom = 0; zoom < p->zooms; zoom++) {
        const double middle = *centre;
        for (int k = 0; k < p->around; k += LANES) {
            lane phase;
            for (int l = 0; l < LANES; l++) phase[l] = middle + width * p->parts[k + l < p->around ? k + l : p->around - 1];
            const lane found = sign * value(p, at, quantity, phase);
            for (int l = 0; l < LANES; l++)
                if (!(k + l) || found[l] > *highest) *highest = found[l], *centre = phase[l];
        }
        width /= 16;
    }
}

/* Sums and squares of the quantities at all samples, and their extrema there, room for `wanted` of each. The lanes
   are parts of the turn. */
static void sampled(const problem *p, const point *at, lane *sum, lane *square, lane *high, lane *low, lane *high_at, lane *low_at) {
    const double width = p->period / (p->steps * p->samples);
    const long length = (p->steps + LANES - 1) / LANES;
    const lane none = {0};
    lane c[N * D], x[3 * N], y[OUTPUTS + 1];
    for (long k = 0; k < length; k++) {
        long step[LANES];
        lane start;
        mask within;
        for (int l = 0; l < LANES; l++) {
            const long own = l * length + k;
            within[l] = own < p->steps ? -1 : 0;
            step[l] = own < p->steps ? own : p->steps - 1;
            start[l] = own * p->samples;
        }
        load(p, at, step, 0, N, c);
        for (long j = 0; j < p->samples; j++) {
            const lane phase = (start + (double)j) * width;
            states(p, at, c, none + (double)j / p->samples, 0, N, x);
            evaluate(at, phase, x, y);
            for (int w = 0; w < p->wanted; w++) {
                const lane found = p->quantity[w] < N ? x[p->quantity[w]] : y[p->quantity[w] - N];
                const mask first = none == (k + j ? 1.0 : 0.0);
                const mask higher = ((found > high[w]) | first) & within, lower = ((found < low[w]) | first) & within;
                sum[w] += chosen(within, found, none);
                square[w] += chosen(within, found * found, none);
                high[w] = chosen(higher, found, high[w]);
                low[w] = chosen(lower, found, low[w]);
                high_at[w] = chosen(higher, phase, high_at[w]);
                low_at[w] = chosen(lower, phase, low_at[w]);
            }
        }
    }
}

/* The lane with the largest of sign times the values, the first of equal ones, among so many. */
static int best(lane values, double sign, int among) {
    int found = 0;
    for (int l = 1; l < among; l++)
        if (sign * values[l] > sign * values[found]) found = l;
    return found;
}

static double total(lane values) {
    double sum = 0.0;
    for (int l = 0; l < LANES; l++) sum += values[l];
    return sum;
}

/* All the points; 1 where memory is missing, else 0. */
int turn(const problem *p) {
    const int W = p->wanted;
    const double count = (double)p->steps * p->samples;
    const long length = (p->steps + LANES - 1) / LANES;
    const int parts = (p->steps + length - 1) / length;
    lane *room = aligned_alloc(sizeof(lane), (6 * W + 1) * sizeof(lane));
    if (!room) return 1;
    lane *sum = room, *square = sum + W, *high = square + W, *low = high + W, *high_at = low + W, *low_at = high_at + W;
    for (long k = 0; k < p->points; k++) {
        const lane none = {0};
        point at = {.curves = p->curves + k * N * p->steps * D, .speed = none + p->speeds[k]};
        for (int i = 0; i < PARAMETERS; i++) at.parameters[i] = none + p->parameters[k * PARAMETERS + i];
        memset(room, 0, 6 * W * sizeof(lane));
        sampled(p, &at, sum, square, high, low, high_at, low_at);
        for (int w = 0; w < W; w++) {
            const int top = best(high[w], 1.0, parts), bottom = best(low[w], -1.0, parts);
            double most = high[w][top], least = low[w][bottom], most_at = high_at[w][top], least_at = low_at[w][bottom];
            extreme(p, &at, p->quantity[w], 1.0, &most_at, &most);
            extreme(p, &at, p->quantity[w], -1.0, &least_at, &least);
            const double made[FIGURES] = {
                most, -least, most > least ? most : least, total(sum[w]) / count,
                turned(p, most_at), turned(p, least_at), sqrt(total(square[w]) / count),
            };
            memcpy(p->figures + (k * W + w) * FIGURES, made, sizeof(made));
        }
    }
    free(room);
    return 0;
}
