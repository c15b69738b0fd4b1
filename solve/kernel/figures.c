/* Figures over one turn of curves and of formulas of these, for many points at once, LANES of them side by side.

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

/* What the points of a group have: the steps that their curves are loaded of, and numbers. */
typedef struct {
    long at[LANES], step[LANES];
    lane c[N * D], speed, parameters[PARAMETERS + 1];
} group;

static void load(const problem *p, group *g, const long *step) {
    for (int l = 0; l < LANES; l++) {
        if (g->step[l] == step[l]) continue;
        g->step[l] = step[l];
        for (int i = 0; i < N; i++) {
            const double *from = p->curves + ((g->at[l] * N + i) * p->steps + step[l]) * D;
            for (int d = 0; d < D; d++) g->c[i * D + d][l] = from[d];
        }
    }
}

/* q, and where formulas need them q' and q'' by time, at theta of the steps that are loaded. */
static void states(const problem *p, const group *g, lane theta, lane *x) {
    const double rate = p->steps / p->period;
    for (int i = 0; i < N; i++) {
        const lane *c = g->c + i * D;
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
            x[N + i] = rate * g->speed * v;
            x[2 * N + i] = 2.0 * rate * rate * g->speed * g->speed * a;
        }
    }
}

static void evaluate(const group *g, lane phase, const lane *x, lane *y) {
#ifdef FORMULAS
    const lane *const in[] = {&phase, &g->speed, x, x + N, x + 2 * N, g->parameters};
    formulas(in, y);
#endif
}

/* A phase within the first turn. */
static inline double turned(const problem *p, double phase) {
    if (phase >= 0.0 && phase < p->period) return phase;
    const double within = fmod(phase, p->period);
    return within < 0.0 ? within + p->period : within;
}

/* A quantity at phases of any turn, one for each point. */
static lane value(const problem *p, group *g, int quantity, lane phase) {
    lane x[3 * N], y[OUTPUTS + 1], theta;
    long step[LANES];
    for (int l = 0; l < LANES; l++) {
        const double place = turned(p, phase[l]) * (p->steps / p->period);
        step[l] = (long)place < p->steps ? (long)place : p->steps - 1;
        theta[l] = place - step[l];
    }
    load(p, g, step);
    states(p, g, theta, x);
    if (quantity < N) return x[quantity];
    evaluate(g, phase, x, y);
    return y[quantity - N];
}

/* The largest maximum of sign times a quantity next to a sample, and its phase. */
static void extreme(const problem *p, group *g, int quantity, double sign, lane *centre, lane *highest) {
    double width = p->period / (p->steps * p->samples);
    for (int zoom = 0; zoom < p->zooms; zoom++) {
        const lane middle = *centre;
        for (int k = 0; k < p->around; k++) {
            const lane phase = middle + width * p->parts[k];
            const lane found = sign * value(p, g, quantity, phase);
            const mask better = k ? found > *highest : found == found;
            *highest = k ? chosen(better, found, *highest) : found;
            *centre = chosen(better, phase, *centre);
        }
        width /= 16;
    }
}

/* Figures of a group's points, room for `wanted` of each: sums, squares, extrema and where they are. */
static void figures(const problem *p, group *g, lane *room) {
    const int W = p->wanted;
    const double width = p->period / (p->steps * p->samples);
    lane *sum = room, *square = sum + W, *high = square + W, *low = high + W, *high_at = low + W, *low_at = high_at + W;
    lane x[3 * N], y[OUTPUTS + 1];
    const lane none = {0};
    memset(room, 0, 6 * W * sizeof(lane));
    for (long k = 0; k < p->steps; k++) {
        long step[LANES];
        for (int l = 0; l < LANES; l++) step[l] = k;
        load(p, g, step);
        for (long j = 0; j < p->samples; j++) {
            const lane phase = none + (k * p->samples + j) * width;
            states(p, g, none + (double)j / p->samples, x);
            evaluate(g, phase, x, y);
            for (int w = 0; w < W; w++) {
                const lane found = p->quantity[w] < N ? x[p->quantity[w]] : y[p->quantity[w] - N];
                const mask first = none == (k + j ? 1.0 : 0.0), higher = (found > high[w]) | first, lower = (found < low[w]) | first;
                sum[w] += found;
                square[w] += found * found;
                high[w] = chosen(higher, found, high[w]);
                low[w] = chosen(lower, found, low[w]);
                high_at[w] = chosen(higher, phase, high_at[w]);
                low_at[w] = chosen(lower, phase, low_at[w]);
            }
        }
    }
    for (int w = 0; w < W; w++) {
        extreme(p, g, p->quantity[w], 1.0, high_at + w, high + w);
        extreme(p, g, p->quantity[w], -1.0, low_at + w, low + w);
    }
}

/* All the points; 1 where memory is missing, else 0. */
int turn(const problem *p) {
    const int W = p->wanted;
    const double count = (double)p->steps * p->samples;
    lane *room = aligned_alloc(sizeof(lane), (6 * W + 1) * sizeof(lane));
    if (!room) return 1;
    for (long start = 0; start < p->points; start += LANES) {
        group g;
        for (int l = 0; l < LANES; l++) {
            g.at[l] = start + l < p->points ? start + l : p->points - 1;
            g.step[l] = -1;
            g.speed[l] = p->speeds[g.at[l]];
            for (int k = 0; k < PARAMETERS; k++) g.parameters[k][l] = p->parameters[g.at[l] * PARAMETERS + k];
        }
        figures(p, &g, room);
        for (int l = 0; l < LANES && start + l < p->points; l++)
            for (int w = 0; w < W; w++) {
                const double high = room[2 * W + w][l], low = room[3 * W + w][l];
                const double made[FIGURES] = {
                    high, -low, high > low ? high : low, room[w][l] / count,
                    turned(p, room[4 * W + w][l]), turned(p, room[5 * W + w][l]),
                    sqrt(room[W + w][l] / count),
                };
                memcpy(p->figures + ((start + l) * W + w) * FIGURES, made, sizeof(made));
            }
    }
    free(room);
    return 0;
}
