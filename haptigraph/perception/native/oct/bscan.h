/* B-scans: what the searches for surfaces and ridges share with Python. Lengths are in cells of the
   downsampled image or in steps along and across a line; `perception/oct/scale.py` derives them from
   millimetres. */

#pragma once

#include "native.h"

#define MAX_RIDGES 2
#define ALONG_STEPS 5       /* averaged along a ridge */
#define CORE_STEPS 5        /* averaged across it, its width */
#define MAX_SQUARE_PX 256   /* pixels whose grey is summed: sums of their rows fit 16 bits */
#define CELL_STEPS 256      /* of a cell in a grey level */
#define MAX_STEP_ROWS 16    /* of a path, from one column to the next */
#define MAX_SCAN_PX 16384   /* in each direction: positions fit 16 bits and as many of a fraction */
#define MAX_CELLS 8192      /* in each direction: the cells on a line fit 16 bits, with a sign */
#define SD_STEPS_PER_MM 1e5 /* rounding of reported standard deviations */
#define MAX_SUM_CELLS 32000 /* in a column of the surfaces: sums of steps fit 32 bits */

/* A downsampled image: mean grey of cells, row by row, in steps. */
typedef struct {
    const int32_t *cells; /* (rows, columns) */
    int rows, columns;
    int group; /* cells side by side that make one column of the surfaces */
} Grid;

/* How a surface is smoothed; its standard deviation is at least `least_sd_rows`, in rows. */
typedef struct {
    const double *window; /* positive weights of columns, (2 reach + 1) */
    int reach;
    double least_sd_rows, scatter_share; /* standard deviations of the rows in the window */
} Smoothing;

/* Limits of the search for both surfaces; lengths in rows. */
typedef struct {
    int edge, deep;                  /* averaged on either side of a step, and below the ILM */
    int thinnest, thickest;          /* from ILM to RPE */
    int band;                        /* thickness of the RPE's bright band */
    int most;                        /* largest step of a path to the next column */
    int min_columns;                 /* of a visible part */
    double step_grey, rpe_step_grey; /* cost of a step of one row, squared */
    double saturation_grey, body_share;
    double dark_grey, top_grey; /* without backscatter; a column that begins brighter begins with tissue */
    double min_rise_grey, min_rise_share; /* of tissue; relative to the typical rise */
    double min_band_grey, min_band_share; /* of the RPE; relative to tissue */
    double border_rows;                   /* nearer to the image's top, the ILM is not visible */
    Smoothing ilm, rpe;
} SurfaceSearch;

/* Limits of the search for ridges; lengths in steps, slopes in rows per column. */
typedef struct {
    double step_px, dark_grey, mask_grey, strip_grey, lowest_slope, highest_slope, inlier_steps;
    double below_ilm_px;  /* rows of the image; deeper below the ILM, no ridge is searched */
    double across, down;  /* pixels of a cell */
    int side;             /* cells from the ridge to its dark sides */
    int votes, erased;    /* least number of cells on a line; cells beside it that it accounts for */
    int gap, run, beyond; /* a longer gap ends a ridge, after such a run; stations kept beyond its end */
} RidgeSearch;

/* A straight line from its entry into the image downwards. */
typedef struct {
    double start_px[2], along_px[2]; /* direction, length 1 */
    double angle_sd_rad;
    int stations; /* one a step */
} RidgeLine;

/* Both surfaces by column, as Python has them. */
typedef struct {
    const double *x_px, *ilm_px, *rpe_px; /* ascending columns, at least one, and rows */
    uint8_t *ilm_visible, *rpe_visible;
    int columns;
} SurfacePair;

/* Limits of the search for a shaft among ridges. */
typedef struct {
    double min_contrast_grey, equal_share;      /* of a ridge; of the typical one beside what is as bright */
    double start_steps, gap_steps, least_steps; /* largest start and gap, and least length, along it */
    double min_ridge_share;                     /* of its length that is a ridge */
    double on_ridge_rows, below_shaft_rows;     /* nearer to it is no tissue; further below it is some */
    double dark_rows, margin_px, max_tissue_share; /* of a shadow: height, soft edge, and tissue in it */
    double floor_grey, tissue_grey;                /* without backscatter, and contrast of tissue over it */
} ShaftSearch;

/* The continuous part of a ridge that casts a shadow. */
typedef struct {
    RidgeLine line;
    double share, typical_grey; /* of it that is a ridge, and its contrast */
    int end_steps, number;      /* its end, and which of the ridges it is */
} Shaft;

/* Limits of the search for the point of a bevel below the shaft's line; lengths in rows and columns. */
typedef struct {
    double wall_rows, spot_rows, above_rows,
        below_rows;              /* far wall; spot on the line; searched beyond both */
    double smooth_rows;          /* at least 1 */
    double half_px, ahead_px[2]; /* of the tip's column, and tissue in full light */
    double bright_share, equal_share, spot_sd_rows, lit_share, min_gain, floor_grey;
    int apart_rows; /* whose noise is independent; positive */
} BevelSearch;

/* A shaft, and limits of the search for the edge of its shadow; lengths in columns, or in rows if named so.
 */
typedef struct {
    double start_px[2], along_px[2], end_x; /* of the shaft; direction; end of its continuous part */
    double margin_px, window_px, max_distance_px;
    double thick_rows, most_rows, below_rows, below_shaft_rows, deep_rows, below_rpe_rows;
    double min_contrast_grey, halved_grey, rise_share;
    int slope_columns, run, half;
} EdgeSearch;

/* A surface, by column. */
typedef struct {
    const double *x_px, *row_px, *sd_px; /* ascending columns; standard deviations may be NULL */
    const uint8_t *is_visible;
    int count;
} Columns;

/* Return the order of two numbers, for qsort. */
static inline int compare_doubles(const void *one, const void *other) {
    const double a = *(const double *)one, b = *(const double *)other;
    return (a > b) - (a < b);
}

static inline int compare_floats(const void *one, const void *other) {
    const float a = *(const float *)one, b = *(const float *)other;
    return (a > b) - (a < b);
}

/* Return values between vertices, linearly; before the first and after the last they continue. */
static inline double between(const double *x, const double *values, int count, double at) {
    int left = 0, right = count - 1;
    if (at <= x[0]) return values[0];
    if (at >= x[right]) return values[right];
    while (right - left > 1) {
        const int middle = (left + right) / 2;
        if (x[middle] <= at)
            left = middle;
        else
            right = middle;
    }
    return (values[right] - values[left]) / (x[right] - x[left]) * (at - x[left]) + values[left];
}

/* Find up to MAX_RIDGES ridges down to a row of the grid in each of its columns, those with most evidence
   first, and write the contrast against the sides at each of their stations and the brightness of the
   brighter side, (MAX_RIDGES, room). Return how many; -1 without memory. */
int find_ridges(const uint8_t *image, int width, int height, const Grid *grid, const RidgeSearch *search,
                const int32_t *limit_row, int room, RidgeLine *lines, float *contrast, float *brighter);

/* Smooth the rows of a surface over its visible columns, in place, and write their standard deviations: the
   scatter about the result, with the least one. `scratch` has two values per column. */
void smooth_rows(double *rows, const uint8_t *visible, int columns, const Smoothing *smoothing,
                 double *scratch, double *sd);

/* Take runs of less than so many columns out of a mask, as in bscan_smoothing.c. */
EXPORT void remove_specks(uint8_t *mask, int columns, int least);

/* How surfaces are reported. */
typedef struct {
    double tip_px, beyond_px;     /* column of the tip, NaN for none; beyond it */
    double alone_px, parallel_px; /* extrapolated so far: by its own slope; parallel to the line above */
    double slope_sd;              /* of what is not visible, rows per column */
    double center_px[2], right_mm, down_mm; /* the origin, and millimetres per pixel to the right and down */
    double shares[2];                       /* of the layers between ILM and RPE */
    int slope_columns;                      /* from which a surface is extrapolated */
} LineLimits;
