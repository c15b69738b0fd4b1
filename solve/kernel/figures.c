/* Figures over one turn of curves and of formulas of these, for many points, LANES phases of one side by side.

   The mathematics is that of period/quantities.py. FORMULAS: a file with `void formulas(const lane *const *in,
   lane *out)`, of phase, speed, q, q', q'' by time and parameters; or none, for the curves alone. N: coordinates,
   D: powers of theta in a step, OUTPUTS: formulas, PARAMETERS: their parameters. */

#include "lane.h"
#include "samples.h"

#define FIGURES 7
#define ORDERS (OUTPUTS ? 3 : 1)   /* derivatives of coordinates that are wanted: formulas are of q, q' and q'' */
#define ROWS (ORDERS * N + OUTPUTS)

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
    const double *parts;           /* (around), rising from -1 to 1; LANES of them at least */
    double *figures;               /* (points, wanted, FIGURES): max, min, max_abs, mean, max_phase, min_phase, rms */
} problem;

/* What a point has: its curves, from the first step on, and numbers. */
typedef struct {
    const double *curves;
    lane speed, parameters[PARAMETERS + 1];
} point;

/* Where the samples of a point are: a row of each coordinate, behind these rows of q' and q'' by time where formulas need
   them, and of the formulas. Before and behind a row is room for LANES more. */
typedef struct {
    long wide, length;             /* samples of a step and of a turn, and what is beside them */
    double *powers;                /* (ORDERS, D, wide): of theta at the samples of a step, and derivatives by time */
    double *rows;                  /* (ROWS, length), from the first sample on */
    long *turning;                 /* (samples): places in a row */
} space;

static void evaluate(const point *at, lane phase, const lane *x, lane *y) {
#ifdef FORMULAS
    const lane *const in[] = {&phase, &at->speed, x, x + N, x + 2 * N, at->parameters};
    formulas(in, y);
#endif
}

/* Phases within the first turn, of such as are less than a turn beside it. */
static inline lane turned(const problem *p, lane phase) {
    return phase + where(phase < 0.0, (lane){0} + p->period) - where(phase >= p->period, (lane){0} + p->period);
}

/* A quantity at phases of such turns. */
static lane value(const problem *p, const point *at, int quantity, lane phase) {
    lane c[N * D], x[3 * N], y[OUTPUTS + 1];
    const int first = quantity < N ? quantity : 0, last = quantity < N ? quantity + 1 : N;
    const double rate = p->steps / p->period;
    const lane place = turned(p, phase) * rate, speed = rate * at->speed;
    const long most = p->steps - 1, step = (long)place[0] < most ? (long)place[0] : most;
    lane theta = place - (double)step;
    for (int i = first; i < last; i++)
        for (int d = 0; d < D; d++) c[i * D + d] = (lane){0} + at->curves[(i * p->steps + step) * D + d];
    if (any((theta < 0.0) | (theta >= 1.0)))                     /* not all lanes are in the step of the first */
        for (int l = 1; l < LANES; l++) {
            const long own = (long)place[l] < most ? (long)place[l] : most;
            theta[l] = place[l] - own;
            for (int i = first; i < last; i++)
                for (int d = 0; d < D; d++) c[i * D + d][l] = at->curves[(i * p->steps + own) * D + d];
        }
    for (int i = first; i < last; i++) {
        lane q = c[i * D + D - 1], v = {0}, a = {0};
        for (int d = D - 2; d >= 0; d--) {
            if (OUTPUTS) {
                a = a * theta + v;
                v = v * theta + q;
            }
            q = q * theta + c[i * D + d];
        }
        x[i] = q;
        if (OUTPUTS) x[N + i] = speed * v, x[2 * N + i] = 2.0 * speed * speed * a;
    }
    if (quantity < N) return x[quantity];
    evaluate(at, phase, x, y);
    return y[quantity - N];
}

/* The largest maximum of sign times a quantity next to a sample, and its phase. */
static double extreme(const problem *p, const point *at, int quantity, double sign, int zooms, double *centre) {
    double width = p->period / (p->steps * p->samples), highest = 0.0;
    for (int zoom = 0; zoom < zooms; zoom++) {
        lane most = (lane){0} - INFINITY, place = (lane){0} + *centre;
        for (int k = 0; k < p->around; k += LANES) {
            const int from = k + LANES < p->around ? k : p->around - LANES;   /* some twice, but none beyond */
            const lane phase = *centre + width * *(const loose *)(p->parts + from);
            const lane found = sign * value(p, at, quantity, phase);
            const mask better = found > most;
            most = chosen(better, found, most), place = chosen(better, phase, place);
        }
        highest = most[0], *centre = place[0];
        for (int l = 1; l < LANES; l++)                          /* of values alike that at the first phase */
            if (most[l] > highest || (most[l] == highest && place[l] < *centre)) highest = most[l], *centre = place[l];
        width /= 16;
    }
    return highest;
}

/* Up to where sign times a quantity may rise next to a sample that is no less than its neighbours: twice as far above
   it as the parabola through the three; -INFINITY next to others. */
static inline double reach(const double *sample, double sign) {
    const double here = sign * sample[0], before = sign * sample[-1], after = sign * sample[1];
    if (!(here >= before && here >= after)) return -INFINITY;
    const double bend = 2.0 * here - before - after;
    return bend > 0.0 ? here + (before - after) * (before - after) / (4.0 * bend) : here;
}

/* The largest maximum of sign times a quantity, from its samples and the places of `count` that may be next to one, and
   its phase: that next to the largest sample, of several the first, unless one next to a lower sample is higher. */
static double outermost(const problem *p, const point *at, int quantity, double sign, const double *samples,
                        const long *places, long count, double *phase) {
    const double width = p->period / (p->steps * p->samples);
    long first = 0;
    for (long k = 0; k < count; k++)
        if (sign * samples[places[k]] > sign * samples[first]) first = places[k];
    const double least = p->tie * fabs(samples[first]), alike = sign * samples[first] - least;
    for (long k = 0; k < count && places[k] < first; k++)
        if (sign * samples[places[k]] >= alike && isfinite(reach(samples + places[k], sign))) first = places[k];
    *phase = first * width;
    double highest = extreme(p, at, quantity, sign, p->zooms, phase);
    for (long k = 0; k < count; k++) {
        if (places[k] == first || !(reach(samples + places[k], sign) > highest)) continue;
        double near = places[k] * width;
        if (!(extreme(p, at, quantity, sign, p->rough, &near) > highest + least)) continue;
        const double found = extreme(p, at, quantity, sign, p->zooms, &near);
        if (found > highest + least) highest = found, *phase = near;
    }
    return highest;
}

/* Powers of theta at the samples of a step, and their derivatives by time. */
static void tabulate(const problem *p, const point *at, const space *s) {
    const double rate = p->steps / p->period * at->speed[0];
    for (long j = 0; j < p->samples; j++)
        for (int order = 0; order < ORDERS; order++) {
            double power = order == 2 ? 2.0 * rate * rate : order ? rate : 1.0;
            for (int d = order; d < D; d++) {
                s->powers[(order * D + d) * s->wide + j] = power;
                power *= (double)j / p->samples * (d + 1) / (d + 1 - order);
            }
        }
}

/* All rows, and behind the last sample of each the first one again, and before the first the last. */
static void sample(const problem *p, const point *at, const space *s) {
    const long count = p->steps * p->samples;
    for (int row = 0; row < ORDERS * N; row++)
        at_samples(at->curves + row % N * p->steps * D, D, p->steps, p->samples, s->powers + row / N * D * s->wide,
                   s->wide, s->rows + row * s->length);
    if (OUTPUTS)
        for (long k = 0; k < count; k += LANES) {
            lane phase, x[3 * N], y[OUTPUTS + 1];
            for (int l = 0; l < LANES; l++) phase[l] = (k + l) * (p->period / count);
            for (int row = 0; row < 3 * N; row++) x[row] = *(const loose *)(s->rows + row * s->length + k);
            evaluate(at, phase, x, y);
            for (int i = 0; i < OUTPUTS; i++) *(loose *)(s->rows + (3 * N + i) * s->length + k) = y[i];
        }
    for (double *row = s->rows; row < s->rows + ROWS * s->length; row += s->length)
        row[-1] = row[count - 1], row[count] = row[0];
}

/* The places of samples that are no less than both their neighbours, or no more; how many. */
static long turning(const double *samples, long count, long *places) {
    long found = 0;
    for (long k = 0; k < count; k += LANES) {
        const lane here = *(const loose *)(samples + k);
        const lane before = *(const loose *)(samples + k - 1), after = *(const loose *)(samples + k + 1);
        const mask turns = ((here >= before) & (here >= after)) | ((here <= before) & (here <= after));
        if (!any(turns)) continue;
        for (int l = 0; l < LANES && k + l < count; l++)
            if (turns[l]) places[found++] = k + l;
    }
    return found;
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
    const long count = p->steps * p->samples, wide = p->samples + LANES, length = count + 2 * LANES;
    /* Zeros, as lanes that reach beyond the samples are evaluated too, and dropped. */
    double *powers = calloc(ORDERS * D * wide + ROWS * length + count, sizeof(double));
    if (!powers) return 1;
    double *rows = powers + ORDERS * D * wide + LANES;
    const space s = {wide, length, powers, rows, (long *)(rows + ROWS * length - LANES)};
    for (long k = 0; k < p->points; k++) {
        const lane none = {0};
        point at = {.curves = p->curves + k * N * p->steps * D, .speed = none + p->speeds[k]};
        for (int i = 0; i < PARAMETERS; i++) at.parameters[i] = none + p->parameters[k * PARAMETERS + i];
        tabulate(p, &at, &s);
        sample(p, &at, &s);
        for (int w = 0; w < p->wanted; w++) {
            const int quantity = p->quantity[w];
            const double *own = rows + (quantity < N ? quantity : (ORDERS - 1) * N + quantity) * length;
            const long turns = turning(own, count, s.turning);
            double sum, square, most_at, least_at;
            const double most = outermost(p, &at, quantity, 1.0, own, s.turning, turns, &most_at);
            const double least = outermost(p, &at, quantity, -1.0, own, s.turning, turns, &least_at);
            total(own, count, &sum, &square);
            const lane phase = turned(p, (lane){most_at, least_at});
            const double made[FIGURES] = {
                most, -least, most > least ? most : least, sum / count, phase[0], phase[1], sqrt(square / count),
            };
            memcpy(p->figures + (k * p->wanted + w) * FIGURES, made, sizeof(made));
        }
    }
    free(powers);
    return 0;
}
