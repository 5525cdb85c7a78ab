/* How much each line of the polar search looks like a needle (`search.PolarSearch`). */

#include "native.h"

#define CONTRAST_GREY 6.0
#define AHEAD 64 /* pixels */

/* Write the mean grey of each sampled cell, (rows, cells).

   Pixels are read in the order of memory, once, and are prefetched: those of a line are far apart, and the
   processor would wait for each. */
static void average_cells(const SearchGrid *grid, const uint8_t *image, int channels, double chroma_share,
                          float *shares, float *grey) {
    const int chroma[2] = {0, whole_share(chroma_share)};
    for (int number = 0; number < grid->pixel_count; number++) {
        const int ahead = number + AHEAD < grid->pixel_count ? number + AHEAD : number;
        __builtin_prefetch(image + (ptrdiff_t)channels * grid->pixels[ahead]);
        const uint8_t *pixel = image + (ptrdiff_t)channels * grid->pixels[number];
        const int value =
            channels == 3 ? grey_of(pixel, chroma[grid->is_inside[number] != 0]) : WHOLE * pixel[0];
        shares[number] = (float)value / (CELL * WHOLE);
    }
    for (int number = 0; number < grid->sampled_count; number++) {
        const int32_t *samples = grid->samples + CELL * number;
        float sum = 0;
        for (int sample = 0; sample < CELL; sample++) sum += shares[samples[sample]];
        grey[grid->sampled[number]] = sum;
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
   shares, grey: room for the pixels, and for the cells. */
EXPORT void score_lines(const SearchGrid *grid, const uint8_t *image, int channels, double chroma_share,
                        double light, float *shares, float *grey, float *score) {
    average_cells(grid, image, channels, chroma_share, shares, grey);
    for (int row = 0; row < grid->rows; row++) {
        const int first = row * grid->cells, wall = first + grid->trocar, last = first + grid->cells;
        score[row] = (float)(max_evidence(grid, grey, first, wall, light) +
                             max_evidence(grid, grey, wall, last, light));
    }
}
