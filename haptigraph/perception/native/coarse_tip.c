/* The coarse tip: how far there is contrast along the shaft (`coarse_tip.py`).

   Evidence accumulates from where the needle comes from: it bridges a gap (a specular highlight, debris), and
   an object beyond a long gap does not count. Where a shaft becomes as bright as its ground, it is followed
   by its own colour. The wall occludes a tip that is in it. */

#include "native.h"

#define MIN_GREY 5.0 /* contrast of a needle on known background, */
#define MIN_GREY_UNKNOWN 8.0
#define MIN_SHARE 0.1 /* the same as a share of the needle's usual contrast */
#define MIN_SHARE_UNKNOWN 0.35
#define MIN_OWN_SHARE 0.25 /* of the shaft's own colour, where its contrast is lost */
#define MIN_LED_PX 2.0     /* of evidence inside, if the shaft is visible up to the wall, */
#define MIN_FREE_MM 0.8    /* and if it is not */
#define PORT_MM 0.55       /* of the port opening, inside the wall, may look like a needle */
#define CANNULA_MM 2.5     /* that hides a needle inside the wall */
#define MIN_OUTSIDE_MM 1.0
#define AT_WALL_MM 0.22

enum { NOWHERE, OUTSIDE, OCCLUDED, INSIDE };

/* The station at which the accumulated evidence is greatest. */
typedef struct {
    int stop;
    double evidence_px;
} Farthest;

/* Least contrast of a needle. */
typedef struct {
    double sure_grey, unsure_grey;
} Levels;

static Levels levels_of(double noise_grey, double usual_grey) {
    return (Levels){maximum(maximum(MIN_GREY, noise_grey), MIN_SHARE * usual_grey),
                    maximum(maximum(MIN_GREY_UNKNOWN, noise_grey), MIN_SHARE_UNKNOWN * usual_grey)};
}

/* Accumulate how much each station looks like a needle, -1 to 1; what does not is ignored before `free`. */
static Farthest farthest(const float *contrast_grey, const uint8_t *is_sure, int start, int stop, int free,
                         Levels levels) {
    Farthest found = {start, 0};
    double sum_px = 0;
    for (int station = start; station < stop; station++) {
        const double level = is_sure[station] ? levels.sure_grey : levels.unsure_grey;
        sum_px += STATION_PX * (minimum(contrast_grey[station] / level, 2) - 1);
        if (station < free) sum_px = maximum(sum_px, 0);
        if (sum_px > found.evidence_px) found = (Farthest){station + 1, sum_px};
    }
    return found;
}

/* Return how far a shaft continues from `stop` on, where its contrast is lost, in its own colour. */
static int followed(const Strip *strip, int stop) {
    int end = stop;
    while (end < strip->inside_stop && strip->is_known[end]) end++;
    if (end == stop) return stop;
    float shown_grey[end - stop];
    double noise_grey;
    const double own_grey = own_color(strip, stop, end, shown_grey, &noise_grey);
    if (!own_grey) return stop;
    const double level = maximum(noise_grey, MIN_OWN_SHARE * own_grey);
    return stop + farthest(shown_grey, strip->is_known + stop, 0, end - stop, 0, (Levels){level, level}).stop;
}

static int count_known(const uint8_t *is_known, int start, int stop) {
    int known = 0;
    for (int station = start; station < stop; station++) known += is_known[station];
    return known;
}

/* Estimate the tip; the shaft is near the strip's middle.

   usual_grey: contrast that this needle had inside before; 0 if unknown.
   tracked_px: its expected tip: up to there, less contrast suffices.
   tip: receives the tip's station and the evidence for it [px].

   Return where the tip is: 0 nowhere, 1 outside the wall, 2 occluded by it, 3 inside. */
EXPORT int estimate_coarse_tip(const Strip *strip, double usual_grey, double tracked_px, double px_per_mm,
                               double *tip) {
    const int stations = strip->excess.stations, start = strip->inside_start;
    float contrast_grey[stations];
    uint8_t is_sure[stations];
    for (int station = 0; station < stations; station++) {
        is_sure[station] = strip->is_known[station] || strip->u_px[station] <= tracked_px;
    }
    const double noise_grey = core_contrast(strip, 0, stations, contrast_grey);
    const Farthest outer =
        farthest(contrast_grey, is_sure, 0, strip->outside_stop, 0, levels_of(noise_grey, 0));
    const Levels levels = levels_of(noise_grey, usual_grey);
    const Farthest inner = farthest(contrast_grey, is_sure, start, strip->inside_stop, 0, levels);
    const int is_outside = outer.evidence_px >= MIN_OUTSIDE_MM * px_per_mm;
    const int is_led = is_outside &&
                       strip->outside_stop - outer.stop <= AT_WALL_MM * px_per_mm / STATION_PX &&
                       count_known(strip->is_known, outer.stop, strip->outside_stop) < 2;
    const int port = (int)minimum(ceil(PORT_MM * px_per_mm / STATION_PX), strip->inside_stop - start);
    const int is_port_known = count_known(strip->is_known, start, start + port) == port;
    const double led_px = MIN_LED_PX + (is_port_known ? 0 : PORT_MM * px_per_mm);
    if (inner.evidence_px >= (is_led ? led_px : MIN_FREE_MM * px_per_mm)) {
        tip[0] = followed(strip, inner.stop) - 1;
        tip[1] = inner.evidence_px + outer.evidence_px;
        return INSIDE;
    }
    if (is_led) {
        const int free = start + (int)(CANNULA_MM * px_per_mm / STATION_PX);
        const Farthest beyond = farthest(contrast_grey, is_sure, start, strip->inside_stop, free, levels);
        if (beyond.evidence_px >= MIN_FREE_MM * px_per_mm) {
            tip[0] = followed(strip, beyond.stop) - 1;
            tip[1] = beyond.evidence_px + outer.evidence_px;
            return INSIDE;
        }
    }
    tip[0] = outer.stop - 1;
    tip[1] = outer.evidence_px;
    return is_outside ? is_led ? OCCLUDED : OUTSIDE : NOWHERE;
}
