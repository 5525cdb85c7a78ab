/* Downsampling of a B-scan, and its grey levels. */

#include <string.h>

#include "oct/bscan.h"

#define LEVELS_PER_GREY 4 /* resolution of quantiles */
#define MAX_LEVELS (256 * LEVELS_PER_GREY)

/* Sum the columns of each square. */
static inline void add_groups(const uint16_t *restrict sums, int across, int columns,
                              int32_t *restrict cells) {
    for (int column = 0; column < columns; column++) {
        int32_t sum = 0;
        for (int x = 0; x < across; x++) sum += sums[column * across + x];
        cells[column] = sum;
    }
}

/* Sum the grey of squares of `across` x `down` pixels; `sums` holds one value per column of the image. */
VECTORS EXPORT void sum_squares(const uint8_t *image, int width, int across, int down, int rows, int columns,
                                uint16_t *sums, int32_t *cells) {
    for (int row = 0; row < rows; row++) {
        memset(sums, 0, sizeof *sums * (size_t)width);
        for (int line = 0; line < down; line++, image += width)
            for (int x = 0; x < width; x++) sums[x] = (uint16_t)(sums[x] + image[x]);
        switch (across) { /* constants let the compiler make vectors of them */
            case 1:
                add_groups(sums, 1, columns, cells);
                break;
            case 2:
                add_groups(sums, 2, columns, cells);
                break;
            case 3:
                add_groups(sums, 3, columns, cells);
                break;
            case 4:
                add_groups(sums, 4, columns, cells);
                break;
            default:
                add_groups(sums, across, columns, cells);
        }
        cells += columns;
    }
}

/* Write where the cells along a side begin, in 256ths of a pixel, and where the last one ends. */
static void write_edges(double size_px, int count, int32_t *edges) {
    for (int cell = 0; cell <= count; cell++) edges[cell] = (int32_t)floor(256 * size_px * cell + 0.5);
}

/* Sum the rows of pixels from one edge to another, each by its part between them. */
static inline void sum_rows(const uint8_t *image, int width, int32_t start, int32_t stop,
                            uint32_t *restrict sums) {
    for (int32_t row = start >> 8; row << 8 < stop; row++) {
        const int32_t first = row << 8, last = first + 256;
        const uint16_t part = (uint16_t)((last < stop ? last : stop) - (first > start ? first : start));
        const uint8_t *restrict pixel = image + (ptrdiff_t)row * width;
        if (first <= start)
            for (int x = 0; x < width; x++) sums[x] = (uint16_t)(pixel[x] * part);
        else
            for (int x = 0; x < width; x++) sums[x] += (uint16_t)(pixel[x] * part);
    }
}

/* Write the mean grey of cells of `across` x `down` pixels, at least 1 each way, in steps. Their sizes need
   not be whole, so that they are the same in millimetres for every scanner. `scratch` has room for three
   values of 32 bits per column of the image, one per column and row of cells, and five more. */
VECTORS EXPORT void average_cells(const uint8_t *image, int width, double across, double down, int rows,
                                  int columns, uint64_t *scratch, int32_t *cells) {
    uint64_t *until = scratch; /* running sums of `sums` */
    uint32_t *sums = (uint32_t *)(until + width + 1);
    int32_t *lefts = (int32_t *)(sums + width + 1), *tops = lefts + columns + 1;
    write_edges(across, columns, lefts);
    write_edges(down, rows, tops);
    const int32_t narrow = (int32_t)floor(256 * across); /* the others are wider by one 256th */
    until[0] = sums[width] = 0;                          /* where the last column may end */
    for (int row = 0; row < rows; row++, cells += columns) {
        sum_rows(image, width, tops[row], tops[row + 1], sums);
        for (int x = 0; x < width; x++) until[x + 1] = until[x] + sums[x];
        const double steps = (double)CELL_STEPS / (tops[row + 1] - tops[row]);
        const double scales[2] = {steps / narrow, steps / (narrow + 1)};
        int64_t before = 0;
        for (int column = 0; column < columns; column++) {
            const int32_t right = lefts[column + 1], x = right >> 8;
            const int64_t after = (int64_t)(256 * until[x] + (uint64_t)(right & 255) * sums[x]);
            const int is_wide = right - lefts[column] > narrow;
            cells[column] = (int32_t)((double)(after - before) * scales[is_wide] + 0.5);
            before = after;
        }
    }
}

/* Return the level below which a share of all counted values lies. */
static int level_of(const int *counts, int total, double share) {
    int below = 0, level = 0;
    for (const int rank = (int)(share * (total - 1)); level < MAX_LEVELS - 1; level++)
        if ((below += counts[level]) > rank) break;
    return level;
}

/* Write quantiles of the grey value of columns, 25 % and 4 %, the median difference of neighbours, and 95 %.
 */
EXPORT void cell_levels(const Grid *grid, double *levels_grey) {
    int counts[MAX_LEVELS] = {0}, differences[MAX_LEVELS] = {0}, total = 0, pairs = 0;
    const double level = (double)LEVELS_PER_GREY / CELL_STEPS;
    for (int row = 0; row < grid->rows; row += 2) {
        const int32_t *cells = grid->cells + (ptrdiff_t)row * grid->columns;
        for (int start = 0; start + grid->group <= grid->columns; start += 2 * grid->group, total++) {
            int64_t sum = 0;
            for (int cell = 0; cell < grid->group; cell++) sum += cells[start + cell];
            counts[clamped((double)sum * level / grid->group, 0, MAX_LEVELS - 1)]++;
            if (start + 1 < grid->columns) {
                differences[clamped(fabs((double)cells[start] - cells[start + 1]) * level, 0,
                                    MAX_LEVELS - 1)]++;
                pairs++;
            }
        }
    }
    levels_grey[0] = (level_of(counts, total, 0.25) + 0.5) / LEVELS_PER_GREY;
    levels_grey[1] = (level_of(counts, total, 0.04) + 0.5) / LEVELS_PER_GREY;
    levels_grey[3] = (level_of(counts, total, 0.95) + 0.5) / LEVELS_PER_GREY;
    levels_grey[2] = pairs ? (level_of(differences, pairs, 0.5) + 0.5) / LEVELS_PER_GREY : 0.0;
}
