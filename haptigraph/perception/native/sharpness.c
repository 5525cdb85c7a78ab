/* Sharpness across a shaft: how much a lane differs from the cubic through four lanes beside it. */

#include <string.h>

#include "native.h"

#define SPACING_PX 2 /* between those lanes: an edge or a point changes within it, no shadow does */
#define REACH_PX (2 * SPACING_PX)    /* to either side of a lane, for its sharpness */
#define SHARP_NOISE (sqrt(70.0) / 6) /* root of the sum of the squared weights of lanes in `sharp` */

static inline double sharp(double far_left, double left, double here, double right, double far_right) {
    return fabs(6 * here - 4 * (left + right) + (far_left + far_right)) / 6;
}

/* Write the mean of each `group` stations in a row. */
static void average_groups(const float *values, int groups, int group, float *means) {
    for (int n = 0; n < groups; n++) means[n] = values[n];
    for (int next = 1; next < group; next++) {
        for (int n = 0; n < groups; n++) means[n] += values[n + next];
    }
    for (int n = 0; n < groups; n++) means[n] /= (float)group;
}

/* Write the sharpness of the sharpest lane of the mean of each `group` stations in a row [grey levels]. */
VECTORS EXPORT void sharpness(const float *excess, ptrdiff_t stride, int lanes, int stations, int group,
                              float *sharpness_grey) {
    const int groups = stations + 1 - group;
    float rows[2 * REACH_PX + 1][groups], *row[2 * REACH_PX + 1];
    for (int n = 0; n < groups; n++) sharpness_grey[n] = 0;
    for (int lane = 0; lane < lanes; lane++) {
        for (int n = 0; n <= 2 * REACH_PX; n++) row[n] = rows[(lane + 1 + n) % (2 * REACH_PX + 1)];
        average_groups(excess + lane * stride, groups, group, row[2 * REACH_PX]);
        if (lane < 2 * REACH_PX) continue;
        const float *left = row[REACH_PX - SPACING_PX], *right = row[REACH_PX + SPACING_PX];
        for (int n = 0; n < groups; n++) {
            const float grey =
                (float)sharp(row[0][n], left[n], row[REACH_PX][n], right[n], row[2 * REACH_PX][n]);
            sharpness_grey[n] = grey > sharpness_grey[n] ? grey : sharpness_grey[n];
        }
    }
}

/* Return the sharpness that noise does not reach in the mean of so many stations [grey levels]. */
EXPORT double sharpness_threshold(double noise_grey, int stations) {
    return noise_threshold_grey(SHARP_NOISE * noise_grey, stations);
}

static double mean(const float *values, int count) {
    double sum = 0;
    for (int n = 0; n < count; n++) sum += values[n];
    return sum / count;
}

/* Return the sharpness of the sharpest lane of the mean of all stations [grey levels], -1 if there is too
   little; write the greatest contrast. */
static double max_sharpness(Rows excess, double *contrast_grey) {
    double means[2 * REACH_PX + 1] = {0}, max = 0;
    *contrast_grey = 0;
    if (excess.lanes <= 2 * REACH_PX || excess.stations < 1) return -1;
    for (int lane = 0; lane < excess.lanes; lane++) {
        memmove(means, means + 1, sizeof means - sizeof *means);
        means[2 * REACH_PX] = mean(excess.first + lane * excess.stride, excess.stations);
        if (lane < 2 * REACH_PX) continue;
        const double *here = means + REACH_PX, left = here[-SPACING_PX], right = here[SPACING_PX];
        *contrast_grey = maximum(*contrast_grey, fabs(*here));
        max = maximum(max, sharp(here[-REACH_PX], left, *here, right, here[REACH_PX]));
    }
    return max;
}

/* The same, 0 if there is too little. */
EXPORT double mean_sharpness(const float *excess, ptrdiff_t stride, int lanes, int stations) {
    double contrast_grey;
    return maximum(max_sharpness((Rows){excess, stride, lanes, stations}, &contrast_grey), 0);
}

int is_sharp(const float *excess, ptrdiff_t stride, int lanes, int stations, double share,
             double noise_grey) {
    double contrast_grey;
    const double max = max_sharpness((Rows){excess, stride, lanes, stations}, &contrast_grey);
    return max >= maximum(share * contrast_grey, sharpness_threshold(noise_grey, stations));
}
