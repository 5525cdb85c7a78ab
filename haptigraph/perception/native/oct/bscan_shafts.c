/* The shaft of a needle among the ridges of a B-scan. Metal blocks the light: a ridge with tissue below it is
   the ghost of a needle, or none. */

#include <stdlib.h>

#include "oct/bscan.h"

/* A ridge that may be a shaft, up to its first gap. */
typedef struct {
    Shaft shaft;
    double end_x, side; /* column of its end; 1 if it comes from the left, else -1 */
    double evidence;
} Candidate;

/* Return the (upper) median of the first values of which one is given; `chosen` has room for all. */
static float median_of(const float *values, const uint8_t *is_given, int count, double *chosen) {
    int given = 0;
    for (int at = 0; at < count; at++)
        if (!is_given || is_given[at]) chosen[given++] = values[at];
    return given ? (float)median(chosen, given) : 0;
}

/* Mark the steps that are as bright as a ridge, and dark beside. */
static void mark_steps(const float *contrast, const float *brighter, int steps, const ShaftSearch *search,
                       double dark_grey, double *chosen, uint8_t *is_ridge) {
    const float least = (float)search->min_contrast_grey, dark = (float)dark_grey;
    int count = 0;
    for (int at = 0; at < steps; at++) {
        is_ridge[at] = (uint8_t)(contrast[at] > least && brighter[at] < dark);
        count += is_ridge[at];
    }
    if (!count) return;
    /* the vitreous beside it may be bright, but its speckle is no shaft */
    const float typical = median_of(contrast, is_ridge, steps, chosen);
    const float bright = (float)maximum(search->min_contrast_grey, typical / 2.0);
    const float equal = (float)(search->equal_share * typical);
    for (int at = 0; at < steps; at++)
        is_ridge[at] = (uint8_t)(contrast[at] > bright && (is_ridge[at] || contrast[at] > equal));
}

/* Write the part of a ridge that starts near the image's border; return whether it is long enough. */
static int is_candidate(const float *contrast, const float *brighter, const RidgeSearch *ridges,
                        const ShaftSearch *search, double *chosen, uint8_t *is_ridge, Candidate *candidate) {
    const RidgeLine *line = &candidate->shaft.line;
    mark_steps(contrast, brighter, line->stations, search, ridges->dark_grey, chosen, is_ridge);
    int start = -1, end = -1, count = 0;
    for (int at = 0; at < line->stations; at++) {
        if (!is_ridge[at]) continue;
        if (start < 0) start = at;
        if (count && at - end > search->gap_steps && at > search->start_steps) break;
        count++;
        end = at;
    }
    if (start < 0 || start > search->start_steps || end < search->least_steps) return 0;
    candidate->shaft.share = (double)count / (end + 1 - start);
    candidate->shaft.end_steps = end;
    candidate->shaft.typical_grey = median_of(contrast, NULL, end + 1, chosen);
    candidate->end_x = line->start_px[0] + end * ridges->step_px * line->along_px[0];
    candidate->side = copysign(1, line->along_px[0]);
    candidate->evidence = 0;
    for (int at = 0; at < end; at++) candidate->evidence += maximum(contrast[at], 0);
    return candidate->shaft.share >= search->min_ridge_share &&
           candidate->shaft.typical_grey > search->min_contrast_grey;
}

/* Return the row at which a line crosses a column. */
static inline double row_at(const RidgeLine *line, double x_px) {
    const double dx = line->along_px[0] != 0 ? line->along_px[0] : 1e-9;
    return line->start_px[1] + line->along_px[1] / dx * (x_px - line->start_px[0]);
}

/* Remove the columns in which a thick ridge was mistaken for tissue. */
static void leave_out(const Candidate *candidate, double most_rows, const SurfacePair *surfaces) {
    const RidgeLine *line = &candidate->shaft.line;
    const double length = candidate->side * (candidate->end_x - line->start_px[0]);
    const double *x_px = surfaces->x_px, half = surfaces->columns > 1 ? (x_px[1] - x_px[0]) / 2 : 0;
    for (int column = 0; column < surfaces->columns; column++) {
        const double x = surfaces->x_px[column], before = candidate->side * (candidate->end_x - x);
        if (!(before >= -half && before <= length)) continue;
        if (fabs(surfaces->ilm_px[column] - row_at(line, x)) < most_rows)
            surfaces->ilm_visible[column] = surfaces->rpe_visible[column] = 0;
    }
}

/* Return whether it is dark below a candidate, before a column. */
static int is_dark_below(const Candidate *candidate, const uint8_t *image, int width, int height,
                         const ShaftSearch *search, double last_x) {
    const RidgeLine *line = &candidate->shaft.line;
    if (candidate->side * (last_x - line->start_px[0]) < 0) return 1;
    const double left = minimum(line->start_px[0], last_x), right = maximum(line->start_px[0], last_x);
    const int first = clamped(nearbyint(left), 0, width), stop = clamped(nearbyint(right) + 1, first, width);
    const float floor_grey = (float)search->floor_grey, limit = (float)(search->tissue_grey / 2);
    int bright = 0;
    for (int column = first; column < stop; column++) {
        const double upper = row_at(line, column) + search->below_shaft_rows;
        const int top = clamped(upper, 0, height), bottom = clamped(upper + search->dark_rows, 0, height);
        const uint8_t *pixel = image + (ptrdiff_t)top * width + column;
        int sum = 0;
        for (int row = top; row < bottom; row++, pixel += width) sum += *pixel;
        if (bottom > top) bright += (float)sum / (float)(bottom - top) - floor_grey > limit;
    }
    return stop == first || (double)bright / (stop - first) <= search->max_tissue_share;
}

/* Return whether no tissue is visible where a needle would shadow it. */
static int casts_shadow(const Candidate *candidate, const uint8_t *image, int width, int height,
                        const ShaftSearch *search, const SurfacePair *surfaces) {
    const double last_x = candidate->end_x - candidate->side * search->margin_px;
    int hidden = 0, visible = 0, tissue = 0;
    for (int column = 0; column < surfaces->columns; column++) {
        const double x = surfaces->x_px[column];
        const int is_hidden = candidate->side * (last_x - x) > 0, is_visible = surfaces->ilm_visible[column];
        hidden += is_hidden;
        visible += is_visible;
        tissue += is_hidden && is_visible &&
                  surfaces->ilm_px[column] > row_at(&candidate->shaft.line, x) + search->below_shaft_rows;
    }
    if (tissue > search->max_tissue_share * (hidden < visible ? hidden : visible)) return 0;
    return is_dark_below(candidate, image, width, height, search, last_x);
}

/* Write the last row of the grid in which a ridge is searched, by its columns. */
static void limit_rows(const Grid *grid, const RidgeSearch *search, int height, const SurfacePair *surfaces,
                       double *ilm_px, int32_t *limit_row) {
    for (int column = 0; column < surfaces->columns; column++)
        ilm_px[column] = surfaces->ilm_visible[column] ? surfaces->ilm_px[column] : height;
    for (int column = 0; column < grid->columns; column++) {
        const double x = (column + 0.5) * search->across - 0.5;
        const double row = between(surfaces->x_px, ilm_px, surfaces->columns, x);
        limit_row[column] = clamped((row + search->below_ilm_px) / search->down, 0, grid->rows);
    }
}

/* Find the shaft: of the ridges that may be one and cast a shadow, that with most evidence.

   Write it, and the contrast and brighter side of all ridges, (MAX_RIDGES, room); columns in which a ridge
   was mistaken for tissue are no longer visible. Return 1; 0 if there is none, -1 without memory. */
EXPORT int find_shaft(const uint8_t *image, int width, int height, const Grid *grid,
                      const RidgeSearch *ridges, const ShaftSearch *search, const SurfacePair *surfaces,
                      int room, Shaft *shaft, float *contrast, float *brighter) {
    const size_t columns = (size_t)surfaces->columns, length = (size_t)room;
    double *memory = malloc((columns + length) * sizeof *memory + (size_t)grid->columns * 4 + length);
    if (!memory) return -1;
    double *chosen = memory + columns;
    int32_t *limit_row = (int32_t *)(chosen + length);
    uint8_t *is_ridge = (uint8_t *)(limit_row + grid->columns);
    RidgeLine lines[MAX_RIDGES];
    Candidate candidates[MAX_RIDGES];
    limit_rows(grid, ridges, height, surfaces, memory, limit_row);
    const int found =
        find_ridges(image, width, height, grid, ridges, limit_row, room, lines, contrast, brighter);
    int count = 0;
    for (int number = 0; number < found; number++) {
        const ptrdiff_t first = (ptrdiff_t)number * room;
        candidates[count].shaft = (Shaft){.line = lines[number], .number = number};
        count += is_candidate(contrast + first, brighter + first, ridges, search, chosen, is_ridge,
                              candidates + count);
    }
    free(memory);
    for (int number = 0; number < count; number++)
        leave_out(candidates + number, search->on_ridge_rows, surfaces);
    const Candidate *best = NULL;
    for (const Candidate *one = candidates; one < candidates + count; one++)
        if (casts_shadow(one, image, width, height, search, surfaces) &&
            (!best || one->evidence > best->evidence))
            best = one;
    if (best) *shaft = best->shaft;
    return found < 0 ? -1 : best != NULL;
}
