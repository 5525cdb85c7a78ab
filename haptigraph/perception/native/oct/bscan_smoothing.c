/* Surfaces in a B-scan, smoothed over their visible columns, without specks. */

#include "oct/bscan.h"

/* Return the mean of values over the visible columns of a window; that of the column itself weighs little. */
static double window_mean(const double *values, const uint8_t *visible, int columns, const double *window,
                          int reach, int column) {
    const int first = column < reach ? 0 : column - reach;
    const int last = column + reach < columns ? column + reach : columns - 1;
    double total = 1e-6, sum = 1e-6 * values[column];
    for (int other = first; other <= last; other++)
        if (visible[other]) {
            total += window[other - column + reach];
            sum += window[other - column + reach] * values[other];
        }
    return sum / total;
}

/* Return the row, in a visible column, of the straight line through the visible columns of a window: their
   mean would be that of a column further from the end of what is visible. */
static double window_line(const double *rows, const uint8_t *visible, int columns, const double *window,
                          int reach, int column) {
    const int first = column < reach ? 0 : column - reach;
    const int last = column + reach < columns ? column + reach : columns - 1;
    double total = 0, offsets = 0, spread = 0, sum = 0, product = 0;
    for (int other = first; other <= last; other++) {
        if (!visible[other]) continue;
        const double weight = window[other - column + reach], offset = other - column;
        total += weight;
        offsets += weight * offset;
        spread += weight * offset * offset;
        sum += weight * rows[other];
        product += weight * offset * rows[other];
    }
    const double determinant = total * spread - offsets * offsets;
    return determinant > 1e-9 ? (spread * sum - offsets * product) / determinant : rows[column];
}

void smooth_rows(double *rows, const uint8_t *visible, int columns, const Smoothing *smoothing,
                 double *scratch, double *sd) {
    double *smooth = scratch, *misses = scratch + columns;
    for (int column = 0; column < columns; column++) {
        smooth[column] = (visible[column] ? window_line : window_mean)(
            rows, visible, columns, smoothing->window, smoothing->reach, column);
        misses[column] = square(rows[column] - smooth[column]);
    }
    for (int column = 0; column < columns; column++) {
        const double variance =
            window_mean(misses, visible, columns, smoothing->window, smoothing->reach, column);
        sd[column] = sqrt(square(smoothing->least_sd_rows) + square(smoothing->scatter_share) * variance);
        rows[column] = smooth[column];
    }
}

/* Return where the run of a mask that begins at a column, or has one value there, ends. */
static int run_end(const uint8_t *mask, int columns, int start) {
    int stop = start;
    while (stop < columns && mask[stop] == mask[start]) stop++;
    return stop;
}

/* Take runs of less than so many columns out of a mask; half are enough for one that may go on: at the mask's
   border, or beside a longer run behind a gap as narrow as the shadow of a vessel. */
EXPORT void remove_specks(uint8_t *mask, int columns, int least) {
    const int narrow = (least + 1) / 2;
    int beside = 0; /* the run before is long enough */
    for (int start = 0, end = 0; start < columns; start = end) {
        end = run_end(mask, columns, start);
        if (!mask[start]) {
            beside = beside && end - start < narrow;
            continue;
        }
        const int next = end < columns ? run_end(mask, columns, end) : columns;
        const int is_long = next < columns && run_end(mask, columns, next) - next >= least;
        const int goes_on = start == 0 || end == columns || beside || (is_long && next - end < narrow);
        beside = end - start >= least;
        for (int column = start; end - start < (goes_on ? narrow : least) && column < end; column++)
            mask[column] = 0;
    }
}
