/* Statistics over one period of curves, and of formulas along the curves, for many points. LANES phases of one point are
   evaluated at a time.

   The mathematics is that of period/signals.py. FORMULAS: file with `void formulas(const lane *const *in,
   lane *out)`, whose inputs are phase, speed, q, q', q'' (time derivatives) and parameters; none for curves only. N:
   number of coordinates. D: number of powers of theta per step. OUTPUTS: number of formulas. PARAMETERS: number of
   their parameters. */

#include "lane.h"
#include "samples.h"

#define FIGURES 7
#define ORDERS (OUTPUTS ? 3 : 1)   /* q only, or q, q' and q'' if there are formulas */
#define ROWS (ORDERS * N + OUTPUTS)

#ifdef FORMULAS
#include FORMULAS
#endif

typedef struct {
    long points, steps, samples;   /* samples: per step */
    int wanted, zooms, rough, around;  /* numbers of: quantities; refinements of an extremum; refinements of a
                                       candidate; phases per refinement */
    double period, tie;            /* tie: relative difference above which extrema are distinct */
    const int *quantity;           /* (wanted): indices; coordinates first, then formulas */
    const double *curves;          /* (points, N, steps, D), lowest power first */
    const double *speeds;          /* (points) */
    const double *parameters;      /* (points, PARAMETERS) */
    const double *parts;           /* (around), ascending from -1 to 1; at least LANES */
    double *figures;               /* (points, wanted, FIGURES): max, min, max_abs, mean, max_phase, min_phase, rms */
} problem;

/* Data of one point: its curves, starting with the first step, speed and parameters. */
typedef struct {
    const double *curves;
    lane speed, parameters[PARAMETERS + 1];
} point;

/* Storage of the samples of a point: one row per coordinate, then rows of q' and q'' (time derivatives) if formulas
   require them, then rows of the formulas. Before and after each row there is space for LANES more values. */
typedef struct {
    long wide, length;             /* lengths of the samples of a step and of a period, with the additional space */
    double *powers;                /* (ORDERS, D, wide): powers of theta at the samples of a step, and their time derivatives */
    double *rows;                  /* (ROWS, length), starting with the first sample */
    long *turning;                 /* (samples): indices in a row */
} space;

static void evaluate(const point *at, lane phase, const lane *x, lane *y) {
#ifdef FORMULAS
    const lane *const in[] = {&phase, &at->speed, x, x + N, x + 2 * N, at->parameters};
    formulas(in, y);
#endif
}

/* Move phases that are less than one period outside the first period into this period. */
static inline lane turned(const problem *p, lane phase) {
    return phase + where(phase < 0.0, (lane){0} + p->period) - where(phase >= p->period, (lane){0} + p->period);
}

/* Values of a quantity at phases within one period of the first period. */
static lane value(const problem *p, const point *at, int quantity, lane phase) {
    lane c[N * D], x[3 * N], y[OUTPUTS + 1];
    const int first = quantity < N ? quantity : 0, last = quantity < N ? quantity + 1 : N;
    const double rate = p->steps / p->period;
    const lane place = turned(p, phase) * rate, speed = rate * at->speed;
    const long most = p->steps - 1, step = (long)place[0] < most ? (long)place[0] : most;
    lane theta = place - (double)step;
    for (int i = first; i < last; i++)
        for (int d = 0; d < D; d++) c[i * D + d] = (lane){0} + at->curves[(i * p->steps + step) * D + d];
    if (any((theta < 0.0) | (theta >= 1.0)))                     /* some lanes are not in the step of the first lane */
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

/* Highest maximum of sign times a quantity near a sample, and its phase. */
static double extreme(const problem *p, const point *at, int quantity, double sign, int zooms, double *centre) {
    double width = p->period / (p->steps * p->samples), highest = 0.0;
    for (int zoom = 0; zoom < zooms; zoom++) {
        lane most = (lane){0} - INFINITY, place = (lane){0} + *centre;
        for (int k = 0; k < p->around; k += LANES) {
            const int from = k + LANES < p->around ? k : p->around - LANES;   /* some values are computed twice, none beyond the end */
            const lane phase = *centre + width * *(const loose *)(p->parts + from);
            const lane found = sign * value(p, at, quantity, phase);
            const mask better = found > most;
            most = chosen(better, found, most), place = chosen(better, phase, place);
        }
        highest = most[0], *centre = place[0];
        for (int l = 1; l < LANES; l++)                          /* of equal values, the one at the first phase */
            if (most[l] > highest || (most[l] == highest && place[l] < *centre)) highest = most[l], *centre = place[l];
        width /= 16;
    }
    return highest;
}

/* Upper bound on sign times a quantity near a sample that is a local maximum; -INFINITY near other samples. The bound
   exceeds the sample by twice as much as the maximum of the parabola through the sample and its neighbours. */
static inline double reach(const double *sample, double sign) {
    const double here = sign * sample[0], before = sign * sample[-1], after = sign * sample[1];
    if (!(here >= before && here >= after)) return -INFINITY;
    const double bend = 2.0 * here - before - after;
    return bend > 0.0 ? here + (before - after) * (before - after) / (4.0 * bend) : here;
}

/* Highest maximum of sign times a quantity, and its phase, from the samples and the indices of `count` candidates. It is
   the maximum near the largest sample (the first of several equal ones), unless one near a lower sample is higher. */
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

/* Powers of theta at the samples of a step, and their time derivatives. */
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

/* Compute all rows. After the last sample of a row, the first one is repeated, and before the first one, the last. */
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

/* Indices of the samples that are local maxima or minima. Returns their number. */
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

/* Sum of the values, and sum of their squares. */
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

/* Compute all points. Returns 1 if memory is insufficient, otherwise 0. */
int turn(const problem *p) {
    const long count = p->steps * p->samples, wide = p->samples + LANES, length = count + 2 * LANES;
    /* Initialised to zero, because lanes beyond the samples are also evaluated; their results are not used. */
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
