/* Elimination with exchanges of rows, which each lane makes for itself. */

/* Exchange rows, `count` of `width` numbers, so that in some lanes the largest of column k from row k on comes to row k;
   returns which rows these were. */
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

/* Solve so many rows with a right side behind them, of which each keeps what acts on it apart from the others. */
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
