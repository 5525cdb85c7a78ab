/* Contrast along a shaft: how much its middle differs from its flanks and from the background. */

#include "native.h"

#define MIN_SNR 4.0
#define CORE 5       /* lanes in the middle of a strip */
#define NOISE_SD 2.0 /* contrast within so many standard deviations of the noise has no centroid */
#define RUN 64       /* stations at a time: their sums stay on the stack */

static void sum_of_squares(Rows rows, int lane, const float *weights, int count, int start, int length,
                           double *sums) {
    for (int n = 0; n < length; n++) sums[n] = 0;
    for (int k = 0; k < count; k++) {
        if (lane + k < 0 || lane + k >= rows.lanes) continue;
        const float *grey = rows.first + (lane + k) * rows.stride + start;
        const double weight = weights[k];
        for (int n = 0; n < length; n++) sums[n] += weight * grey[n] * grey[n];
    }
}

void contrast_along(const Strip *strip, int lane, const float *weights, int count, int start, int stop,
                    float *contrast_grey) {
    double excess[RUN], detrended[RUN];
    for (int from = start; from < stop; from += RUN) {
        const int length = stop - from < RUN ? stop - from : RUN;
        sum_of_squares(strip->excess, lane, weights, count, from, length, excess);
        sum_of_squares(strip->detrended, lane, weights, count, from, length, detrended);
        for (int n = 0; n < length; n++) {
            contrast_grey[from - start + n] = (float)sqrt(minimum(excess[n], 4 * detrended[n]));
        }
    }
}

double noise_threshold_grey(double noise_grey, int count) { return MIN_SNR * noise_grey / sqrt(count); }

double core_contrast(const Strip *strip, int start, int stop, float *contrast_grey) {
    static const float weights[CORE] = {0.2f, 0.2f, 0.2f, 0.2f, 0.2f};
    contrast_along(strip, strip->excess.lanes / 2 - CORE / 2, weights, CORE, start, stop, contrast_grey);
    return noise_threshold_grey(strip->noise_grey, CORE);
}

/* Return the lane of the contrast's centroid, from one lane to another, in the mean of some stations; NaN
   without contrast. */
EXPORT double contrast_centroid(const Strip *strip, int first, int last, int start, int stop) {
    const double noise_grey = NOISE_SD * strip->noise_grey * sqrt(stop - start);
    double total = 0, moment = 0;
    for (int lane = first > 0 ? first : 0; lane <= last && lane < strip->excess.lanes; lane++) {
        const float *row = strip->excess.first + lane * strip->excess.stride;
        double sum = 0;
        for (int station = start; station < stop; station++) sum += row[station];
        const double contrast = maximum(fabs(sum) - noise_grey, 0);
        total += contrast;
        moment += contrast * lane;
    }
    return total > 0 ? moment / total : NAN;
}
