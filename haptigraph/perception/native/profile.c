/* A shaft's own profile: what it looks like across, in grey and colour, and how much of it there is
   elsewhere.

   Metal mirrors its surroundings, so its contrast changes from image to image, but hardly along one shaft.
   The projection onto its profile is therefore far less noisy than any contrast, and a shadow, which is wider
   and softer, has little of it. */

#include <string.h>

#include "native.h"

#define MAX_REACH_PX 16
#define CORE_PX 1       /* on either side of the shaft's middle */
#define NOISE_FLOOR 3.0 /* times the noise of a pixel: less contrast than that is none */

typedef struct {
    double excess[2 * MAX_REACH_PX + 1], chroma[2 * MAX_REACH_PX + 1];
} Across;

/* Return the excess of a pixel; where the picture itself shows less, the background has changed. */
static double excess_at(const Strip *strip, int lane, int station) {
    const double excess = strip->excess.first[lane * strip->excess.stride + station];
    const double most = 2 * fabs(strip->detrended.first[lane * strip->detrended.stride + station]);
    return minimum(maximum(excess, -most), most);
}

/* Return the lane of the shaft's middle, which may be outside the strip. */
static int middle_lane(const Strip *strip, double offset_px, double slope, int station) {
    const double middle = strip->excess.lanes / 2 + offset_px + slope * strip->u_px[station];
    return clamped(floor(middle + 0.5), -MAX_REACH_PX - 1, strip->excess.lanes + MAX_REACH_PX);
}

/* Add `weight` times what one station shows about a lane. */
static void add_station(const Strip *strip, int lane, int reach, int station, double weight, Across *sum) {
    for (int k = -reach; k <= reach; k++) {
        if (lane + k < 0 || lane + k >= strip->excess.lanes) continue;
        sum->excess[reach + k] += weight * excess_at(strip, lane + k, station);
        if (strip->chroma.lanes) {
            const float *chroma = strip->chroma.first + (lane + k) * strip->chroma.stride;
            sum->chroma[reach + k] += weight * chroma[station];
        }
    }
}

static void mean_across(const Strip *strip, double offset_px, double slope, int reach, int start, int stop,
                        Across *mean) {
    memset(mean, 0, sizeof *mean);
    for (int n = start; n < stop; n++) {
        add_station(strip, middle_lane(strip, offset_px, slope, n), reach, n, 1.0 / (stop - start), mean);
    }
}

static double dot(const Across *one, const Across *other, int reach) {
    double sum = 0;
    for (int k = 0; k <= 2 * reach; k++) {
        sum += one->excess[k] * other->excess[k] + one->chroma[k] * other->chroma[k];
    }
    return sum;
}

/* Return how much of what is dark in some lanes of a shaft's profile there is beyond, and its power. */
static double dark_share(const Across *shaft, const Across *beyond, int first, int last, double *power) {
    double sum = 0;
    *power = 0;
    for (int k = first; k <= last; k++) {
        const double dark = minimum(shaft->excess[k], 0);
        *power += dark * dark;
        sum += dark * beyond->excess[k];
    }
    return sum / *power;
}

/* Return the brightest of some lanes of a profile, or with `sign` -1 the darkest. */
static int extreme(const Across *across, int first, int last, int sign) {
    int best = first;
    for (int k = first + 1; k <= last; k++) {
        if (sign * across->excess[k] > sign * across->excess[best]) best = k;
    }
    return best;
}

/* Return how much there is beyond of the dark rims about a shaft's bright middle, of the rim of which there
   is less: 1 for all of it; 0 if the middle is not `least_grey` brighter than they, as in a shadow, or if the
   shaft has no such rims. */
static double rims_share(const Across *shaft, const Across *beyond, int reach, double noise_grey,
                         double least_grey) {
    if (reach <= CORE_PX) return 0;
    const int middle = extreme(shaft, reach - CORE_PX, reach + CORE_PX, 1), last = 2 * reach;
    const int left = extreme(shaft, 0, middle - 1, -1), right = extreme(shaft, middle + 1, last, -1);
    double left_grey2, right_grey2;
    const double left_share = dark_share(shaft, beyond, 0, middle - 1, &left_grey2);
    const double right_share = dark_share(shaft, beyond, middle + 1, last, &right_grey2);
    if (shaft->excess[middle] <= 0 || minimum(left_grey2, right_grey2) < square(NOISE_FLOOR * noise_grey)) {
        return 0;
    }
    const double rims_grey = (beyond->excess[left] + beyond->excess[right]) / 2;
    return beyond->excess[middle] - rims_grey > least_grey ? minimum(left_share, right_share) : 0;
}

/* Return how much of a shaft's profile, as it is from `start` to before `stop`, the stations from `from` to
   before `until` show, 1 for all of it and 0 for none; NaN if the shaft does not stand out of the noise.
   Found are what noise does to it, and the share of dark rims about a bright middle. The shaft's middle is at
   v = offset_px + slope u. */
EXPORT double profile_share(const Strip *strip, double offset_px, double slope, int reach, int start,
                            int stop, int from, int until, double *found) {
    Across shaft, beyond;
    found[0] = INFINITY, found[1] = 0;
    reach = reach < MAX_REACH_PX ? reach : MAX_REACH_PX;
    if (stop <= start || until <= from || reach < 0) return NAN;
    mean_across(strip, offset_px, slope, reach, start, stop, &shaft);
    mean_across(strip, offset_px, slope, reach, from, until, &beyond);
    const int channels = strip->chroma.lanes ? 2 : 1;
    const double noise_grey2 = square(strip->noise_grey);
    const double power =
        dot(&shaft, &shaft, reach) - channels * (2 * reach + 1) * noise_grey2 / (stop - start);
    if (power <= noise_grey2 / (until - from)) return NAN;
    found[0] = sqrt(noise_grey2 / power / (until - from));
    const double least_grey = NOISE_FLOOR * strip->noise_grey * sqrt(1.5 / (until - from));
    found[1] = rims_share(&shaft, &beyond, reach, strip->noise_grey, least_grey);
    return dot(&shaft, &beyond, reach) / power;
}
