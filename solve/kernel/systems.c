/* Solutions of many small systems of linear equations, LANES of them side by side.

   R: equations of a system, C: its right sides. */

#include "lane.h"

#define COLS (R + C)
#define EXCESS 32.0                /* multipliers beyond this ask for pivots of the system's own */

typedef struct {
    long count;
    const double *systems;         /* (count, R, COLS): matrix and right sides beside each other */
    double *solutions;             /* (count, R, C) */
    int *unsure;                   /* (count): where a multiplier was in excess, or not finite */
} problem;

static inline lane absolute(lane x) { return (lane)((mask)x & 0x7fffffffffffffffLL); }

/* The row with the largest sum of moduli over the lanes, which all of them then use. */
static int pivot(lane rows[R][COLS], int k) {
    double best = -1.0;
    int found = k;
    for (int i = k; i < R; i++) {
        const lane a = absolute(rows[i][k]);
        double sum = 0.0;
        for (int l = 0; l < LANES; l++) sum += a[l];
        if (sum > best) best = sum, found = i;
    }
    return found;
}

/* The right sides become the solutions; tells in which lanes a multiplier was in excess. */
static mask solve(lane rows[R][COLS]) {
    mask sure = ~(mask){0};
    lane inverse[R], kept[COLS];
    for (int k = 0; k < R; k++) {
        const int best = pivot(rows, k);
        if (best != k) {
            memcpy(kept, rows[k], sizeof kept);
            memcpy(rows[k], rows[best], sizeof kept);
            memcpy(rows[best], kept, sizeof kept);
        }
        inverse[k] = 1.0 / rows[k][k];
        for (int i = k + 1; i < R; i++) {
            const lane factor = rows[i][k] * inverse[k];
            sure &= absolute(factor) <= EXCESS;
            for (int j = k + 1; j < COLS; j++) rows[i][j] -= factor * rows[k][j];
        }
    }
    for (int k = R - 1; k >= 0; k--) {
        for (int i = k + 1; i < R; i++)
            for (int j = R; j < COLS; j++) rows[k][j] -= rows[k][i] * rows[i][j];
        for (int j = R; j < COLS; j++) rows[k][j] *= inverse[k];
    }
    return ~sure;
}

void systems(const problem *p) {
    static _Thread_local lane rows[R][COLS];
    for (long start = 0; start < p->count; start += LANES) {
        const long left = p->count - start, filled = left < LANES ? left : LANES;
        for (int l = 0; l < LANES; l++) {
            const double *from = p->systems + (start + (l < filled ? l : filled - 1)) * R * COLS;
            for (int i = 0; i < R; i++)
                for (int j = 0; j < COLS; j++) rows[i][j][l] = from[i * COLS + j];
        }
        const mask unsure = solve(rows);
        for (long l = 0; l < filled; l++) {
            double *to = p->solutions + (start + l) * R * C;
            for (int i = 0; i < R; i++)
                for (int j = 0; j < C; j++) to[i * C + j] = rows[i][R + j][l];
            p->unsure[start + l] = unsure[l] != 0;
        }
    }
}
