/* How much each line of the polar search looks like a needle (`search.PolarSearch`). */

#include "native.h"

#define CONTRAST_GREY 6.0
#define CHUNK 64  /* pixels that are read at once, */
#define AHEAD 128 /* and how many before it they are fetched: a new image is in no cache */
#define STEP 3    /* about so many are in one line of the cache */

typedef int32_t Word __attribute__((aligned(1), may_alias)); /* a pixel and the byte behind it */

/* Return the grey of a pixel, blue in the lowest byte, as a share of its cell's. */
static inline float share_of(int pixel, int chroma) {
    return (float)grey_of_color(pixel & 255, pixel >> 8 & 255, pixel >> 16 & 255, chroma) / (CELL * WHOLE);
}

/* Write the mean grey of each sampled cell, (rows, cells).

   Pixels are read in the order of memory, once, and fetched before: those of a line are far apart, and the
   processor would wait for each. Loading four bytes at once takes half the time; the last pixel has no byte
   behind it. */
static void average_cells(const SearchGrid *grid, const uint8_t *image, int channels, double chroma_share,
                          float *restrict shares, float *restrict grey) {
    const int chroma = whole_share(chroma_share), count = grid->pixel_count;
    const int loaded = channels == 3 && count ? count - 1 : 0;
    const int32_t *pixels = grid->pixels;
    const uint8_t *is_inside = grid->is_inside;
    for (int start = 0; start < loaded; start += CHUNK) {
        const int stop = start + CHUNK < loaded ? start + CHUNK : loaded;
        for (int number = stop + AHEAD; number < stop + AHEAD + CHUNK && number < count; number += STEP) {
            __builtin_prefetch(image + 3 * pixels[number], 0, 2);
        }
        for (int number = start; number < stop; number++) {
            const int pixel = *(const Word *)(image + 3 * pixels[number]);
            shares[number] = share_of(pixel, is_inside[number] ? chroma : 0);
        }
    }
    for (int number = loaded; number < count; number++) {
        const uint8_t *first = image + (ptrdiff_t)channels * pixels[number], *last = first + channels - 1;
        const int pixel = first[0] | first[channels / 2] << 8 | *last << 16;
        shares[number] = share_of(pixel, is_inside[number] ? chroma : 0);
    }
    for (int number = 0; number < grid->sampled_count; number++) {
        const int32_t *samples = grid->samples + CELL * number;
        float sum = 0;
        for (int sample = 0; sample < CELL; sample++) sum += shares[samples[sample]];
        grey[grid->sampled[number]] = sum;
    }
}

/* Return the greatest evidence accumulated from the first of some cells on; no cell adds more than 1. */
static double max_evidence(const SearchGrid *grid, const float *grey, int start, int stop, double light) {
    const int count = grid->rows * grid->cells;
    double sum = 0, max = 0;
    for (int cell = start; cell < stop; cell++) {
        if (!grid->is_observable[cell]) continue;
        const double one = grey[cell] - grey[grid->flanks[cell]];
        const double other = grey[cell] - grey[grid->flanks[count + cell]];
        const double contrast = maximum(minimum(one, other), -maximum(one, other));
        sum += minimum(maximum(contrast, 0) * light / CONTRAST_GREY - 1, 1);
        if (sum < max - (stop - cell)) break;
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
VECTORS EXPORT void score_lines(const SearchGrid *grid, const uint8_t *image, int channels,
                                double chroma_share, double light, float *shares, float *grey, float *score) {
    average_cells(grid, image, channels, chroma_share, shares, grey);
    for (int row = 0; row < grid->rows; row++) {
        const int first = row * grid->cells, wall = first + grid->trocar, last = first + grid->cells;
        score[row] = (float)(max_evidence(grid, grey, first, wall, light) +
                             max_evidence(grid, grey, wall, last, light));
    }
}
