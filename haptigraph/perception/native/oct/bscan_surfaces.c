/* ILM and RPE in a downsampled B-scan, as best paths from left to right by dynamic programming (Bellman
   1957), as for retinal layers in OCT: Chiu et al. 2010, Optics Express 18(18).

   A path has one row per column and maximizes the sum of rewards less the cost of steps. */

#include <stdlib.h>
#include <string.h>

#include "oct/bscan.h"

#define EXCLUDED (-1e9f)
#define FALL_SHARE 0.5f  /* of the reward for the end of the RPE's band */
#define UPPER_SHARE 0.8f /* of the reward of a path, for one above it */

/* Compress large differences; `share` is one over the limit. */
static inline float saturating(float grey, float share) { return grey / (fabsf(grey) * share + 1); }

/* Return how far a rise counts: not up to the least, in full from twice the least on. */
static inline float evidence(float rise, float least) {
    const float share = rise / least - 1;
    return share < 0 ? 0 : share < 1 ? share : 1;
}

/* Return the mean grey of a column's rows from start to before stop, from its running sums. */
static inline float mean(const int32_t *sums, int start, int stop, float scale) {
    return (float)(sums[stop] - sums[start]) * (scale / (float)(stop - start));
}

/* Write a column's sums over its rows so far; above the image its first row repeats, and below it the darker
   of its last two: one bright row there may be a streak. */
static inline void sum_column(const Grid *grid, int column, int group, int above, int below, int32_t *sums) {
    const int32_t *cells = grid->cells + (ptrdiff_t)column * group;
    int32_t sum = 0, value = 0, before = 0;
    for (int cell = 0; cell < group; cell++) value += cells[cell];
    *sums++ = 0;
    for (int row = 0; row < above; row++) *sums++ = sum += value;
    for (int row = 0; row < grid->rows; row++, cells += grid->columns) {
        before = value;
        value = 0;
        for (int cell = 0; cell < group; cell++) value += cells[cell];
        *sums++ = sum += value;
    }
    if (before < value) value = before;
    for (int row = 0; row < below; row++) *sums++ = sum += value;
}

/* Write the running sums of all columns, `stride` values each. */
static void running_sums(const Grid *grid, int above, int below, int stride, int32_t *sums) {
    const int group = grid->group, columns = grid->columns / group;
    for (int column = 0; column < columns; column++, sums += stride)
        if (group == 2) /* nearly always; a constant spares the compiler a loop */
            sum_column(grid, column, 2, above, below, sums);
        else
            sum_column(grid, column, group, above, below, sums);
}

/* Let it be dark above the image if a column begins with tissue, so that its ILM is at the image's top. */
static void darken_above(int32_t *sums, int deep, double tissue, int32_t dark) {
    if (sums[deep + deep / 2] - sums[deep] > tissue * (deep / 2))
        for (int row = 0; row < deep; row++) sums[row] = sums[deep] - dark * (deep - row);
}

/* Write the best gain of a path to each row, given those to the rows of the previous column. */
static void advance(const float *restrict before, const float *restrict cost, int most, int rows,
                    const float *restrict reward, float *restrict best) {
    for (int row = 0; row < rows; row++) best[row] = before[row - most] - cost[0];
    for (int step = 1; step <= 2 * most; step++)
        for (int row = 0; row < rows; row++) {
            const float gain = before[row - most + step] - cost[step];
            best[row] = gain > best[row] ? gain : best[row];
        }
    for (int row = 0; row < rows; row++) best[row] += reward[row];
}

/* Write the row of the best path in each column; a step costs `cost` from -most to most, more is excluded.
   Return whether there was memory. */
VECTORS EXPORT int best_path(const float *reward, int columns, int rows, int most, const float *cost,
                             int32_t *path) {
    const int stride = rows + 2 * most;
    float *memory = malloc(sizeof *memory * (size_t)columns * (size_t)stride);
    if (!memory) return 0;
    for (float *at = memory; at < memory + (ptrdiff_t)columns * stride; at += stride)
        for (int row = 0; row < most; row++) at[row] = at[stride - 1 - row] = EXCLUDED;
    float *best = memory + most;
    for (int row = 0; row < rows; row++) best[row] = reward[row];
    for (int column = 1; column < columns; column++, best += stride)
        advance(best, cost, most, rows, reward + (ptrdiff_t)column * rows, best + stride);
    int row = 0;
    for (int other = 1; other < rows; other++) row = best[other] > best[row] ? other : row;
    for (int column = columns - 1; column > 0; column--) {
        path[column] = row;
        best -= stride;
        int to = row - most;
        for (int step = 1; step <= 2 * most; step++)
            if (best[row - most + step] - cost[step] > best[to] - cost[to - row + most])
                to = row - most + step;
        row = to < 0 ? 0 : to < rows ? to : rows - 1; /* if gains are not comparable */
    }
    path[0] = row;
    free(memory);
    return 1;
}

/* Find the best path where a step costs its square. */
static int best_rows(const float *reward, int columns, int rows, int most, double step_grey, int32_t *path) {
    float cost[2 * MAX_STEP_ROWS + 1] = {0};
    for (int step = 0; step <= 2 * most; step++) cost[step] = (float)(step_grey * square(step - most));
    return best_path(reward, columns, rows, most, cost, path);
}

/* Return the position of the largest value within a row of a path, by a parabola through it. */
static double peak_near(const float *values, int count, int row) {
    const int low = row < 2 ? 2 : row > count - 3 ? count - 3 : row;
    int best = low - 1;
    for (int other = low; other <= low + 1; other++) best = values[other] > values[best] ? other : best;
    const double before = values[best - 1], at = values[best], after = values[best + 1];
    const double curvature = before - 2 * at + after;
    const double offset = curvature < 0 ? 0.5 * (before - after) / curvature : 0;
    return best + maximum(-0.5, minimum(offset, 0.5));
}

/* Write step, rise and reward of the ILM in each row of a column, from its running sums at its first row. In
   the reward, a rise counts as far as it is abrupt, which that of a haze is not. */
static void reward_ilm(const int32_t *restrict sums, int rows, const SurfaceSearch *search, float scale,
                       float *restrict step, float *restrict rise, float *restrict reward) {
    const float dark = (float)search->dark_grey, limit = 1 / (float)search->saturation_grey;
    const float share = (float)search->body_share;
    const int deep = search->deep, half = deep / 2, edge = search->edge;
    for (int row = 0; row < rows; row++) {
        const float upper = mean(sums + row, 0, half, scale), lower = mean(sums + row, half, deep, scale);
        const float above = mean(sums + row, -deep, 0, scale) - dark; /* metal is bright, too, but thin */
        const float body = (upper < lower ? upper : lower) - dark;
        step[row] = mean(sums + row, 0, edge, scale) - mean(sums + row, -edge, 0, scale);
        rise[row] = body - (above > 0 ? above : 0);
        const float abrupt = rise[row] < step[row] ? rise[row] : step[row];
        reward[row] = saturating(step[row], limit) + saturating(abrupt, limit) + share * body;
    }
}

/* Move a path to the one above it if that is nearly as good in columns with tissue: it follows the RPE then,
   where a haze hides much of the ILM's step. Return whether there was memory. */
static int prefer_upper(const float *reward, const float *rise, int columns, int rows,
                        const SurfaceSearch *search, int32_t *path) {
    const int span = search->thickest - search->thinnest;
    const size_t count = (size_t)columns;
    float *part = calloc(count * (size_t)span + count, 4);
    if (!part) return 0;
    int32_t *upper = (int32_t *)(part + count * (size_t)span);
    for (int column = 0; column < columns; column++) {
        const int top = path[column] - search->thickest;
        const float *from = reward + (ptrdiff_t)column * rows + top;
        for (int row = top < 0 ? -top : 0; row < span; row++)
            part[(ptrdiff_t)column * span + row] = from[row];
    }
    const int found = best_rows(part, columns, span, search->most, search->step_grey, upper);
    float of_path = 0, of_upper = 0;
    for (int column = 0; found && column < columns; column++) {
        const ptrdiff_t at = (ptrdiff_t)column * rows + path[column];
        if (rise[at] < search->min_rise_grey) continue;
        of_path += reward[at];
        of_upper += part[(ptrdiff_t)column * span + upper[column]];
    }
    for (int column = 0; found && of_upper > UPPER_SHARE * of_path && column < columns; column++)
        path[column] = clamped(path[column] - search->thickest + upper[column], 0, rows - 1);
    free(part);
    return found;
}

/* Return a quantile of the values of some columns, of all if `of` is NULL; 0 for none. */
static float quantile(const float *values, const uint8_t *of, int columns, double share, float *ordered) {
    int count = 0;
    for (int column = 0; column < columns; column++)
        if (!of || of[column]) ordered[count++] = values[column];
    qsort(ordered, (size_t)count, sizeof *ordered, compare_floats);
    return count ? ordered[(int)(share * (count - 1))] : 0;
}

/* Return the least rise of tissue, given that along a path. */
static float least_rise(const SurfaceSearch *search, const float *rise, int columns, float *ordered) {
    const float typical = quantile(rise, NULL, columns, 0.9, ordered);
    return (float)maximum(search->min_rise_grey, search->min_rise_share * typical);
}

/* Find the ILM: the first step from dark to bright with bright tissue below. `sums` are the running sums of
   each column, `stride` values each, from `deep` rows above the image on.

   Write its sub-pixel row in each column, and how much brighter it is below than above [grey levels]. Return
   whether there was memory. */
static int find_ilm(const Grid *grid, const SurfaceSearch *search, int32_t *sums, int stride, double *ilm,
                    float *rise_grey, float *ordered) {
    const int columns = grid->columns / grid->group, rows = grid->rows, deep = search->deep;
    const size_t count = (size_t)columns * (size_t)rows;
    float *reward = calloc(3 * count + (size_t)columns, sizeof *reward);
    if (!reward) return 0;
    float *step = reward + count, *rise = step + count;
    int32_t *path = (int32_t *)(rise + count);
    const int steps = CELL_STEPS * grid->group;
    for (int column = 0; column < columns; column++) {
        const ptrdiff_t first = (ptrdiff_t)column * rows;
        darken_above(sums, deep, search->top_grey * steps, (int32_t)(search->dark_grey * steps));
        reward_ilm(sums + deep, rows, search, 1 / (float)steps, step + first, rise + first, reward + first);
        sums += stride;
    }
    int found = best_rows(reward, columns, rows, search->most, search->step_grey, path);
    for (int column = 0; found && column < columns; column++)
        rise_grey[column] = rise[(ptrdiff_t)column * rows + path[column]];
    const float least = least_rise(search, rise_grey, columns, ordered);
    for (size_t at = 0; at < count; at++) reward[at] *= evidence(rise[at], least);
    found = found && best_rows(reward, columns, rows, search->most, search->step_grey, path) &&
            prefer_upper(reward, rise, columns, rows, search, path);
    for (int column = 0; found && column < columns; column++) {
        const ptrdiff_t first = (ptrdiff_t)column * rows;
        ilm[column] = peak_near(step + first, rows, path[column]);
        rise_grey[column] = rise[first + path[column]];
    }
    free(reward);
    return found;
}

/* Write rise, fall and reward of the RPE in each row of a column, from its running sums at its first row. */
static void reward_rpe(const int32_t *restrict sums, int rows, const SurfaceSearch *search, float least,
                       float scale, float *restrict rise, float *restrict fall, float *restrict reward) {
    const float limit = 1 / (float)search->saturation_grey;
    const int band = search->band, edge = search->edge;
    for (int row = 0; row < rows; row++) {
        const float body = mean(sums + row, 0, band, scale);
        const float step = mean(sums + row, 0, edge, scale) - mean(sums + row, -edge, 0, scale);
        rise[row] = body - mean(sums + row, -band, 0, scale);
        fall[row] = body - mean(sums + row, 2 * band, 4 * band, scale);
        const float sum = saturating(step, limit) + saturating(rise[row], limit) +
                          FALL_SHARE * saturating(fall[row], limit);
        reward[row] = sum * evidence(rise[row] < fall[row] ? rise[row] : fall[row], least);
    }
}

/* Find the RPE: the upper edge of the bright band below the ILM. `sums` are the running sums of each column,
   `stride` values each, from the image's first row on.

   Write its sub-pixel row in each column, and by how much the band is brighter than above and below it.
   Return whether there was memory. */
static int find_rpe(const Grid *grid, const SurfaceSearch *search, const int32_t *sums, int stride,
                    const double *ilm, const uint8_t *visible, float least, double *rpe, float *rise_grey,
                    float *fall_grey) {
    const int columns = grid->columns / grid->group, band = search->band, end = grid->rows;
    const int above = band > search->edge ? band : search->edge, rows = search->thickest - search->thinnest;
    const size_t count = (size_t)columns * (size_t)rows;
    float *reward = calloc(3 * count + (size_t)columns, sizeof *reward);
    if (!reward) return 0;
    float *rise = reward + count, *fall = rise + count;
    int32_t *path = (int32_t *)(fall + count);
    const float scale = 1 / (float)(CELL_STEPS * grid->group);
    for (int column = 0; column < columns; column++) {
        const int first = clamped(ilm[column] + 0.5, 0, end) + search->thinnest;
        const int from = first < above ? above - first : 0, to = end - 2 * band - first;
        const ptrdiff_t at = (ptrdiff_t)column * rows + from;
        if (!visible[column] || to <= from) continue;
        reward_rpe(sums + (ptrdiff_t)column * stride + first + from, (to < rows ? to : rows) - from, search,
                   least, scale, rise + at, fall + at, reward + at);
    }
    const int found = best_rows(reward, columns, rows, search->most, search->rpe_step_grey, path);
    for (int column = 0; found && column < columns; column++) {
        const ptrdiff_t at = (ptrdiff_t)column * rows;
        rpe[column] =
            peak_near(rise + at, rows, path[column]) + clamped(ilm[column] + 0.5, 0, end) + search->thinnest;
        rise_grey[column] = rise[at + path[column]];
        fall_grey[column] = fall[at + path[column]];
    }
    free(reward);
    return found;
}

/* Average values over three visible columns: the speckle of one says little of a band. */
static void average_visible(float *values, const uint8_t *visible, int columns, float *kept) {
    memcpy(kept, values, sizeof *kept * (size_t)columns);
    for (int column = 0; column < columns; column++) {
        const float before = column > 0 && visible[column - 1] ? kept[column - 1] : kept[column];
        const float after = column + 1 < columns && visible[column + 1] ? kept[column + 1] : kept[column];
        values[column] = (before + 2 * kept[column] + after) / 4;
    }
}

/* Find both surfaces.

   Write their rows and standard deviations in rows of the grid, (4, columns): of the ILM, of the RPE, and
   the same of the standard deviations; where they are visible, (2, columns); and the contrast of visible
   tissue against what is dark. Return whether there was memory. */
VECTORS EXPORT int find_surfaces(const Grid *grid, const SurfaceSearch *search, double *rows,
                                 uint8_t *visible, double *tissue_grey) {
    const int columns = grid->columns / grid->group;
    const size_t count = (size_t)columns;
    const int deep = search->deep, below = deep > 4 * search->band ? deep : 4 * search->band;
    const int stride = deep + grid->rows + below + 1;
    double *scratch = malloc(count * (2 * sizeof *scratch + (3 + (size_t)stride) * sizeof(float)));
    if (!scratch) return 0;
    float *rise = (float *)(scratch + 2 * count), *fall = rise + count, *ordered = fall + count;
    int32_t *sums = (int32_t *)(ordered + count);
    running_sums(grid, deep, below, stride, sums);
    double *ilm = rows, *rpe = rows + columns;
    uint8_t *is_tissue = visible, *is_band = visible + columns;
    int found = find_ilm(grid, search, sums, stride, ilm, rise, ordered);
    float least = least_rise(search, rise, columns, ordered);
    for (int column = 0; column < columns; column++) is_tissue[column] = rise[column] >= least;
    remove_specks(is_tissue, columns, search->min_columns);
    *tissue_grey = quantile(rise, is_tissue, columns, 0.5, ordered);
    smooth_rows(ilm, is_tissue, columns, &search->ilm, scratch, rows + 2 * count);
    least = (float)maximum(search->min_band_share * *tissue_grey, search->min_band_grey);
    found = found && find_rpe(grid, search, sums + deep, stride, ilm, is_tissue, least, rpe, rise, fall);
    average_visible(fall, is_tissue, columns, ordered);
    for (int column = 0; column < columns; column++)
        is_band[column] = is_tissue[column] && rise[column] > least && fall[column] > least &&
                          rpe[column] < grid->rows - 2 * search->band;
    smooth_rows(rpe, is_band, columns, &search->rpe, scratch, rows + 3 * count);
    remove_specks(is_band, columns, search->min_columns);
    for (int column = 0; column < columns; column++) is_tissue[column] &= ilm[column] >= search->border_rows;
    remove_specks(is_tissue, columns, search->min_columns);
    free(scratch);
    return found;
}
