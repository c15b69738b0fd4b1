/* Stage accelerations of the steps of a turn by collocation, as linear functions of the states at the starts of
   the steps and of loads at their stages; LANES steps side by side.

   N: coordinates, S: stages. */

#include "lane.h"
#include "stage.h"

#define RIGHT (NX + ROWS)
#define COLS (ROWS + RIGHT)
#define ENTRIES (3 * N * N + N)

typedef struct {
    long steps;
    const double *h;               /* (steps): their lengths */
    const double *entries;         /* (steps, S, ENTRIES): Omega^2 M, Omega C, K by rows and d at the stages */
    const double *A, *A2, *c;
    double *responses;             /* (steps, ROWS, RIGHT) */
} problem;

static inline lane chosen(mask m, lane x, lane y) { return (lane)(((mask)x & m) | ((mask)y & ~m)); }

/* Exchange rows so that in every lane the largest of column k comes to row k. */
static void exchange(lane rows[ROWS][COLS], int k) {
    lane largest = absolute(rows[k][k]);
    mask best = (mask){0} + k;
    for (int i = k + 1; i < ROWS; i++) {
        const lane a = absolute(rows[i][k]);
        const mask larger = a > largest;
        largest = chosen(larger, a, largest);
        best = (best & ~larger) | (((mask){0} + i) & larger);
    }
    for (int i = k + 1; i < ROWS; i++) {
        const mask this = best == i;
        long long any = 0;
        for (int l = 0; l < LANES; l++) any |= this[l];
        for (int j = k; any && j < COLS; j++) {
            const lane x = rows[k][j], y = rows[i][j];
            rows[k][j] = chosen(this, y, x);
            rows[i][j] = chosen(this, x, y);
        }
    }
}

/* The right sides become the solutions. */
static void solve(lane rows[ROWS][COLS]) {
    lane inverse[ROWS];
    for (int k = 0; k < ROWS; k++) {
        exchange(rows, k);
        inverse[k] = 1.0 / rows[k][k];
        for (int i = k + 1; i < ROWS; i++) {
            const lane factor = rows[i][k] * inverse[k];
            for (int j = k + 1; j < COLS; j++) rows[i][j] -= factor * rows[k][j];
        }
    }
    for (int k = ROWS - 1; k >= 0; k--) {
        for (int i = k + 1; i < ROWS; i++)
            for (int j = ROWS; j < COLS; j++) rows[k][j] -= rows[k][i] * rows[i][j];
        for (int j = ROWS; j < COLS; j++) rows[k][j] *= inverse[k];
    }
}

/* 1 where there is memory. */
int responses(const problem *p) {
    const size_t size = sizeof(lane[ROWS][COLS]);
    lane e[ENTRIES], (*rows)[COLS] = aligned_alloc(sizeof(lane), size);
    if (!rows) return 0;
    for (long start = 0; start < p->steps; start += LANES) {
        const long left = p->steps - start, filled = left < LANES ? left : LANES;
        lane h;
        memset(rows, 0, size);
        for (int l = 0; l < LANES; l++) h[l] = p->h[start + (l < filled ? l : filled - 1)];
        for (int i = 0; i < S; i++) {
            for (int l = 0; l < LANES; l++) {
                const double *from = p->entries + ((start + (l < filled ? l : filled - 1)) * S + i) * ENTRIES;
                for (int k = 0; k < ENTRIES; k++) e[k][l] = from[k];
            }
            stage_rows(i, h, p->A, p->A2, p->c, e, e + N * N, e + 2 * N * N, rows[i * N], COLS);
            for (int a = 0; a < N; a++) rows[i * N + a][ROWS + NX + i * N + a] += 1.0;
        }
        solve(rows);
        for (long l = 0; l < filled; l++)
            for (int i = 0; i < ROWS; i++)
                for (int j = 0; j < RIGHT; j++)
                    p->responses[((start + l) * ROWS + i) * RIGHT + j] = rows[i][ROWS + j][l];
    }
    free(rows);
    return 1;
}
