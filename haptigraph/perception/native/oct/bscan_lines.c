/* The surfaces of a B-scan as they are reported: lines from the first to the last visible column, extended
   below the tip, with the layers between them. */

#include <stdlib.h>

#include "oct/bscan.h"

/* One line, by vertex. */
typedef struct {
    double *x_px, *row_px, *sd_px;
    uint8_t *is_visible;
    int count;
} Line;

/* Return the row of a surface beyond its visible part, parallel to the line above it or, without one, by the
   slope of its last columns there, if it has so many: the `number` of its visible columns, first to last. */
static double beyond(const Columns *surface, const Line *above, const int *seen, int number,
                     const LineLimits *limits, double x_px) {
    const int slope_columns = limits->slope_columns;
    const int after = x_px > surface->x_px[seen[number - 1]];
    const int *end = seen + (after ? number - slope_columns : 0);
    if (number <= slope_columns) return surface->row_px[seen[after ? number - 1 : 0]];
    if (above->count) {
        double sum = 0, total = 0;
        for (int one = 0; one < slope_columns; one++) {
            const int at = end[one];
            const double weight = surface->sd_px ? 1 / maximum(square(surface->sd_px[at]), 1e-9) : 1;
            const double row = between(above->x_px, above->row_px, above->count, surface->x_px[at]);
            sum += weight * (surface->row_px[at] - row);
            total += weight;
        }
        return between(above->x_px, above->row_px, above->count, x_px) + sum / total;
    }
    double x_mean = 0, row_mean = 0, product = 0, spread = 0;
    for (int one = 0; one < slope_columns; one++) {
        x_mean += surface->x_px[end[one]] / slope_columns;
        row_mean += surface->row_px[end[one]] / slope_columns;
    }
    for (int one = 0; one < slope_columns; one++) {
        product += (surface->x_px[end[one]] - x_mean) * (surface->row_px[end[one]] - row_mean);
        spread += square(surface->x_px[end[one]] - x_mean);
    }
    return row_mean + product / spread * (x_px - x_mean);
}

static double uncertain(double sd_px, const LineLimits *limits, double distance_px) {
    return sqrt(square(sd_px) + square(limits->slope_sd * distance_px));
}

/* Write one vertex. */
static void add(Line *line, double x_px, double row_px, double sd_px, int is_visible) {
    line->x_px[line->count] = x_px;
    line->row_px[line->count] = row_px;
    line->sd_px[line->count] = sd_px;
    line->is_visible[line->count++] = (uint8_t)is_visible;
}

/* Write a surface from its first to its last visible column, extended to the tip; nothing if that is too far
   from what is visible. The line above it may be empty. `seen` has a value per column. */
static void trace(const Columns *surface, const Line *above, const LineLimits *limits, int *seen,
                  Line *line) {
    int number = 0, next = 0;
    double nearest_px = INFINITY;
    for (int column = 0; column < surface->count; column++) {
        if (!surface->is_visible[column]) continue;
        seen[number++] = column;
        nearest_px = minimum(nearest_px, fabs(surface->x_px[column] - limits->tip_px));
    }
    line->count = 0;
    if (!number || nearest_px > (above->count ? limits->parallel_px : limits->alone_px)) return;
    const double *x = surface->x_px, *row = surface->row_px, *sd = surface->sd_px;
    const int first = seen[0], last = seen[number - 1];
    const double before = limits->tip_px - limits->beyond_px, after = limits->tip_px + limits->beyond_px;
    const int goes_before = x[first] > before;
    if (goes_before)
        add(line, before, beyond(surface, above, seen, number, limits, before),
            uncertain(sd ? sd[first] : NAN, limits, x[first] - before), 0);
    for (int column = first; column <= last; column++) {
        if (surface->is_visible[column]) {
            add(line, x[column], row[column], sd ? sd[column] : NAN, 1);
            next++;
            continue;
        }
        const int left = seen[next - 1], right = seen[next];
        const double off = x[column] - x[left], rest = x[right] - x[column];
        const double share = off / (off + rest);
        const double sd_px = sd ? sd[left] + share * (sd[right] - sd[left]) : NAN;
        add(line, x[column], row[left] + share * (row[right] - row[left]),
            uncertain(sd_px, limits, minimum(off, rest)), 0);
    }
    if (!goes_before && after > x[last])
        add(line, after, beyond(surface, above, seen, number, limits, after),
            uncertain(sd ? sd[last] : NAN, limits, after - x[last]), 0);
}

/* Write the vertices and standard deviations of a line in millimetres; y follows after room for all x. */
static void write_line(const Line *line, const LineLimits *limits, size_t room, double *points_mm,
                       double *sds_mm) {
    for (int at = 0; at < line->count; at++) {
        points_mm[at] = (line->x_px[at] - limits->center_px[0]) * limits->right_mm;
        points_mm[room + (size_t)at] = (limits->center_px[1] - line->row_px[at]) * limits->down_mm;
        sds_mm[at] = nearbyint(limits->down_mm * line->sd_px[at] * SD_STEPS_PER_MM) / SD_STEPS_PER_MM;
    }
}

/* Write the ranges of a line that are not visible, from x to x in millimetres; return how many. */
static int write_ranges(const Line *line, const LineLimits *limits, double *ranges_mm) {
    int count = 0;
    for (int at = 0; at < line->count; at++) {
        if (line->is_visible[at]) continue;
        const double from = line->x_px[at > 0 ? at - 1 : 0];
        while (at < line->count && !line->is_visible[at]) at++;
        const double to = line->x_px[at < line->count ? at : line->count - 1];
        ranges_mm[2 * count] = (from - limits->center_px[0]) * limits->right_mm;
        ranges_mm[2 * count++ + 1] = (to - limits->center_px[0]) * limits->right_mm;
    }
    return count;
}

/* Write the lines of ILM and RPE, and of two layers at shares of the way between them, as vertices x, y and
   standard deviations, (4, 2, columns + 1) and (4, columns + 1) [mm]; the ranges of ILM and RPE that are not
   visible, (2, columns, 2); and how many vertices and ranges ILM and RPE have, (4). Return whether there was
   memory. */
EXPORT int surface_lines(const Columns *ilm, const Columns *rpe, const LineLimits *limits, double *points_mm,
                         double *sds_mm, double *ranges_mm, int32_t *counts) {
    const size_t columns = (size_t)ilm->count, room = columns + 1;
    double *memory = malloc(room * (8 * sizeof(double) + 2) + columns * sizeof(int));
    if (!memory) return 0;
    int *seen = (int *)(memory + 8 * room);
    uint8_t *visible = (uint8_t *)(seen + columns);
    Line lines[2] = {{memory, memory + room, memory + 2 * room, visible, 0},
                     {memory + 3 * room, memory + 4 * room, memory + 5 * room, visible + room, 0}};
    const Line none = {0};
    for (int number = 0; number < 2; number++) {
        trace(number ? rpe : ilm, number ? lines : &none, limits, seen, lines + number);
        write_line(lines + number, limits, room, points_mm + 2 * number * room, sds_mm + number * room);
        counts[number] = lines[number].count;
        counts[2 + number] = write_ranges(lines + number, limits, ranges_mm + 2 * number * columns);
    }
    const Line *top = lines, *bottom = lines + 1;
    for (int number = 0; number < 2 && top->count && bottom->count; number++) {
        const double share = limits->shares[number];
        const Line layer = {bottom->x_px, memory + 6 * room, memory + 7 * room, bottom->is_visible,
                            bottom->count};
        for (int at = 0; at < layer.count; at++) {
            const double x = layer.x_px[at], row = between(top->x_px, top->row_px, top->count, x);
            const double sd = between(top->x_px, top->sd_px, top->count, x);
            layer.row_px[at] = row + share * (bottom->row_px[at] - row);
            layer.sd_px[at] = sqrt(square((1 - share) * sd) + square(share * bottom->sd_px[at]));
        }
        write_line(&layer, limits, room, points_mm + 2 * (2 + number) * room, sds_mm + (2 + number) * room);
    }
    free(memory);
    return 1;
}
