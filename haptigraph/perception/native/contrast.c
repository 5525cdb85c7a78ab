/* Contrast along a shaft: how much its middle differs from its flanks and from the background. */

#include "native.h"

#define MIN_SNR 4.0
#define CORE 5              /* lanes in the middle of a strip */
#define CHROMA_SD 2.0       /* of the noise in the colour, squared: less is none */
#define NOISE_PER_REACH 3.0 /* grey levels: in noise, stations are averaged to so many either side */
#define MAX_REACH 3
#define BEHIND 12      /* stations whose colour those beyond must have, */
#define MIN_COLOR 0.15 /* at least so much of it */
#define MAX_OWN 2.0    /* of its own colour that a shaft shows: more is a vessel that has moved */
#define RUN 64         /* stations at a time: their sums stay on the stack */

/* Return the mean of some stations about one, of those that there are. */
static inline double mean_about(const float *grey, int stations, int at, int reach) {
    const int first = at > reach ? at - reach : 0;
    const int last = at + reach < stations ? at + reach : stations - 1;
    double sum = 0;
    for (int n = first; n <= last; n++) sum += grey[n];
    return sum / (last - first + 1);
}

static void sum_of_squares(Rows rows, int lane, const float *weights, int count, int start, int length,
                           int reach, double *sums) {
    for (int n = 0; n < length; n++) sums[n] = 0;
    for (int k = 0; k < count; k++) {
        if (lane + k < 0 || lane + k >= rows.lanes) continue;
        const float *grey = rows.first + (lane + k) * rows.stride;
        const double weight = weights[k];
        if (reach) {
            for (int n = 0; n < length; n++) {
                sums[n] += weight * square(mean_about(grey, rows.stations, start + n, reach));
            }
        } else {
            for (int n = 0; n < length; n++) sums[n] += weight * grey[start + n] * grey[start + n];
        }
    }
}

void contrast_along(const Strip *strip, int lane, const float *weights, int count, int start, int stop,
                    int reach, float *contrast_grey) {
    const double noise_grey2 = square(strip->noise_grey) / (2 * reach + 1);
    double excess[RUN], detrended[RUN], chroma[RUN];
    for (int from = start; from < stop; from += RUN) {
        const int length = stop - from < RUN ? stop - from : RUN;
        sum_of_squares(strip->excess, lane, weights, count, from, length, reach, excess);
        sum_of_squares(strip->detrended, lane, weights, count, from, length, reach, detrended);
        sum_of_squares(strip->chroma, lane, weights, count, from, length, reach, chroma);
        for (int n = 0; n < length; n++) {
            const double bluer = maximum(chroma[n] - CHROMA_SD * noise_grey2, 0);
            contrast_grey[from - start + n] = (float)sqrt(minimum(excess[n], 4 * detrended[n]) + bluer);
        }
    }
}

double noise_threshold_grey(double noise_grey, int count) { return MIN_SNR * noise_grey / sqrt(count); }

static double core_contrast_in(const Strip *strip, int lanes, int start, int stop, float *contrast_grey) {
    static const float weights[CORE] = {0.2f, 0.2f, 0.2f, 0.2f, 0.2f};
    const int reach = clamped(strip->noise_grey / NOISE_PER_REACH, 0, MAX_REACH);
    contrast_along(strip, lanes / 2 - CORE / 2, weights, CORE, start, stop, reach, contrast_grey);
    return noise_threshold_grey(strip->noise_grey, CORE * (2 * reach + 1));
}

double core_contrast(const Strip *strip, int start, int stop, float *contrast_grey) {
    return core_contrast_in(strip, strip->excess.lanes, start, stop, contrast_grey);
}

/* Return the share of some stations whose middle lanes have a colour that no shadow explains, as clear as
   right before them; 0 if it is not clear there. */
EXPORT double colored_share(const Strip *strip, int start, int stop, double grey) {
    const int first = start - BEHIND > strip->inside_start ? start - BEHIND : strip->inside_start;
    if (start <= first || stop <= start) return 0;
    Strip colour = *strip;
    float contrast_grey[stop - first];
    double behind[BEHIND];
    colour.excess.lanes = colour.detrended.lanes = 0;
    const double noise_grey = core_contrast_in(&colour, strip->chroma.lanes, first, stop, contrast_grey);
    for (int n = 0; n < start - first; n++) behind[n] = contrast_grey[n];
    const double usual_grey = median(behind, start - first);
    const double level = maximum(noise_grey, MIN_COLOR * usual_grey);
    int colored = 0;
    for (int n = start - first; n < stop - first; n++) colored += contrast_grey[n] >= level;
    return usual_grey >= maximum(noise_grey, grey) ? (double)colored / (stop - start) : 0;
}

/* Return how much bluer than red the middle lanes are, with its sign. */
static double bluer_at(const Strip *strip, int station, int reach) {
    const Rows rows = strip->chroma;
    double sum = 0;
    for (int k = -(CORE / 2); k <= CORE / 2; k++) {
        const int lane = rows.lanes / 2 + k;
        if (lane < 0 || lane >= rows.lanes) continue;
        sum += mean_about(rows.first + lane * rows.stride, rows.stations, station, reach);
    }
    return sum / CORE;
}

double own_color(const Strip *strip, int start, int stop, float *shown_grey, double *noise_grey) {
    const int first = start - BEHIND;
    if (first < strip->inside_start || !strip->chroma.lanes) return 0;
    const int reach = clamped(strip->noise_grey / NOISE_PER_REACH, 0, MAX_REACH);
    *noise_grey = noise_threshold_grey(strip->noise_grey, CORE * (2 * reach + 1));
    double behind[BEHIND];
    for (int n = first; n < start; n++) behind[n - first] = bluer_at(strip, n, reach);
    const double own = median(behind, BEHIND), sign = own < 0 ? -1 : 1;
    if (fabs(own) < *noise_grey) return 0;
    for (int n = start; n < stop; n++) {
        const double bluer = sign * bluer_at(strip, n, reach);
        shown_grey[n - start] = bluer <= MAX_OWN * fabs(own) ? (float)maximum(bluer, 0) : 0;
    }
    return fabs(own);
}

/* Return the share of some stations whose middle lanes show at least half of the shaft's own colour; 0 if
   that is less than `grey`. */
EXPORT double own_color_share(const Strip *strip, int start, int stop, double grey) {
    if (stop <= start) return 0;
    float shown_grey[stop - start];
    double noise_grey;
    const double own_grey = own_color(strip, start, stop, shown_grey, &noise_grey);
    if (own_grey < grey || !own_grey) return 0;
    int colored = 0;
    for (int n = 0; n < stop - start; n++) colored += shown_grey[n] >= maximum(noise_grey, own_grey / 2);
    return (double)colored / (stop - start);
}
