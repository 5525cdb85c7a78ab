/* The jaws of forceps: the metal connected to the shaft in a patch along it (`forceps.jaws`).

   Metal differs from the background about as much as the shaft, has no colour of its own and lies within the
   globe. Its connected part that covers most of the shaft's line ends in a jaw on either side. */

#include <stdlib.h>
#include <string.h>

#include "native.h"

#define LEVEL 0.45 /* of the shaft's contrast; its shadow has less */
#define MIN_CONTRAST_GREY 12.0
#define MAX_CHROMA_GREY 28 /* of metal, between its strongest and weakest colour; dye has more */
#define END_STATIONS 3     /* at the end of a jaw, whose middle is its tip */

/* Write how much a lane differs from the background, times the patch's light. */
static void differences(const JawPatch *patch, int lane, int count, float *restrict differs) {
    const ptrdiff_t first = (ptrdiff_t)lane * patch->stations;
    const float light = (float)patch->light, *background = patch->background + first;
    const uint8_t *grey = patch->grey + first;
    for (int n = 0; n < count; n++) differs[n] = fabsf(grey[n] - background[n] * light);
}

/* Return the median contrast of the shaft: of the mean of its lanes, where it is certainly visible. */
static double shaft_contrast(const JawPatch *patch) {
    const int half = patch->lanes / 2, lanes = 2 * patch->core + 1, count = patch->visible;
    float sum[count], differs[count];
    double contrast[count];
    for (int n = 0; n < count; n++) sum[n] = 0;
    for (int lane = half - patch->core; lane <= half + patch->core; lane++) {
        differences(patch, lane, count, differs);
        for (int n = 0; n < count; n++) sum[n] += differs[n];
    }
    for (int n = 0; n < count; n++) contrast[n] = sum[n] / (float)lanes;
    return median(contrast, count);
}

/* Forget what lies outside the globe in a lane. */
static void keep_inside(const JawPatch *patch, int lane, uint8_t *metal) {
    const double limit = square(patch->radius_px), across = square(lane - patch->center_px[1]);
    int first = 0, stop = patch->stations;
    while (first < stop && !(square(first - patch->center_px[0]) + across < limit)) first++;
    while (stop > first && !(square(stop - 1 - patch->center_px[0]) + across < limit)) stop--;
    memset(metal, 0, (size_t)first), memset(metal + stop, 0, (size_t)(patch->stations - stop));
}

static void keep_grey(const uint8_t *restrict pixels, int count, uint8_t *restrict metal) {
    for (int n = 0; n < count; n++) {
        const uint8_t blue = pixels[3 * n], green = pixels[3 * n + 1], red = pixels[3 * n + 2];
        const uint8_t high = blue > green ? blue : green, low = blue > green ? green : blue;
        const uint8_t chroma = (uint8_t)((high > red ? high : red) - (low < red ? low : red));
        metal[n] &= chroma < MAX_CHROMA_GREY;
    }
}

/* Mark the metal of each lane: what differs from the background at least so much, (lanes, stations). */
static void mark_metal(const JawPatch *patch, float least_grey, uint8_t *restrict metal) {
    const int stations = patch->stations;
    float differs[stations];
    for (int lane = 0; lane < patch->lanes; lane++, metal += stations) {
        const ptrdiff_t first = (ptrdiff_t)lane * stations;
        differences(patch, lane, stations, differs);
        for (int n = 0; n < stations; n++) metal[n] = differs[n] >= least_grey;
        if (patch->pixels) keep_grey(patch->pixels + 3 * first, stations, metal);
        if (patch->is_other) {
            const uint8_t *is_other = patch->is_other + first;
            for (int n = 0; n < stations; n++) metal[n] &= !is_other[n];
        }
        keep_inside(patch, lane, metal);
    }
}

/* Mark what is beside a marked pixel, too; with `flip` 1, what is beside one that is not is marked no more.
   Pixels beyond the border do not count. */
static void widen(const uint8_t *mask, uint8_t flip, int lanes, int stations, uint8_t *restrict widened) {
    uint8_t any[stations + 2];
    any[0] = any[stations + 1] = 0;
    for (int lane = 0; lane < lanes; lane++, mask += stations, widened += stations) {
        const uint8_t *above = lane > 0 ? mask - stations : mask;
        const uint8_t *below = lane < lanes - 1 ? mask + stations : mask;
        for (int n = 0; n < stations; n++) {
            any[n + 1] = (above[n] ^ flip) | (mask[n] ^ flip) | (below[n] ^ flip);
        }
        for (int n = 0; n < stations; n++) widened[n] = (any[n] | any[n + 1] | any[n + 2]) ^ flip;
    }
}

/* Return the first run of the part that a run belongs to. */
static int part_of(Run *runs, int number) {
    while (runs[number].part != number) number = runs[number].part = runs[runs[number].part].part;
    return number;
}

/* Write the runs of marked pixels, lane by lane, those that touch with a common part; return their number. */
static int find_runs(const uint8_t *mask, int lanes, int stations, Run *runs, int room) {
    int count = 0, before = 0; /* `before`: first run of the lane before that may touch */
    for (int lane = 0; lane < lanes; lane++, mask += stations) {
        const int first_here = count;
        for (int at = 0; at < stations && count < room; count++) {
            const uint8_t *first = memchr(mask + at, 1, (size_t)(stations - at));
            if (!first) break;
            const uint8_t *stop = memchr(first, 0, (size_t)(mask + stations - first));
            Run *run = runs + count;
            at = stop ? (int)(stop - mask) : stations;
            *run = (Run){lane, (int)(first - mask), at, count, 0};
            while (before < first_here && runs[before].stop < run->first) before++;
            for (int k = before; k < first_here && runs[k].first <= run->stop; k++) {
                const int one = part_of(runs, k), other = part_of(runs, count);
                runs[one > other ? one : other].part = one > other ? other : one;
            }
        }
        before = first_here;
    }
    return count;
}

/* Return the part that covers most of the shaft's line, -1 if none does. */
static int shaft_part(Run *runs, int count, int half) {
    int part = -1;
    for (int k = 0; k < count; k++) {
        const Run *run = runs + k;
        if (run->lane >= half - 1 && run->lane <= half + 1) {
            runs[part_of(runs, k)].on_line += run->stop - run->first;
        }
    }
    for (int k = 0; k < count; k++) {
        if (runs[k].on_line > (part < 0 ? 0 : runs[part].on_line)) part = k;
    }
    return part;
}

/* Write the tip of a part from one lane to another whose last station is `last`: station and lane. */
static void jaw_tip(Run *runs, int count, int part, int low, int high, int last, double *tip_px) {
    int pixels = 0, sum = 0;
    for (int k = 0; k < count; k++) {
        if (runs[k].lane < low || runs[k].lane > high || part_of(runs, k) != part) continue;
        const int first = last - END_STATIONS + 1, from = runs[k].first > first ? runs[k].first : first;
        const int length = (runs[k].stop < last + 1 ? runs[k].stop : last + 1) - from;
        if (length > 0) pixels += length, sum += length * (runs[k].lane - low);
    }
    tip_px[0] = last + 0.5, tip_px[1] = (double)sum / pixels + low;
}

/* Find the tips of both jaws: (station, lane) of the one beyond the shaft's line, then of the other. Jaws are
   equally long: if only one side extends that far, they are closed and beside the line.

   metal, closed: room for a mask of the patch each.
   runs, room: room for so many runs.
   Returns whether there are jaws. */
VECTORS EXPORT int find_jaws(const JawPatch *patch, uint8_t *metal, uint8_t *closed, Run *runs, int room,
                             double *tips_px) {
    const int lanes = patch->lanes, stations = patch->stations, half = lanes / 2;
    const double contrast_grey = shaft_contrast(patch);
    if (!(contrast_grey >= MIN_CONTRAST_GREY)) return 0;
    mark_metal(patch, (float)maximum(LEVEL * contrast_grey, MIN_CONTRAST_GREY), metal);
    widen(metal, 0, lanes, stations, closed);
    widen(closed, 1, lanes, stations, metal);
    const int count = find_runs(metal, lanes, stations, runs, room), part = shaft_part(runs, count, half);
    if (part < 0) return 0;
    int reach[2] = {-1, -1}, low[2] = {half, 0}, high[2] = {lanes - 1, half};
    for (int k = 0; k < count; k++) {
        for (int side = 0; side < 2; side++) {
            const int is_there = runs[k].lane >= low[side] && runs[k].lane <= high[side];
            if (is_there && runs[k].stop - 1 > reach[side] && part_of(runs, k) == part) {
                reach[side] = runs[k].stop - 1;
            }
        }
    }
    const int longer = reach[1] > reach[0], difference = abs(reach[0] - reach[1]);
    if (reach[longer] < patch->min_length_px) return 0;
    for (int side = 0; side < 2; side++) {
        const int from = reach[side] < 0 || difference > patch->max_difference_px ? longer : side;
        jaw_tip(runs, count, part, low[from], high[from], reach[from], tips_px + 2 * side);
    }
    return 1;
}
