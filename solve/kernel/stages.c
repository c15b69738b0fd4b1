/* Stage systems of the collocation steps of one period, LANES steps at a time. They are factorised once, and solved for
   loads at the stages, also in transposed form.

   N: number of coordinates. S: number of stages. */

#include "lane.h"
#include "rows.h"
#include "stage.h"

#define COLS (ROWS + NX)
#define ENTRIES (3 * N * N + N)

typedef struct {
    long steps, columns;
    const double *h;               /* (steps): step lengths */
    long terms, between;           /* R, and the distance in the table between the first terms of two steps */
    const int *entry;              /* (R), ascending: index of the entry of each term, in Omega^2 M, Omega C, K (row order), d */
    const double *table;           /* (steps, S, R): terms at the stages */
    const double *coefficients;    /* (R) */
    const double *A, *A2, *b, *bA, *c;
    double *factors;               /* (groups of LANES steps, ROWS, ROWS, LANES): L below the diagonal; U with inverse pivots */
    long long *order;              /* (groups, ROWS, LANES): row with which each row was exchanged */
    double *by_state;              /* (steps, ROWS, NX): stage accelerations per unit of the states at the starts */
    double *maps;                  /* (steps, NX, NX): maps from the states at the starts to those at the ends */
    const double *given;           /* (steps, ROWS, columns): loads, or weights of stage accelerations */
    double *found;                 /* (steps, ROWS, columns): stage accelerations, or weights of loads */
} problem;

/* L and U replace the matrix, with inverse pivots on the diagonal. The further columns are replaced by solutions. */
static void factorise(lane rows[ROWS][COLS], mask order[ROWS]) {
    for (int k = 0; k < ROWS; k++) {
        order[k] = exchange_rows(rows[0], ROWS, COLS, k, ~(mask){0});
        rows[k][k] = 1.0 / rows[k][k];
        for (int i = k + 1; i < ROWS; i++) {
            const lane factor = rows[i][k] *= rows[k][k];
            for (int j = k + 1; j < COLS; j++) rows[i][j] -= factor * rows[k][j];
        }
    }
    for (int k = ROWS - 1; k >= 0; k--) {
        for (int i = k + 1; i < ROWS; i++)
            for (int j = ROWS; j < COLS; j++) rows[k][j] -= rows[k][i] * rows[i][j];
        for (int j = ROWS; j < COLS; j++) rows[k][j] *= rows[k][k];
    }
}

/* Map (NX, NX) from the states at the start of a step to those at its end, from the stage accelerations. */
static void step_map(const problem *p, lane h, lane rows[ROWS][COLS], lane map[NX][NX]) {
    for (int a = 0; a < N; a++)
        for (int j = 0; j < NX; j++) {
            lane q = {0}, v = {0};
            for (int i = 0; i < S; i++) {
                q += p->bA[i] * rows[i * N + a][ROWS + j];
                v += p->b[i] * rows[i * N + a][ROWS + j];
            }
            map[a][j] = h * h * q;
            map[N + a][j] = h * v;
        }
    for (int a = 0; a < N; a++) {
        map[a][a] += 1.0;
        map[a][N + a] += h;
        map[N + a][N + a] += 1.0;
    }
}

/* Returns 1 if memory is available. */
int factorised(const problem *p) {
    lane e[ENTRIES], map[NX][NX], (*rows)[COLS] = allocate(sizeof(lane[ROWS][COLS]));
    mask order[ROWS];
    if (!rows) return 0;
    memset(e, 0, sizeof(e));
    for (long group = 0; group * LANES < p->steps; group++) {
        const long start = group * LANES, left = p->steps - start, filled = left < LANES ? left : LANES;
        lane h;
        scaled by;
        for (int l = 0; l < LANES; l++) h[l] = p->h[start + (l < filled ? l : filled - 1)];
        scale(h, p->A, p->A2, p->c, &by);
        for (int i = 0; i < S; i++) {
            const double *from[LANES];
            for (int l = 0; l < LANES; l++)
                from[l] = p->table + (start + (l < filled ? l : filled - 1)) * p->between + i * p->terms;
            for (long r = 0, last = -1; r < p->terms; last = p->entry[r++]) {
                lane term;
                for (int l = 0; l < LANES; l++) term[l] = from[l][r];
                term *= p->coefficients[r];
                e[p->entry[r]] = p->entry[r] == last ? e[p->entry[r]] + term : term;
            }
            stage_rows(i, &by, e, e + N * N, e + 2 * N * N, rows[i * N], COLS);
        }
        factorise(rows, order);
        step_map(p, h, rows, map);
        for (int i = 0; i < ROWS; i++) {
            loose *to = (loose *)p->factors + (group * ROWS + i) * ROWS;
            for (int j = 0; j < ROWS; j++) to[j] = rows[i][j];
            for (int l = 0; l < LANES; l++) p->order[(group * ROWS + i) * LANES + l] = order[i][l];
        }
        for (long l = 0; l < filled; l++) {
            for (int i = 0; i < ROWS; i++)
                for (int j = 0; j < NX; j++) p->by_state[((start + l) * ROWS + i) * NX + j] = rows[i][ROWS + j][l];
            for (int i = 0; i < NX; i++)
                for (int j = 0; j < NX; j++) p->maps[((start + l) * NX + i) * NX + j] = map[i][j][l];
        }
    }
    release(rows);
    return 1;
}

static void swap(lane *x, const long long *order, int k) {
    long long other = 0;
    for (int l = 0; l < LANES; l++) other |= order[k * LANES + l] ^ k;
    for (int l = 0; other && l < LANES; l++) {
        const long long i = order[k * LANES + l];
        const double t = x[k][l];
        x[k][l] = x[i][l];
        x[i][l] = t;
    }
}

static void solve(const loose *f, const long long *order, lane *x) {
    for (int k = 0; k < ROWS; k++) swap(x, order, k);
    for (int k = 0; k < ROWS; k++)
        for (int i = k + 1; i < ROWS; i++) x[i] -= f[i * ROWS + k] * x[k];
    for (int k = ROWS - 1; k >= 0; k--) {
        x[k] *= f[k * ROWS + k];
        for (int i = 0; i < k; i++) x[i] -= f[i * ROWS + k] * x[k];
    }
}

static void solve_transposed(const loose *f, const long long *order, lane *x) {
    for (int k = 0; k < ROWS; k++) {
        x[k] *= f[k * ROWS + k];
        for (int i = k + 1; i < ROWS; i++) x[i] -= f[k * ROWS + i] * x[k];
    }
    for (int k = ROWS - 1; k >= 0; k--)
        for (int i = 0; i < k; i++) x[i] -= f[k * ROWS + i] * x[k];
    for (int k = ROWS - 1; k >= 0; k--) swap(x, order, k);
}

static void each(const problem *p, void (*one)(const loose *, const long long *, lane *)) {
    lane x[ROWS];
    for (long group = 0; group * LANES < p->steps; group++) {
        const long left = p->steps - group * LANES, filled = left < LANES ? left : LANES;
        const long at = group * LANES * ROWS * p->columns;
        for (long column = 0; column < p->columns; column++) {
            for (int l = 0; l < LANES; l++)
                for (int i = 0; i < ROWS; i++)
                    x[i][l] = l < filled ? p->given[at + (l * ROWS + i) * p->columns + column] : 0.0;
            one((const loose *)p->factors + group * ROWS * ROWS, p->order + group * ROWS * LANES, x);
            for (int l = 0; l < filled; l++)
                for (int i = 0; i < ROWS; i++) p->found[at + (l * ROWS + i) * p->columns + column] = x[i][l];
        }
    }
}

void solved(const problem *p) { each(p, solve); }

void pulled(const problem *p) { each(p, solve_transposed); }
