/* Elimination with exchanges of rows, separately in each lane. */

/* Exchange rows, `count` of `width` numbers each, in some lanes, so that row k contains the largest entry of column k
   among the rows from k on. Returns the rows that were exchanged with row k. */
static inline mask exchange_rows(lane *rows, int count, int width, int k, mask some) {
    lane largest = absolute(rows[k * width + k]);
    mask best = (mask){0} + k;
    for (int i = k + 1; i < count; i++) {
        const lane a = absolute(rows[i * width + k]);
        const mask larger = (a > largest) & some;
        largest = chosen(larger, a, largest);
        best = (best & ~larger) | (((mask){0} + i) & larger);
    }
    const int other = any(best ^ k);
    for (int i = k + 1; other && i < count; i++) {
        const mask this = best == i;
        if (!any(this)) continue;
        for (int j = 0; j < width; j++) {
            const lane x = rows[k * width + j], y = rows[i * width + j];
            rows[k * width + j] = chosen(this, y, x);
            rows[i * width + j] = chosen(this, x, y);
        }
    }
    return best;
}

/* Solve a system of `count` rows; the last column is the right-hand side. */
static inline void solve_rows(lane *rows, int count, lane *x) {
    const int width = count + 1;
    for (int k = 0; k < count; k++) {
        exchange_rows(rows, count, width, k, ~(mask){0});
        for (int i = k + 1; i < count; i++) {
            const lane factor = rows[i * width + k] / rows[k * width + k];
            for (int j = k + 1; j < width; j++) rows[i * width + j] -= factor * rows[k * width + j];
        }
    }
    for (int k = count - 1; k >= 0; k--) {
        x[k] = rows[k * width + count];
        for (int j = k + 1; j < count; j++) x[k] -= rows[k * width + j] * x[j];
        x[k] /= rows[k * width + k];
    }
}
