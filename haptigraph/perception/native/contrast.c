/* Contrast along a shaft: how much its middle differs from what is beside and was behind it. */

#include "native.h"

#define LEAST_SNR 4.0
#define CORE 5 /* lanes in the middle of a strip */
#define RUN 64 /* stations at a time: what is summed of them stays on the stack */

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
    double differs[RUN], stands_out[RUN];
    for (int from = start; from < stop; from += RUN) {
        const int length = stop - from < RUN ? stop - from : RUN;
        sum_of_squares(strip->excess, lane, weights, count, from, length, differs);
        sum_of_squares(strip->beside, lane, weights, count, from, length, stands_out);
        for (int n = 0; n < length; n++) {
            contrast_grey[from - start + n] = (float)sqrt(least(differs[n], 4 * stands_out[n]));
        }
    }
}

double above_noise_grey(double noise_grey, int count) { return LEAST_SNR * noise_grey / sqrt(count); }

double core_contrast(const Strip *strip, int start, int stop, float *contrast_grey) {
    static const float weights[CORE] = {0.2f, 0.2f, 0.2f, 0.2f, 0.2f};
    contrast_along(strip, strip->excess.lanes / 2 - CORE / 2, weights, CORE, start, stop, contrast_grey);
    return above_noise_grey(strip->noise_grey, CORE);
}
