/* How sharp something is across a shaft: how much a lane differs from the cubic through four beside it. */

#include <string.h>

#include "native.h"

#define BESIDE_PX 2 /* from lane to lane: an edge or a point changes over so little, no shadow does */
#define REACH_PX (2 * BESIDE_PX)     /* to either side of a lane, that tells how sharp it is */
#define SHARP_NOISE (sqrt(70.0) / 6) /* root of the sum of the squares of what `sharp` weights lanes with */

static inline double sharp(double far_left, double left, double here, double right, double far_right) {
    return fabs(6 * here - 4 * (left + right) + (far_left + far_right)) / 6;
}

/* Write how much the sharpest lane of every station differs from those beside it [grey levels]. */
EXPORT void sharpness(const float *excess, ptrdiff_t stride, int lanes, int stations, float *sharpness_grey) {
    for (int n = 0; n < stations; n++) sharpness_grey[n] = 0;
    for (int lane = REACH_PX; lane < lanes - REACH_PX; lane++) {
        const float *here = excess + lane * stride;
        const float *left = here - BESIDE_PX * stride, *right = here + BESIDE_PX * stride;
        const float *far_left = here - REACH_PX * stride, *far_right = here + REACH_PX * stride;
        for (int n = 0; n < stations; n++) {
            const float grey = (float)sharp(far_left[n], left[n], here[n], right[n], far_right[n]);
            sharpness_grey[n] = grey > sharpness_grey[n] ? grey : sharpness_grey[n];
        }
    }
}

/* Return how sharp the mean of so many stations must be so that noise does not explain it [grey levels]. */
EXPORT double least_sharpness(double noise_grey, int stations) {
    return above_noise_grey(SHARP_NOISE * noise_grey, stations);
}

static double mean(const float *values, int count) {
    double sum = 0;
    for (int n = 0; n < count; n++) sum += values[n];
    return sum / count;
}

/* Return how much the sharpest lane of the mean of all stations differs from those beside it [grey levels];
   its greatest contrast goes to `contrast_grey`. Return -1 if there is too little to tell. */
static double sharpest(Rows excess, double *contrast_grey) {
    double means[2 * REACH_PX + 1] = {0}, most = 0;
    *contrast_grey = 0;
    if (excess.lanes <= 2 * REACH_PX || excess.stations < 1) return -1;
    for (int lane = 0; lane < excess.lanes; lane++) {
        memmove(means, means + 1, sizeof means - sizeof *means);
        means[2 * REACH_PX] = mean(excess.first + lane * excess.stride, excess.stations);
        if (lane < 2 * REACH_PX) continue;
        const double *here = means + REACH_PX, left = here[-BESIDE_PX], right = here[BESIDE_PX];
        *contrast_grey = largest(*contrast_grey, fabs(*here));
        most = largest(most, sharp(here[-REACH_PX], left, *here, right, here[REACH_PX]));
    }
    return most;
}

/* The same, 0 if there is too little to tell. */
EXPORT double mean_sharpness(const float *excess, ptrdiff_t stride, int lanes, int stations) {
    double contrast_grey;
    return largest(sharpest((Rows){excess, stride, lanes, stations}, &contrast_grey), 0);
}

int is_sharp(const float *excess, ptrdiff_t stride, int lanes, int stations, double share,
             double noise_grey) {
    double contrast_grey;
    const double most = sharpest((Rows){excess, stride, lanes, stations}, &contrast_grey);
    return most >= largest(share * contrast_grey, least_sharpness(noise_grey, stations));
}
