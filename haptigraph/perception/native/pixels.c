/* Passes over the pixels of a whole region: the background is learned, stained tissue is marked and filled.
 */

#include <string.h>

#include "native.h"

#define RATE 0.25f     /* of a new image in the background */
#define CHUNK 256      /* pixels that are learned at once */
#define MIN_FREE 1e-3f /* share of a window that counts as free */

/* Learn what is visible of the background in one region.

   image, channels: BGR or grey, `width` pixels wide, from the region's first pixel on; so are the planes.
   chroma_share: of blue less red in the grey within the globe.
   is_free: pixels of the region that the needle does not occlude, (rows, columns).
   was_visible: pixels that were free before; what is free for the first time is taken as it is.
   grey, chroma: the background, and how much bluer than red it is. */
VECTORS EXPORT void learn_background(const uint8_t *image, int channels, ptrdiff_t width, int rows,
                                     int columns, double chroma_share, const uint8_t *is_inside,
                                     const uint8_t *is_free, uint8_t *restrict was_visible,
                                     float *restrict grey, float *restrict chroma) {
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
VECTORS EXPORT void mark_stains(const uint8_t *image, ptrdiff_t width, int rows, int columns,
                                int min_blue_grey, int min_red_grey, const uint8_t *is_inside,
                                uint8_t *restrict dye, uint8_t *restrict blood, int *counts) {
    const int16_t dye_grey = (int16_t)min_blue_grey, blood_grey = (int16_t)min_red_grey;
    counts[0] = counts[1] = 0;
    for (int row = 0; row < rows; row++) {
        uint8_t any = 0;
        for (int column = 0; column < columns; column++) {
            const uint8_t *pixel = image + 3 * column;
            const int16_t blue = pixel[0], green = pixel[1], red = pixel[2];
            const int16_t cooler = blue - red, bluer = blue - green, redder = red - green;
            dye[column] = (cooler > dye_grey) & (bluer > dye_grey) & is_inside[column];
            blood[column] = (-cooler > blood_grey) & (redder > blood_grey) & is_inside[column];
            any |= dye[column] | blood[column];
        }
        for (int column = 0; any && column < columns; column++) {
            counts[0] += dye[column], counts[1] += blood[column];
        }
        image += 3 * width, is_inside += columns, dye += columns, blood += columns;
    }
}

/* The row or column of an image that a position beyond its border shows: mirrored at the border's middle. */
static int mirrored(int at, int count) {
    while (count > 1 && (at < 0 || at >= count)) at = at < 0 ? -at : 2 * (count - 1) - at;
    return count > 1 ? at : 0;
}

/* Sums over a column of the window: of each colour, and of the number of pixels, (4, columns). */
static void add_row(const uint8_t *image, const uint8_t *is_filled, int columns, int sign, int *sums) {
    int *blue = sums, *green = sums + columns, *red = sums + 2 * columns, *number = sums + 3 * columns;
    for (int column = 0; column < columns; column++) {
        const int counts = is_filled[column] ? 0 : sign;
        blue[column] += counts * image[3 * column];
        green[column] += counts * image[3 * column + 1];
        red[column] += counts * image[3 * column + 2];
        number[column] += counts;
    }
}

/* Fill the marked pixels of a row with the mean of the others in the window about each. */
static void fill_row(const uint8_t *is_filled, int columns, int reach, const int *sums, uint8_t *filled) {
    const double scale = 1.0 / square(2 * reach + 1);
    int window[4] = {0};
    for (int column = -reach; column < reach; column++) {
        for (int k = 0; k < 4; k++) window[k] += sums[k * columns + mirrored(column, columns)];
    }
    for (int column = 0; column < columns; column++) {
        const int last = mirrored(column + reach, columns), first = mirrored(column - reach, columns);
        for (int k = 0; k < 4; k++) window[k] += sums[k * columns + last];
        if (is_filled[column] && window[3]) {
            const float share = (float)maximum((float)(window[3] * scale), MIN_FREE);
            for (int k = 0; k < 3; k++) {
                filled[3 * column + k] = (uint8_t)((float)(window[k] * scale) / share);
            }
        }
        for (int k = 0; k < 4; k++) window[k] -= sums[k * columns + first];
    }
}

/* Fill marked pixels of a region with the mean of the others in a window about each, if there are any.

   image: BGR, `width` pixels wide, from the region's first pixel on; so is `filled`, which receives them.
   is_filled: the marked pixels, (rows, columns).
   reach: of the window to each side; at the region's border, it shows the region mirrored.
   sums: room for four numbers per column. */
VECTORS EXPORT void fill_marked(const uint8_t *image, ptrdiff_t width, int rows, int columns,
                                const uint8_t *is_filled, int reach, int *sums, uint8_t *filled) {
    for (int at = 0; at < 4 * columns; at++) sums[at] = 0;
    for (int row = -reach; row < rows + reach; row++) {
        const int last = mirrored(row, rows), middle = row - reach, first = mirrored(middle - reach, rows);
        add_row(image + 3 * width * last, is_filled + (ptrdiff_t)columns * last, columns, 1, sums);
        if (middle < 0) continue;
        const uint8_t *marked = is_filled + (ptrdiff_t)columns * middle;
        if (memchr(marked, 1, (size_t)columns)) {
            fill_row(marked, columns, reach, sums, filled + 3 * width * middle);
        }
        add_row(image + 3 * width * first, is_filled + (ptrdiff_t)columns * first, columns, -1, sums);
    }
}
