/* Eigenvalues of real matrices and their condition numbers, LANES matrices at a time.

   The mathematics is that of period/eigenvalues.py. NX: number of rows of a matrix. */

#include "lane.h"

#include "schur.h"
#include "singular.h"

#define TINY 1e-300
#define EXPONENT 0x7ff0000000000000LL /* exponent bits: the largest power of 2 that does not exceed a number */
#define SWEEPS 8                   /* largest number of sweeps to balance two rows, */
#define GAIN 0.95                  /* which end if norms are not reduced below this fraction */
#define CANCELLED (8 * 2.220446049250313e-16) /* fraction of a sum of squares that is round-off */

typedef struct {
    long count;
    const double *matrices;        /* (count, NX, NX), finite */
    const double *units;           /* (count, NX): powers of 2 that balance the matrices; or null */
    double *values;                /* (count, NX), complex, in order of decreasing modulus, positive imaginary part
                                      first; NaN if the iteration fails */
    double *sizes;                 /* (count): Frobenius norms of the balanced matrices; for NX = 2, the least over all units */
    double *norms;                 /* (count): spectral norms of the balanced matrices */
    double *conditions;            /* (count, NX): condition numbers of their eigenvalues */
} problem;

/* Load LANES matrices, starting with index `first`, in their units, divided by powers of 2 so that squares neither
   overflow nor underflow. The last matrix also fills the remaining lanes. Returns the powers. */
static lane taken(const problem *p, long first, lane A[NX][NX]) {
    for (int l = 0; l < LANES; l++) {
        const long at = first + l < p->count ? first + l : p->count - 1;
        const double *from = p->matrices + at * NX * NX, *units = p->units ? p->units + at * NX : NULL;
        for (int i = 0; i < NX; i++)
            for (int j = 0; j < NX; j++)
                A[i][j][l] = units ? from[i * NX + j] * units[j] / units[i] : from[i * NX + j];
    }
    lane most = {0};
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) most = larger(most, absolute(A[i][j]));
    const lane power = (lane)((mask)most & EXPONENT), unit = chosen(power > 0.0, power, (lane){0} + 1.0);
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) A[i][j] /= unit;
    return unit;
}

#if NX == 2

/* Smallest Frobenius norm over all units. */
static lane size_of(lane A[NX][NX]) {
    return root(A[0][0] * A[0][0] + A[1][1] * A[1][1] + 2.0 * absolute(A[0][1] * A[1][0]));
}

/* Both eigenvalues, without the cancellation of the textbook formula. */
static void both(lane a, lane b, lane c, lane d, complex_lane values[NX]) {
    const lane none = {0}, half = (a + d) / 2.0, discriminant = (a - d) / 2.0 * ((a - d) / 2.0) + b * c;
    const mask real = discriminant >= 0.0;
    const lane size = root(absolute(discriminant)), first = half + chosen(half < 0.0, -size, size);
    const lane second = where(first != 0.0, (a * d - b * c) / first);
    values[0] = (complex_lane){chosen(real, first, half), where(~real, size)};
    values[1] = (complex_lane){chosen(real, second, half), none - where(~real, size)};
}

/* Norm of the balanced matrix, and condition number of its eigenvalues. According to the Schur form [[x, t], [0, y]],
   both eigenvalues have the condition number sqrt(1 + t^2 / |x - y|^2). */
static lane norm_and_condition(lane a, lane b, lane c, lane d, lane *condition) {
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        const lane column = root(a * a + c * c), row = root(a * a + b * b);
        const lane factor = root(row / column);
        const mask gains = (row > 0.0) & (column > 0.0) & (column * factor + row / factor < GAIN * (column + row));
        if (!any(gains)) break;
        b = chosen(gains, b / factor, b);
        c = chosen(gains, c * factor, c);
    }
    complex_lane x[NX];
    both(a, b, c, d, x);
    const lane square = a * a + b * b + c * c + d * d, first = x[0].re * x[0].re + x[0].im * x[0].im;
    const lane second = x[1].re * x[1].re + x[1].im * x[1].im, left = square - first - second;
    const lane excess = where(left >= CANCELLED * square, left);
    const complex_lane apart = minus(x[0], x[1]);
    const lane gap = apart.re * apart.re + apart.im * apart.im, none = {0};
    *condition = root(1.0 + where(excess > 0.0, excess / chosen(gap > 0.0, gap, none + TINY)));
    const lane rest = square * square / 4.0 - first * second;
    return root(square / 2.0 + root(where(rest > 0.0, rest)));
}

static void solve(lane A[NX][NX], complex_lane values[NX], lane *norm, lane conditions[NX]) {
    both(A[0][0], A[0][1], A[1][0], A[1][1], values);
    *norm = norm_and_condition(A[0][0], A[0][1], A[1][0], A[1][1], conditions);
    conditions[1] = conditions[0];
}

#else

/* Frobenius norm. */
static lane size_of(lane A[NX][NX]) {
    lane square = {0};
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < NX; j++) square += A[i][j] * A[i][j];
    return root(square);
}

/* Condition numbers of the eigenvalues of a triangular matrix, from its right and left eigenvectors (J. H. Wilkinson,
   The Algebraic Eigenvalue Problem, 1965, chapter 2). Equal eigenvalues are treated as if they differed by round-off. */
static void conditioned(complex_lane T[NX][NX], lane conditions[NX]) {
    lane size = {0};
    for (int i = 0; i < NX; i++)
        for (int j = i; j < NX; j++) size = larger(size, modulus(T[i][j]));
    const lane least = size * ROUNDING;
    for (int i = 0; i < NX; i++) {
        complex_lane x[NX];
        lane product = {0};
        for (int left = 0; left < 2; left++) {
            lane square = {0};
            for (int step = 0, k = i; k >= 0 && k < NX; k += left ? 1 : -1, step++) {
                complex_lane sum = {{0}, {0}};
                for (int j = i; step && j != k; j += left ? 1 : -1)
                    sum = plus(sum, times(x[j], left ? T[j][k] : T[k][j]));
                complex_lane gap = minus(T[i][i], T[k][k]);
                const mask equal = modulus(gap) < least;
                gap = (complex_lane){chosen(equal, least, gap.re), where(~equal, gap.im)};
                x[k] = step ? over(sum, gap) : (complex_lane){(lane){0} + 1.0, {0}};
                square += x[k].re * x[k].re + x[k].im * x[k].im;
            }
            product = left ? product * root(square) : root(square);
        }
        conditions[i] = product;
    }
}

static void solve(lane A[NX][NX], complex_lane values[NX], lane *norm, lane conditions[NX]) {
    complex_lane T[NX][NX];
    lane z[NX * NX];
    memcpy(z, A, sizeof(z));
    *norm = singular_value(z, NX, 1);
    const mask missed = triangular(A, T, 1);
    conditioned(T, conditions);
    const lane none = {0};
    for (int i = 0; i < NX; i++) values[i] = (complex_lane){chosen(missed, none + NAN, T[i][i].re), T[i][i].im};
}

#endif

static void exchange(double *x, int i, int j, int count) {
    for (int k = 0; k < count; k++) {
        const double t = x[i * count + k];
        x[i * count + k] = x[j * count + k];
        x[j * count + k] = t;
    }
}

/* Make eigenvalues of a real matrix exactly conjugate in pairs, and exactly real if no other eigenvalue is nearer to the
   conjugate. */
static void pair(double *values, double *conditions) {
    for (int i = 0; i < NX; i++) {
        const double re = values[2 * i], im = values[2 * i + 1];
        double least = fabs(2.0 * im);
        int mate = i;
        for (int j = i + 1; j < NX; j++) {
            const double distance = hypot(values[2 * j] - re, values[2 * j + 1] + im);
            if (distance < least) least = distance, mate = j;
        }
        if (mate == i) {
            values[2 * i + 1] = 0.0;
            continue;
        }
        exchange(values, i + 1, mate, 2);
        exchange(conditions, i + 1, mate, 1);
        values[2 * i] = values[2 * i + 2] = (re + values[2 * i + 2]) / 2.0;
        values[2 * i + 1] = (fabs(im) + fabs(values[2 * i + 3])) / 2.0;
        values[2 * i + 3] = -values[2 * i + 1];
        conditions[i] = conditions[i + 1] = fmax(conditions[i], conditions[i + 1]);
        i++;
    }
}

/* Sort by decreasing modulus. Pairs are not separated. */
static void sort(double *values, double *conditions) {
    for (int i = 1; i < NX; i++)
        for (int j = i; j > 0 && hypot(values[2 * j], values[2 * j + 1]) > hypot(values[2 * j - 2], values[2 * j - 1]); j--) {
            exchange(values, j - 1, j, 2);
            exchange(conditions, j - 1, j, 1);
        }
}

void multipliers(const problem *p) {
    for (long first = 0; first < p->count; first += LANES) {
        lane A[NX][NX], norm, conditions[NX];
        complex_lane found[NX];
        const lane unit = taken(p, first, A);
        const lane size = size_of(A) * unit;
        solve(A, found, &norm, conditions);
        for (int l = 0; l < LANES && first + l < p->count; l++) {
            double values[2 * NX], own[NX];
            for (int i = 0; i < NX; i++) {
                values[2 * i] = found[i].re[l] * unit[l], values[2 * i + 1] = found[i].im[l] * unit[l];
                own[i] = conditions[i][l];
            }
            if (NX > 2) {
                pair(values, own);
                sort(values, own);
            }
            memcpy(p->values + (first + l) * 2 * NX, values, sizeof(values));
            p->sizes[first + l] = size[l];
            p->norms[first + l] = norm[l] * unit[l];
            memcpy(p->conditions + (first + l) * NX, own, sizeof(own));
        }
    }
}
