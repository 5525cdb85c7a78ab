/* How far the tip of a bevelled needle lies below the line of its shaft, in the tip's column of a B-scan. */

#include <stdlib.h>

#include "oct/bscan.h"

#define MAX_COLUMN_ROWS 4096 /* in the column of a tip: values per row that lie on the stack */

/* A bright run of rows. */
typedef struct {
    double start, end, grey; /* rows from the shaft's line; brightest grey */
} Spot;

/* Write the mean of a span of columns in rows from top to before bottom. The parts of columns count, so that
   the span is as wide in scans of any resolution. */
static void mean_rows(const uint8_t *image, int width, double left, double right, int top, int bottom,
                      double *means) {
    left = maximum(0, minimum(left + 0.5, width - 1)); /* from the edge of the image on */
    right = maximum(left + 1, minimum(right + 0.5, width));
    const int first = (int)left, last = clamped(ceil(right) - 1, first, width - 1);
    const double first_part = first + 1 - left, last_part = right - last;
    for (int row = top; row < bottom; row++) {
        const uint8_t *pixel = image + (ptrdiff_t)row * width;
        int sum = 0;
        for (int column = first + 1; column < last; column++) sum += pixel[column];
        const double ends = first_part * pixel[first] + (last > first ? last_part * pixel[last] : 0);
        *means++ = (sum + ends) / (right - left);
    }
}

/* Average values over a window of rows, whose outermost may count in part. */
static void smooth(const double *values, int count, double rows, double *means) {
    const int reach = clamped(ceil(rows / 2 - 0.5), 0, count);
    for (int row = 0; row < count; row++) {
        double sum = 0, total = 0;
        for (int off = -reach; off <= reach; off++) {
            if (row + off < 0 || row + off >= count) continue;
            const double part = minimum(1, rows / 2 + 0.5 - abs(off));
            sum += part * values[row + off];
            total += part;
        }
        means[row] = sum / total;
    }
}

/* Return a run of rows with its lower end at half of its brightness, sub-pixel. */
static Spot spot_of(const double *profile, int count, int first, int last, double top) {
    int peak = first;
    for (int row = first; row <= last; row++) peak = profile[row] > profile[peak] ? row : peak;
    const double grey = profile[peak];
    double end = count - 1;
    for (int row = peak + 1; row < count; row++)
        if (profile[row] <= grey / 2) {
            end = row - 1 + (profile[row - 1] - grey / 2) / maximum(profile[row - 1] - profile[row], 1e-6);
            break;
        }
    return (Spot){top + first, top + end, grey};
}

/* Write the drop of the lowest spot that belongs to the metal: of some that begin on the line, brightest
   `upper_grey` and the last one ending at `upper_end`, and of the brightest one below them. */
static void drop_of(const BevelSearch *search, int has_upper, double upper_end, double upper_grey,
                    const Spot *lower, double *drop) {
    const double spot = search->spot_rows, end = has_upper ? upper_end : 0;
    drop[0] = end > spot ? end : 0;
    drop[1] = end > spot ? search->spot_sd_rows : end > spot / 2 ? end / 2 : 0;
    if (!lower) return;
    /* a bevel's second part, or a floater: the uncertainty covers both */
    drop[1] = maximum((lower->end - drop[0]) / 2, search->spot_sd_rows);
    if (!has_upper || lower->grey >= search->equal_share * upper_grey) {
        drop[0] = lower->end;
        drop[1] = search->spot_sd_rows;
    }
}

/* Write how many rows a tip above the retina, whose line crosses its column at (x, y), lies below that line,
   and the standard deviation. */
EXPORT void drop_in_vitreous(const uint8_t *image, int width, int height, const BevelSearch *search, double x,
                             double y, double ilm_px, double typical_grey, double *drop) {
    drop[0] = drop[1] = 0;
    const int upper = clamped(nearbyint(y) - nearbyint(search->above_rows), 0, height);
    const double end = minimum(minimum(nearbyint(y) + search->wall_rows, ilm_px - 2), height);
    const int count = clamped(nearbyint(end), 0, height) - upper;
    if (count < 6 || count > MAX_COLUMN_ROWS) return;
    double values[MAX_COLUMN_ROWS], profile[MAX_COLUMN_ROWS];
    mean_rows(image, width, x - search->half_px, x + search->half_px, upper, upper + count, values);
    for (int row = 0; row < count; row++) values[row] -= search->floor_grey;
    smooth(values, count, search->smooth_rows, profile);
    qsort(values, (size_t)count, sizeof *values, compare_doubles);
    const double bright = maximum(values[count / 4], 0) + search->bright_share * typical_grey;
    const double top = upper - y, most = maximum(2, nearbyint(search->spot_rows / 3));
    int has_upper = 0, has_lower = 0;
    double upper_end = 0, upper_grey = 0;
    Spot lower = {0};
    for (int row = 0; row < count; row++) {
        if (!(profile[row] > bright)) continue;
        int last = row;
        for (int next = row + 1; next < count && next - last <= most; next++)
            if (profile[next] > bright) last = next;
        const Spot spot = spot_of(profile, count, row, last, top);
        row = last;
        if (spot.start <= search->spot_rows) {
            upper_end = spot.end;
            upper_grey = has_upper ? maximum(upper_grey, spot.grey) : spot.grey;
            has_upper = 1;
        } else if (!has_lower || spot.grey > lower.grey) {
            lower = spot;
            has_lower = 1;
        }
    }
    drop_of(search, has_upper, upper_end, upper_grey, has_lower ? &lower : NULL, drop);
}

/* Return the variance of the steps of a profile between rows so far apart. */
static double variance_of_steps(const double *values, int count, int apart) {
    const double mean = (values[count - 1] - values[0]) / (count - 1) * apart;
    double sum = 0;
    for (int at = apart; at < count; at++) sum += square(values[at] - values[at - apart] - mean);
    return sum / (count - apart);
}

/* Write a span of columns beside the tip, from one end to the other; return whether the image has it. */
static int span_of(double x, double one, double other, int width, double *left, double *right) {
    *left = x + minimum(one, other);
    *right = x + maximum(one, other);
    return *left >= 0 && *right < width - 1;
}

/* Write the same of a tip in tissue: where, in its column, tissue in the light ends. `side` is 1 if the
   needle comes from the left, else -1. */
EXPORT void drop_in_tissue(const uint8_t *image, int width, int height, const BevelSearch *search, double x,
                           double y, double side, double *drop) {
    drop[0] = drop[1] = 0;
    const int top = clamped(nearbyint(y + search->spot_rows / 2), 0, height);
    const int count = clamped(nearbyint(y + (search->wall_rows + search->below_rows)), 0, height) - top;
    const double *ahead = search->ahead_px, half = search->half_px;
    double left, right, left_ahead, right_ahead;
    if (count < 12 || count <= 2 * search->apart_rows || count > MAX_COLUMN_ROWS ||
        !span_of(x, -side * half, side * half, width, &left, &right) ||
        !span_of(x, side * ahead[0], side * ahead[1], width, &left_ahead, &right_ahead))
        return;
    double full[MAX_COLUMN_ROWS], loss[MAX_COLUMN_ROWS], total = 0, sum = 0, upper = 0, most = 0, lit = 0;
    mean_rows(image, width, left, right, top, top + count, loss);
    mean_rows(image, width, left_ahead, right_ahead, top, top + count, full);
    for (int row = 0; row < count; row++) total += loss[row] = full[row] - loss[row];
    int end = 0;
    for (int rows = 1; rows < count; rows++) {
        sum += loss[rows - 1];
        const double above = sum / rows, below = (total - sum) / (count - rows);
        if (rows == 1) upper = above;
        const double gain = below > above ? (double)rows * (count - rows) / count * square(below - above) : 0;
        if (gain <= most) continue;
        most = gain;
        upper = above;
        end = rows - 1;
    }
    for (int row = 0; row <= end; row++) lit += full[row] / (end + 1);
    const double rows = top + end + 0.5 - y;
    if (!(upper < (1 - search->lit_share) * (lit - search->floor_grey))) return;
    const double noise = variance_of_steps(loss, count, search->apart_rows) / 2;
    if (!(most > search->min_gain * noise && rows > search->spot_rows)) return;
    drop[0] = rows;
    drop[1] = rows / 3;
}
