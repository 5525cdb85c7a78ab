/* The tip network: how likely a tip is at each place about an apparent one, from the pixels along its shaft.

   A convolutional network along the shaft. What a station shows across it becomes `FEATURES` numbers; then
   each layer compares stations that are further apart. `make train-tip` learns its weights. */

#include "tip_network.h"

#include <float.h>
#include <string.h>

#define STEP_MM 0.08           /* between the stations of its window, */
#define LANE_MM 0.05           /* and between its lanes */
#define SHAFT (TIP_BEHIND - 4) /* stations whose contrast is the unit of all values */
#define COLOR_SHARE 0.5        /* of the colour in that unit */
#define MAX_VALUE 4.0f
#define CHUNK 24   /* stations that are summed together, */
#define TOGETHER 3 /* and features */
#define USUAL_PX_PER_MM 18
#define MIN_SD_PX 0.1
#define PLACE_SD_MM 0.05 /* of a tip at a place */
#define FAR_MM 0.3       /* what is further from the mean counts as elsewhere, */
#define FAR_PX 2.5       /* or further than this, in coarse images */

static const double step_sd_px[TIP_STEPS] = {0.3, 1.0};

typedef float Features[FEATURES][TIP_STATIONS + 2 * PADDING];

/* Between a lane and the next one, and between a station and the next one. */
typedef struct {
    int lane, station;
    double past_lane, past_station;
} Place;

static float sampled(Rows rows, Place at) {
    const float *one = rows.first + at.lane * rows.stride + at.station, *other = one + rows.stride;
    const double left = one[0] + at.past_station * ((double)one[1] - one[0]);
    const double right = other[0] + at.past_station * ((double)other[1] - other[0]);
    return (float)(left + at.past_lane * (right - left));
}

/* Write what the strip shows about an apparent tip, in the globe or before it; the shaft's middle is at
   v = offset_px + slope u. */
EXPORT void tip_window(const Strip *strip, double offset_px, double slope, double tip_px, double px_per_mm,
                       int is_outside, float *values) {
    TipWindow *window = (TipWindow *)values;
    const int start = is_outside ? 0 : strip->inside_start, lanes = strip->excess.lanes;
    const int end = is_outside ? strip->outside_stop : strip->inside_stop;
    const int stop = end < strip->excess.stations ? end : strip->excess.stations;
    memset(window, 0, sizeof *window);
    for (int n = 0; n < TIP_STATIONS; n++) {
        const double u_px = tip_px + (n - TIP_BEHIND) * STEP_MM * px_per_mm;
        const double along = (u_px - strip->u_px[0]) / STATION_PX;
        if (!(along >= start && along < stop - 1)) continue;
        Place at = {.station = (int)along};
        at.past_station = along - at.station;
        window->is_inside[n] = 1;
        for (int k = -SIDE; k <= SIDE; k++) {
            const double lane = lanes / 2 + offset_px + slope * u_px + k * LANE_MM * px_per_mm;
            const double across = minimum(maximum(lane, 0), lanes - 1.001);
            at.lane = (int)across, at.past_lane = across - at.lane;
            window->seen[0][k + SIDE][n] = sampled(strip->excess, at);
            window->seen[1][k + SIDE][n] = sampled(strip->detrended, at);
            if (strip->chroma.lanes) window->seen[2][k + SIDE][n] = sampled(strip->chroma, at);
        }
    }
}

/* Return the root mean square of one channel along the shaft. */
static double contrast(const TipWindow *window, int channel) {
    double sum = 0;
    for (int k = 0; k < ACROSS; k++)
        for (int n = 0; n < SHAFT; n++) sum += square(window->seen[channel][k][n]);
    return sqrt(sum / (ACROSS * SHAFT));
}

/* Add to the sums of some stations, for some features, what rows of values weigh, each at `taps` positions
   that are `apart`. */
static inline void add_rows(const float *first, ptrdiff_t stride, int rows, int taps, ptrdiff_t apart,
                            const float *weights, ptrdiff_t next, float sums[TOGETHER][CHUNK]) {
    for (int row = 0; row < rows; row++) {
        for (int tap = 0; tap < taps; tap++) {
            const float *values = first + row * stride + tap * apart;
            for (int feature = 0; feature < TOGETHER; feature++) {
                const float weight = weights[feature * next + row * taps + tap];
                for (int n = 0; n < CHUNK; n++) sums[feature][n] += weight * values[n];
            }
        }
    }
}

/* Write the features of each station alone. */
static void first_layer(const TipWeights *weights, TipWindow *window, const double *context,
                        Features features) {
    const double unit = contrast(window, 0) + COLOR_SHARE * contrast(window, CHANNELS - 1) + 1;
    const float scale = (float)(1 / unit);
    const float whole[CONTEXT] = {(float)log((context[0] + 1) / unit),
                                  (float)log(context[1] / USUAL_PX_PER_MM),
                                  (float)log(context[2] + MIN_SD_PX)};
    float *values = (float *)window;
    for (int n = 0; n < CHANNELS * ACROSS * TIP_STATIONS; n++) {
        const float value = scale * values[n];
        values[n] = value < -MAX_VALUE ? -MAX_VALUE : value > MAX_VALUE ? MAX_VALUE : value;
    }
    float sums[TOGETHER][CHUNK];
    for (int feature = 0; feature < FEATURES; feature += TOGETHER) {
        for (int from = 0; from < TIP_STATIONS; from += CHUNK) {
            for (int k = 0; k < TOGETHER; k++) {
                const float *rest = weights->first[feature + k] + CHANNELS * ACROSS + 1;
                float bias = weights->first_bias[feature + k];
                for (int n = 0; n < CONTEXT; n++) bias += rest[n] * whole[n];
                for (int n = 0; n < CHUNK; n++) {
                    sums[k][n] = bias + (from + n == TIP_BEHIND ? rest[CONTEXT] : 0);
                }
            }
            add_rows(values + from, TIP_STATIONS, CHANNELS * ACROSS + 1, 1, 0, weights->first[feature],
                     sizeof weights->first[0] / sizeof(float), sums);
            for (int k = 0; k < TOGETHER; k++) {
                float *written = features[feature + k] + PADDING + from;
                for (int n = 0; n < CHUNK; n++) written[n] = sums[k][n] > 0 ? sums[k][n] : 0;
            }
        }
    }
}

/* Write the features of each station, with what it shows together with those so far before and behind it. */
static void add_layer(const TipWeights *weights, int layer, Features before, Features after) {
    const int apart = 1 << layer;
    float sums[TOGETHER][CHUNK];
    for (int feature = 0; feature < FEATURES; feature += TOGETHER) {
        for (int from = PADDING; from < PADDING + TIP_STATIONS; from += CHUNK) {
            for (int k = 0; k < TOGETHER; k++)
                for (int n = 0; n < CHUNK; n++) sums[k][n] = weights->layer_bias[layer][feature + k];
            add_rows(before[0] + from - TAPS / 2 * apart, TIP_STATIONS + 2 * PADDING, FEATURES, TAPS, apart,
                     weights->layer[layer][feature][0], sizeof weights->layer[0][0] / sizeof(float), sums);
            for (int k = 0; k < TOGETHER; k++) {
                const float *old = before[feature + k] + from;
                float *written = after[feature + k] + from;
                for (int n = 0; n < CHUNK; n++) written[n] = old[n] + (sums[k][n] > 0 ? sums[k][n] : 0);
            }
        }
    }
}

/* Return what a station's features weigh. */
static double weighed(const float *weights, float bias, Features features, int station) {
    double sum = bias;
    for (int n = 0; n < FEATURES; n++) sum += weights[n] * features[n][PADDING + station];
    return sum;
}

/* Write the probability of a tip at each place, of which the middle one is the apparent tip, then that of
   none of them, then that of the contrast step there being the tip, as precise as each of `step_sd_px`.
   `context` is noise [grey levels], scale [px per mm], and the step's standard deviation [px]. `values`
   receives a window as `tip_window` writes it, and is changed. */
VECTORS EXPORT void tip_places(const float *numbers, float *values, const double *context, double *places) {
    const TipWeights *weights = (const TipWeights *)numbers;
    Features both[2];
    memset(both, 0, sizeof both);
    first_layer(weights, (TipWindow *)values, context, both[0]);
    for (int layer = 0; layer < LAYERS; layer++) {
        add_layer(weights, layer, both[layer % 2], both[(layer + 1) % 2]);
    }
    float (*const features)[TIP_STATIONS + 2 * PADDING] = both[LAYERS % 2];
    double elsewhere = weights->elsewhere_bias, highest, total = 0;
    for (int feature = 0; feature < FEATURES; feature++) {
        float most = features[feature][PADDING];
        for (int n = 1; n < TIP_STATIONS; n++) most = fmaxf(most, features[feature][PADDING + n]);
        elsewhere += weights->elsewhere[feature] * most;
    }
    highest = places[TIP_PLACES] = elsewhere;
    for (int n = 0; n < TIP_PLACES; n++) {
        places[n] = weighed(weights->place, weights->place_bias, features, TIP_BEHIND - TIP_PLACES / 2 + n);
    }
    for (int n = 0; n < TIP_STEPS; n++) {
        places[TIP_PLACES + 1 + n] = weighed(weights->step[n], weights->step_bias[n], features, TIP_BEHIND);
    }
    for (int n = 0; n < TIP_KINDS; n++) highest = maximum(highest, places[n]);
    for (int n = 0; n < TIP_KINDS; n++) total += places[n] = exp(places[n] - highest);
    for (int n = 0; n < TIP_KINDS; n++) places[n] /= total;
}

/* Return where a kind of `tip_places` is, and its standard deviation [mm]. */
static double at_mm(int kind, double px_per_mm, double *sd_mm) {
    const int step = kind - TIP_PLACES - 1;
    *sd_mm = step < 0 ? PLACE_SD_MM : step_sd_px[step] / px_per_mm;
    return step < 0 ? (kind - TIP_PLACES / 2) * STEP_MM : 0;
}

/* Write mean and standard deviation [mm] of the places near `about_mm`, and the probability of all others. */
static void summed(const double *shares, double px_per_mm, double about_mm, double within_mm, double *tip) {
    double near = DBL_MIN, first = 0, second = 0, sd_mm;
    for (int kind = 0; kind < TIP_KINDS; kind++) {
        const double mm = at_mm(kind, px_per_mm, &sd_mm);
        if (kind == TIP_PLACES || fabs(mm - about_mm) > within_mm) continue;
        near += shares[kind], first += shares[kind] * mm;
        second += shares[kind] * (square(mm) + square(sd_mm));
    }
    tip[0] = first / near;
    tip[1] = sqrt(maximum(second / near - square(tip[0]), 0));
    tip[2] = 1 - near;
}

/* Write how far a tip is beyond the apparent one, its standard deviation [mm], and how probably it is far
   from there, from what `tip_places` wrote. */
EXPORT void tip_posterior(const double *places, double px_per_mm, double *tip) {
    summed(places, px_per_mm, 0, INFINITY, tip);
    summed(places, px_per_mm, tip[0], maximum(FAR_MM, FAR_PX / px_per_mm), tip);
}

/* The same from a strip, for a tip whose standard deviation is `sd_px`; the others as in `tip_window`. */
EXPORT void judge_tip(const Strip *strip, const float *numbers, double offset_px, double slope, double tip_px,
                      double sd_px, double px_per_mm, int is_outside, double *tip) {
    const double context[CONTEXT] = {strip->noise_grey, px_per_mm, sd_px};
    float values[TIP_VALUES];
    double places[TIP_KINDS];
    tip_window(strip, offset_px, slope, tip_px, px_per_mm, is_outside, values);
    tip_places(numbers, values, context, places);
    tip_posterior(places, px_per_mm, tip);
}
