/* Figures over one turn of curves and of formulas of these, for many points, LANES phases of one side by side.

   The mathematics is that of period/quantities.py. FORMULAS: a file with `void formulas(const lane *const *in,
   lane *out)`, of phase, speed, q, q', q'' by time and parameters; or none, for the curves alone. N: coordinates,
   D: powers of theta in a step, OUTPUTS: formulas, PARAMETERS: their parameters. */

#include "lane.h"

#define FIGURES 7

#ifdef FORMULAS
#include FORMULAS
#endif

typedef struct {
    long points, steps, samples;   /* samples: of a step */
    int wanted, zooms, rough, around;  /* quantities; narrowings of an extremum, and of one that may be lower than
                                      another; phases of each */
    double period, tie;            /* part of the largest value by which one extremum is beyond another */
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
static double extreme(const problem *p, const point *at, int quantity, double sign, int zooms, double *centre) {
    double width = p->period / (p->steps * p->samples), highest = 0.0;
    for (int zoom = 0; zoom < zooms; zoom++) {
        const double middle = *centre;
        for (int k = 0; k < p->around; k += LANES) {
            lane phase;
            for (int l = 0; l < LANES; l++) phase[l] = middle + width * p->parts[k + l < p->around ? k + l : p->around - 1];
            const lane found = sign * value(p, at, quantity, phase);
            for (int l = 0; l < LANES; l++)
                if (!(k + l) || found[l] > highest) highest = found[l], *centre = phase[l];
        }
        width /= 16;
    }
    return highest;
}

/* Up to where sign times a quantity may rise next to a sample that is no less than its neighbours: twice as far above
   it as the parabola through the three; -INFINITY next to others. */
static inline double reach(const double *samples, long count, double sign, long k) {
    const double here = sign * samples[k];
    const double before = sign * samples[k ? k - 1 : count - 1], after = sign * samples[k + 1 < count ? k + 1 : 0];
    if (!(here >= before && here >= after)) return -INFINITY;
    const double bend = 2.0 * here - before - after;
    return bend > 0.0 ? here + (before - after) * (before - after) / (4.0 * bend) : here;
}

/* The largest maximum of sign times a quantity, from its samples, and its phase: that next to the largest sample, of
   several the first, unless one next to a lower sample is higher. */
static double outermost(const problem *p, const point *at, int quantity, double sign, const double *samples, double *phase) {
    const long count = p->steps * p->samples;
    const double width = p->period / count;
    long first = 0;
    for (long k = 1; k < count; k++)
        if (sign * samples[k] > sign * samples[first]) first = k;
    const double least = p->tie * fabs(samples[first]), alike = sign * samples[first] - least;
    for (long k = 0; k < first; k++)
        if (sign * samples[k] >= alike && isfinite(reach(samples, count, sign, k))) first = k;
    *phase = first * width;
    double highest = extreme(p, at, quantity, sign, p->zooms, phase);
    for (long k = 0; k < count; k++) {
        if (k == first || !(reach(samples, count, sign, k) > highest)) continue;
        double near = k * width;
        if (!(extreme(p, at, quantity, sign, p->rough, &near) > highest + least)) continue;
        const double found = extreme(p, at, quantity, sign, p->zooms, &near);
        if (found > highest + least) highest = found, *phase = near;
    }
    return highest;
}

/* The quantities at all samples, (wanted, steps samples). The lanes are parts of the turn. */
static void sampled(const problem *p, const point *at, double *values) {
    const long count = p->steps * p->samples, length = (p->steps + LANES - 1) / LANES;
    const lane none = {0};
    lane c[N * D], x[3 * N], y[OUTPUTS + 1];
    for (long k = 0; k < length; k++) {
        long step[LANES];
        lane start;
        for (int l = 0; l < LANES; l++) {
            step[l] = l * length + k < p->steps ? l * length + k : p->steps - 1;
            start[l] = step[l] * p->samples;
        }
        load(p, at, step, 0, N, c);
        for (long j = 0; j < p->samples; j++) {
            states(p, at, c, none + (double)j / p->samples, 0, N, x);
            evaluate(at, (start + (double)j) * (p->period / count), x, y);
            for (int w = 0; w < p->wanted; w++) {
                const lane found = p->quantity[w] < N ? x[p->quantity[w]] : y[p->quantity[w] - N];
                for (int l = 0; l < LANES; l++) values[w * count + step[l] * p->samples + j] = found[l];
            }
        }
    }
}

/* Sums of so many values, and of their squares. */
static void total(const double *values, long count, double *sum, double *square) {
    lane sums = {0}, squares = {0};
    long k = 0;
    for (; k + LANES <= count; k += LANES) {
        const lane v = *(const loose *)(values + k);
        sums += v;
        squares += v * v;
    }
    *sum = *square = 0.0;
    for (int l = 0; l < LANES; l++) *sum += sums[l], *square += squares[l];
    for (; k < count; k++) *sum += values[k], *square += values[k] * values[k];
}

/* All the points; 1 where memory is missing, else 0. */
int turn(const problem *p) {
    const long count = p->steps * p->samples;
    double *values = malloc((p->wanted * count + 1) * sizeof(double));
    if (!values) return 1;
    for (long k = 0; k < p->points; k++) {
        const lane none = {0};
        point at = {.curves = p->curves + k * N * p->steps * D, .speed = none + p->speeds[k]};
        for (int i = 0; i < PARAMETERS; i++) at.parameters[i] = none + p->parameters[k * PARAMETERS + i];
        sampled(p, &at, values);
        for (int w = 0; w < p->wanted; w++) {
            const double *own = values + w * count;
            double sum, square, most_at, least_at;
            const double most = outermost(p, &at, p->quantity[w], 1.0, own, &most_at);
            const double least = outermost(p, &at, p->quantity[w], -1.0, own, &least_at);
            total(own, count, &sum, &square);
            const double made[FIGURES] = {
                most, -least, most > least ? most : least, sum / count,
                turned(p, most_at), turned(p, least_at), sqrt(square / count),
            };
            memcpy(p->figures + (k * p->wanted + w) * FIGURES, made, sizeof(made));
        }
    }
    free(values);
    return 0;
}
