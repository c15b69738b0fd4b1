/* Collocation over one period for many points. The lanes of a vector register contain LANES points.

   Compiled for one size: N coordinates, of which the first P are of second order; S stages; NODES accelerations that
   define the curve of a step; STIFF if the end of a step is a stage; ORBIT if the periodic solution is computed in
   addition to its stability. The mathematics is that of methods/collocation.py and period/period_map.py. The last index
   of every array of a group of points is the lane. */

#include "lane.h"
#include "rows.h"
#include "stage.h"

#define LANE 1
#define SEGMENT 2
#define W (NX + ORBIT)             /* columns of an affine map: one per state, and one for the load */
#define COLS (ROWS + W)
#define ENTRIES (3 * N * N + N)
#define D (2 + NODES)              /* number of powers of theta per step */
#define PANEL 4                    /* number of columns eliminated before the other columns are updated */
#define TILE (W % 6 == 1 ? 7 : 6)  /* columns of a product that are summed in one loop; no single column remains */
#define EXCESS 32.0                /* elimination factor above which rows are exchanged */

#include "chain.h"

typedef struct {
    long groups, steps;
    int jumps;                     /* whether the matrices jump at ends of steps */
    int terms;                     /* R */
    int own;                       /* SEGMENT or LANE if each lane has its own table; in this case without coefficients */
    const int *entry;              /* (R), ascending: index of the entry of each term */
    const double *stages;          /* (steps S, R), LANE: (groups, steps S, R, LANES), SEGMENT: (LANES steps S, R) */
    const double *nodes;           /* the same for the starts of the steps or, with jumps, for their starts and
                                      then for their ends; not used if STIFF and no jumps */
    const double *h;               /* (steps): step lengths */
    const double *coefficients;    /* (groups, R, LANES) */
    const double *A, *A2, *b, *bA, *c, *powers;
    double *Phi;                   /* (groups LANES, NX, NX) */
    double *units;                 /* (groups LANES, NX): powers of 2 that balance Phi; or null */
    double *condition;             /* (groups LANES): condition number of G + H relative to (G, H), in
                                      G x_0 + H x_0 = r; NaN if curves are not finite */
    double *curves;                /* (groups LANES, N, steps, D) */
    double *maps;                  /* (groups LANES, steps, NX, W): maps of the steps; or null */
} problem;

/* Omega^2 M, Omega C and K in row order, and d, at one phase. */
static void matrices(const problem *p, long group, const double *tables, long phase, long phases, lane *e) {
    const loose *c = (const loose *)(p->coefficients + group * p->terms * LANES);
    int last = -1;
    if (p->own == LANE) {
        const loose *t = (const loose *)tables + (group * phases + phase) * p->terms;
        for (int r = 0; r < p->terms; r++) e[p->entry[r]] = t[r];
        return;
    }
    if (p->own == SEGMENT) {
        for (int r = 0; r < p->terms; r++) {
            lane term;
            for (int l = 0; l < LANES; l++) term[l] = tables[(l * phases + phase) * p->terms + r];
            term *= c[r];
            e[p->entry[r]] = p->entry[r] == last ? e[p->entry[r]] + term : term;
            last = p->entry[r];
        }
        return;
    }
    const double *t = tables + phase * p->terms;
    for (int r = 0; r < p->terms;) {
        const int entry = p->entry[r];
        lane sum = c[r] * t[r];
        while (++r < p->terms && p->entry[r] == entry) sum += c[r] * t[r];
        e[entry] = sum;
    }
}

/* Stage system of one step, followed by its right-hand sides: rows (ROWS, COLS). */
static void build(const problem *p, long group, long step, const scaled *by, lane *e, lane *rows) {
    for (int i = 0; i < S; i++) {
        matrices(p, group, p->stages, step * S + i, p->steps * S, e);
        const lane *M = e, *C = e + N * N, *K = e + 2 * N * N, *d = e + 3 * N * N;
        stage_rows(i, by, M, C, K, rows + i * N * COLS, COLS);
        for (int a = 0; a < N && ORBIT; a++) rows[(i * N + a) * COLS + ROWS + NX] = d[a];
    }
}

/* Eliminate `width` columns of row i and, with `both`, of the next row. Returns the lanes in which a factor is so large
   that rows should have been exchanged. */
static inline __attribute__((always_inline)) mask
subtract(lane *rows, const lane *inverse, int from, const int width, int i, const int both) {
    const lane *restrict pivots = rows + from * COLS;
    lane *restrict x = rows + i * COLS, *restrict y = x + (both ? COLS : 0);
    lane l[PANEL], r[PANEL], largest = {0};
    for (int k = 0; k < width; k++) {
        lane s = x[from + k], t = y[from + k];
        for (int m = 0; m < k; m++) {
            s -= l[m] * pivots[m * COLS + from + k];
            t -= r[m] * pivots[m * COLS + from + k];
        }
        l[k] = s * inverse[from + k], r[k] = t * inverse[from + k];
        largest = larger(largest, larger(absolute(l[k]), absolute(r[k])));
    }
    for (int j = from + width; j < COLS; j++) {
        lane s = x[j], t = y[j];
        for (int k = 0; k < width; k++) {
            const lane u = pivots[k * COLS + j];
            s -= l[k] * u;
            t -= r[k] * u;
        }
        x[j] = s;
        if (both) y[j] = t;
    }
    return largest > EXCESS;
}

/* Eliminate within the rows of one panel. */
static inline __attribute__((always_inline)) mask own(lane *rows, lane *inverse, int from, const int width) {
    mask excess = {0};
    inverse[from] = 1.0 / rows[from * COLS + from];
#define NEXT(k) \
    if (width > k) { \
        excess |= subtract(rows, inverse, from, k, from + k, 0); \
        inverse[from + k] = 1.0 / rows[(from + k) * COLS + from + k]; \
    }
    NEXT(1)
    NEXT(2)
    NEXT(3)
#undef NEXT
    return excess;
}

/* Reduce the rows to upper triangular form, panel by panel, and store the inverses of the pivots. Returns the lanes in
   which rows should have been exchanged. */
static mask eliminate(lane *rows, lane *inverse) {
    mask excess = {0};
    for (int from = 0; from + PANEL <= ROWS; from += PANEL) {
        excess |= own(rows, inverse, from, PANEL);
        int i = from + PANEL;
        for (; i + 1 < ROWS; i += 2) excess |= subtract(rows, inverse, from, PANEL, i, 1);
        if (i < ROWS) excess |= subtract(rows, inverse, from, PANEL, i, 0);
    }
    if (ROWS % PANEL) excess |= own(rows, inverse, ROWS - ROWS % PANEL, ROWS % PANEL);
    return excess;
}

/* The same with exchanges of rows in some lanes; results in the other lanes are as before. */
static void eliminate_with_exchanges(lane *rows, lane *inverse, mask some) {
    for (int k = 0; k < ROWS; k++) {
        exchange_rows(rows, ROWS, COLS, k, some);
        inverse[k] = 1.0 / rows[k * COLS + k];
        int i = k + 1;
        for (; i + 1 < ROWS; i += 2) subtract(rows, inverse, k, 1, i, 1);
        if (i < ROWS) subtract(rows, inverse, k, 1, i, 0);
    }
}

/* Products of two rows x and y (count) and `width` columns of b. Rows of b have the length `stride`. */
static inline __attribute__((always_inline)) void
products(const lane *restrict x, const lane *restrict y, const lane *restrict b, int stride, int count, const int width, lane sum[2][TILE]) {
    for (int m = 0; m < width; m++) sum[0][m] = sum[1][m] = (lane){0};
    for (int k = 0; k < count; k++)
        for (int m = 0; m < width; m++) {
            sum[0][m] += x[k] * b[k * stride + m];
            sum[1][m] += y[k] * b[k * stride + m];
        }
}

/* `width` solutions from column j on, in rows k and k + 1. Those in the rows below are known. */
static inline __attribute__((always_inline)) void
solve_two(const lane *rows, const lane *inverse, lane *solution, int k, int j, const int width) {
    const lane *x = rows + k * COLS, *y = x + COLS;
    lane *found = solution + k * W + j, sum[2][TILE];
    products(x + k + 2, y + k + 2, found + 2 * W, W, ROWS - k - 2, width, sum);
    for (int m = 0; m < width; m++) {
        const lane below = (y[ROWS + j + m] - sum[1][m]) * inverse[k + 1];
        found[W + m] = below;
        found[m] = (x[ROWS + j + m] - sum[0][m] - x[k + 1] * below) * inverse[k];
    }
}

/* All solutions (ROWS, W), by back substitution. */
static void substitute(const lane *rows, const lane *inverse, lane *solution) {
    const int last = ROWS - 1;
    for (int j = 0; j < W && ROWS % 2; j++) solution[last * W + j] = rows[last * COLS + ROWS + j] * inverse[last];
    for (int k = ROWS - ROWS % 2 - 2; k >= 0; k -= 2) {
        int j = 0;
        for (; j + TILE <= W; j += TILE) solve_two(rows, inverse, solution, k, j, TILE);
        if (W % TILE) solve_two(rows, inverse, solution, k, j, W % TILE);
    }
}

/* Map (NX, W) of the states over the step, from the stage accelerations (ROWS, W). */
static void step_map(const problem *p, long step, const lane *stages, lane *map) {
    const double h = p->h[step];
    for (int a = 0; a < N; a++)
        for (int j = 0; j < W; j++) {
            lane q = {0}, v = {0};
            for (int i = 0; i < S; i++) {
                const lane x = stages[(i * N + a) * W + j];
                q += p->bA[i] * x;
                v += p->b[i] * x;
            }
            map[a * W + j] = a < P ? h * h * q : h * v;
            if (a < P) map[(N + a) * W + j] = h * v;
        }
    for (int a = 0; a < N; a++) {
        map[a * W + a] += 1.0;
        if (a >= P) continue;
        map[a * W + N + a] += h;
        map[(N + a) * W + N + a] += 1.0;
    }
}

/* `width` columns from j on, in two rows, of the product of `map` and `from`. An odd last row is computed twice. */
static inline __attribute__((always_inline)) void
follow_two(const lane *map, const lane *from, lane *to, int i, int j, const int width) {
    const int next = NX % 2 && i + 1 == NX ? i : i + 1;
    lane sum[2][TILE];
    products(map + i * W, map + next * W, from + j, W, NX, width, sum);
    for (int m = 0; m < width; m++) {
        const int load = ORBIT && j + m == NX;
        to[i * W + j + m] = load ? sum[0][m] + map[i * W + NX] : sum[0][m];
        to[next * W + j + m] = load ? sum[1][m] + map[next * W + NX] : sum[1][m];
    }
}

/* to = `map` applied after `from`; all are affine maps (NX, W). */
static void follow(const lane *restrict map, const lane *restrict from, lane *restrict to) {
    for (int i = 0; i < NX; i += 2) {
        int j = 0;
        for (; j + TILE <= W; j += TILE) follow_two(map, from, to, i, j, TILE);
        if (W % TILE) follow_two(map, from, to, i, j, W % TILE);
    }
}

/* States (steps + 1, NX) and stage accelerations (steps, ROWS) from the starts of the blocks. */
static void trace(const problem *p, long length, const lane *starts, const lane *stages, lane *x, lane *a) {
    for (long k = 0; k < p->steps; k++) {
        const double h = p->h[k];
        if (k % length == 0) memcpy(x + k * NX, starts + k / length * NX, NX * sizeof(lane));
        const lane *from = x + k * NX, *map = stages + k * ROWS * W;
        lane *to = x + (k + 1) * NX, *found = a + k * ROWS;
        for (int i = 0; i < ROWS; i++) {
            lane s = map[i * W + NX];
            for (int j = 0; j < NX; j++) s += map[i * W + j] * from[j];
            found[i] = s;
        }
        for (int i = 0; i < N; i++) {
            lane q = {0}, v = {0};
            for (int j = 0; j < S; j++) {
                q += p->bA[j] * found[j * N + i];
                v += p->b[j] * found[j * N + i];
            }
            if (i < P) {
                to[i] = from[i] + h * from[N + i] + h * h * q;
                to[N + i] = from[N + i] + h * v;
            } else to[i] = from[i] + h * v;
        }
    }
    memcpy(x + p->steps * NX, x, NX * sizeof(lane));
}

/* Cyclic shift: every lane takes the value of the lane that is `places` lanes after it. */
static lane rotated(lane x, int places) {
    lane r;
    for (int l = 0; l < LANES; l++) r[l] = x[(l + places) % LANES];
    return r;
}

/* Powers of theta in every step, from states and accelerations; returns their sum. */
static lane draw(const problem *p, long group, const lane *x, const lane *a, const lane *starts, const lane *ends) {
    const int known = STIFF && !p->jumps;
    lane total = {0};
    for (long k = 0; k < p->steps; k++)
        for (int i = 0; i < N; i++) {
            const double h = p->h[k];
            const double unit = i < P ? h * h : h;
            lane data[NODES], power[D];
            data[0] = unit * (known ? a[(k ? k - 1 : p->steps - 1) * ROWS + (S - 1) * N + i] : starts[k * N + i]);
            if (known && !k && p->own == SEGMENT) data[0] = rotated(data[0], LANES - 1);
            for (int j = 0; j < S; j++) data[1 + j] = unit * a[k * ROWS + j * N + i];
            if (NODES > S + 1) {
                data[NODES - 1] = unit * (p->jumps ? ends[k * N + i] : starts[(k + 1) % p->steps * N + i]);
                if (k + 1 == p->steps && p->own == SEGMENT) data[NODES - 1] = rotated(data[NODES - 1], 1);
            }
            power[0] = x[k * NX + i];
            if (i < P) power[1] = h * x[k * NX + N + i];
            for (int d = 2; d < D; d++) {
                power[d] = (lane){0};
                for (int j = 0; j < NODES; j++) power[d] += p->powers[d * D + 2 + j] * data[j];
            }
            if (i >= P) {                                        /* rates are integrated only once */
                for (int d = 1; d + 1 < D; d++) power[d] = (d + 1.0) * power[d + 1];
                power[D - 1] = (lane){0};
            }
            for (int d = 0; d < D; d++) total += power[d];
            for (int l = 0; l < LANES; l++) {
                double *to = p->curves + (((group * LANES + l) * N + i) * p->steps + k) * D;
                for (int d = 0; d < D; d++) to[d] = power[d][l];
            }
        }
    return total;
}

/* The following code takes little time to run but most of the compilation time. Therefore, it is optimised less. */
#pragma GCC optimize("O2")

/* Highest derivatives (N) from the equations of motion, for a state at one of the nodes. */
static void acceleration(const problem *p, long group, long node, const lane *x, lane *e, lane *z, lane *a) {
    matrices(p, group, p->nodes, node, p->jumps ? 2 * p->steps : p->steps, e);
    const lane *M = e, *C = e + N * N, *K = e + 2 * N * N, *d = e + 3 * N * N;
    for (int i = 0; i < N; i++) {
        lane *row = z + i * (N + 1);
        memcpy(row, M + i * N, P * sizeof(lane));
        memcpy(row + P, C + i * N + P, (N - P) * sizeof(lane));
        row[N] = d[i];
        for (int j = 0; j < P; j++) row[N] -= C[i * N + j] * x[N + j] + K[i * N + j] * x[j];
        for (int j = P; j < N; j++) row[N] -= K[i * N + j] * x[j];
    }
    solve_rows(z, N, a);
}

/* Workspace for one group. */
typedef struct {
    long length, blocks;           /* numbers of steps per block and of blocks per lane */
    lane *memory, *e, *rows, *inverse, *map, *sum, *next, *maps, *stages, *z, *saved, *chain, *x0, *a, *x, *starts, *ends;
} room;

static int open_room(const problem *p, long most_blocks, room *r) {
    const long wanted = p->steps < most_blocks ? p->steps : most_blocks;
    r->length = (p->steps + wanted - 1) / wanted;
    r->blocks = (p->steps + r->length - 1) / r->length;
    const size_t B = r->blocks + LANES, stages = (ORBIT ? p->steps : 1) * (size_t)(ROWS * W);
    size_t size = ENTRIES + (size_t)ROWS * (COLS + 1) + 3 * NX * W + B * NX * W + stages;
    if (ORBIT) size += NX * CYCLIC + B * (NX * CYCLIC + NX * ROW + NX) + p->steps * (size_t)(ROWS + NX + 2 * N) + NX;
    r->memory = allocate(size * sizeof(lane));
    if (!r->memory) return 1;
    r->e = r->memory, r->rows = r->e + ENTRIES, r->inverse = r->rows + ROWS * COLS, r->map = r->inverse + ROWS;
    r->sum = r->map + NX * W, r->next = r->sum + NX * W, r->maps = r->next + NX * W;
    r->stages = r->maps + B * NX * W, r->z = r->stages + stages, r->saved = r->z + NX * CYCLIC;
    r->chain = r->saved + B * NX * CYCLIC, r->x0 = r->chain + B * NX * ROW, r->a = r->x0 + B * NX;
    r->x = r->a + p->steps * ROWS, r->starts = r->x + (p->steps + 1) * NX;
    r->ends = r->starts + p->steps * N;
    memset(r->e, 0, ENTRIES * sizeof(lane));
    return 0;
}

/* sum = map applied after sum. */
static void append(room *r, const lane *map) {
    follow(map, r->sum, r->next);
    lane *t = r->sum;
    r->sum = r->next;
    r->next = t;
}

/* Stage accelerations of every step, as affine functions of its start, and the maps of the blocks. */
static void advance(const problem *p, long group, room *r) {
    const lane none = {0};
    double h = 0.0;
    scaled by;
    for (long block = 0; block < r->blocks; block++) {
        for (long k = block * r->length; k < (block + 1) * r->length && k < p->steps; k++) {
            lane *map = k % r->length ? r->map : r->sum;
            if (p->h[k] != h) scale(none + (h = p->h[k]), p->A, p->A2, p->c, &by);
            build(p, group, k, &by, r->e, r->rows);
            const mask excess = eliminate(r->rows, r->inverse);
            if (any(excess)) {
                build(p, group, k, &by, r->e, r->rows);
                eliminate_with_exchanges(r->rows, r->inverse, excess);
            }
            lane *stages = r->stages + (ORBIT ? k : 0) * ROWS * W;
            substitute(r->rows, r->inverse, stages);
            step_map(p, k, stages, map);
            if (p->maps)
                for (int i = 0; i < NX * W; i++)
                    for (int l = 0; l < LANES; l++) p->maps[((group * LANES + l) * p->steps + k) * NX * W + i] = map[i][l];
            if (map == r->map) append(r, map);
        }
        memcpy(r->maps + block * NX * W, r->sum, NX * W * sizeof(lane));
    }
    memcpy(r->sum, r->maps, NX * W * sizeof(lane));
    for (long block = 1; block < r->blocks; block++) append(r, r->maps + block * NX * W);
}

/* Write Phi, its units, and the curves from the starts of the blocks. The result is finite in a lane if the curves are. */
static lane write(const problem *p, long group, const room *r) {
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++)
            for (int l = 0; l < LANES; l++) p->Phi[((group * LANES + l) * NX + i) * NX + j] = r->sum[i * W + j][l];
    if (p->units) {
        lane unit[NX];
        balance(0, 1, r->sum, unit);
        for (int i = 0; i < NX; i++)
            for (int l = 0; l < LANES; l++) p->units[(group * LANES + l) * NX + i] = unit[i][l];
    }
    if (!ORBIT) return (lane){0};
    trace(p, r->length, r->x0, r->stages, r->x, r->a);
    for (long k = 0; k < (STIFF && !p->jumps ? 0 : p->steps); k++) {
        acceleration(p, group, k, r->x + k * NX, r->e, r->rows, r->starts + k * N);
        if (NODES > S + 1 && p->jumps)
            acceleration(p, group, p->steps + k, r->x + (k + 1) * NX, r->e, r->rows, r->ends + k * N);
    }
    return draw(p, group, r->x, r->a, r->starts, r->ends);
}

/* Solve the groups one after another. Returns 1 if memory is insufficient, otherwise 0. */
int level(const problem *p) {
    room r;
    if (open_room(p, BLOCKS, &r)) return 1;
    for (long group = 0; group < p->groups; group++) {
        advance(p, group, &r);
        lane condition = {0};
        if (ORBIT) condition = close_chain(p->steps, r.blocks, r.maps, r.saved, r.chain, r.z, r.x0, 1);
        condition += 0.0 * write(p, group, &r);
        if (ORBIT) ((loose *)p->condition)[group] = condition;
    }
    release(r.memory);
    return 0;
}

/* Solve one point. Each lane contains a segment of the period with p->steps steps. Returns as `level` does. */
int segments(const problem *p) {
    room r;
    if (open_room(p, BLOCKS / LANES, &r)) return 1;
    advance(p, 0, &r);
    lane *whole = r.chain;                                       /* not yet used before the chain is closed */
    for (int l = 0; l < LANES; l++)
        for (int i = 0; i < NX * W; i++) {
            const lane none = {0};
            whole[l * NX * W + i] = none + r.sum[i][l];
        }
    memcpy(r.sum, whole, NX * W * sizeof(lane));
    for (int l = 1; l < LANES; l++) append(&r, whole + l * NX * W);
    lane condition = {0};
    if (ORBIT) condition = close_segments(p->steps, r.blocks, r.maps, r.saved, r.chain, r.z, r.x0);
    const lane total = write(p, 0, &r);
    for (int l = 0; l < LANES; l++) condition += 0.0 * total[l];
    if (ORBIT) *(loose *)p->condition = condition;
    release(r.memory);
    return 0;
}
