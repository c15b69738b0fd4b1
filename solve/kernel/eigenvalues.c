/* Eigenvalues lambda of lambda^2 M + lambda C + K, LANES pencils at a time. They are those of the balanced state matrix
   (E. E. Osborne, J. ACM 7 (1960) 338-345).

   N: number of coordinates. P: number of second-order coordinates; the others are the last ones, and their columns of M
   are zero. */

#include "lane.h"
#include "rows.h"

#define NX (N + P)
#define SWEEPS 8                   /* largest number of balancing sweeps */
#define GAIN 0.9                   /* balancing continues if it reduces norms below this fraction */
#include "schur.h"

typedef struct {
    long count;
    const double *entries;         /* (3 N N, count): entries of M, C and K in row order */
    double *values;                /* (NX, count), complex; NaN if the iteration fails */
} problem;

/* State matrices for (q, q') of LANES pencils, starting with index `first`. The last pencil also fills the remaining
   lanes. Rows contain the coefficients of the highest derivatives, K, and the columns of C that belong to rates. */
static void states(const problem *p, long first, lane A[NX][NX]) {
    static const lane none;
    lane rows[N][2 * N + P];
    for (int part = 0; part < 3; part++)
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++) {
                const double *given = p->entries + ((part * N + i) * N + j) * p->count;
                if (j >= P && part == 0) continue;
                const int column = part == 0 ? j : part == 2 ? N + j : j < P ? 2 * N + j : j;
                if (first + LANES <= p->count) rows[i][column] = *(const loose *)(given + first);
                else
                    for (int l = 0; l < LANES; l++) rows[i][column][l] = given[first + l < p->count ? first + l : p->count - 1];
            }
    for (int k = 0; k < N; k++) {
        exchange_rows(rows[0], N, 2 * N + P, k, ~(mask){0});
        for (int j = k + 1; j < 2 * N + P; j++) rows[k][j] /= rows[k][k];
        for (int i = 0; i < N; i++)
            for (int j = k + 1; i != k && j < 2 * N + P; j++) rows[i][j] -= rows[i][k] * rows[k][j];
    }
    for (int i = 0; i < N; i++)
        for (int j = 0; j < NX; j++) {
            if (i < P) A[i][j] = j == N + i ? none + 1.0 : none;
            A[i < P ? N + i : i][j] = -rows[i][N + j];
        }
}

/* Balance the matrix: choose units in which each row and its column have similar norms. */
static void balance(lane A[NX][NX]) {
    for (int sweep = 0, open = 1; open && sweep < SWEEPS; sweep++) {
        open = 0;
        for (int i = 0; i < NX; i++) {
            lane row = {0}, column = {0};
            for (int j = 0; j < NX; j++) {
                row += i == j ? 0.0 * row : absolute(A[i][j]);
                column += i == j ? 0.0 * row : absolute(A[j][i]);
            }
            const lane unit = root(row / column);
            const mask gains = (column * unit + row / unit < GAIN * (column + row)) & (row > 0.0) & (column > 0.0);
            if (!any(gains)) continue;
            const lane factor = chosen(gains, unit, (lane){0} + 1.0), inverse = 1.0 / factor;
            for (int j = 0; j < NX; j++) A[i][j] *= inverse;
            for (int j = 0; j < NX; j++) A[j][i] *= factor;
            open = 1;
        }
    }
}

void eigenvalues(const problem *p) {
    for (long first = 0; first < p->count; first += LANES) {
        lane A[NX][NX];
        complex_lane H[NX][NX];
        states(p, first, A);
        balance(A);
        const mask missed = triangular(A, H, 0);
        for (int i = 0; i < NX; i++)
            for (int l = 0; l < LANES && first + l < p->count; l++) {
                double *value = p->values + 2 * (i * p->count + first + l);
                value[0] = missed[l] ? NAN : H[i][i].re[l];
                value[1] = missed[l] ? NAN : H[i][i].im[l];
            }
    }
}
