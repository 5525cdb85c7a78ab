/* Where the middle of a shaft lies (`bevel.Bevel`). */

#include "native.h"

#define NOISE 2.0 /* what is no more than so many deviations does not count */

/* Return the lane in the middle of what differs from the empty eye, from one lane to another, in the mean of
   some stations; NaN if nothing does. */
EXPORT double middle_lane(const Strip *strip, int first, int last, int start, int stop) {
    const double noise_grey = NOISE * strip->noise_grey * sqrt(stop - start);
    double total = 0, moment = 0;
    for (int lane = first > 0 ? first : 0; lane <= last && lane < strip->excess.lanes; lane++) {
        const float *row = strip->excess.first + lane * strip->excess.stride;
        double sum = 0;
        for (int station = start; station < stop; station++) sum += row[station];
        const double contrast = largest(fabs(sum) - noise_grey, 0);
        total += contrast;
        moment += contrast * lane;
    }
    return total > 0 ? moment / total : NAN;
}
