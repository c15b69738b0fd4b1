/* The system of the stage accelerations of a step of collocation: N coordinates, S stages. */

#define NX (2 * N)                 /* state: q, dq/dphase */
#define ROWS (S * N)

/* The N rows of stage i, `width` numbers each: what multiplies the accelerations, and behind these what the
   state at the start of the step gives. M, C, K: at the stage. */
static inline void stage_rows(int i, lane h, const double *A, const double *A2, const double *c, const lane *M, const lane *C, const lane *K, lane *rows, int width) {
    for (int a = 0; a < N; a++) {
        lane *row = rows + a * width;
        for (int j = 0; j < S; j++) {
            const lane damped = h * A[i * S + j], stiff = h * h * A2[i * S + j];
            for (int b = 0; b < N; b++) row[j * N + b] = damped * C[a * N + b] + stiff * K[a * N + b];
        }
        for (int b = 0; b < N; b++) {
            row[i * N + b] += M[a * N + b];
            row[ROWS + b] = -K[a * N + b];
            row[ROWS + N + b] = -C[a * N + b] - h * c[i] * K[a * N + b];
        }
    }
}
