/* The system of the stage accelerations of a step of collocation: N coordinates, S stages.

   P: coordinates of second order, all unless it is given; the others behind them have rates in place of accelerations, and
   columns of zeros in M. */

#ifndef P
#define P N
#endif
#define NX (N + P)                 /* state: q, dq/dphase of the first P */
#define ROWS (S * N)

/* The method's numbers in a step of length h. */
typedef struct {
    lane A[S][S], A2[S][S], c[S];  /* h A, h^2 A^2, h c */
} scaled;

static inline void scale(lane h, const double *A, const double *A2, const double *c, scaled *to) {
    for (int i = 0; i < S; i++) {
        for (int j = 0; j < S; j++) to->A[i][j] = h * A[i * S + j], to->A2[i][j] = h * h * A2[i * S + j];
        to->c[i] = h * c[i];
    }
}

/* The N rows of stage i, `width` numbers each: what multiplies the accelerations, and behind these what the
   state at the start of the step gives. M, C, K: at the stage. */
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
