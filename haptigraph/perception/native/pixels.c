/* Passes over the pixels of a whole region: the background is learned, stained tissue is marked and filled.
 */

#include <string.h>

#include "native.h"

#define RATE 0.25f       /* of a new image in the background */
#define CHUNK 256        /* pixels that are learned at once */
#define RUN 64           /* pixels that are looked at together: most show no stain */
#define AHEAD 4          /* rows that are fetched before they are needed: none is in the cache after a wait */
#define SAMPLES_AHEAD 16 /* the same of pixels far apart */
#define LINE 64          /* bytes that are fetched at once */
#define MIN_FREE 1e-3f   /* share of a window that counts as free */

/* Begin to load some values into the cache's second level: the first would overflow. */
static inline void fetch(const void *first, ptrdiff_t bytes) {
    for (ptrdiff_t at = 0; at < bytes; at += LINE) __builtin_prefetch((const char *)first + at, 0, 2);
}

static inline void write_grey(const uint8_t *blue, const uint8_t *green, const uint8_t *red, int share,
                              const uint8_t *is_inside, int count, float *restrict grey) {
    for (int at = 0; at < count; at++) {
        const int whole = grey_of_color(blue[at], green[at], red[at], is_inside[at] ? share : 0);
        grey[at] = (float)((whole + WHOLE / 2) / WHOLE);
    }
}

/* Write the grey of some pixels, and how much bluer than red they are. */
static void read_pixels(const uint8_t *image, int channels, int share, const uint8_t *is_inside, int count,
                        float *restrict grey, float *restrict bluer) {
    uint8_t blue[CHUNK], green[CHUNK], red[CHUNK];
    if (channels == 1) {
        for (int at = 0; at < count; at++) grey[at] = image[at], bluer[at] = 0;
        return;
    }
    for (int at = 0; at < count; at++) {
        blue[at] = image[3 * at], green[at] = image[3 * at + 1], red[at] = image[3 * at + 2];
    }
    if (share) {
        write_grey(blue, green, red, share, is_inside, count, grey);
    } else {
        write_grey(blue, green, red, 0, is_inside, count, grey); /* compiled to half as much */
    }
    for (int at = 0; at < count; at++) bluer[at] = (float)(blue[at] - red[at]);
}

/* Write the rate at which each pixel is learned, and that it was visible. */
static void rates_of(const uint8_t *is_free, uint8_t *restrict was_visible, int count, float *restrict rate) {
    uint8_t usual = 1;
    for (int at = 0; at < count; at++) usual &= is_free[at] & was_visible[at];
    for (int at = 0; at < count; at++) rate[at] = RATE;
    if (usual) return;
    for (int at = 0; at < count; at++) {
        const float free = is_free[at], before = was_visible[at];
        rate[at] = free * (1 + before * (RATE - 1));
        was_visible[at] |= is_free[at];
    }
}

static void approach(const float *seen, const float *rate, int count, float *restrict plane) {
    for (int at = 0; at < count; at++) plane[at] += rate[at] * (seen[at] - plane[at]);
}

/* Learn what is visible of the background in one region.

   image, channels: BGR or grey, `width` pixels wide, from the region's first pixel on; so are the planes.
   chroma_share: of blue less red in the grey within the globe.
   is_free: pixels of the region that the needle does not occlude, (rows, columns); NULL if it is elsewhere.
   was_visible: pixels that were free before; what is free for the first time is taken as it is.
   grey, chroma: the background, and how much bluer than red it is; NULL if that is not learned. */
VECTORS EXPORT void learn_background(const uint8_t *image, int channels, ptrdiff_t width, int rows,
                                     int columns, double chroma_share, const uint8_t *is_inside,
                                     const uint8_t *is_free, uint8_t *was_visible, float *grey,
                                     float *chroma) {
    const int share = whole_share(chroma_share);
    float seen[CHUNK], bluer[CHUNK], rate[CHUNK];
    uint8_t all_free[CHUNK];
    memset(all_free, 1, sizeof all_free);
    for (int row = 0; row < rows; row++) {
        for (int start = 0; start < columns; start += CHUNK) {
            const int count = columns - start < CHUNK ? columns - start : CHUNK;
            const ptrdiff_t at = row * width + start, ahead = at + AHEAD * width;
            if (row + AHEAD < rows) {
                fetch(image + channels * ahead, channels * count);
                fetch(is_inside + ahead, count), fetch(was_visible + ahead, count);
                fetch(grey + ahead, count * (ptrdiff_t)sizeof *grey);
                if (chroma) fetch(chroma + ahead, count * (ptrdiff_t)sizeof *chroma);
            }
            read_pixels(image + channels * at, channels, share, is_inside + at, count, seen, bluer);
            const uint8_t *free = is_free ? is_free + row * (ptrdiff_t)columns + start : all_free;
            rates_of(free, was_visible + at, count, rate);
            approach(seen, rate, count, grey + at);
            if (chroma) approach(bluer, rate, count, chroma + at);
        }
    }
}

static inline uint8_t larger(uint8_t one, uint8_t other) { return one > other ? one : other; }

/* Return by how much a value is larger than another; 0 if it is not. */
static inline uint8_t excess(uint8_t one, uint8_t other) { return (uint8_t)(larger(one, other) - other); }

/* Return whether any of RUN pixels may be marked. Every byte is taken for the first of a pixel, which
   is faster than to separate them; `is_first` is 255 for those that are, else 0. Reads two bytes more. */
static int any_stain(const uint8_t *image, const uint8_t *is_first, uint8_t dye_grey, uint8_t blood_grey) {
    uint8_t any = 0;
    for (int at = 0; at < 3 * RUN; at++) {
        const uint8_t blue = image[at], green = image[at + 1], red = image[at + 2];
        const uint8_t bluer = excess(excess(blue, larger(green, red)), dye_grey);
        const uint8_t redder = excess(excess(red, larger(blue, green)), blood_grey);
        any |= is_first[at] & (bluer | redder);
    }
    return any;
}

/* Count the marked pixels in a part of a row. */
static void count_marked(const uint8_t *mask, int row, int start, int stop, Marked *marked) {
    int count = 0;
    for (int column = start; column < stop; column++) count += mask[column];
    if (!count) return;
    while (!mask[start]) start++;
    while (!mask[stop - 1]) stop--;
    marked->count += count, marked->last_row = row;
    marked->first_row = row < marked->first_row ? row : marked->first_row;
    marked->first_column = start < marked->first_column ? start : marked->first_column;
    marked->last_column = stop - 1 > marked->last_column ? stop - 1 : marked->last_column;
}

/* Mark what is much bluer than any other colour, dye, and what is much redder, blood.

   image: BGR, `width` pixels wide, from the region's first pixel on.
   spans: first column in which tissue is looked for, and first in which it is not, of each row.
   dye, blood: receive what is either, (rows, columns).
   dyed, bloody: receive how many pixels are marked, and first and last row and column of these. */
VECTORS EXPORT void mark_stains(const uint8_t *image, ptrdiff_t width, int rows, int columns,
                                int min_blue_grey, int min_red_grey, const int32_t *spans,
                                uint8_t *restrict dye, uint8_t *restrict blood, Marked *dyed,
                                Marked *bloody) {
    const int16_t dye_grey = (int16_t)min_blue_grey, blood_grey = (int16_t)min_red_grey;
    uint8_t is_first[3 * RUN];
    for (int at = 0; at < 3 * RUN; at++) is_first[at] = at % 3 ? 0 : 255;
    *dyed = *bloody = (Marked){0, rows, -1, columns, -1};
    memset(dye, 0, (size_t)(rows * (ptrdiff_t)columns));
    memset(blood, 0, (size_t)(rows * (ptrdiff_t)columns));
    for (int row = 0; row < rows; row++, spans += 2) {
        const int end = spans[1] < columns ? spans[1] : columns;
        for (int start = spans[0] > 0 ? spans[0] : 0; start < end; start += RUN) {
            const int stop = end - start < RUN ? end : start + RUN;
            if (row + AHEAD < rows) fetch(image + 3 * (AHEAD * width + start), 3 * (stop - start));
            if (columns - start > RUN &&
                !any_stain(image + 3 * start, is_first, (uint8_t)dye_grey, (uint8_t)blood_grey)) {
                continue;
            }
            for (int column = start; column < stop; column++) {
                const uint8_t *pixel = image + 3 * column;
                const int16_t blue = pixel[0], green = pixel[1], red = pixel[2];
                const int16_t cooler = blue - red, bluer = blue - green, redder = red - green;
                dye[column] = (cooler > dye_grey) & (bluer > dye_grey);
                blood[column] = (-cooler > blood_grey) & (redder > blood_grey);
            }
            count_marked(dye, row, start, stop, dyed), count_marked(blood, row, start, stop, bloody);
        }
        image += 3 * width, dye += columns, blood += columns;
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

/* Fill the marked pixels of a row, from a first to a last column, with the mean of the others in the window
   about each. */
static void fill_row(const uint8_t *is_filled, int first, int last, int columns, int reach, const int *sums,
                     uint8_t *filled) {
    const double scale = 1.0 / square(2 * reach + 1);
    int window[4] = {0};
    for (int column = first - reach; column < first + reach; column++) {
        for (int k = 0; k < 4; k++) window[k] += sums[k * columns + mirrored(column, columns)];
    }
    for (int column = first; column <= last; column++) {
        const int entering = mirrored(column + reach, columns), leaving = mirrored(column - reach, columns);
        for (int k = 0; k < 4; k++) window[k] += sums[k * columns + entering];
        if (is_filled[column] && window[3]) {
            const float share = (float)maximum((float)(window[3] * scale), MIN_FREE);
            for (int k = 0; k < 3; k++) {
                filled[3 * column + k] = (uint8_t)((float)(window[k] * scale) / share);
            }
        }
        for (int k = 0; k < 4; k++) window[k] -= sums[k * columns + leaving];
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
        int from = 0, last_marked = columns - 1;
        while (from < columns && !marked[from]) from++;
        while (last_marked > from && !marked[last_marked]) last_marked--;
        if (from < columns) {
            fill_row(marked, from, last_marked, columns, reach, sums, filled + 3 * width * middle);
        }
        add_row(image + 3 * width * first, is_filled + (ptrdiff_t)columns * first, columns, -1, sums);
    }
}

/* Return the grey of the pixel that so many of some pixels are not brighter than, that one not counted.

   image, channels: BGR or grey.
   pixels: their indices, (count). */
VECTORS EXPORT int ranked_grey(const uint8_t *image, int channels, const int32_t *pixels, int count,
                               int rank) {
    int counts[256] = {0}, grey = 0;
    for (int number = 0; number < count; number++) {
        const uint8_t *pixel = image + (ptrdiff_t)channels * pixels[number];
        const int ahead = number + SAMPLES_AHEAD < count ? number + SAMPLES_AHEAD : number;
        __builtin_prefetch(image + (ptrdiff_t)channels * pixels[ahead]);
        counts[channels == 1 ? *pixel : (grey_of(pixel, 0) + WHOLE / 2) / WHOLE]++;
    }
    for (rank -= counts[0]; rank >= 0 && grey < 255; rank -= counts[grey]) grey++;
    return grey;
}
