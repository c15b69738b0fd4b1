/* Closed chains of affine maps, x_{k+1} = A_k x_k + b_k, x_m = x_0, solved by structured orthogonal elimination
   (S. J. Wright, SIAM J. Sci. Stat. Comput. 13 (1992) 742-764), LANES chains at a time. The constants are explained in
   period/period_map.py.

   NX: number of states. A map is (NX, W); column NX is its load. */

#define BLOCKS 32                  /* number of blocks at which multiplication ends and orthogonal elimination begins */
#define ROW (2 * NX + 1)           /* columns of a row of the chain: two states and a right-hand side */
#define CYCLIC (3 * NX + 1)        /* the same with a state between them, which is eliminated */
#define STRIP (NX % 2 ? 3 : 6)     /* columns that are reflected in one loop; a divisor of 3 NX */
#define BALANCING 50               /* largest number of balancing sweeps */
#define UNLIKE 2.0                 /* log2 of the ratio of squared row and column norms above which to balance */
#define APART 1e-3                 /* ratio of the terms of two states below which units are changed */
#define EPS 2.220446049250313e-16
#define RESTS (512.0 * EPS)        /* largest ratio of a state that counts as zero to its terms, over the growth of round-off */
#define REGULAR 1e13               /* upper limit of the condition number of regular chains */
#define LEFT 1e-12                 /* relative residual above which the nodes have different units */
#define SINGULAR 1e14              /* condition number above which a chain is singular */
#define AGAIN 3                    /* largest number of repeated solutions */
#define SMALLEST -100              /* smallest log2 of the ratio between the units of two nodes per repetition */

#include "singular.h"

/* Householder reflections of rows (count, CYCLIC) that make the first NX columns triangular. The other columns are
   transformed in strips, which may contain columns for which this is not necessary. */
static void reflect(lane *z, int count) {
    for (int k = 0; k < NX; k++) {
        lane v[2 * NX], square = {0};
        for (int i = k; i < count; i++) {
            v[i] = z[i * CYCLIC + k];
            square += v[i] * v[i];
        }
        const lane head = v[k], norm = root(square);
        const mask negative = head < 0.0;
        const lane diagonal = (lane)((mask)norm ^ (((mask)(-norm) ^ (mask)norm) & ~negative));
        v[k] = head - diagonal;                                  /* no cancellation */
        const lane product = norm * absolute(v[k]);              /* half of |v|^2 */
        const mask nothing = product == 0.0;
        const lane factor = (lane)((mask)(1.0 / product) & ~nothing);
        for (int j = 1 + k / STRIP * STRIP; j < CYCLIC; j += STRIP) {
            lane dot[STRIP] = {0};
            for (int i = k; i < count; i++)
                for (int m = 0; m < STRIP; m++) dot[m] += v[i] * z[i * CYCLIC + j + m];
            for (int m = 0; m < STRIP; m++) dot[m] *= factor;
            for (int i = k; i < count; i++)
                for (int m = 0; m < STRIP; m++) z[i * CYCLIC + j + m] -= dot[m] * v[i];
        }
        z[k * CYCLIC + k] = diagonal;
    }
}

/* Join two rows G x_a + H x_b = r and G' x_b + H' x_c = r' by eliminating x_b. The first half of z (2 NX, CYCLIC) then
   determines x_b from x_a and x_c; `to` is a row for x_a and x_c. Rows are G | H | r, (NX, ROW). */
static void join(const lane *first, const lane *second, lane *z, lane *to) {
    for (int i = 0; i < NX; i++) {
        lane *top = z + i * CYCLIC, *bottom = z + (NX + i) * CYCLIC;
        for (int j = 0; j < NX; j++) {
            top[j] = first[i * ROW + NX + j];
            top[NX + j] = first[i * ROW + j];
            top[2 * NX + j] = bottom[NX + j] = (lane){0};
            bottom[j] = second[i * ROW + j];
            bottom[2 * NX + j] = second[i * ROW + NX + j];
        }
        top[3 * NX] = first[i * ROW + 2 * NX];
        bottom[3 * NX] = second[i * ROW + 2 * NX];
    }
    reflect(z, 2 * NX);
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < ROW; j++) to[i * ROW + j] = z[(NX + i) * CYCLIC + NX + j];
}

/* The following code takes little time to run but long to compile. Therefore, it is optimised less. */
#pragma GCC push_options
#pragma GCC optimize("O2")

/* State between two other states, from the rows that `join` has stored. */
static void between(const lane *saved, const lane *before, const lane *after, lane *x) {
    for (int i = NX - 1; i >= 0; i--) {
        const lane *row = saved + i * CYCLIC;
        lane s = row[3 * NX];
        for (int j = 0; j < NX; j++) s -= row[NX + j] * before[j] + row[2 * NX + j] * after[j];
        for (int j = i + 1; j < NX; j++) s -= row[j] * x[j];
        x[i] = s / row[i];
    }
}

/* State of a closed chain with one row, (G + H) x = r. Returns the condition number of G + H relative to (G, H). */
static lane close_row(const lane *row, lane *z, lane *x) {
    static const lane none[NX];
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) {
            z[i * NX + j] = row[i * ROW + j];
            z[(NX + i) * NX + j] = row[i * ROW + NX + j];
        }
    const lane most = singular_value(z, 2 * NX, 1);
    memset(z, 0, NX * CYCLIC * sizeof(lane));
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++) z[i * CYCLIC + j] = row[i * ROW + j] + row[i * ROW + NX + j];
        z[i * CYCLIC + 3 * NX] = row[i * ROW + 2 * NX];
    }
    reflect(z, NX);
    between(z, none, none, x);
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) z[i * NX + j] = j < i ? none[0] : z[i * CYCLIC + j];
    return most / singular_value(z, NX, 0);
}

/* Powers of 2 by which columns are multiplied and rows divided so that their norms are similar (`balance_matrices` of
   period/eigenvalues.py). */
static void scale_alike(double size[NX][NX], double *unit) {
    double power[NX] = {0.0}, ratio[NX], inverse[NX];
    for (int i = 0; i < NX; i++) unit[i] = inverse[i] = 1.0;
    for (int sweep = 0; sweep < BALANCING; sweep++) {
        double most = 0.0;
        for (int i = 0; i < NX; i++) {
            double row = 0.0, column = 0.0;
            for (int j = 0; j < NX; j++) {
                const double x = size[i][j] * (unit[j] * inverse[i]), y = size[j][i] * (unit[i] * inverse[j]);
                row += x * x, column += y * y;
            }
            ratio[i] = log2(row / column);
            if (!isfinite(ratio[i])) ratio[i] = 0.0;
            most = fmax(most, fabs(ratio[i]));
        }
        if (!(most > UNLIKE)) break;
        for (int i = 0; i < NX; i++) {
            power[i] += ratio[i] / 8.0;
            unit[i] = exp2(power[i]);
            inverse[i] = 1.0 / unit[i];
        }
    }
    for (int i = 0; i < NX; i++) unit[i] = exp2(rint(power[i]));
}

/* Units (NX) of the states, powers of 2, in which the maps of the blocks are balanced. They differ between lanes, or are
   common to all lanes if these are segments of one chain. */
static void balance(int common, long blocks, const lane *maps, lane *unit) {
    lane total = {0}, part[NX][NX];
    double size[NX][NX], own[NX];
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) {
            part[i][j] = (lane){0};
            for (long k = 0; k < blocks; k++) part[i][j] += absolute(maps[(k * NX + i) * W + j]);
            total += part[i][j];
        }
    for (int l = 0; l < LANES; l++) {
        for (int i = 0; i < NX; i++)
            for (int j = 0; j < NX; j++) {
                size[i][j] = 0.0;
                for (int m = common ? 0 : l; m < (common ? LANES : l + 1); m++)
                    size[i][j] += total[m] > 0.0 ? part[i][j][m] / total[m] : 0.0;
            }
        scale_alike(size, own);
        for (int i = 0; i < NX; i++) unit[i][l] = own[i];
    }
}

/* Largest power of 2 that does not exceed a number, in each lane. */
static lane power_of(lane x) {
    lane r;
    for (int l = 0; l < LANES; l++) r[l] = isfinite(x[l]) && x[l] > 0.0 ? ldexp(1.0, ilogb(x[l])) : 1.0;
    return r;
}

/* Rows G x_k + H x_{k+1} = r of the blocks, in units of the states and of the nodes, from their affine maps. level:
   whether the rows of a block are scaled to entries of at most about 1, because units of the nodes may make them large. */
static void rows_of(long blocks, const lane *maps, const lane *unit, const lane *node, int level, lane *rows) {
    for (long k = 0; k < blocks; k++) {
        lane *block = rows + k * NX * ROW, most = (lane){0} + 1.0;
        for (int i = 0; i < NX; i++) {
            const lane ahead = unit[i] * node[k + 1];
            for (int j = 0; j < NX; j++) {
                block[i * ROW + j] = maps[(k * NX + i) * W + j] * (unit[j] * node[k] / ahead);
                block[i * ROW + NX + j] = (lane){0};
                most = larger(most, absolute(block[i * ROW + j]));
            }
            block[i * ROW + NX + i] -= 1.0;
            block[i * ROW + 2 * NX] = -maps[(k * NX + i) * W + NX] / ahead;
        }
        const lane inverse = 1.0 / power_of(most);
        for (int i = 0; level && i < NX * ROW; i++) block[i] *= inverse;
    }
}

/* Join neighbouring rows until one remains: a row for the first and the last state. */
static void reduce(long count, lane *rows, lane *saved) {
    for (; count > 1; count = (count + 1) / 2) {
        for (long k = 0; k + 1 < count; k += 2) {
            join(rows + k * NX * ROW, rows + (k + 1) * NX * ROW, saved, rows + k / 2 * NX * ROW);
            saved += NX * CYCLIC;                                /* only half of z is kept; the next join overwrites the other half */
        }
        if (count % 2) memcpy(rows + count / 2 * NX * ROW, rows + (count - 1) * NX * ROW, NX * ROW * sizeof(lane));
    }
}

/* States between the first and the last one, which `reduce` has eliminated. */
static void expand(long count, const lane *saved, lane *x, const lane *end) {
    if (count < 2) return;
    const long pairs = count / 2, starts = (count + 1) / 2;
    expand(starts, saved + pairs * NX * CYCLIC, x, end);
    for (long k = starts - 1; k > 0; k--) memcpy(x + 2 * k * NX, x + k * NX, NX * sizeof(lane));
    for (long k = 0; k < pairs; k++)
        between(saved + k * NX * CYCLIC, x + 2 * k * NX, 2 * k + 2 < count ? x + (2 * k + 2) * NX : end, x + (2 * k + 1) * NX);
}

/* Largest value over all lanes, in every lane. */
static lane shared(lane x) {
    double most = x[0];
    for (int l = 1; l < LANES; l++) most = fmax(most, x[l]);
    return (lane){0} + most;
}

/* Largest sum `acting` of the moduli of the terms of each state x (blocks, NX), and largest modulus `size` of the state,
   over the blocks and in the units. They are separate for each lane, or common to all lanes. `after`: states after the
   last block. Returns the largest residual at a node, relative to its terms. */
static lane acting_on(int common, long blocks, const lane *maps, const lane *x, const lane *after, const lane *unit, lane *acting,
                      lane *size) {
    lane left = {0};
    for (int i = 0; i < NX; i++) size[i] = acting[i] = (lane){0};
    for (long k = 0; k < blocks; k++) {
        const lane *to = k + 1 < blocks ? x + (k + 1) * NX : after;
        lane most = {0}, over = {0};
        for (int i = 0; i < NX; i++) {
            const lane *map = maps + (k * NX + i) * W;
            lane sum = absolute(map[NX]), rest = map[NX] - to[i];
            for (int j = 0; j < NX; j++) sum += absolute(map[j] * x[k * NX + j]), rest += map[j] * x[k * NX + j];
            size[i] = larger(size[i], absolute(x[k * NX + i]) / unit[i]);
            acting[i] = larger(acting[i], sum / unit[i]);
            most = larger(most, sum / unit[i]), over = larger(over, absolute(rest) / unit[i]);
        }
        left = larger(left, where(most > 0.0, over / most));
    }
    if (common) {
        left = shared(left);
        for (int i = 0; i < NX; i++) acting[i] = shared(acting[i]), size[i] = shared(size[i]);
    }
    return left;
}

/* Change the units (blocks + 1) of the nodes, in the lanes `open`, so that the states x (blocks, NX) have similar sizes at
   all nodes. `after`: states after the last block. */
static void alike(int common, long blocks, const lane *x, const lane *after, const lane *unit, mask open, lane *node) {
    lane size[BLOCKS + 1], most = {0};
    for (long k = 0; k <= blocks; k++) {
        const lane *state = k < blocks ? x + k * NX : after;
        size[k] = (lane){0};
        for (int i = 0; i < NX; i++) size[k] = larger(size[k], absolute(state[i]) / (unit[i] * node[k]));
        most = larger(most, size[k]);
    }
    if (common) most = shared(most);
    for (long k = 0; k <= blocks; k++)
        for (int l = 0; l < LANES; l++)
            if (open[l]) node[k][l] *= ldexp(1.0, (int)fmax(logb(size[k][l]) - logb(most[l]), SMALLEST));
}

/* If the terms of some states are far smaller than those of others, change the units by powers of 2 so that all terms
   have the same size; elimination would mix them. Returns 1 if any unit changes. */
static int resize(const lane *acting, lane *unit) {
    int changed = 0;
    for (int l = 0; l < LANES; l++) {
        double most = 0.0, least = INFINITY;
        for (int i = 0; i < NX; i++) {
            most = fmax(most, acting[i][l]);
            if (acting[i][l] > 0.0) least = fmin(least, acting[i][l]);
        }
        if (!(isfinite(most) && least < APART * most)) continue;
        changed = 1;
        for (int i = 0; i < NX; i++)
            if (acting[i][l] > 0.0) unit[i][l] *= ldexp(1.0, ilogb(acting[i][l]) - ilogb(most));
    }
    return changed;
}

/* Condition number of the states of a chain with `steps` steps. `first`: condition number of the chain in units of the
   states. `condition`: condition number in units that also differ between the nodes. The result is larger if the residual
   `left` is large and, if `sized`, if the terms of a state cancel. States that are round-off of their terms are excluded, also
   in the `balanced` units, in which the round-off of all states is similar. The result is limited so that a chain that is
   regular in the first units does not count as singular. `acting` and `size` are in the units `unit`. */
static lane of_states(lane first, lane condition, long steps, const lane *acting, const lane *size, const lane *unit,
                      const lane *balanced, lane left, int sized) {
    const double growth = fmax(8.0, steps / 16.0);
    const lane rounding = EPS * growth + (lane){0}, regular = (lane){0} + REGULAR;
    condition = chosen(first < SINGULAR, -larger(-regular, -condition), condition);
    lane most = {0}, most_balanced = {0}, cancels = (lane){0} + 1.0;
    for (int i = 0; i < NX; i++) {
        most = larger(most, acting[i]);
        most_balanced = larger(most_balanced, acting[i] * unit[i] / balanced[i]);
    }
    const lane rests = -larger(-8.0 * rounding * condition, (lane){0} - RESTS * growth);
    const lane balanced_rests = -larger(-rests, (lane){0} - RESTS) * most_balanced;
    for (int i = 0; sized && i < NX; i++) {
        const mask moves = (size[i] > rests * most) & (size[i] * unit[i] / balanced[i] > balanced_rests);
        cancels = larger(cancels, (lane)((mask)(acting[i] / size[i]) & moves));
    }
    const lane lost = -larger(-left / rounding, -regular);
    return larger(lost, -larger(-larger(condition, regular), -condition * cancels));     /* NaN is preserved */
}

/* Solution of a closed chain, and its residual relative to the terms. */
typedef struct {
    lane x[(BLOCKS + 1) * NX], condition, left, first;
} closing;

/* Keep a solution in the lanes in which its residual is smaller than before, or the chain was singular before. Returns the
   lanes in which the chain must be solved again. */
static mask keep(closing *kept, int again, long states, const lane *x, lane condition, lane left) {
    mask better = ~(mask){0};
    if (again) better = (left < kept->left) | ~(kept->condition < SINGULAR);
    for (long i = 0; i < states; i++) kept->x[i] = chosen(better, x[i], kept->x[i]);
    kept->condition = chosen(better, condition, kept->condition);
    kept->left = chosen(better, left, kept->left);
    if (!again) kept->first = condition;
    return (kept->left > LEFT) | (kept->condition > SINGULAR);
}

/* States x (blocks, NX) at the starts of the blocks of a closed chain with `steps` steps. Returns their condition number.
   sized: whether the sizes of the states are considered. */
static lane close_chain(long steps, long blocks, const lane *maps, lane *saved, lane *rows, lane *z, lane *x, int sized) {
    lane unit[NX], balanced[NX], node[BLOCKS + 1], acting[NX], size[NX], condition, left;
    closing kept;
    balance(0, blocks, maps, unit);
    memcpy(balanced, unit, sizeof unit);
    for (long k = 0; k <= blocks; k++) node[k] = (lane){0} + 1.0;
    int again = 0;
    for (int resized = !sized;;) {
        rows_of(blocks, maps, unit, node, again, rows);
        reduce(blocks, rows, saved);
        condition = close_row(rows, z, x);
        expand(blocks, saved, x, x);
        for (long k = 0; k < blocks; k++)
            for (int i = 0; i < NX; i++) x[k * NX + i] *= unit[i] * node[k];
        left = acting_on(0, blocks, maps, x, x, unit, acting, size);
        if (!resized++ && resize(acting, unit)) continue;
        const mask open = keep(&kept, again, blocks * NX, x, condition, left);
        if (again++ == AGAIN || !any(open)) break;
        alike(0, blocks, kept.x, kept.x, unit, open, node);
    }
    if (again > 1) {
        memcpy(x, kept.x, blocks * NX * sizeof(lane));
        acting_on(0, blocks, maps, x, x, unit, acting, size);
    }
    return of_states(kept.first, kept.condition, steps, acting, size, unit, balanced, kept.left, sized);
}

/* The same if the lanes are segments of one chain: each lane is followed by the next one, and the last by the first. */
static lane close_segments(long steps, long blocks, const lane *maps, lane *saved, lane *rows, lane *z, lane *x) {
    static const lane none = {0};
    lane unit[NX], balanced[NX], node[BLOCKS + 1], acting[NX], size[NX], condition, left;
    lane *whole = rows + blocks * NX * ROW, *kept_rows = saved + blocks * NX * CYCLIC;
    lane starts[LANES * NX], *ends = x + blocks * NX;
    closing kept;
    balance(1, blocks, maps, unit);
    memcpy(balanced, unit, sizeof unit);
    for (long k = 0; k <= blocks; k++) node[k] = none + 1.0;
    int again = 0;
    for (int resized = 0;;) {
        rows_of(blocks, maps, unit, node, again, rows);
        reduce(blocks, rows, saved);
        for (int l = 0; l < LANES; l++)
            for (int i = 0; i < NX * ROW; i++) whole[l * NX * ROW + i] = none + rows[i][l];
        reduce(LANES, whole, kept_rows);
        condition = close_row(whole, z, starts);
        expand(LANES, kept_rows, starts, starts);
        for (int i = 0; i < NX; i++)
            for (int l = 0; l < LANES; l++) {
                x[i][l] = starts[l * NX + i][0];
                ends[i][l] = starts[(l + 1) % LANES * NX + i][0];
            }
        expand(blocks, saved, x, ends);
        for (long k = 0; k <= blocks; k++)
            for (int i = 0; i < NX; i++) x[k * NX + i] *= unit[i] * node[k];
        left = acting_on(1, blocks, maps, x, ends, unit, acting, size);
        if (!resized++ && resize(acting, unit)) continue;
        const mask open = keep(&kept, again, (blocks + 1) * NX, x, condition, left);
        if (again++ == AGAIN || !any(open)) break;
        alike(1, blocks, kept.x, kept.x + blocks * NX, unit, open, node);
    }
    if (again > 1) {
        memcpy(x, kept.x, (blocks + 1) * NX * sizeof(lane));
        acting_on(1, blocks, maps, x, ends, unit, acting, size);
    }
    return of_states(kept.first, kept.condition, LANES * steps, acting, size, unit, balanced, kept.left, 1);
}

#pragma GCC pop_options
