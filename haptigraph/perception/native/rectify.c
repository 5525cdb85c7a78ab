/* A rectified strip of the image, less the background (`rectify.rectify`).

   Lanes run along the shaft, stations across it. Each station is detrended: the linear ramp between its two
   ends, its flanks, is subtracted, from the image and from the background alike. */

#include "native.h"

#define FINENESS 32 /* steps per pixel in which OpenCV samples */
#define AWAY 65536  /* steps from 0: truncation rounds where there are no negative numbers */
#define FLANK_PX 4
#define UNEVEN_GREY 10.0 /* between the flanks on known background, where one shows another object, */
#define UNEVEN_SD 3.0    /* and in standard deviations of the noise */
#define EVEN_SHARE 0.33  /* of that: the other flank differs less from the background */
#define MIN_GAIN 0.5
#define MAX_GAIN 2.0
#define MIN_NOISE_GREY 0.5 /* that of rounding */
#define DEFAULT_NOISE_GREY 3.0
#define MIN_FLANK_GREY 16.0 /* of both flanks: darker ones have no colour */

/* Write the image positions of a strip's pixels to `whole` (x, y) and `part`, as `cv2.remap` takes them.

   u_px: positions of the stations along the line, from x, y [px] on; nx, ny across it, dx, dy along it.

   Return 0, and write nothing, if a position is not finite or beyond MAX_PX. */
VECTORS EXPORT int strip_positions(int half_px, const float *u_px, int stations, float x, float y, float nx,
                                   float ny, float dx, float dy, int16_t *whole, uint16_t *part) {
    int is_valid =
        fabsf(x) <= MAX_PX && fabsf(y) <= MAX_PX && fabsf(nx) + fabsf(ny) <= 2 && fabsf(dx) + fabsf(dy) <= 2;
    for (int station = 0; station < stations; station++) is_valid &= fabsf(u_px[station]) <= MAX_PX;
    if (!is_valid) return 0;
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
    return 1;
}

/* The mean grey of both flanks of each station, (n) each. */
typedef struct {
    float *left, *right;
} Flanks;

static void average_flanks(const float *pixels, int lanes, int n, Flanks flanks) {
    for (int station = 0; station < n; station++) flanks.left[station] = flanks.right[station] = 0;
    for (int lane = 0; lane < FLANK_PX; lane++) {
        const float *left = pixels + lane * n, *right = pixels + (lanes - 1 - lane) * n;
        for (int station = 0; station < n; station++) {
            flanks.left[station] += left[station] / FLANK_PX;
            flanks.right[station] += right[station] / FLANK_PX;
        }
    }
}

/* Turn a strip of BGR into grey, between two positions with what is more blue than red brighter. */
static void to_grey(const uint8_t *pixels, int lanes, const float *u_px, int n, double chroma_share,
                    double from_px, double to_px, float *grey) {
    int chroma[n];
    for (int station = 0; station < n; station++) {
        chroma[station] = u_px[station] > from_px && u_px[station] < to_px ? whole_share(chroma_share) : 0;
    }
    for (int lane = 0; lane < lanes; lane++) {
        for (int station = 0; station < n; station++, pixels += 3) {
            grey[lane * n + station] = (float)grey_of(pixels, chroma[station]) / WHOLE;
        }
    }
}

static void mark_known(const float *background, int lanes, int n, uint8_t *is_known) {
    float lowest[n];
    for (int station = 0; station < n; station++) lowest[station] = background[station];
    for (int lane = 1; lane < lanes; lane++) {
        const float *row = background + lane * n;
        for (int station = 0; station < n; station++) {
            lowest[station] = row[station] < lowest[station] ? row[station] : lowest[station];
        }
    }
    for (int station = 0; station < n; station++) is_known[station] = lowest[station] >= 0;
}

/* Return how many times brighter the flanks are than those of the background. */
static double gain(Flanks now, Flanks then, const uint8_t *is_known, int n) {
    double now_sum = 0, then_sum = 0;
    for (int station = 0; station < n; station++) {
        if (!is_known[station]) continue;
        now_sum += now.left[station] + now.right[station];
        then_sum += then.left[station] + then.right[station];
    }
    return then_sum > 0 ? minimum(maximum(now_sum / then_sum, MIN_GAIN), MAX_GAIN) : 1;
}

/* Return a robust standard deviation of the noise.

   From the differences of neighbours along the shaft: its own edges and its shadow's run that way. */
static double estimate_noise(const float *excess, int n) {
    const int pairs = n / 3;
    double changes[FLANK_PX * pairs + 1];
    int count = 0;
    for (int lane = FLANK_PX; lane < 2 * FLANK_PX; lane++) {
        for (int pair = 0; pair < pairs; pair++) {
            const float *at = excess + lane * n + 3 * pair;
            changes[count++] = fabs((double)at[1] - at[0]);
        }
    }
    if (!count) return DEFAULT_NOISE_GREY;
    return maximum(1.4826 / sqrt(2) * median(changes, count), MIN_NOISE_GREY);
}

/* Level stations with one flank only where the other shows another object.

   A bubble or another instrument that reaches into one flank would shift the ramp in the middle as well. */
static void level_with_one_flank(Flanks off, const uint8_t *is_known, int lanes, int n, double noise_grey,
                                 float *excess) {
    const double max_even_grey = maximum(UNEVEN_GREY, UNEVEN_SD * noise_grey);
    for (int station = 0; station < n; station++) {
        const float left = fabsf(off.left[station]), right = fabsf(off.right[station]);
        const float uneven = off.right[station] - off.left[station];
        if (!is_known[station] || fabsf(uneven) <= max_even_grey ||
            minimum(left, right) >= EVEN_SHARE * fabsf(uneven))
            continue;
        for (int lane = 0; lane < lanes; lane++) {
            const float ramp = (float)lane / (float)(lanes - 1);
            excess[lane * n + station] += uneven * (left < right ? ramp : ramp - 1);
        }
    }
}

/* Turn a strip of BGR into the colour that no shadow explains: metal has it on a coloured background.

   A shadow makes blue less red and grey darker by one factor; what is left is not due to it. Zero outside the
   globe.

   now: grey of the flanks.
   factor: how many times brighter each station's background is, (n).
   excess: grey over background and ramp, (lanes, n).
   chroma: how much bluer than red the background is, (lanes, n); receives the colour, in units in which its
   noise is no more than that of the grey. */
static void subtract_chroma(const uint8_t *pixels, int lanes, int n, Flanks now, float light,
                            const uint8_t *is_inside, const float *factor, const float *excess,
                            double noise_grey, float *chroma) {
    float ends[2][n], share[n];
    const Flanks off = {ends[0], ends[1]};
    for (int station = 0; station < n; station++) share[station] = 0;
    for (int lane = 0; lane < lanes; lane++) {
        const int is_flank = lane < FLANK_PX || lane >= lanes - FLANK_PX;
        float *over = chroma + lane * n;
        for (int station = 0; station < n; station++, pixels += 3) {
            const float bluer = (float)(pixels[0] - pixels[2]);
            over[station] = is_inside[station] ? light * bluer - factor[station] * over[station] : 0;
            if (is_flank) share[station] += bluer / FLANK_PX;
        }
    }
    average_flanks(chroma, lanes, n, off);
    for (int station = 0; station < n; station++) {
        const float grey = now.left[station] + now.right[station];
        share[station] = is_inside[station] ? share[station] / (float)maximum(grey, MIN_FLANK_GREY) : 0;
    }
    for (int lane = 0; lane < lanes; lane++) {
        const float right = (float)lane / (float)(lanes - 1), left = 1 - right;
        const float *grey = excess + lane * n;
        float *over = chroma + lane * n;
        for (int station = 0; station < n; station++) {
            over[station] -= left * off.left[station] + right * off.right[station];
            over[station] -= share[station] * grey[station];
        }
    }
    const float scale = (float)minimum(noise_grey / estimate_noise(chroma, n), 1);
    for (int pixel = 0; pixel < lanes * n; pixel++) chroma[pixel] *= scale;
}

/* Subtract a strip's background, and the ramps between the flanks.

   pixels: the strip, (lanes, n, channels), BGR or grey; is made `light` times brighter.
   chroma_share, from_px, to_px: of blue less red in the grey, and between which positions.
   excess: the background, (lanes, n) grey, negative where not known; receives what is left over it.
   detrended, is_known: receive what is left over the ramps alone, (lanes, n), and where the background is
   known, (n).
   chroma: as in `subtract_chroma`; NULL if the grey alone counts.

   Return the noise [grey levels]. */
VECTORS EXPORT double subtract_background(const uint8_t *pixels, int channels, int lanes, int n,
                                          const float *u_px, double chroma_share, double from_px,
                                          double to_px, float light, float *excess, float *detrended,
                                          uint8_t *is_known, float *chroma) {
    float ends[6][n], factor[n];
    const Flanks now = {ends[0], ends[1]}, then = {ends[2], ends[3]}, off = {ends[4], ends[5]};
    if (channels == 3) {
        to_grey(pixels, lanes, u_px, n, chroma_share, from_px, to_px, detrended);
    } else {
        for (int pixel = 0; pixel < lanes * n; pixel++) detrended[pixel] = pixels[pixel];
    }
    mark_known(excess, lanes, n, is_known);
    average_flanks(detrended, lanes, n, now);
    average_flanks(excess, lanes, n, then);
    const float total_gain = light * (float)gain(now, then, is_known, n);
    for (int station = 0; station < n; station++) {
        factor[station] = is_known[station] ? total_gain : 0;
        off.left[station] = light * now.left[station] - factor[station] * then.left[station];
        off.right[station] = light * now.right[station] - factor[station] * then.right[station];
    }
    for (int lane = 0; lane < lanes; lane++) {
        const float right = (float)lane / (float)(lanes - 1), left = 1 - right;
        float *above = detrended + lane * n, *over = excess + lane * n;
        for (int station = 0; station < n; station++) {
            const float level = above[station] - (left * now.left[station] + right * now.right[station]);
            const float ground = over[station] - (left * then.left[station] + right * then.right[station]);
            above[station] = light * level;
            over[station] = above[station] - factor[station] * ground;
        }
    }
    const double noise_grey = estimate_noise(excess, n);
    if (chroma) {
        uint8_t is_inside[n];
        for (int station = 0; station < n; station++) {
            is_inside[station] = u_px[station] > from_px && u_px[station] < to_px;
        }
        subtract_chroma(pixels, lanes, n, now, light, is_inside, factor, excess, noise_grey, chroma);
    }
    level_with_one_flank(off, is_known, lanes, n, noise_grey, excess);
    return noise_grey;
}
