/* The edge of a needle's shadow on the tissue below it. */

#include <stdlib.h>

#include "oct/bscan.h"

#define UPPER_SHARE 0.85 /* the edge's width is counted between these shares of its contrast */
#define LOWER_SHARE 0.25
#define MIN_COLUMNS 8

/* One surface by column. */
typedef struct {
    const double *x_px, *row_px;
    const uint8_t *is_visible;
    int columns;
} Surface;

/* Return the slope of a surface by least squares over `count` visible columns, from the first on or, with
   step -1, from the last on back; 0 if there are fewer. Write the column it is counted from. */
static double end_slope(const Surface *surface, int count, int step, int *from) {
    double x_sum = 0, row_sum = 0, product = 0, spread = 0;
    for (int pass = 0; pass < 2; pass++) {
        int seen = 0;
        const double x_mean = x_sum / count, row_mean = row_sum / count;
        for (int at = step > 0 ? 0 : surface->columns - 1; at >= 0 && at < surface->columns && seen < count;
             at += step) {
            if (!surface->is_visible[at]) continue;
            if (!seen++) *from = at;
            if (pass) {
                product += (surface->x_px[at] - x_mean) * (surface->row_px[at] - row_mean);
                spread += square(surface->x_px[at] - x_mean);
            } else {
                x_sum += surface->x_px[at];
                row_sum += surface->row_px[at];
            }
        }
        if (seen < count) return 0;
    }
    return product / maximum(spread, 1e-9);
}

/* Write a surface's rows in some columns of the image, extrapolated where it is not visible. Return whether
   it is visible at all. */
static int trace(const Surface *surface, const EdgeSearch *search, int first, int count, double *rows) {
    int left = -1, right = -1;
    const double left_slope = end_slope(surface, search->slope_columns, 1, &left);
    const double right_slope = end_slope(surface, search->slope_columns, -1, &right);
    if (left < 0) return 0;
    for (int number = 0, next = left, last = left; number < count; number++) {
        const double x = first + number;
        while (next < right && surface->x_px[next] < x) {
            last = next;
            do next++;
            while (!surface->is_visible[next]);
        }
        double rise;
        if (x <= surface->x_px[left] || x >= surface->x_px[right]) {
            const int end = x <= surface->x_px[left] ? left : right;
            rise = (end == left ? left_slope : right_slope) * (x - surface->x_px[end]);
            rise = maximum(-search->most_rows, minimum(rise, search->most_rows));
            rows[number] = surface->row_px[end] + rise;
            continue;
        }
        rise = surface->row_px[next] - surface->row_px[last];
        rows[number] = surface->row_px[last] +
                       rise * (x - surface->x_px[last]) / (surface->x_px[next] - surface->x_px[last]);
    }
    return 1;
}

/* Write the range of columns in which the edge may be; return their number, 0 without visible tissue. */
static int range_of(const Surface *ilm, const Surface *rpe, const EdgeSearch *search, double side, int width,
                    int *first) {
    double nearest = INFINITY, furthest = -INFINITY;
    const double slope = search->along_px[1] / search->along_px[0];
    for (int at = 0; at < ilm->columns; at++) {
        const double ahead = side * (ilm->x_px[at] - search->end_x);
        if (!ilm->is_visible[at] || ahead <= -search->margin_px) continue;
        nearest = minimum(nearest, ahead);
        const double floor_row = rpe->is_visible[at] ? rpe->row_px[at] : ilm->row_px[at] + search->thick_rows;
        if (search->start_px[1] + slope * (ilm->x_px[at] - search->start_px[0]) < floor_row)
            furthest = maximum(furthest, ahead);
    }
    if (!(nearest <= search->max_distance_px)) return 0;
    const double near = search->end_x - side * search->margin_px;
    const double far = search->end_x + side * (maximum(nearest, furthest) + search->window_px);
    *first = clamped(minimum(near, far) + 0.5, 0, width);
    return clamped(maximum(near, far) + 1.5, *first, width) - *first;
}

/* Write the mean grey of each column's part that the shadow of a needle darkens; NaN where it has no rows. */
static void profile_of(const uint8_t *image, int width, int height, const EdgeSearch *search, int first,
                       int count, const double *ilm, const double *rpe, double *profile) {
    const double slope = search->along_px[1] / search->along_px[0];
    for (int number = 0; number < count; number++) {
        const double shaft = search->start_px[1] + slope * (first + number - search->start_px[0]);
        double top = maximum(ilm[number] + search->below_rows, shaft + search->below_shaft_rows);
        double bottom = top + search->deep_rows;
        if (rpe) {
            top = minimum(top, rpe[number]);
            bottom = minimum(top + search->deep_rows, rpe[number] + search->below_rpe_rows);
        }
        const int start = clamped(top + 0.5, 0, height), stop = clamped(bottom + 0.5, 0, height);
        const uint8_t *pixel = image + (ptrdiff_t)start * width + first + number;
        int sum = 0;
        for (int row = start; row < stop; row++, pixel += width) sum += *pixel;
        profile[number] = stop > start ? (double)sum / (stop - start) : NAN;
    }
}

/* Return where a profile first reaches a level from start on, sub-pixel; NaN if it does not before stop. */
static double crossing(const double *profile, int start, int stop, double level) {
    for (int at = start; at < stop; at++)
        if (profile[at] >= level) {
            const double share =
                at ? (level - profile[at - 1]) / maximum(profile[at] - profile[at - 1], 1e-6) : 0;
            return at ? at - 1 + maximum(0, minimum(share, 1)) : 0;
        }
    return NAN;
}

/* Return where a dark profile first rises and stays bright, NaN if it does not, and write the rise's width.
 */
static double first_rise(const double *profile, int count, const EdgeSearch *search, double *ordered,
                         double *width) {
    const int run = search->run;
    if (count <= run) return NAN;
    for (int at = 0; at < count; at++) ordered[at] = profile[at];
    qsort(ordered, (size_t)count, sizeof *ordered, compare_doubles);
    const double low = ordered[run / 2], range = ordered[count * 4 / 5] - low;
    if (range < search->min_contrast_grey) return NAN;
    const double level = low + maximum(search->min_contrast_grey, search->rise_share * range) / 2;
    double sum = 0;
    int first = 0;
    for (int at = 0; at < count && first == 0; at++) {
        sum += profile[at] - (at >= run ? profile[at - run] : 0);
        if (at >= run - 1 && sum > level * run) first = at - run + 1;
        if (at == run - 1 && sum > level * run) break; /* it begins bright */
    }
    const int start = first > 2 ? first - 2 : 0, stop = first + 3 * run < count ? first + 3 * run : count;
    double bright = 0;
    for (int at = first + run / 2; at < stop; at++) bright += profile[at];
    const double contrast = bright / (stop - first - run / 2) - low;
    const double half_light = square(contrast) / maximum(contrast + search->halved_grey, 1e-6);
    const double at = crossing(profile, start, stop, low + half_light);
    if (!(at > 0)) return NAN;
    const double upper = crossing(profile, (int)at, stop, low + UPPER_SHARE * contrast);
    int lower = (int)at;
    while (lower > 0 && profile[lower] > low + LOWER_SHARE * contrast) lower--;
    *width = (upper >= 0 ? upper : stop) - lower;
    return at;
}

/* Find the shadow's edge near the end of a shaft. Write its column and its width; return 1, 0 if there is
   none, -1 without memory. */
EXPORT int shadow_edge(const uint8_t *image, int width, int height, const EdgeSearch *search,
                       const SurfacePair *pair, double *edge_px) {
    const Surface ilm = {pair->x_px, pair->ilm_px, pair->ilm_visible, pair->columns};
    const Surface rpe = {pair->x_px, pair->rpe_px, pair->rpe_visible, pair->columns};
    const double side = search->along_px[0] < 0 ? -1 : 1;
    int first = 0, count = range_of(&ilm, &rpe, search, side, width, &first);
    if (count < search->window_px) return 0;
    double *memory = malloc(4 * sizeof *memory * (size_t)count);
    if (!memory) return -1;
    double *floor_rows = memory + count, *profile = floor_rows + count, *smooth = profile + count;
    trace(&ilm, search, first, count, memory);
    const int has_floor = trace(&rpe, search, first, count, floor_rows);
    profile_of(image, width, height, search, first, count, memory, has_floor ? floor_rows : NULL, profile);
    int valid = 0;
    while (count && isnan(profile[0])) profile++, first++, count--;
    while (valid < count && !isnan(profile[valid])) valid++;
    for (int at = valid; at < count; at++) valid = isnan(profile[at]) ? valid : 0; /* a gap */
    const int length = 2 * search->half + 1;
    double at = NAN;
    if (valid >= MIN_COLUMNS && valid > length) {
        for (int number = 0; number <= valid - length; number++) {
            double sum = 0;
            for (int other = number; other < number + length; other++)
                sum += profile[side > 0 ? other : valid - 1 - other];
            smooth[number] = sum / length;
        }
        at = first_rise(smooth, valid - length + 1, search, memory, edge_px + 1) + search->half;
        edge_px[0] = side > 0 ? first + at : first + valid - 1 - at;
    }
    free(memory);
    return at > 0;
}
