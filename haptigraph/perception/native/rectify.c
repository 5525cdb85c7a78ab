/* A strip of the image laid straight, with the empty eye taken away (`strip.lay_straight`).

   Lanes run along the shaft, stations across it. Every station is put level: the straight ramp between its
   two ends, its flanks, is taken from it, from what is seen and from the empty eye alike. Knows no needle. */

#include "native.h"

#define FINENESS 32 /* OpenCV samples between pixels in such steps */
#define AWAY 65536  /* steps from 0: what is cut off where there are no negative numbers is rounded */
#define FLANK_PX 4
#define APART_GREY 10.0 /* between the flanks of known ground, where one shows something else, */
#define APART_NOISE 3.0
#define EVEN_SHARE 0.33 /* of that: the other flank differs less from the empty eye */
#define LEAST_GAIN 0.5
#define MOST_GAIN 2.0
#define LEAST_NOISE_GREY 0.5 /* that of rounding */
#define UNTOLD_NOISE_GREY 3.0

/* Put where the pixels of a strip lie in the image into `whole` (x, y) and `part`, as `cv2.remap` takes them.

   u_px: places along the line of so many stations.
   x, y: the line's foot [px]; nx, ny across it, dx, dy along it. */
EXPORT void place_strip(int half_px, const float *u_px, int stations, float x, float y, float nx, float ny,
                        float dx, float dy, int16_t *whole, uint16_t *part) {
    for (int lane = -half_px; lane <= half_px; lane++) {
        const float lane_x = (float)lane * nx + x, lane_y = (float)lane * ny + y;
        for (int station = 0; station < stations; station++) {
            const int fine_x = (int)((lane_x + u_px[station] * dx) * FINENESS + (AWAY + 0.5f)) - AWAY;
            const int fine_y = (int)((lane_y + u_px[station] * dy) * FINENESS + (AWAY + 0.5f)) - AWAY;
            whole[2 * station] = (int16_t)(fine_x >> 5);
            whole[2 * station + 1] = (int16_t)(fine_y >> 5);
            part[station] = (uint16_t)((fine_y & (FINENESS - 1)) * FINENESS + (fine_x & (FINENESS - 1)));
        }
        whole += 2 * stations, part += stations;
    }
}

/* What the two flanks of every station are in the mean, (n) each. */
typedef struct {
    float *left, *right;
} Flanks;

static void measure(const float *pixels, int lanes, int n, Flanks flanks) {
    for (int station = 0; station < n; station++) flanks.left[station] = flanks.right[station] = 0;
    for (int lane = 0; lane < FLANK_PX; lane++) {
        const float *left = pixels + lane * n, *right = pixels + (lanes - 1 - lane) * n;
        for (int station = 0; station < n; station++) {
            flanks.left[station] += left[station] / FLANK_PX;
            flanks.right[station] += right[station] / FLANK_PX;
        }
    }
}

/* Turn a strip of BGR into grey, between two places with what is more blue than red brighter. */
static void to_grey(const uint8_t *seen, int lanes, const float *u_px, int n, double chroma_share,
                    double from_px, double to_px, float *grey) {
    int more[n];
    for (int station = 0; station < n; station++) {
        more[station] = u_px[station] > from_px && u_px[station] < to_px ? whole_share(chroma_share) : 0;
    }
    for (int lane = 0; lane < lanes; lane++) {
        for (int station = 0; station < n; station++, seen += 3) {
            grey[lane * n + station] = (float)grey_of(seen, more[station]) / WHOLE;
        }
    }
}

static void mark_known(const float *without, int lanes, int n, uint8_t *is_known) {
    float lowest[n];
    for (int station = 0; station < n; station++) lowest[station] = without[station];
    for (int lane = 1; lane < lanes; lane++) {
        const float *row = without + lane * n;
        for (int station = 0; station < n; station++) {
            lowest[station] = row[station] < lowest[station] ? row[station] : lowest[station];
        }
    }
    for (int station = 0; station < n; station++) is_known[station] = lowest[station] >= 0;
}

/* Return how much brighter the light is than it was for the empty eye, from sums of the flanks. */
static double gain(Flanks now, Flanks then, const uint8_t *is_known, int n) {
    double now_sum = 0, then_sum = 0;
    for (int station = 0; station < n; station++) {
        if (!is_known[station]) continue;
        now_sum += now.left[station] + now.right[station];
        then_sum += then.left[station] + then.right[station];
    }
    return then_sum > 0 ? least(largest(now_sum / then_sum, LEAST_GAIN), MOST_GAIN) : 1;
}

/* Return a robust standard deviation of the noise.

   From the difference of neighbours along the shaft: its own edges and its shadow's run that way. */
static double noise_in(const float *excess, int n) {
    const int pairs = n / 3;
    double changes[FLANK_PX * pairs + 1];
    int count = 0;
    for (int lane = FLANK_PX; lane < 2 * FLANK_PX; lane++) {
        for (int pair = 0; pair < pairs; pair++) {
            const float *at = excess + lane * n + 3 * pair;
            changes[count++] = fabs((double)at[1] - at[0]);
        }
    }
    if (!count) return UNTOLD_NOISE_GREY;
    return largest(1.4826 / sqrt(2) * median(changes, count), LEAST_NOISE_GREY);
}

/* Put stations level with one of their flanks where the other shows something else.

   A bubble or another instrument that reaches into one flank would put the ramp between both off in the
   middle as well. */
static void level_with_one(Flanks off, const uint8_t *is_known, int lanes, int n, double noise_grey,
                           float *excess) {
    const double most_grey = largest(APART_GREY, APART_NOISE * noise_grey);
    for (int station = 0; station < n; station++) {
        const float left = fabsf(off.left[station]), right = fabsf(off.right[station]);
        const float apart = off.right[station] - off.left[station];
        if (!is_known[station] || fabsf(apart) <= most_grey ||
            least(left, right) >= EVEN_SHARE * fabsf(apart))
            continue;
        for (int lane = 0; lane < lanes; lane++) {
            const float ramp = (float)lane / (float)(lanes - 1);
            excess[lane * n + station] += apart * (left < right ? ramp : ramp - 1);
        }
    }
}

/* Take what is level between the flanks from what is seen and from the empty eye, and that from it.

   light: how many times brighter the strip is to be.
   excess: of the empty eye when it begins, what differs from it when it ends.
   beside: what is seen when it begins, what differs from the flanks when it ends.

   Return the noise [grey levels]. */
static double take_level(int lanes, int n, float light, float *excess, float *beside, uint8_t *is_known) {
    float ends[6][n], factor[n];
    const Flanks now = {ends[0], ends[1]}, then = {ends[2], ends[3]}, off = {ends[4], ends[5]};
    mark_known(excess, lanes, n, is_known);
    measure(beside, lanes, n, now);
    measure(excess, lanes, n, then);
    const float again = light * (float)gain(now, then, is_known, n);
    for (int station = 0; station < n; station++) {
        factor[station] = is_known[station] ? again : 0;
        off.left[station] = light * now.left[station] - factor[station] * then.left[station];
        off.right[station] = light * now.right[station] - factor[station] * then.right[station];
    }
    for (int lane = 0; lane < lanes; lane++) {
        const float right = (float)lane / (float)(lanes - 1), left = 1 - right;
        float *above = beside + lane * n, *over = excess + lane * n;
        for (int station = 0; station < n; station++) {
            const float level = above[station] - (left * now.left[station] + right * now.right[station]);
            const float ground = over[station] - (left * then.left[station] + right * then.right[station]);
            above[station] = light * level;
            over[station] = above[station] - factor[station] * ground;
        }
    }
    const double noise_grey = noise_in(excess, n);
    level_with_one(off, is_known, lanes, n, noise_grey, excess);
    return noise_grey;
}

/* Take the empty eye, and what is level between the flanks, from a strip.

   seen, channels: as the camera sees it, (lanes, n, channels), BGR or grey.
   u_px: of the stations.
   chroma_share, from_px, to_px: of blue less red in the grey, and between which places.
   light: how many times brighter the strip is to be.
   excess: the empty eye when it begins, (lanes, n) grey, negative where not known; then what differs from it
   and from the flanks. beside: what differs from the flanks alone, (lanes, n). is_known: stations where the
   empty eye is known, (n).

   Return the noise [grey levels]. */
EXPORT double level_strip(const uint8_t *seen, int channels, int lanes, int n, const float *u_px,
                          double chroma_share, double from_px, double to_px, float light, float *excess,
                          float *beside, uint8_t *is_known) {
    if (channels == 3) {
        to_grey(seen, lanes, u_px, n, chroma_share, from_px, to_px, beside);
    } else {
        for (int pixel = 0; pixel < lanes * n; pixel++) beside[pixel] = seen[pixel];
    }
    return take_level(lanes, n, light, excess, beside, is_known);
}
