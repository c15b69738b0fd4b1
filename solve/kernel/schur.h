/* Schur form of real matrices with NX rows, LANES matrices at a time, by Householder reflections and the shifted QR
   algorithm (J. H. Wilkinson, The Algebraic Eigenvalue Problem, 1965, chapter 8) in complex arithmetic. */

#define TURNS 40                   /* largest number of QR steps per eigenvalue */
#define AGAIN 10                   /* number of steps after which a different shift is used */
#define ROUNDING 2.3e-16

typedef struct {
    lane re, im;
} complex_lane;

static inline complex_lane times(complex_lane x, complex_lane y) {
    return (complex_lane){x.re * y.re - x.im * y.im, x.re * y.im + x.im * y.re};
}

static inline complex_lane plus(complex_lane x, complex_lane y) { return (complex_lane){x.re + y.re, x.im + y.im}; }

static inline complex_lane minus(complex_lane x, complex_lane y) { return (complex_lane){x.re - y.re, x.im - y.im}; }

static inline complex_lane conjugate(complex_lane x) { return (complex_lane){x.re, -x.im}; }

static inline lane modulus(complex_lane x) { return root(x.re * x.re + x.im * x.im); }

/* x / y, or 0 if y is 0. */
static inline complex_lane over(complex_lane x, complex_lane y) {
    const lane square = y.re * y.re + y.im * y.im, inverse = where(square > 0.0, 1.0 / square);
    const complex_lane product = times(x, conjugate(y));
    return (complex_lane){product.re * inverse, product.im * inverse};
}

static inline complex_lane square_root(complex_lane x) {
    const lane r = modulus(x), large = root((r + absolute(x.re)) * 0.5);
    const lane small = where(large > 0.0, x.im / (2.0 * large));
    const mask right = x.re >= 0.0, up = x.im >= 0.0;
    return (complex_lane){chosen(right, large, absolute(small)), chosen(right, small, chosen(up, large, -large))};
}

/* Hessenberg form, by reflections from both sides. */
static void reduce(lane A[NX][NX]) {
    for (int k = 0; k + 2 < NX; k++) {
        lane v[NX], square = {0};
        for (int i = k + 1; i < NX; i++) v[i] = A[i][k], square += v[i] * v[i];
        const lane norm = root(square), end = chosen(v[k + 1] < 0.0, norm, -norm);
        v[k + 1] -= end;                                         /* no cancellation */
        const lane product = norm * absolute(v[k + 1]), factor = where(product > 0.0, 1.0 / product);
        A[k + 1][k] = end;
        for (int i = k + 2; i < NX; i++) A[i][k] = (lane){0};
        for (int j = k + 1; j < NX; j++) {
            lane dot = {0};
            for (int i = k + 1; i < NX; i++) dot += v[i] * A[i][j];
            for (int i = k + 1; i < NX; i++) A[i][j] -= dot * factor * v[i];
        }
        for (int i = 0; i < NX; i++) {
            lane dot = {0};
            for (int j = k + 1; j < NX; j++) dot += A[i][j] * v[j];
            for (int j = k + 1; j < NX; j++) A[i][j] -= dot * factor * v[j];
        }
    }
}

/* Eigenvalue of the block of rows and columns m - 1 and m that is nearer to its last diagonal entry. */
static complex_lane shift(complex_lane H[NX][NX], int m) {
    const complex_lane end = H[m][m], gap = minus(H[m - 1][m - 1], end), half = {gap.re * 0.5, gap.im * 0.5};
    const complex_lane product = times(H[m - 1][m], H[m][m - 1]);
    const complex_lane r = square_root(plus(times(half, half), product));
    const mask same = half.re * r.re + half.im * r.im >= 0.0;
    const complex_lane signed_root = {chosen(same, r.re, -r.re), chosen(same, r.im, -r.im)};
    return minus(end, over(product, plus(half, signed_root)));
}

/* One QR step for the first m + 1 rows and columns. Only the lanes in `open` change. With `whole`, the further columns
   are also transformed. */
static inline __attribute__((always_inline)) void
turn(complex_lane H[NX][NX], int m, complex_lane by, mask open, const int whole) {
    complex_lane c[NX], s[NX];
    for (int k = 0; k <= m; k++) H[k][k] = minus(H[k][k], by);
    for (int k = 0; k < m; k++) {
        const complex_lane a = H[k][k], b = H[k + 1][k];
        const lane square = a.re * a.re + a.im * a.im + b.re * b.re + b.im * b.im, r = root(square);
        const mask moves = open & (r > 0.0);
        const lane inverse = where(moves, 1.0 / r), stays = where(~moves, (lane){0} + 1.0);
        c[k] = (complex_lane){a.re * inverse + stays, a.im * inverse};
        s[k] = (complex_lane){b.re * inverse, b.im * inverse};
        H[k][k] = (complex_lane){chosen(moves, r, a.re), chosen(moves, (lane){0}, a.im)};
        H[k + 1][k] = (complex_lane){where(~moves, b.re), where(~moves, b.im)};
        for (int j = k + 1; j <= (whole ? NX - 1 : m); j++) {
            const complex_lane x = H[k][j], y = H[k + 1][j];
            H[k][j] = plus(times(conjugate(c[k]), x), times(conjugate(s[k]), y));
            H[k + 1][j] = minus(times(c[k], y), times(s[k], x));
        }
    }
    for (int k = 0; k < m; k++)
        for (int i = 0; i <= k + 1; i++) {
            const complex_lane x = H[i][k], y = H[i][k + 1];
            H[i][k] = plus(times(x, c[k]), times(y, s[k]));
            H[i][k + 1] = minus(times(y, conjugate(c[k])), times(x, conjugate(s[k])));
        }
    for (int k = 0; k <= m; k++) H[k][k] = plus(H[k][k], by);
}

/* Triangular form of a real matrix: the diagonal only, or all entries if `whole`. Returns the lanes in which the
   iteration fails. */
static inline __attribute__((always_inline)) mask
triangular(lane A[NX][NX], complex_lane H[NX][NX], const int whole) {
    reduce(A);
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) H[i][j] = (complex_lane){A[i][j], {0}};
    mask missed = {0};
    for (int m = NX - 1; m > 0; m--) {
        mask open = ~(mask){0};
        for (int step = 0; step < TURNS; step++) {
            const lane below = modulus(H[m][m - 1]);
            open = ~(below <= ROUNDING * (modulus(H[m][m]) + modulus(H[m - 1][m - 1])));
            if (!any(open)) break;
            complex_lane by = shift(H, m);
            if (step % AGAIN == AGAIN - 1) by.re += below;
            turn(H, m, (complex_lane){where(open, by.re), where(open, by.im)}, open, whole);
        }
        missed |= open;
    }
    return missed;
}
