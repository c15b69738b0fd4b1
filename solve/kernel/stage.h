/* Equations for the stage accelerations of a collocation step with N coordinates and S stages.

   P: number of second-order coordinates, by default all. The others are the last ones; they have rates instead of
   accelerations, and their columns of M are zero. */

#ifndef P
#define P N
#endif
#define NX (N + P)                 /* states: q, and dq/dphase of the first P coordinates */
#define ROWS (S * N)

/* Coefficients of the method for a step of length h. */
typedef struct {
    lane A[S][S], A2[S][S], c[S];  /* h A, h^2 A^2, h c */
} scaled;

static inline void scale(lane h, const double *A, const double *A2, const double *c, scaled *to) {
    for (int i = 0; i < S; i++) {
        for (int j = 0; j < S; j++) to->A[i][j] = h * A[i * S + j], to->A2[i][j] = h * h * A2[i * S + j];
        to->c[i] = h * c[i];
    }
}

/* The N rows of stage i, with `width` entries each: coefficients of the accelerations, followed by those of the state at
   the start of the step. M, C, K: matrices at the stage. */
static inline void stage_rows(int i, const scaled *restrict by, const lane *restrict M, const lane *restrict C,
                              const lane *restrict K, lane *restrict rows, int width) {
    for (int a = 0; a < N; a++) {
        lane *row = rows + a * width;
        for (int b = 0; b < N; b++) {
            const lane damping = C[a * N + b], stiffness = K[a * N + b];
            if (b >= P) {
                for (int j = 0; j < S; j++) row[j * N + b] = by->A[i][j] * stiffness;
                row[i * N + b] += damping;
                row[ROWS + b] = -stiffness;
                continue;
            }
            for (int j = 0; j < S; j++) row[j * N + b] = by->A[i][j] * damping + by->A2[i][j] * stiffness;
            row[i * N + b] += M[a * N + b];
            row[ROWS + b] = -stiffness;
            row[ROWS + N + b] = -damping - by->c[i] * stiffness;
        }
    }
}
