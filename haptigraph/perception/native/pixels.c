/* Passes over the pixels of a whole region: the background is learned, stained tissue is marked. */

#include "native.h"

#define RATE 0.25f /* of a new image in the background */
#define CHUNK 256  /* pixels that are learned at once */

/* Learn what is visible of the background in one region.

   image, channels: BGR or grey, `width` pixels wide, from the region's first pixel on; so are the planes.
   chroma_share: of blue less red in the grey within the globe.
   is_free: pixels of the region that the needle does not occlude, (rows, columns).
   was_visible: pixels that were free before; what is free for the first time is taken as it is.
   grey, chroma: the background, and how much bluer than red it is. */
EXPORT void learn_background(const uint8_t *image, int channels, ptrdiff_t width, int rows, int columns,
                             double chroma_share, const uint8_t *is_inside, const uint8_t *is_free,
                             uint8_t *restrict was_visible, float *restrict grey, float *restrict chroma) {
    const int share = whole_share(chroma_share);
    for (int row = 0; row < rows; row++) {
        for (int start = 0; start < columns; start += CHUNK) {
            const int count = columns - start < CHUNK ? columns - start : CHUNK;
            float seen[CHUNK], bluer[CHUNK], rate[CHUNK];
            const uint8_t *pixel = image + channels * start;
            for (int at = 0; channels == 3 && at < count; at++, pixel += 3) {
                seen[at] = (float)((grey_of(pixel, is_inside[start + at] ? share : 0) + WHOLE / 2) / WHOLE);
                bluer[at] = (float)(pixel[0] - pixel[2]);
            }
            for (int at = 0; channels == 1 && at < count; at++) seen[at] = pixel[at], bluer[at] = 0;
            for (int at = 0; at < count; at++) {
                const float free = is_free[start + at], before = was_visible[start + at];
                rate[at] = free * (1 + before * (RATE - 1));
                was_visible[start + at] |= is_free[start + at];
            }
            for (int at = 0; at < count; at++) {
                grey[start + at] += rate[at] * (seen[at] - grey[start + at]);
                chroma[start + at] += rate[at] * (bluer[at] - chroma[start + at]);
            }
        }
        image += channels * width, is_free += columns;
        is_inside += width, was_visible += width, grey += width, chroma += width;
    }
}

/* Mark what is much bluer than any other colour, dye, and what is much redder, blood.

   image: BGR, `width` pixels wide, from the region's first pixel on.
   is_inside: where tissue is looked for, (rows, columns), as `dye` and `blood`.
   counts: receives the number of marked pixels of each. */
EXPORT void mark_stains(const uint8_t *image, ptrdiff_t width, int rows, int columns, int min_blue_grey,
                        int min_red_grey, const uint8_t *is_inside, uint8_t *restrict dye,
                        uint8_t *restrict blood, int *counts) {
    counts[0] = counts[1] = 0;
    for (int row = 0; row < rows; row++) {
        for (int column = 0; column < columns; column++) {
            const uint8_t *pixel = image + 3 * column;
            const int cooler = pixel[0] - pixel[2];
            dye[column] = blood[column] = 0;
            if (cooler <= min_blue_grey && -cooler <= min_red_grey) continue;
            if (!is_inside[column]) continue;
            counts[0] += dye[column] = cooler > 0 && pixel[0] - pixel[1] > min_blue_grey;
            counts[1] += blood[column] = cooler < 0 && pixel[2] - pixel[1] > min_red_grey;
        }
        image += 3 * width, is_inside += columns, dye += columns, blood += columns;
    }
}
