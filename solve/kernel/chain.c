/* Chains of affine maps of NX states, with any number of right-hand sides.

   closed: states of the periodic solution. followed: states that follow from the first ones. */

#include "lane.h"
#define W (NX + 1)
#include "chain.h"

typedef struct {
    long steps, columns;
    const double *maps;            /* (steps, NX, NX) */
    const double *loads;           /* (steps, NX, columns) */
    double *states;                /* closed: (steps, NX, columns); followed: (steps + 1, NX, columns), the first are input */
    double *condition;             /* (1): condition number of the closed chain */
} problem;

/* to = A from + load, for `width` columns. A null pointer `load` counts as zero. */
static inline void next(const double *restrict A, const double *restrict from, const double *restrict load, double *restrict to, long width) {
    for (int i = 0; i < NX; i++) {
        double *row = to + i * width;
        for (long j = 0; j < width; j++) row[j] = load ? load[i * width + j] : 0.0;
        for (int k = 0; k < NX; k++) {
            const double factor = A[i * NX + k];
            for (long j = 0; j < width; j++) row[j] += factor * from[k * width + j];
        }
    }
}

int followed(const problem *p) {
    const long size = NX * p->columns;
    for (long k = 0; k < p->steps; k++)
        next(p->maps + k * NX * NX, p->states + k * size, 0, p->states + (k + 1) * size, p->columns);
    return 1;
}

/* Map (NX, NX) and loads (NX, columns) of one block, from those of its steps `from` … `to`. */
static void joined(const problem *p, long from, long to, double *map, double *load, double *room) {
    const long size = NX * p->columns;
    memcpy(map, p->maps + from * NX * NX, NX * NX * sizeof(double));
    memcpy(load, p->loads + from * size, size * sizeof(double));
    for (long k = from + 1; k < to; k++) {
        next(p->maps + k * NX * NX, map, 0, room, NX);
        memcpy(map, room, NX * NX * sizeof(double));
        next(p->maps + k * NX * NX, load, p->loads + k * size, room, p->columns);
        memcpy(load, room, size * sizeof(double));
    }
}

/* Returns 1 if memory is available. */
int closed(const problem *p) {
    const long length = (p->steps + BLOCKS - 1) / BLOCKS, B = (p->steps + length - 1) / length, c = p->columns;
    const size_t size = NX * CYCLIC + B * (NX * W + NX * CYCLIC + NX * ROW + NX);
    const size_t numbers = B * NX * (NX + c) + NX * (NX + c);
    lane *maps = allocate(size * sizeof(lane));
    double *map = malloc(numbers * sizeof(double));
    if (!maps || !map) {
        release(maps), free(map);
        return 0;
    }
    lane *z = maps + B * NX * W, *saved = z + NX * CYCLIC, *rows = saved + B * NX * CYCLIC, *x = rows + B * NX * ROW;
    double *load = map + B * NX * NX, *room = load + B * NX * c;
    for (long k = 0; k < B; k++) {
        const long end = (k + 1) * length < p->steps ? (k + 1) * length : p->steps;
        joined(p, k * length, end, map + k * NX * NX, load + k * NX * c, room);
    }
    for (long first = 0; first < c; first += LANES) {
        for (long k = 0; k < B * NX; k++) {
            const lane none = {0};
            for (int j = 0; j < NX; j++) maps[k * W + j] = none + map[k * NX + j];
            for (int l = 0; l < LANES; l++) maps[k * W + NX][l] = load[k * c + (first + l < c ? first + l : c - 1)];
        }
        const double condition = shared(close_chain(p->steps, B, maps, saved, rows, z, x, 0))[0];
        p->condition[0] = first ? fmax(p->condition[0], condition) : condition;
        for (long k = 0; k < B; k++)
            for (int i = 0; i < NX; i++)
                for (int l = 0; l < LANES && first + l < c; l++)
                    p->states[(k * length * NX + i) * c + first + l] = x[k * NX + i][l];
    }
    for (long k = 1; k < p->steps; k++)
        if (k % length) {
            const long at = (k - 1) * NX * c;
            next(p->maps + (k - 1) * NX * NX, p->states + at, p->loads + at, p->states + at + NX * c, c);
        }
    release(maps), free(map);
    return 1;
}
