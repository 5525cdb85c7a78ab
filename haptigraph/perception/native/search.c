/* How much each line of the polar search looks like a needle (`search.PolarSearch`). */

#include "native.h"

#define CONTRAST_GREY 6.0
#define AHEAD 64 /* samples */

/* Write the mean grey of each sampled cell, (rows, cells).

   Samples are in the order of their pixels in memory, and are prefetched: a line's own are far apart, and the
   processor would wait for each. */
static void average_cells(const SearchGrid *grid, const uint8_t *image, int channels, double chroma_share,
                          float *grey) {
    const int chroma[2] = {0, whole_share(chroma_share)};
    for (int cell = 0; cell < grid->rows * grid->cells; cell++) grey[cell] = 0;
    for (int sample = 0; sample < grid->samples; sample++) {
        const int ahead = sample + AHEAD < grid->samples ? sample + AHEAD : sample;
        __builtin_prefetch(image + (ptrdiff_t)channels * grid->pixels[ahead]);
        const uint8_t *pixel = image + (ptrdiff_t)channels * grid->pixels[sample];
        const int value =
            channels == 3 ? grey_of(pixel, chroma[grid->is_inside[sample] != 0]) : WHOLE * pixel[0];
        grey[grid->cells_of[sample]] += (float)value / (CELL * WHOLE);
    }
}

/* Return the greatest evidence accumulated from the first of some cells on. */
static double max_evidence(const SearchGrid *grid, const float *grey, int start, int stop, double light) {
    const int count = grid->rows * grid->cells;
    double sum = 0, max = 0;
    for (int cell = start; cell < stop; cell++) {
        if (!grid->is_observable[cell]) continue;
        const double one = grey[cell] - grey[grid->flanks[cell]];
        const double other = grey[cell] - grey[grid->flanks[count + cell]];
        const double contrast = maximum(minimum(one, other), -maximum(one, other));
        sum += minimum(maximum(contrast, 0) * light / CONTRAST_GREY - 1, 1);
        max = maximum(max, sum);
    }
    return max;
}

/* Write how much each line differs from both its flanks without a gap, inwards from the wall and from the far
   end of the shaft towards it, (rows).

   image, channels: BGR or grey.
   chroma_share: of blue less red in the grey.
   light: how many times brighter the image would be in good light.
   grey: room for the cells. */
EXPORT void score_lines(const SearchGrid *grid, const uint8_t *image, int channels, double chroma_share,
                        double light, float *grey, float *score) {
    average_cells(grid, image, channels, chroma_share, grey);
    for (int row = 0; row < grid->rows; row++) {
        const int first = row * grid->cells, wall = first + grid->trocar, last = first + grid->cells;
        score[row] = (float)(max_evidence(grid, grey, first, wall, light) +
                             max_evidence(grid, grey, wall, last, light));
    }
}
