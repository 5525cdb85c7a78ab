/* The two edges of the shaft, sub-pixel, block by block.

   Edges are maxima of the slope across the shaft; the middle of both does not care how the metal between them
   is lit. The two edges of one thing have slopes of opposite sign: a dark needle falls and rises, a bright
   one rises and falls. The edge of a shaded side beside a highlight has no maximum of its own, but every edge
   has a foot, where the image begins to change, and all feet are equally far out. They suffer more from
   noise. Knows no line: whether pairs lie on one is shaft_line.c's to tell. */

#include "edges.h"

#include <string.h>

#define UNSEEN_PX (-100.0) /* width of a pair of edges that is not there */
#define LEAST_SNR 5.0
#define LEAST_SLOPE 3.0 /* grey levels per px: softer is shadow or texture */
#define FAINT 0.08      /* share of the steepest slope of any sign, */
#define STRONG 0.5      /* and of the same sign */
#define FLOOR_PX 0.3    /* what light, and ground as bright, do to an edge, however little noise there is */
#define LEAST_CURVATURE 1e-3
#define SPARE_PX 4      /* of a strip's half width is not searched for edges */
#define FOOT_PX 1.4     /* from an edge to its foot, through a focused lens and the slope filter */
#define FOOT_SHARE 0.15 /* of the sharpest bend of the same sign */
#define FOOT_SNR 6.0
#define USUAL_FOOT_SNR 12.0

/* The slope filter: t exp(-t^2 / 2 SIGMA^2), about the blur of a focused lens; a ramp of 1 makes 1. */
#define SIGMA_PX 1.0
#define TAP_1 0.24302974
#define TAP_2 0.10845453
#define TAP_3 0.01335373
#define SLOPE_NOISE (2 * (square(TAP_1) + square(TAP_2) + square(TAP_3)))
#define CURVE_NOISE (2 * (square(TAP_3) + square(TAP_2 - TAP_3) + square(TAP_1 - TAP_2) + square(TAP_1)))
/* Of the slope filter, and of a maximum's curvature by its neighbours. */
#define SLOPE_BLUR_PX2 (square(SIGMA_PX) + 0.25)

/* The top of a maximum. */
typedef struct {
    double lane, curvature, height;
} Peak;

/* Tell whether an edge must be steeper to be told from noise than to be told from a shadow's. */
int is_noisy(double noise_grey) { return noise_grey > LEAST_SLOPE * sqrt(BLOCK / SLOPE_NOISE) / LEAST_SNR; }

/* Return the usual deviation of the blur across edges, on the sharper side, from what is usual on either. */
double sharp_blur_px(double left_px2, double right_px2) {
    return sqrt(largest(least(left_px2, right_px2) - SLOPE_BLUR_PX2, 0));
}

static int whole(int start, int stop, int last, int size) {
    if (stop > last) stop = last;
    return stop > start ? (stop - start) / size : 0;
}

/* Return how many whole blocks lie before a tip, on either side of the wall. */
Blocks blocks_before(const Strip *strip, double tip_px, int size) {
    const double stations = floor((tip_px - strip->u_px[0]) / STATION_PX);
    const int last = (int)least(largest(stations, 0), strip->excess.stations);
    const Blocks blocks = {size, whole(0, strip->before_stop, last, size),
                           whole(strip->inside_start, strip->inside_stop, last, size)};
    return blocks;
}

/* Return how many doubles `find_edges` needs. */
size_t edges_memory(const Strip *strip, Blocks blocks) {
    return (size_t)(blocks.outside + blocks.inside) * (size_t)(2 * strip->excess.lanes + 14);
}

static void lay_out(Edges *edges, double *memory) {
    const int n = edges->blocks;
    double **const parts[] = {
        &edges->middle_px, &edges->variance_px2, &edges->width_px,
        &edges->steepness, &edges->blur_px2[0],  &edges->blur_px2[1],
    };
    edges->u_px = memory;
    edges->about_px = memory += n;
    memory += n;
    for (size_t part = 0; part < sizeof parts / sizeof *parts; part++, memory += 2 * n) *parts[part] = memory;
    edges->rising = memory;
}

static int first_station(const Strip *strip, Blocks blocks, int block) {
    return block < blocks.outside ? block * blocks.size
                                  : strip->inside_start + (block - blocks.outside) * blocks.size;
}

/* Put the mean of every block into `means`, (lanes, n). */
static void average(const Strip *strip, Blocks blocks, int n, double *means) {
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

/* Turn means into slopes across the shaft, both (lanes, n); the outermost lanes go on. */
static void slope(const double *means, int lanes, int n, double *rising) {
    for (int lane = 0; lane < lanes; lane++) {
        const double *row[7];
        for (int tap = 0; tap < 7; tap++) {
            const int at = lane + tap - 3;
            row[tap] = means + (at < 0 ? 0 : at < lanes ? at : lanes - 1) * n;
        }
        for (int block = 0; block < n; block++) {
            rising[lane * n + block] = TAP_1 * (row[4][block] - row[2][block]) +
                                       TAP_2 * (row[5][block] - row[1][block]) +
                                       TAP_3 * (row[6][block] - row[0][block]);
        }
    }
}

/* Find where the steep places lie by and large: a resistant line, through the medians of the outer thirds
   (Tukey, Exploratory Data Analysis, 1977). */
static void lie_about(Edges *edges) {
    const int n = edges->blocks, third = (n + 2) / 3;
    double middle[n], total[n], moment[n];
    for (int block = 0; block < n; block++) total[block] = moment[block] = 0;
    for (int lane = 1; lane < edges->lanes - 1; lane++) {
        for (int block = 0; block < n; block++) {
            const double power = square(edges->rising[lane * n + block]);
            total[block] += power;
            moment[block] += (lane - 1) * power;
        }
    }
    for (int block = 0; block < n; block++) middle[block] = moment[block] / largest(total[block], 1e-6);
    const double first = median(middle, third), last = median(middle + n - third, third);
    const double start_px = edges->u_px[third / 2], end_px = edges->u_px[n - 1 - third / 2];
    const double slope = end_px > start_px ? (last - first) / (end_px - start_px) : 0;
    for (int block = 0; block < n; block++) {
        edges->about_px[block] = edges->u_px[block] * slope + (first - slope * start_px);
    }
}

/* Return the maximum about the lane after one; `sign` turns slopes, which are n apart from lane to lane. */
static Peak peak_at(const double *slopes, int n, double sign, int lane) {
    const double *at = slopes + lane * n;
    const double before = sign * at[0], here = sign * at[n], after = sign * at[2 * n];
    const double curvature = largest(2 * here - before - after, LEAST_CURVATURE);
    return (Peak){lane + (after - before) / (2 * curvature), curvature, here};
}

/* Return the lane of the first maximum from `start` by `step` up to `end`, or -1; `sign` turns slopes. */
static int outermost(const double *slopes, int n, double sign, double at_least, int start, int end,
                     int step) {
    for (int lane = start; step > 0 ? lane <= end : lane >= end; lane += step) {
        const double before = sign * slopes[lane * n], at = sign * slopes[(lane + 1) * n];
        if (at >= at_least && at > sign * slopes[(lane + 2) * n] && at >= before) return lane;
    }
    return -1;
}

/* Find both edges of one block, of either pair. */
static void find_pairs(const Edges *edges, int block) {
    const int n = edges->blocks, lanes = edges->lanes, half_px = lanes / 2;
    const double *slopes = edges->rising + block, about_px = edges->about_px[block];
    double most[2] = {-INFINITY, -INFINITY};
    for (int lane = 0; lane < lanes; lane++) {
        most[0] = largest(most[0], slopes[lane * n]);
        most[1] = largest(most[1], -slopes[lane * n]);
    }
    const double sure = largest(LEAST_SNR * edges->noise_grey * sqrt(SLOPE_NOISE), LEAST_SLOPE);
    const int start = (int)largest(ceil(about_px - (half_px - SPARE_PX)), 0);
    const int end = (int)least(floor(about_px + (half_px - SPARE_PX)), lanes - 3);
    Peak left[2], right[2];
    int has_edge[2];
    for (int falls = 0; falls < 2; falls++) {
        const double sign = falls ? -1 : 1;
        const double at_least = largest(largest(STRONG * most[falls], FAINT * most[1 - falls]), sure);
        int ends[2] = {outermost(slopes, n, sign, at_least, start, end, 1),
                       outermost(slopes, n, sign, at_least, end, start, -1)};
        has_edge[falls] = ends[0] >= 0;
        for (int side = 0; side < 2; side++) {
            (side ? right : left)[falls] = peak_at(slopes, n, sign, ends[side] < 0 ? 0 : ends[side]);
        }
    }
    for (int falls = 0; falls < 2; falls++) {
        const Peak one = left[falls], other = right[1 - falls]; /* a pair's right edge has the other sign */
        const int pair = falls * n + block;
        const int is_pair = has_edge[0] && has_edge[1] && one.lane < about_px && other.lane > about_px;
        /* The noise of a maximum's place is the noise of the derivative there over the curvature. */
        const double spread = 1 / square(one.curvature) + 1 / square(other.curvature);
        edges->middle_px[pair] = (one.lane + other.lane) / 2 - (half_px - 1);
        edges->variance_px2[pair] = CURVE_NOISE * square(edges->noise_grey) / 4 * spread + square(FLOOR_PX);
        edges->width_px[pair] = is_pair ? other.lane - one.lane : UNSEEN_PX;
        edges->steepness[pair] = least(one.height, other.height);
        edges->blur_px2[0][pair] = one.height / one.curvature;
        edges->blur_px2[1][pair] = other.height / other.curvature;
    }
}

/* Find the outermost edge of either sign on either side of where the steep places lie.

   `memory` is for as many doubles as `edges_memory` says; edges lie in it. */
void find_edges(const Strip *strip, Blocks blocks, double *memory, Edges *edges) {
    const int n = blocks.outside + blocks.inside, lanes = strip->excess.lanes;
    edges->blocks = n, edges->outside = blocks.outside, edges->lanes = lanes;
    edges->noise_grey = strip->noise_grey / sqrt(blocks.size);
    lay_out(edges, memory);
    for (int block = 0; block < n; block++) {
        edges->u_px[block] = strip->u_px[first_station(strip, blocks, block) + blocks.size / 2];
    }
    double *means = edges->rising + lanes * n;
    average(strip, blocks, n, means);
    slope(means, lanes, n, edges->rising);
    lie_about(edges);
    for (int block = 0; block < n; block++) find_pairs(edges, block);
}

/* Put the bends of one block's slopes into `bends`; of those that fall they have the other sign. */
static void bend(const Edges *edges, int block, double *bends) {
    const double *slopes = edges->rising + block;
    const int n = edges->blocks;
    for (int lane = 0; lane < edges->lanes - 1; lane++) {
        bends[lane] = slopes[(lane + 1) * n] - slopes[lane * n];
    }
}

static double most_of(const double *values, int count, double sign) {
    double most = -INFINITY;
    for (int number = 0; number < count; number++) most = largest(most, sign * values[number]);
    return most;
}

/* Put the pairs of one block where its outermost feet say. */
static void step_out(const Edges *edges, int block, double noise, double *middle_px, double *width_px) {
    const int count = edges->lanes - 1, half_px = edges->lanes / 2, n = edges->blocks;
    double bends[count];
    bend(edges, block, bends);
    const double most = largest(most_of(bends, count, 1), most_of(bends, count, -1));
    const double at_least = largest(FOOT_SHARE * most, FOOT_SNR * noise), about_px = edges->about_px[block];
    /* Their lanes lie half-way between those of slopes. */
    const int start = (int)largest(ceil(about_px - 0.5 - (half_px - SPARE_PX)), 0);
    const int end = (int)least(floor(about_px - 0.5 + (half_px - SPARE_PX)), count - 3);
    for (int falls = 0; falls < 2; falls++) {
        const double sign = falls ? -1 : 1; /* the foot of a right edge bends as that of a left one */
        const int left = outermost(bends, 1, sign, at_least, start, end, 1);
        const int right = outermost(bends, 1, sign, at_least, end, start, -1);
        const int at = falls * n + block;
        if (left < 0 || edges->width_px[at] <= 0) continue;
        const Peak one = peak_at(bends, 1, sign, left), other = peak_at(bends, 1, sign, right);
        const double left_px = one.lane + 0.5 + FOOT_PX, right_px = other.lane + 0.5 - FOOT_PX;
        if (right_px <= left_px) continue;
        middle_px[at] = (left_px + right_px) / 2 - (half_px - 1);
        width_px[at] = right_px - left_px;
    }
}

/* Put the same pairs with their edges where the outermost feet say into `middle_px` and `width_px`, (2 n).

   Return 0 if feet drown in noise. Pairs without two feet stay as they are. */
int at_feet(const Edges *edges, double *middle_px, double *width_px) {
    const int n = edges->blocks, count = edges->lanes - 1;
    const double noise = edges->noise_grey * sqrt(CURVE_NOISE);
    double most[2 * n], bends[count];
    for (int block = 0; block < n; block++) {
        bend(edges, block, bends);
        most[block] = most_of(bends, count, 1);
        most[n + block] = most_of(bends, count, -1);
    }
    memcpy(middle_px, edges->middle_px, 2 * n * sizeof *middle_px);
    memcpy(width_px, edges->width_px, 2 * n * sizeof *width_px);
    if (median(most, 2 * n) < USUAL_FOOT_SNR * noise) return 0;
    for (int block = 0; block < n; block++) step_out(edges, block, noise, middle_px, width_px);
    return 1;
}
