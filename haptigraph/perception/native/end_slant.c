/* How a shaft's end is cut, from where each of its lanes ends.

   A lane ends where all its contrast up to beyond the tip says so: as far on as that contrast is, over its
   usual contrast. Each lane is compared with itself, so it does not matter how the metal is lit, nor does
   blur along the shaft. A plane that cuts a cylinder lets it end, at x from -1 to 1 across it, at
   slant x / 2 + curve sqrt(1 - x^2) widths from somewhere: no other end has a slant without a curve. */

#include "least_squares.h"

#define WHOLE_WIDTHS 5.0 /* before the tip, from where on */
#define CUT_WIDTHS 3.0   /* to where a shaft is whole */
#define MIN_WHOLE 3      /* stations there */
#define BESIDE_PX 1.0    /* of blur beside the shaft, */
#define BEYOND_PX 2.0    /* and beyond the tip */

/* Return the sum of the contrast of some stations, along a line parallel to the shaft that is on a lane at
   its tip. */
static double sum_along(const Strip *strip, double lane, double slope, double tip_px, int start, int stop) {
    double all = 0;
    for (int n = start; n < stop; n++) {
        const double across = lane + slope * (strip->u_px[n] - tip_px);
        const int left = clamped(across, 0, strip->excess.lanes - 2);
        const float *grey = strip->excess.first + left * strip->excess.stride + n;
        all += grey[0] + (across - left) * ((double)grey[strip->excess.stride] - grey[0]);
    }
    return all;
}

/* Return the first station within the globe that is no nearer than a position along the strip. */
static int station_at(const Strip *strip, double at_px) {
    const int stop = minimum(strip->inside_stop, strip->excess.stations);
    return clamped(ceil((at_px - strip->u_px[0]) / STATION_PX), strip->inside_start, stop);
}

/* Write slant and curve of a shaft's end [widths], and the standard deviation of the slant. The shaft's
   middle is at v = offset_px + slope u. Return whether enough of it is visible. */
EXPORT int end_slant(const Strip *strip, double offset_px, double slope, double tip_px, double width_px,
                     double *found) {
    const int lanes = strip->excess.lanes;
    const int first = station_at(strip, tip_px - WHOLE_WIDTHS * width_px);
    const int start = station_at(strip, tip_px - CUT_WIDTHS * width_px);
    const int stop = station_at(strip, tip_px + BEYOND_PX);
    const double middle = lanes / 2 + offset_px + slope * tip_px, reach_px = width_px / 2 + BESIDE_PX;
    const int last = clamped(floor(middle + reach_px), -1, lanes - 1);
    double inverse[UNKNOWNS][UNKNOWNS] = {{0}}, right[UNKNOWNS] = {0}, answer[UNKNOWNS], unexplained = 0;
    int lane = clamped(ceil(middle - reach_px), 0, lanes);
    const int spare = last - lane + 1 - UNKNOWNS;
    if (start - first < MIN_WHOLE || stop <= start || spare < 1) return 0;
    for (; lane <= last; lane++) {
        const double whole = sum_along(strip, lane, slope, tip_px, first, start) / (start - first);
        const double rest = sum_along(strip, lane, slope, tip_px, start, stop) * STATION_PX / width_px;
        const double x = (lane - middle) / (width_px / 2);
        const double design[UNKNOWNS] = {whole, whole * x / 2, whole * sqrt(maximum(1 - x * x, 0))};
        for (int row = 0; row < UNKNOWNS; row++) {
            for (int column = 0; column < UNKNOWNS; column++) {
                inverse[row][column] += design[row] * design[column];
            }
            right[row] += design[row] * rest;
        }
        unexplained += square(rest);
    }
    invert(inverse);
    multiply(inverse, right, answer);
    for (int n = 0; n < UNKNOWNS; n++) unexplained -= answer[n] * right[n];
    const double ends = stop - start, of_noise = ends * (1 + ends / (start - first)); /* of both sums */
    const double by_noise = of_noise * square(strip->noise_grey * STATION_PX / width_px);
    found[0] = answer[1], found[1] = answer[2];
    found[2] = sqrt(inverse[1][1] * (by_noise + maximum(unexplained, 0) / spare));
    return isfinite(found[0]) && isfinite(found[1]) && isfinite(found[2]);
}
