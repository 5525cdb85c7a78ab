/* The shaft's middle line: where the middles of its edges lie, weighed by how sure they are.

   Which pairs of edges can be trusted, whether their feet say better where they are, and what the light does
   to them. Knows no trocar and no time. */

#include <stdlib.h>
#include <string.h>

#include "least_squares.h"

#define CLEAR_CONFIDENCE 0.6   /* with less in noise, */
#define LONG_BLOCK (3 * BLOCK) /* so many stations are looked at together */
#define LEAST_SCATTER 0.05     /* of residuals over expected deviations, squared */
#define NEAR_PX 3.0
#define LEAST_STEEP 0.25 /* of the shaft's edges: softer ones are its shadow's */
#define NARROWER_PX 1.2
#define WIDER_PX 3.0
#define FROM_COMMON_PX 1.5  /* a pair so far off the common line may be on the right one */
#define MESSY 3.0           /* scatter: the line may run between two things */
#define SURPRISING_PX 3.0   /* off where it was expected: it may run along something else */
#define LEAST_LEAN_PX2 0.25 /* how much blurrier one edge may be than the other in the same light */
#define LEAN_RATE 0.35      /* shift of the middle away from an edge that fades, per px2; */
#define MOST_LEAN_PX 0.35   /* at most */
#define SHADE_RATE 0.1      /* of what one image tells of that shift */
#define FIRST_SHARE 0.6     /* deviation of a highlight's share when first seen; */
#define SHARE_CHANGE 0.01   /* added per image */
#define RETRY_IMAGES 8      /* after so many without feet they are tried as seldom */
#define BETTER 0.5          /* scatter by feet, over that by slopes */
#define WORSE 2.0
#define FARTHER_OUT_PX 1.5
#define NOISY 0.2        /* scatter that noise alone makes */
#define LEAST_SHARE 0.75 /* of the blocks on the line */

/* A straight line across a strip: v = offset_px + slope u (`shaft.LineFit`). */
typedef struct {
    double offset_px, slope, covariance[3], width_px, blur_px, scatter;
    Appearance look;
    uint8_t *is_on_line, *is_steep; /* of every block, (n) */
    int blocks, on_line;
    double most_off_px; /* how far it leaves the strip's middle at either end */
} Fit;

static double median_of(const double *values, const uint8_t *is_one, int count) {
    double chosen[count];
    int number = 0;
    for (int index = 0; index < count; index++) {
        if (is_one[index]) chosen[number++] = values[index];
    }
    return number ? median(chosen, number) : 0;
}

/* Put by how much pairs are narrower than the shaft must be there into `missing`; infinite if too wide.

   Away from the tip it never gets narrower: a narrower place has lost an outer edge, and so has a dark pair
   within a bright one. A far wider one shows something else's. A width counts for others once two neighbours
   have it. */
static void find_missing(const double *width_px, int n, double *missing) {
    for (int row = 0; row < 2; row++) {
        const double *width = width_px + row * n;
        double most_beyond = -INFINITY, *lacks = missing + row * n;
        lacks[n - 2] = lacks[n - 1] = 0;
        for (int block = n - 3; block >= 0; block--) {
            most_beyond = largest(most_beyond, least(width[block + 1], width[block + 2]));
            lacks[block] = largest(most_beyond - NARROWER_PX - width[block], 0);
        }
        for (int block = 0; row && block < n; block++) {
            if (width[block] > 0) lacks[block] = largest(lacks[block], width_px[block] - width[block]);
        }
        for (int block = 1; block < n - 1; block++) {
            const double common =
                largest(least(width[block - 1], width[block]), least(width[block], width[block + 1]));
            if (width[block] > common + WIDER_PX) lacks[block] = INFINITY;
        }
    }
}

/* Return whether bright pairs lie within dark ones: a highlight on the metal may be seen. */
static int shows_highlight(const double *width_px, const double *missing, int n) {
    int within = 0;
    for (int block = 0; block < n; block++) {
        const double bright = width_px[block], dark = width_px[n + block];
        within += bright > 0 && dark > bright && missing[n + block] < NARROWER_PX;
    }
    return within >= LEAST_BLOCKS;
}

/* Return how far off the middle is on one side of the wall, for one edge fades into the shade, or NaN.

   That edge is blurrier, and found where it begins to fade: the axis lies nearer to it. Beside a dark shaft
   an edge may be blurred by the shaft's shadow just as well. One image tells it badly. */
static double shaded_px(const Edges *edges, int start, int stop, double before_px) {
    const int n = edges->blocks;
    double leans[n];
    int bright = 0, dark = 0;
    for (int block = start; block < stop; block++) {
        dark += edges->width_px[n + block] > 0;
        if (edges->width_px[block] <= 0) continue;
        leans[bright++] = edges->blur_px2[1][block] - edges->blur_px2[0][block];
    }
    if (bright < LEAST_BLOCKS && dark < LEAST_BLOCKS) return before_px;
    const double lean = bright >= dark ? median(leans, bright) : 0;
    const double shift_px = least(LEAN_RATE * largest(fabs(lean) - LEAST_LEAN_PX2, 0), MOST_LEAN_PX);
    const double now_px = -copysign(shift_px, lean);
    return isnan(before_px) ? now_px : before_px + SHADE_RATE * (now_px - before_px);
}

/* Trust every pair as far as it can be; return how many can. */
static int weigh(const Pairs *pairs, const double *missing, double *trust) {
    int usable = 0;
    for (int pair = 0; pair < 2 * pairs->edges->blocks; pair++) {
        const double variance_px2 = pairs->edges->variance_px2[pair] + square(missing[pair] / 2);
        trust[pair] = pairs->width_px[pair] > 0 ? 1 / variance_px2 : 0;
        usable += trust[pair] > 0;
    }
    return usable;
}

/* Mark blocks with edges near the line that are steep enough to be the needle's and not its shadow's.

   Within the globe the ground may be nearly as bright as the needle: there they may be less steep. */
static void mark_steep(const Pairs *pairs, const Weighed *weighed, uint8_t *is_steep) {
    const Edges *edges = pairs->edges;
    const int n = edges->blocks;
    const double usual = median_of(edges->steepness, weighed->is_on, 2 * n);
    uint8_t is_inner[2 * n];
    int inner = 0;
    for (int pair = 0; pair < 2 * n; pair++) {
        is_inner[pair] = weighed->is_on[pair] && pair % n >= edges->outside;
        inner += is_inner[pair];
    }
    const double inner_usual =
        inner >= LEAST_BLOCKS ? least(median_of(edges->steepness, is_inner, 2 * n), usual) : usual;
    for (int block = 0; block < n; block++) {
        const double at_least = LEAST_STEEP * (block >= edges->outside ? inner_usual : usual);
        is_steep[block] = 0;
        for (int pair = block; pair < 2 * n; pair += n) {
            is_steep[block] |= fabs(weighed->miss_px[pair]) <= NEAR_PX && edges->steepness[pair] > at_least &&
                               weighed->trust[pair] > 0;
        }
    }
}

/* Put what was solved into a fit. */
static void conclude(const Pairs *pairs, const Appearance *look, const Weighed *weighed, const Solution *found,
                     Fit *fit) {
    const int n = pairs->edges->blocks;
    const double spread = largest(found->scatter, LEAST_SCATTER);
    fit->offset_px = found->answer[0];
    fit->slope = found->answer[1] / SCALE_PX;
    fit->covariance[0] = spread * found->covariance[0][0];
    fit->covariance[1] = spread * found->covariance[0][1] / SCALE_PX;
    fit->covariance[2] = spread * found->covariance[1][1] / square(SCALE_PX);
    fit->width_px = median_of(pairs->width_px, weighed->is_on, 2 * n);
    fit->blur_px = sharp_blur_px(median_of(pairs->edges->blur_px2[0], weighed->is_on, 2 * n),
                                 median_of(pairs->edges->blur_px2[1], weighed->is_on, 2 * n));
    fit->scatter = found->scatter;
    fit->look = *look;
    if (!isnan(look->share)) {
        fit->look.share = found->answer[4];
        fit->look.share_sd =
            hypot(sqrt(found->covariance[4][4] * largest(found->scatter, 1)), SHARE_CHANGE);
    }
    const double first_px = fit->offset_px + fit->slope * pairs->edges->u_px[0];
    const double last_px = fit->offset_px + fit->slope * pairs->edges->u_px[n - 1];
    fit->most_off_px = largest(fabs(first_px), fabs(last_px));
    mark_steep(pairs, weighed, fit->is_steep);
}

/* Fit the line by what pairs can be trusted, those within `miss_px` of the strip's middle, or, where it
   `is_messy`, of the line that most of them are on. Return 0 if too few blocks are on it. */
static int fit_pairs(const Pairs *pairs, double miss_px, Appearance look, int is_messy, Fit *fit) {
    const int n = pairs->edges->blocks;
    double missing[2 * n], trust[2 * n], off_px[2 * n];
    uint8_t is_on[2 * n];
    Weighed weighed = {2 * n, trust, off_px, is_on};
    Solution found;
    find_missing(pairs->width_px, n, missing);
    if (weigh(pairs, missing, trust) < LEAST_BLOCKS) return 0;
    if (pairs->are_feet) {
        look.share = NAN;
    } else if (isnan(look.share) && shows_highlight(pairs->width_px, missing, n)) {
        look.share = 0, look.share_sd = FIRST_SHARE;
    }
    memcpy(off_px, pairs->middle_px, sizeof off_px);
    if (is_messy) miss_common_line(pairs, trust, off_px);
    solve(pairs, &look, is_messy ? FROM_COMMON_PX : miss_px, &weighed, &found);
    fit->blocks = n, fit->on_line = 0;
    for (int block = 0; block < n; block++) {
        fit->is_on_line[block] = is_on[block] || is_on[n + block];
        fit->on_line += fit->is_on_line[block];
    }
    if (fit->on_line < LEAST_BLOCKS) return 0;
    conclude(pairs, &look, &weighed, &found, fit);
    fit->look.images = pairs->are_feet ? 0 : look.images + 1;
    return 1;
}

/* Tell whether feet lie on one line better than the steepest places do.

   If they are further out they may do so worse: then the steepest places are a highlight's. If not, they must
   do so much better, and noise alone must not explain it. */
static int is_better(const Fit *feet, const Fit *slopes) {
    if (feet->on_line < LEAST_SHARE * slopes->on_line) return 0;
    if (feet->width_px > slopes->width_px + FARTHER_OUT_PX) return feet->scatter < WORSE * slopes->scatter;
    return slopes->scatter > NOISY && feet->scatter < BETTER * slopes->scatter;
}

/* Tell whether the line that most pairs are on is to be preferred to one that may run along something else.
 */
static int is_common_better(const Fit *common, const Fit *fit) {
    return fit->scatter > MESSY || common->on_line > fit->on_line ||
           (common->on_line == fit->on_line && fit->scatter > common->scatter);
}

static void copy_fit(const Fit *from, Fit *to) {
    uint8_t *const is_on_line = to->is_on_line, *const is_steep = to->is_steep;
    memcpy(is_on_line, from->is_on_line, (size_t)from->blocks);
    memcpy(is_steep, from->is_steep, (size_t)from->blocks);
    *to = *from;
    to->is_on_line = is_on_line, to->is_steep = is_steep;
}

/* Fit a line to edges, or to their feet where these are better. Return 0 if there is none. */
static int fit_edges(const Edges *edges, double miss_px, Appearance look, Fit *fit) {
    const int n = edges->blocks;
    double middle_px[2 * n], width_px[2 * n];
    uint8_t masks[2 * n];
    Fit other = {.is_on_line = masks, .is_steep = masks + n};
    Pairs pairs = {edges, edges->middle_px, edges->width_px, 0};
    look.shaded_px[0] = shaded_px(edges, 0, edges->outside, look.shaded_px[0]);
    look.shaded_px[1] = shaded_px(edges, edges->outside, n, look.shaded_px[1]);
    int is_fit = fit_pairs(&pairs, miss_px, look, 0, fit);
    const int tries_feet = look.images < RETRY_IMAGES || fmod(look.images, RETRY_IMAGES) == 0;
    if (tries_feet && at_feet(edges, middle_px, width_px)) {
        const Pairs feet = {edges, middle_px, width_px, 1};
        if (fit_pairs(&feet, miss_px, look, 0, &other) && (!is_fit || is_better(&other, fit))) {
            pairs = feet;
            copy_fit(&other, fit);
            is_fit = 1;
        }
    }
    if (is_fit && (fit->scatter > MESSY || fit->most_off_px > SURPRISING_PX)) {
        const int is_other = fit_pairs(&pairs, miss_px, look, 1, &other);
        if (is_other && is_common_better(&other, fit)) copy_fit(&other, fit);
    }
    return is_fit;
}

/* Fit a line to blocks of so many stations; put their places into `u_px`. Return 0 if there is none, -1
   without memory. */
static int fit_blocks(const Strip *strip, double tip_px, double miss_px, const Appearance *look, int size, Fit *fit,
                      float *u_px) {
    const Blocks blocks = blocks_before(strip, tip_px, size);
    if (blocks.outside + blocks.inside < LEAST_BLOCKS) return 0;
    double *memory = malloc(edges_memory(strip, blocks) * sizeof *memory);
    if (!memory) return -1;
    Edges edges;
    find_edges(strip, blocks, memory, &edges);
    const int is_fit = fit_edges(&edges, miss_px, *look, fit);
    for (int block = 0; block < edges.blocks; block++) u_px[block] = (float)edges.u_px[block];
    free(memory);
    return is_fit;
}

static double confidence(const Fit *fit) { return (double)fit->on_line / fit->blocks; }

static void write(const Fit *fit, double *told) {
    const double values[] = {
        fit->offset_px,         fit->slope,
        fit->covariance[0],     fit->covariance[1],
        fit->covariance[2],     fit->width_px,
        fit->blur_px,           confidence(fit),
        fit->look.share,        fit->look.share_sd,
        fit->look.images,       fit->look.shaded_px[0],
        fit->look.shaded_px[1],
    };
    memcpy(told, values, sizeof values);
}

/* Fit the shaft's middle line to all that is visible of it before the tip (`shaft.fit_line`).

   tip_px: where the needle ends, roughly.
   miss_px: how far the shaft may be from the strip's middle.
   seen: what earlier images told of its look, (5).
   told: the fit, its look at the end, (13).
   blocks_px, is_on_line, is_steep: of every block, room for a third of the stations and one more.

   Return how many blocks there are; 0 if too few show two edges that lie on one line, -1 without memory. */
EXPORT int fit_line(const Strip *strip, double tip_px, double miss_px, const double *seen, double *told,
                    float *blocks_px, uint8_t *is_on_line, uint8_t *is_steep) {
    const Appearance look = {seen[0], seen[1], seen[2], {seen[3], seen[4]}};
    Fit fit = {.is_on_line = is_on_line, .is_steep = is_steep};
    int is_fit = fit_blocks(strip, tip_px, miss_px, &look, BLOCK, &fit, blocks_px);
    if (is_noisy(strip->noise_grey) && is_fit >= 0 && !(is_fit && confidence(&fit) >= CLEAR_CONFIDENCE)) {
        const int most = strip->excess.stations / BLOCK + 1;
        uint8_t masks[2 * most];
        float long_px[most];
        Fit other = {.is_on_line = masks, .is_steep = masks + most};
        const int is_other = fit_blocks(strip, tip_px, miss_px, &look, LONG_BLOCK, &other, long_px);
        if (is_other > 0 && (!is_fit || confidence(&other) > confidence(&fit))) {
            copy_fit(&other, &fit);
            memcpy(blocks_px, long_px, (size_t)other.blocks * sizeof *long_px);
            is_fit = 1;
        }
        if (is_other < 0) is_fit = -1;
    }
    if (is_fit > 0) write(&fit, told);
    return is_fit > 0 ? fit.blocks : is_fit;
}
