/* How far a needle reaches, roughly: as far as there is contrast along the shaft (`tip.estimate_coarse_tip`).

   Evidence is summed from where the needle comes from, so that a gap (glare, debris) is bridged and a thing
   beyond a long gap is not the needle. Nothing behind the wall can be seen: a needle whose tip is in there
   has none. */

#include "native.h"

#define LEAST_GREY 5.0
#define UNKNOWN_GREY 8.0
#define KNOWN_SHARE 0.1 /* of the contrast that the needle had before */
#define UNKNOWN_SHARE 0.35
#define LEAST_HELD_PX 2.0 /* of tip inside, when the shaft is seen to enter the wall */
#define LEAST_FREE_MM 0.8 /* when it is not */
#define MOUTH_MM 0.55     /* of the hole, inside the wall, may look like a needle if never seen empty */
#define LEAST_OUTSIDE_MM 1.0
#define AT_WALL_MM 0.22

enum { NOWHERE, OUTSIDE, HIDDEN, INSIDE };

/* Where the summed evidence of some stations is greatest, and how great it is. */
typedef struct {
    int stop;
    double evidence_px;
} Farthest;

/* Sum how much every station looks like a needle, -1 to 1. */
static Farthest farthest(const float *contrast_grey, const uint8_t *is_sure, int start, int stop,
                         double noise_grey, double usual_grey) {
    const double sure = largest(largest(LEAST_GREY, noise_grey), KNOWN_SHARE * usual_grey);
    const double unsure = largest(largest(UNKNOWN_GREY, noise_grey), UNKNOWN_SHARE * usual_grey);
    Farthest found = {start, 0};
    double sum_px = 0;
    for (int station = start; station < stop; station++) {
        sum_px += STATION_PX * (least(contrast_grey[station] / (is_sure[station] ? sure : unsure), 2) - 1);
        if (sum_px > found.evidence_px) found = (Farthest){station + 1, sum_px};
    }
    return found;
}

static int count_known(const uint8_t *is_known, int start, int stop) {
    int known = 0;
    for (int station = start; station < stop; station++) known += is_known[station];
    return known;
}

/* Find how far the needle reaches, roughly; the shaft lies near the strip's middle.

   usual_grey: contrast that this needle had inside before; 0 where not known.
   followed_px: how far it reached just before: up to there less shows that it still does.
   told: the last station of the reach, and the length that shows a needle less that that shows none [px].

   Return where the tip is: 0 nowhere, 1 before the wall, 2 in it, 3 inside. */
EXPORT int estimate_coarse_tip(const Strip *strip, double usual_grey, double followed_px, double px_per_mm,
                      double *told) {
    const int stations = strip->excess.stations, start = strip->inside_start;
    float contrast_grey[stations];
    uint8_t is_sure[stations];
    for (int station = 0; station < stations; station++) {
        is_sure[station] = strip->is_known[station] || strip->u_px[station] <= followed_px;
    }
    const double noise_grey = core_contrast(strip, 0, stations, contrast_grey);
    const Farthest outer = farthest(contrast_grey, is_sure, 0, strip->before_stop, noise_grey, 0);
    const Farthest inner =
        farthest(contrast_grey, is_sure, start, strip->inside_stop, noise_grey, usual_grey);
    const int is_outside = outer.evidence_px >= LEAST_OUTSIDE_MM * px_per_mm;
    const int is_held = is_outside &&
                        strip->before_stop - outer.stop <= AT_WALL_MM * px_per_mm / STATION_PX &&
                        count_known(strip->is_known, outer.stop, strip->before_stop) < 2;
    const int mouth = (int)least(ceil(MOUTH_MM * px_per_mm / STATION_PX), strip->inside_stop - start);
    const int is_mouth_known = count_known(strip->is_known, start, start + mouth) == mouth;
    const double held_px = LEAST_HELD_PX + (is_mouth_known ? 0 : MOUTH_MM * px_per_mm);
    if (inner.evidence_px >= (is_held ? held_px : LEAST_FREE_MM * px_per_mm)) {
        told[0] = inner.stop - 1;
        told[1] = inner.evidence_px + outer.evidence_px;
        return INSIDE;
    }
    told[0] = outer.stop - 1;
    told[1] = outer.evidence_px;
    return is_outside ? is_held ? HIDDEN : OUTSIDE : NOWHERE;
}
