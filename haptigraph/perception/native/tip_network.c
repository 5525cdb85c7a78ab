/* The tip network: how likely a tip is at each place about an apparent one, from the pixels along its shaft.

   A convolutional network along the shaft. What a station shows across it becomes `FEATURES` numbers; then
   each layer compares stations that are further apart. `make train-tip` learns its weights. */

#include "tip_network.h"

#include <string.h>

#define STEP_MM 0.08           /* between the stations of its window, */
#define LANE_MM 0.05           /* and between its lanes */
#define SHAFT (TIP_BEHIND - 4) /* stations whose contrast is the unit of all values */
#define COLOR_SHARE 0.5        /* of the colour in that unit */
#define MAX_VALUE 4.0f
#define CHUNK 24 /* stations that are summed together */
#define FINE 8   /* places between two of the network's, where it is combined with a contrast step */
#define ELSEWHERE_SD_MM 0.6
#define PI 3.14159265358979323846

typedef float Features[FEATURES][TIP_STATIONS + 2 * PADDING];

/* Return the value at a position between lanes, and between a station and the next one. */
static float sampled(Rows rows, double lane, int station, double part) {
    const double within = minimum(maximum(lane, 0), rows.lanes - 1.001);
    const int below = (int)within;
    const float *one = rows.first + below * rows.stride + station, *other = one + rows.stride;
    const double left = one[0] + part * ((double)one[1] - one[0]);
    const double right = other[0] + part * ((double)other[1] - other[0]);
    return (float)(left + (within - below) * (right - left));
}

/* Write what the strip shows about an apparent tip; the shaft's middle is at v = offset_px + slope u. */
EXPORT void tip_window(const Strip *strip, double offset_px, double slope, double tip_px, double px_per_mm,
                       float *values) {
    TipWindow *window = (TipWindow *)values;
    const Rows channels[CHANNELS] = {strip->excess, strip->detrended, strip->chroma};
    const int stop =
        strip->inside_stop < strip->excess.stations ? strip->inside_stop : strip->excess.stations;
    memset(window, 0, sizeof *window);
    for (int n = 0; n < TIP_STATIONS; n++) {
        const double u_px = tip_px + (n - TIP_BEHIND) * STEP_MM * px_per_mm;
        const double at = (u_px - strip->u_px[0]) / STATION_PX;
        if (!(at >= strip->inside_start && at < stop - 1)) continue;
        const int station = (int)at;
        window->is_inside[n] = 1;
        for (int k = -SIDE; k <= SIDE; k++) {
            const double lane = strip->excess.lanes / 2 + offset_px + slope * u_px + k * LANE_MM * px_per_mm;
            for (int channel = 0; channel < CHANNELS; channel++) {
                if (!channels[channel].lanes) continue;
                window->seen[channel][k + SIDE][n] = sampled(channels[channel], lane, station, at - station);
            }
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

/* Add to the sums of some stations what rows of values weigh, each at `taps` positions that are `apart`. */
static inline void add_rows(const float *first, ptrdiff_t stride, int rows, int taps, ptrdiff_t apart,
                            const float *weights, float *sums) {
    float here[CHUNK];
    for (int n = 0; n < CHUNK; n++) here[n] = sums[n];
    for (int row = 0; row < rows; row++) {
        for (int tap = 0; tap < taps; tap++) {
            const float *values = first + row * stride + tap * apart, weight = weights[row * taps + tap];
            for (int n = 0; n < CHUNK; n++) here[n] += weight * values[n];
        }
    }
    for (int n = 0; n < CHUNK; n++) sums[n] = here[n];
}

/* Write the features of each station alone. */
static void first_layer(const TipWeights *weights, TipWindow *window, double noise_grey, Features features) {
    const double unit = contrast(window, 0) + COLOR_SHARE * contrast(window, CHANNELS - 1) + 1;
    const float scale = (float)(1 / unit), noise = (float)log((noise_grey + 1) / unit);
    float *values = (float *)window;
    for (int n = 0; n < CHANNELS * ACROSS * TIP_STATIONS; n++) {
        const float value = scale * values[n];
        values[n] = value < -MAX_VALUE ? -MAX_VALUE : value > MAX_VALUE ? MAX_VALUE : value;
    }
    for (int feature = 0; feature < FEATURES; feature++) {
        const float *weight = weights->first[feature];
        const float bias = weights->first_bias[feature] + noise * weight[CHANNELS * ACROSS + 1];
        for (int from = 0; from < TIP_STATIONS; from += CHUNK) {
            float *sums = features[feature] + PADDING + from;
            for (int n = 0; n < CHUNK; n++) sums[n] = bias;
            add_rows(values + from, TIP_STATIONS, CHANNELS * ACROSS + 1, 1, 0, weight, sums);
            for (int n = 0; n < CHUNK; n++) sums[n] = sums[n] > 0 ? sums[n] : 0;
        }
    }
}

/* Add what each station shows together with those so far before and behind it. */
static void add_layer(const TipWeights *weights, int layer, Features features) {
    float sums[FEATURES][TIP_STATIONS];
    const int apart = 1 << layer;
    for (int feature = 0; feature < FEATURES; feature++) {
        for (int n = 0; n < TIP_STATIONS; n++) sums[feature][n] = weights->layer_bias[layer][feature];
        for (int from = 0; from < TIP_STATIONS; from += CHUNK) {
            const float *first = features[0] + PADDING + from - TAPS / 2 * apart;
            add_rows(first, TIP_STATIONS + 2 * PADDING, FEATURES, TAPS, apart,
                     weights->layer[layer][feature][0], sums[feature] + from);
        }
    }
    for (int feature = 0; feature < FEATURES; feature++) {
        for (int n = 0; n < TIP_STATIONS; n++) {
            features[feature][PADDING + n] += sums[feature][n] > 0 ? sums[feature][n] : 0;
        }
    }
}

/* Write the probability of a tip at each place, of which the middle one is the apparent tip, and, last, that
   of none of them. `values` receives a window as `tip_window` writes it, and is changed. */
VECTORS EXPORT void tip_places(const float *numbers, float *values, double noise_grey, double *places) {
    const TipWeights *weights = (const TipWeights *)numbers;
    Features features;
    memset(features, 0, sizeof features);
    first_layer(weights, (TipWindow *)values, noise_grey, features);
    for (int layer = 0; layer < LAYERS; layer++) add_layer(weights, layer, features);
    double elsewhere = weights->elsewhere_bias, highest, total = 0;
    for (int feature = 0; feature < FEATURES; feature++) {
        float most = features[feature][PADDING];
        for (int n = 1; n < TIP_STATIONS; n++) most = fmaxf(most, features[feature][PADDING + n]);
        elsewhere += weights->elsewhere[feature] * most;
    }
    highest = places[TIP_PLACES] = elsewhere;
    for (int place = 0; place < TIP_PLACES; place++) {
        double logit = weights->place_bias;
        for (int feature = 0; feature < FEATURES; feature++) {
            logit +=
                weights->place[feature] * features[feature][PADDING + TIP_BEHIND - TIP_PLACES / 2 + place];
        }
        places[place] = logit;
        highest = maximum(highest, logit);
    }
    for (int place = 0; place <= TIP_PLACES; place++) total += places[place] = exp(places[place] - highest);
    for (int place = 0; place <= TIP_PLACES; place++) places[place] /= total;
}

/* Return the density of the network's places at a fine one, between two of them. */
static double density(const double *places, int fine) {
    const int place = fine / FINE;
    const double part = (double)(fine % FINE) / FINE;
    return places[place] + part * (place + 1 < TIP_PLACES ? places[place + 1] - places[place] : 0);
}

/* Combine the places of a tip with a contrast step, which is at the middle one: sd_mm is its standard
   deviation, `mistaken` the share of such steps that are no tip. `tip` receives how far the tip is beyond the
   step, and its standard deviation [mm]. */
EXPORT void tip_posterior(const double *places, double sd_mm, double mistaken, double *tip) {
    const double step_mm = STEP_MM / FINE, level = 1 / (TIP_PLACES * STEP_MM);
    double total = 0, first = 0, second = 0;
    for (int fine = 0; fine < TIP_PLACES * FINE; fine++) {
        const double at_mm = fine * step_mm - TIP_PLACES / 2 * STEP_MM;
        const double far = exp(-square(at_mm / ELSEWHERE_SD_MM) / 2) / (sqrt(2 * PI) * ELSEWHERE_SD_MM);
        const double near = exp(-square(at_mm / sd_mm) / 2) / (sqrt(2 * PI) * sd_mm);
        const double shown = density(places, fine) / STEP_MM + places[TIP_PLACES] * far;
        const double weight = shown * (mistaken * level + (1 - mistaken) * near);
        total += weight, first += weight * at_mm, second += weight * square(at_mm);
    }
    tip[0] = first / total;
    tip[1] = sqrt(maximum(second / total - square(tip[0]), 0) + square(step_mm) / 12);
}
