/* Singular values of matrices with NX columns, LANES matrices at a time. */

#define ANGLE 1e-4                 /* cosine between columns below which their norms count as singular values */

/* This code takes little time to run but long to compile. Therefore, it is optimised less. */
#pragma GCC push_options
#pragma GCC optimize("O2")

/* Largest or smallest singular value of a matrix with NX columns, which Jacobi rotations make orthogonal (M. R. Hestenes,
   J. SIAM 6 (1958) 51-90). */
static lane singular_value(lane *z, int count, int largest) {
    mask open = ~(mask){0};
    for (int sweep = 0; any(open) && sweep < 30; sweep++) {
        open = (mask){0};
        for (int i = 0; i < NX; i++)
            for (int j = i + 1; j < NX; j++) {
                lane first = {0}, second = {0}, both = {0};
                for (int k = 0; k < count; k++) {
                    const lane x = z[k * NX + i], y = z[k * NX + j];
                    first += x * x, second += y * y, both += x * y;
                }
                const mask off = absolute(both) > ANGLE * root(first * second);
                open |= off;
                if (!any(off)) continue;
                const lane ratio = (second - first) / (2.0 * both);
                const lane small = 1.0 / (absolute(ratio) + root(1.0 + ratio * ratio));
                const mask negative = ratio < 0.0;
                const lane t = (lane)(((mask)(-small) & negative & off) | ((mask)small & ~negative & off));
                const lane c = 1.0 / root(1.0 + t * t), s = c * t;
                for (int k = 0; k < count; k++) {
                    const lane x = z[k * NX + i], y = z[k * NX + j];
                    z[k * NX + i] = c * x - s * y;
                    z[k * NX + j] = s * x + c * y;
                }
            }
    }
    lane found = {0};
    for (int i = 0; i < NX; i++) {
        lane square = {0};
        for (int k = 0; k < count; k++) square += z[k * NX + i] * z[k * NX + i];
        found = !i ? square : largest ? larger(found, square) : -larger(-found, -square);
    }
    return root(found);
}

#pragma GCC pop_options
