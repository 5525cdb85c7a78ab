/* The two edges of the shaft, sub-pixel, block by block.

   Edges are maxima of the slope across the shaft; the middle between two does not depend on how the metal
   between them is lit. The two edges of one object have slopes of opposite sign: a dark needle falls and
   rises, a bright one rises and falls. The edge of a shaded side beside a highlight has no maximum of its
   own, but every edge has a foot, where the image begins to change, and all feet are equally far out. Noise
   affects feet more. `shaft_line.c` decides which pairs of edges lie on one line. */

#include "edges.h"

#include <string.h>

#define NO_WIDTH_PX (-100.0) /* width of a pair that does not exist */
#define MIN_SNR 5.0
#define MIN_SLOPE 3.0 /* grey levels per px: less is shadow or texture */
#define MIN_SHARE 0.5 /* of the steepest slope of the same sign */
#define FLOOR_PX 0.3  /* what light, and background of equal brightness, do to an edge without noise */
#define MIN_CURVATURE 1e-3
#define MARGIN_PX 4         /* of a strip's half width is not searched for edges */
#define FOOT_PX 1.4         /* from an edge to its foot, through a focused lens and the slope filter */
#define MIN_FOOT_SHARE 0.15 /* of the greatest change of slope */
#define MIN_FOOT_SNR 6.0
#define MIN_USUAL_FOOT_SNR 12.0

/* The slope filter: t exp(-t^2 / 2 SIGMA^2), about the blur of a focused lens; a ramp of 1 gives 1. */
#define SIGMA_PX 1.0
#define TAP_1 0.24302974
#define TAP_2 0.10845453
#define TAP_3 0.01335373
#define SLOPE_NOISE (2 * (square(TAP_1) + square(TAP_2) + square(TAP_3)))
#define CURVE_NOISE (2 * (square(TAP_3) + square(TAP_2 - TAP_3) + square(TAP_1 - TAP_2) + square(TAP_1)))
/* Of the slope filter, and of taking a maximum's curvature from its neighbours. */
#define SLOPE_BLUR_PX2 (square(SIGMA_PX) + 0.25)

/* The top of a maximum. */
typedef struct {
    double lane, curvature, height;
} Peak;

/* Return whether noise rather than shadow limits how steep an edge must be. */
int is_noisy(double noise_grey) { return noise_grey > MIN_SLOPE * sqrt(BLOCK / SLOPE_NOISE) / MIN_SNR; }

/* Return the standard deviation of the blur across the sharper edge, from the median variance of either. */
double sharp_blur_px(double left_px2, double right_px2) {
    return sqrt(maximum(minimum(left_px2, right_px2) - SLOPE_BLUR_PX2, 0));
}

static int count_blocks(int start, int stop, int last, int size) {
    if (stop > last) stop = last;
    return stop > start ? (stop - start) / size : 0;
}

/* Return how many whole blocks there are before a tip, on either side of the wall. */
Blocks blocks_before(const Strip *strip, double tip_px, int size) {
    const double stations = floor((tip_px - strip->u_px[0]) / STATION_PX);
    const int last = (int)minimum(maximum(stations, 0), strip->excess.stations);
    const Blocks blocks = {size, count_blocks(0, strip->outside_stop, last, size),
                           count_blocks(strip->inside_start, strip->inside_stop, last, size)};
    return blocks;
}

/* Return how many doubles `find_edges` needs. */
size_t edges_memory(const Strip *strip, Blocks blocks) {
    return (size_t)(blocks.outside + blocks.inside) * (size_t)(2 * strip->excess.lanes + 14);
}

static void assign_memory(Edges *edges, double *memory) {
    const int n = edges->blocks;
    double **const parts[] = {
        &edges->middle_px, &edges->variance_px2, &edges->width_px,
        &edges->steepness, &edges->blur_px2[0],  &edges->blur_px2[1],
    };
    edges->u_px = memory;
    edges->axis_px = memory += n;
    memory += n;
    for (size_t part = 0; part < sizeof parts / sizeof *parts; part++, memory += 2 * n) *parts[part] = memory;
    edges->slope = memory;
}

static int first_station(const Strip *strip, Blocks blocks, int block) {
    return block < blocks.outside ? block * blocks.size
                                  : strip->inside_start + (block - blocks.outside) * blocks.size;
}

/* Write the mean of each block to `means`, (lanes, n). */
static void average_blocks(const Strip *strip, Blocks blocks, int n, double *means) {
    for (int lane = 0; lane < strip->excess.lanes; lane++) {
        const float *row = strip->excess.first + lane * strip->excess.stride;
        for (int block = 0; block < n; block++) {
            const float *from = row + first_station(strip, blocks, block);
            double sum = 0;
            for (int station = 0; station < blocks.size; station++) sum += from[station];
            means[lane * n + block] = sum / blocks.size;
        }
    }
}

/* Turn means into slopes across the shaft, both (lanes, n); the outermost lanes are repeated beyond. */
static void find_slopes(const double *means, int lanes, int n, double *slope) {
    for (int lane = 0; lane < lanes; lane++) {
        const double *row[7];
        for (int tap = 0; tap < 7; tap++) {
            const int at = lane + tap - 3;
            row[tap] = means + (at < 0 ? 0 : at < lanes ? at : lanes - 1) * n;
        }
        for (int block = 0; block < n; block++) {
            slope[lane * n + block] = TAP_1 * (row[4][block] - row[2][block]) +
                                      TAP_2 * (row[5][block] - row[1][block]) +
                                      TAP_3 * (row[6][block] - row[0][block]);
        }
    }
}

/* Estimate the axis roughly, by where slopes are steep: a resistant line, through the medians of the outer
   thirds (Tukey, Exploratory Data Analysis, 1977). */
static void find_rough_axis(Edges *edges) {
    const int n = edges->blocks, third = (n + 2) / 3;
    double middle[n], total[n], moment[n];
    for (int block = 0; block < n; block++) total[block] = moment[block] = 0;
    for (int lane = 1; lane < edges->lanes - 1; lane++) {
        for (int block = 0; block < n; block++) {
            const double power = square(edges->slope[lane * n + block]);
            total[block] += power;
            moment[block] += (lane - 1) * power;
        }
    }
    for (int block = 0; block < n; block++) middle[block] = moment[block] / maximum(total[block], 1e-6);
    const double first = median(middle, third), last = median(middle + n - third, third);
    const double start_px = edges->u_px[third / 2], end_px = edges->u_px[n - 1 - third / 2];
    const double slope = end_px > start_px ? (last - first) / (end_px - start_px) : 0;
    for (int block = 0; block < n; block++) {
        edges->axis_px[block] = edges->u_px[block] * slope + (first - slope * start_px);
    }
}

/* Return the maximum about the lane after one, in values n apart from lane to lane, times a sign. */
static Peak peak_at(const double *values, int n, double sign, int lane) {
    const double *at = values + lane * n;
    const double before = sign * at[0], here = sign * at[n], after = sign * at[2 * n];
    const double curvature = maximum(2 * here - before - after, MIN_CURVATURE);
    return (Peak){lane + (after - before) / (2 * curvature), curvature, here};
}

/* Return the lane of the first maximum from `start` by `step` up to `end`, in values times a sign, or -1. */
static int first_peak(const double *values, int n, double sign, double threshold, int start, int end,
                      int step) {
    for (int lane = start; step > 0 ? lane <= end : lane >= end; lane += step) {
        const double before = sign * values[lane * n], at = sign * values[(lane + 1) * n];
        if (at >= threshold && at > sign * values[(lane + 2) * n] && at >= before) return lane;
    }
    return -1;
}

/* Find both edges of both pairs of one block. */
static void find_pairs(const Edges *edges, int block) {
    const int n = edges->blocks, lanes = edges->lanes, half_px = lanes / 2;
    const double *slopes = edges->slope + block, axis_px = edges->axis_px[block];
    double steepest[2] = {-INFINITY, -INFINITY};
    for (int lane = 0; lane < lanes; lane++) {
        steepest[0] = maximum(steepest[0], slopes[lane * n]);
        steepest[1] = maximum(steepest[1], -slopes[lane * n]);
    }
    const double min_slope = maximum(MIN_SNR * edges->noise_grey * sqrt(SLOPE_NOISE), MIN_SLOPE);
    const int start = clamped(ceil(axis_px - (half_px - MARGIN_PX)), 0, lanes);
    const int end = clamped(floor(axis_px + (half_px - MARGIN_PX)), -1, lanes - 3);
    Peak left[2], right[2];
    int has_edge[2];
    for (int falls = 0; falls < 2; falls++) {
        const double sign = falls ? -1 : 1;
        const double threshold = maximum(MIN_SHARE * steepest[falls], min_slope);
        int ends[2] = {first_peak(slopes, n, sign, threshold, start, end, 1),
                       first_peak(slopes, n, sign, threshold, end, start, -1)};
        has_edge[falls] = ends[0] >= 0;
        for (int side = 0; side < 2; side++) {
            (side ? right : left)[falls] = peak_at(slopes, n, sign, ends[side] < 0 ? 0 : ends[side]);
        }
    }
    for (int falls = 0; falls < 2; falls++) {
        const Peak one = left[falls], other = right[1 - falls]; /* a pair's right edge has the other sign */
        const int pair = falls * n + block;
        const int is_pair = has_edge[0] && has_edge[1] && one.lane < axis_px && other.lane > axis_px;
        /* The noise of a maximum's position is the noise of the derivative there over the curvature. */
        const double spread = 1 / square(one.curvature) + 1 / square(other.curvature);
        edges->middle_px[pair] = (one.lane + other.lane) / 2 - (half_px - 1);
        edges->variance_px2[pair] = CURVE_NOISE * square(edges->noise_grey) / 4 * spread + square(FLOOR_PX);
        edges->width_px[pair] = is_pair ? other.lane - one.lane : NO_WIDTH_PX;
        edges->steepness[pair] = minimum(one.height, other.height);
        edges->blur_px2[0][pair] = one.height / one.curvature;
        edges->blur_px2[1][pair] = other.height / other.curvature;
    }
}

/* Find the outermost edge of either sign on either side of the approximate axis. `memory` has room for as
   many doubles as `edges_memory` returns and must outlive `edges`. */
void find_edges(const Strip *strip, Blocks blocks, double *memory, Edges *edges) {
    const int n = blocks.outside + blocks.inside, lanes = strip->excess.lanes;
    edges->blocks = n, edges->outside = blocks.outside, edges->lanes = lanes;
    edges->noise_grey = strip->noise_grey / sqrt(blocks.size);
    assign_memory(edges, memory);
    for (int block = 0; block < n; block++) {
        edges->u_px[block] = strip->u_px[first_station(strip, blocks, block) + blocks.size / 2];
    }
    double *means = edges->slope + lanes * n;
    average_blocks(strip, blocks, n, means);
    find_slopes(means, lanes, n, edges->slope);
    find_rough_axis(edges);
    for (int block = 0; block < n; block++) find_pairs(edges, block);
}

/* Write how one block's slope changes from lane to lane. */
static void find_changes(const Edges *edges, int block, double *changes) {
    const double *slopes = edges->slope + block;
    const int n = edges->blocks;
    for (int lane = 0; lane < edges->lanes - 1; lane++) {
        changes[lane] = slopes[(lane + 1) * n] - slopes[lane * n];
    }
}

static double max_of(const double *values, int count, double sign) {
    double max = -INFINITY;
    for (int number = 0; number < count; number++) max = maximum(max, sign * values[number]);
    return max;
}

/* Write the position of one block's pairs by their outermost feet. */
static void find_feet_of(const Edges *edges, int block, double noise, double *middle_px, double *width_px) {
    const int count = edges->lanes - 1, half_px = edges->lanes / 2, n = edges->blocks;
    double changes[count];
    find_changes(edges, block, changes);
    const double max = maximum(max_of(changes, count, 1), max_of(changes, count, -1));
    const double threshold = maximum(MIN_FOOT_SHARE * max, MIN_FOOT_SNR * noise);
    const double axis_px = edges->axis_px[block] - 0.5; /* changes lie half-way between slopes */
    const int start = clamped(ceil(axis_px - (half_px - MARGIN_PX)), 0, count);
    const int end = clamped(floor(axis_px + (half_px - MARGIN_PX)), -1, count - 3);
    for (int falls = 0; falls < 2; falls++) {
        const double sign = falls ? -1 : 1; /* the foot of a right edge bends like that of a left one */
        const int left = first_peak(changes, 1, sign, threshold, start, end, 1);
        const int right = first_peak(changes, 1, sign, threshold, end, start, -1);
        const int at = falls * n + block;
        if (left < 0 || edges->width_px[at] <= 0) continue;
        const Peak one = peak_at(changes, 1, sign, left), other = peak_at(changes, 1, sign, right);
        const double left_px = one.lane + 0.5 + FOOT_PX, right_px = other.lane + 0.5 - FOOT_PX;
        if (right_px <= left_px) continue;
        middle_px[at] = (left_px + right_px) / 2 - (half_px - 1);
        width_px[at] = right_px - left_px;
    }
}

/* Write the middle and width of the same pairs by their outermost feet, (2 n); pairs without two feet keep
   theirs. Return 0 if noise hides the feet. */
int find_feet(const Edges *edges, double *middle_px, double *width_px) {
    const int n = edges->blocks, count = edges->lanes - 1;
    const double noise = edges->noise_grey * sqrt(CURVE_NOISE);
    double max[2 * n], changes[count];
    for (int block = 0; block < n; block++) {
        find_changes(edges, block, changes);
        max[block] = max_of(changes, count, 1);
        max[n + block] = max_of(changes, count, -1);
    }
    memcpy(middle_px, edges->middle_px, 2 * n * sizeof *middle_px);
    memcpy(width_px, edges->width_px, 2 * n * sizeof *width_px);
    if (median(max, 2 * n) < MIN_USUAL_FOOT_SNR * noise) return 0;
    for (int block = 0; block < n; block++) find_feet_of(edges, block, noise, middle_px, width_px);
    return 1;
}
