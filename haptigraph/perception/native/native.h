/* The compiled part of perception: loops over pixels, edges and contrasts.

   Python calls it through the wrappers beside it, one per function, which check every argument before C sees
   it; tests call two more. Plain C11 without state: no globals, no allocation that outlives a call. Doubles,
   except for the pixels of strips, which are floats. Sums run in the order of the indices and nothing is
   contracted or reassociated (see hatch_build.py), so it gives the same digits on every machine with IEEE
   754. OpenCV, which samples a strip's background, rounds the last bit by the processor. */

#pragma once

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Before a pass over many pixels: gcc compiles it, with all it calls, for AVX2 as well, and the loader
   chooses by the processor. The digits are the same. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define VECTORS __attribute__((target_clones("avx2", "default"), flatten))
#else
#define VECTORS
#endif

/* Constants and structs that Python shares: `interface.c` exports their values and layouts. */
#define STATION_PX 2.0     /* between stations of a strip; 1 in a tip patch */
#define BLOCK 3            /* stations that are averaged before edges are detected */
#define CELL 4             /* samples along a line of the polar search that are averaged */
#define AROUND_PX 6        /* to either side of a shaft's middle that its point's sharpness is measured in */
#define MIN_LANES 9        /* two flanks and the noise beside them; sharpness needs as many */
#define MAX_LANES 4096     /* with these two, products fit an int, */
#define MAX_STATIONS 16384 /* and the values per station that lie on the stack fit there */
#define MAX_PX 1048576     /* from the origin: positions fit an int as fine as OpenCV samples them */
#define VOLUME_CELL 4      /* rows of a volume that a cell of a reduced one averages */
#define VOLUME_PADDED 8    /* values that a point has of a template's Jacobian; the last two are 0 */
#define MAX_VOLUME_ROWS 4096 /* values per row that lie on the stack fit there */

/* Rows of pixels: lanes across the shaft, one value per station along it. */
typedef struct {
    const float *first;
    ptrdiff_t stride; /* from lane to lane, in values */
    int lanes, stations;
} Rows;

/* Rectified pixels along an expected line. */
typedef struct {
    Rows excess;             /* over the background and the ramp between the flanks [grey levels] */
    Rows detrended;          /* over the ramp between the flanks alone */
    const float *u_px;       /* position of each station along the line */
    const uint8_t *is_known; /* stations whose background is known */
    double noise_grey;       /* standard deviation of a pixel of `excess` without needle */
    int outside_stop, inside_start, inside_stop; /* stations outside the wall begin with the first */
    Rows chroma; /* blue less red over the background and the ramp; without lanes if the grey alone counts */
} Strip;

/* Where the lines of a polar search sample the image. */
typedef struct {
    const int32_t *pixels;        /* indices of the sampled pixels, ascending, (pixel_count) */
    const uint8_t *is_inside;     /* pixels inside the globe, where blue less red counts, (pixel_count) */
    const int32_t *sampled;       /* indices of the sampled cells, (sampled_count) */
    const int32_t *samples;       /* which of the pixels each of them samples, (sampled_count, CELL) */
    const int32_t *flanks;        /* indices of the cells on either side of each cell, (2, rows, cells) */
    const uint8_t *is_observable; /* cells in which a needle would be visible, (rows, cells) */
    int pixel_count, sampled_count, rows, cells;
    int trocar; /* cells of a row before it are outside the eye */
} SearchGrid;

/* What earlier images showed of a needle's appearance; NaN for what is not known. */
typedef struct {
    double highlight, highlight_sd; /* offset of the specular highlight, as a share of its pair's width */
    double images;                  /* since feet fitted better than edges, or the needle appeared */
    double shaded_px[2];            /* shift of the middle by a shaded edge, outside and inside */
} Appearance;

/* A volume whose rows were reduced to cells. */
typedef struct {
    const float *first; /* (columns, slices, cells) */
    int columns, slices, cells;
    int first_cell, last_cell; /* of those with usable rows */
} ReducedVolume;

/* A straight line across a strip: v = offset_px + slope u. */
typedef struct {
    double offset_px, slope, covariance[3], light_rad, width_px, blur_px, scatter;
    Appearance appearance;
    uint8_t *is_on_line, *is_steep; /* of each block, (blocks) */
    int blocks, on_line;
    double max_offset_px; /* from the strip's middle, at either end */
} LineFit;

#define BEHIND_PX 12 /* of the needle in a tip patch, over which its contrast is measured at first */

/* The part of a strip in which a tip is located sub-pixel. */
typedef struct {
    double middle_px;    /* lane of the shaft's middle, may be between two */
    double blur_px;      /* standard deviation of the blur across the shaft's edges */
    double fading_share; /* the same as TIP_LEVEL where rims and middle differ */
    int start, stop;     /* stations of the patch */
    int continues;       /* whether the strip shows more beyond them */
    int about;           /* approximate tip, from the first of them on */
    int is_outside;      /* outside the wall, where the background may be unknown */
    int uses_chroma;     /* whether its contrast is that of its colour, too */
} TipPatch;

/* How many pixels of a mask are marked, and the first and last row and column that have some. */
typedef struct {
    int count, first_row, last_row, first_column, last_column;
} Marked;

/* A part of the image along the shaft of forceps: lanes across it, stations along it, a pixel each. */
typedef struct {
    const uint8_t *grey;            /* (lanes, stations) */
    const uint8_t *pixels;          /* the same in colour, BGR; NULL if there is none */
    const float *background;        /* the eye without forceps, (lanes, stations) */
    const uint8_t *is_other;        /* pixels of another instrument, (lanes, stations); NULL without one */
    double light;                   /* how many times brighter the patch is than the background */
    double center_px[2], radius_px; /* of the globe, less its rim: station and lane */
    double min_length_px;           /* of metal, from the first station */
    double max_difference_px;       /* between the lengths of two jaws */
    int lanes, stations;
    int core;    /* lanes to either side of the middle one that the shaft covers for sure */
    int visible; /* stations in which it is visible for sure, from the first on */
} JawPatch;

/* Marked pixels of a lane without a gap. */
typedef struct {
    int lane, first, stop;
    int part;    /* the first run of those connected with it */
    int on_line; /* pixels of these on the shaft's line, counted in the first */
} Run;

static inline double maximum(double one, double other) { return one > other ? one : other; }
static inline double minimum(double one, double other) { return one < other ? one : other; }
static inline double square(double value) { return value * value; }

/* Return a value as an int of a range; its lower end for NaN. */
static inline int clamped(double value, int low, int high) {
    return value > low ? value < high ? (int)value : high : low;
}

/* Grey as OpenCV computes it (ITU-R BT.601), in integer parts of a grey level, which are faster. */
#define WHOLE 65536
#define BLUE 7471
#define GREEN 38470
#define RED 19595

static inline int whole_share(double share) { return (int)(WHOLE * share); }

/* Return the grey of a colour, with a share of blue less red added. */
static inline int grey_of_color(int blue, int green, int red, int chroma) {
    const int max = 255 * WHOLE;
    int grey = (BLUE + chroma) * blue + GREEN * green + (RED - chroma) * red;
    grey = grey < 0 ? 0 : grey; /* two plain steps: gcc makes vectors of them */
    return grey > max ? max : grey;
}

/* Return the same of a BGR pixel. */
static inline int grey_of(const uint8_t *pixel, int chroma) {
    return grey_of_color(pixel[0], pixel[1], pixel[2], chroma);
}

/* Return the (upper) median of some values, which are reordered. */
double median(double *values, int count);

/* Write the contrast [grey levels] of the stations from start to before stop, each averaged with so many
   within reach on either side. `weights` are those of `count` lanes from `lane` on; lanes beyond the strip
   count as 0. */
void contrast_along(const Strip *strip, int lane, const float *weights, int count, int start, int stop,
                    int reach, float *contrast_grey);

/* The same for the middle lanes of a strip. Return the contrast that noise does not reach. */
EXPORT double core_contrast(const Strip *strip, int start, int stop, float *contrast_grey);

/* Write how much of a shaft's own colour, that right before `start`, the stations from there to before `stop`
   show [grey levels], 0 where they show another. No shadow has it.
   Return that colour, 0 if it is not clear; noise_grey receives what noise does not reach. */
double own_color(const Strip *strip, int start, int stop, float *shown_grey, double *noise_grey);

/* Return what noise does not reach in a mean of so many values [grey levels]. */
double noise_threshold_grey(double noise_grey, int count);

/* Return whether the mean of all stations is sharper across the shaft than noise, and than a share of its own
   contrast. */
int is_sharp(const float *excess, ptrdiff_t stride, int lanes, int stations, double share, double noise_grey);
