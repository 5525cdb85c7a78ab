/* How much every line of a fan looks like a needle (`fan.Fan`). */

#include "native.h"

#define CELL 4 /* samples along a line that are looked at together, as in fan.py */
#define CONTRAST_GREY 6.0
#define AHEAD 64 /* samples */

/* Where a fan lies in the image, as `fan.Fan` packs it. */
typedef struct {
    const int32_t *pixels;   /* numbers of the samples' pixels in the image, rising, (n) */
    const int32_t *cells_of; /* numbers of the samples' cells, (n) */
    const uint8_t *is_bluer; /* samples in which blue less red counts, (n) */
    const int32_t *flanks;   /* numbers of the cells on either side of every one, (2, rows, cells) */
    const uint8_t *is_told;  /* cells that tell something, (rows, cells) */
    int n, rows, cells;
    int trocar; /* cells of a row before it are outside of the eye */
} Layout;

/* Put the mean grey of every cell that is sampled into `grey`, (rows, cells).

   Samples come in the order in which their pixels lie in memory, and these are called for in time: a line's
   own are far apart, and each would have to be waited for. */
static void unroll(const Layout *layout, const uint8_t *image, int channels, double chroma_share,
                   float *grey) {
    const int more[2] = {0, whole_share(chroma_share)};
    for (int cell = 0; cell < layout->rows * layout->cells; cell++) grey[cell] = 0;
    for (int sample = 0; sample < layout->n; sample++) {
        const int ahead = sample + AHEAD < layout->n ? sample + AHEAD : sample;
        __builtin_prefetch(image + (ptrdiff_t)channels * layout->pixels[ahead]);
        const uint8_t *pixel = image + (ptrdiff_t)channels * layout->pixels[sample];
        const int value = channels == 3 ? grey_of(pixel, more[layout->is_bluer[sample]]) : WHOLE * pixel[0];
        grey[layout->cells_of[sample]] += (float)value / (CELL * WHOLE);
    }
}

/* Return how much evidence there is from the first of some cells on, up to where it is most. */
static double longest(const Layout *layout, const float *grey, int start, int stop, double light) {
    const int count = layout->rows * layout->cells;
    double sum = 0, most = 0;
    for (int cell = start; cell < stop; cell++) {
        if (!layout->is_told[cell]) continue;
        const double one = grey[cell] - grey[layout->flanks[cell]];
        const double other = grey[cell] - grey[layout->flanks[count + cell]];
        const double contrast = largest(least(one, other), -largest(one, other));
        sum += least(largest(contrast, 0) * light / CONTRAST_GREY - 1, 1);
        most = largest(most, sum);
    }
    return most;
}

/* Put how much every line differs from both its sides, without a gap, inwards from the wall and from the far
   end of the shaft towards it, into `score`, (rows).

   image, channels: BGR or grey.
   chroma_share: of blue less red in the grey.
   light: how many times brighter the image would be in good light.
   grey: room for the cells. */
EXPORT void score_fan(const Layout *layout, const uint8_t *image, int channels, double chroma_share,
                      double light, float *grey, float *score) {
    unroll(layout, image, channels, chroma_share, grey);
    for (int row = 0; row < layout->rows; row++) {
        const int first = row * layout->cells, wall = first + layout->trocar, last = first + layout->cells;
        score[row] =
            (float)(longest(layout, grey, first, wall, light) + longest(layout, grey, wall, last, light));
    }
}
