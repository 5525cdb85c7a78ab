/* The shaft's middle line: a robust, inverse-variance-weighted fit to the middles of its edges.
   Decides which pairs of edges to trust, and whether their feet locate them better. */

#include <stdlib.h>
#include <string.h>

#include "least_squares.h"

#define CLEAR_CONFIDENCE 0.6   /* with less, in noise, */
#define LONG_BLOCK (3 * BLOCK) /* so many stations are averaged */
#define NEAR_PX 3.0
#define MIN_STEEP_SHARE 0.25 /* of the shaft's edges: its shadow's are less steep */
#define NARROWER_PX 1.2
#define WIDER_PX 3.0
#define FROM_COMMON_PX 1.5    /* a pair so far off the common line may be on the right one */
#define MESSY_SCATTER 1.0     /* the line may run between two objects */
#define UNEXPECTED_PX 3.0     /* off the expected line: it may run along another object */
#define MIN_LEAN_PX2 0.25     /* how much blurrier one edge may be than the other in the same light */
#define LEAN_RATE 0.35        /* shift of the middle away from an edge that fades, per px2; */
#define MAX_LEAN_PX 0.35      /* at most */
#define SHADE_RATE 0.1        /* weight of one image in that shift */
#define HIGHLIGHT_SD 0.6      /* prior sd of a highlight's share when it is first visible; */
#define HIGHLIGHT_CHANGE 0.01 /* sd added per image */
#define RETRY_IMAGES 8        /* after so many without feet, they are tried only every so many images */
#define BETTER 0.5            /* scatter of feet over that of slopes */
#define WORSE 2.0
#define FARTHER_OUT_PX 1.5
#define NOISE_SCATTER 0.2      /* that noise alone explains */
#define MIN_ON_LINE_SHARE 0.75 /* of the blocks */

static double median_where(const double *values, const uint8_t *is_one, int count) {
    double chosen[count];
    int number = 0;
    for (int index = 0; index < count; index++) {
        if (is_one[index]) chosen[number++] = values[index];
    }
    return number ? median(chosen, number) : 0;
}

/* Write by how much pairs are narrower than the shaft must be there; infinity where they are too wide.

   Away from the tip the shaft never gets narrower: a narrower pair has lost an outer edge, and so has a dark
   pair within a bright one. A far wider pair belongs to another object. A width counts for others once two
   neighbours have it. */
static void find_missing_width(const double *width_px, int n, double *missing_px) {
    for (int row = 0; row < 2; row++) {
        const double *width = width_px + row * n;
        double max_beyond = -INFINITY, *missing = missing_px + row * n;
        missing[n - 2] = missing[n - 1] = 0;
        for (int block = n - 3; block >= 0; block--) {
            max_beyond = maximum(max_beyond, minimum(width[block + 1], width[block + 2]));
            missing[block] = maximum(max_beyond - NARROWER_PX - width[block], 0);
        }
        for (int block = 0; row && block < n; block++) {
            if (width[block] > 0) missing[block] = maximum(missing[block], width_px[block] - width[block]);
        }
        for (int block = 1; block < n - 1; block++) {
            const double common =
                maximum(minimum(width[block - 1], width[block]), minimum(width[block], width[block + 1]));
            if (width[block] > common + WIDER_PX) missing[block] = INFINITY;
        }
    }
}

/* Return whether bright pairs lie within dark ones, as a specular highlight on the metal does. */
static int has_highlight(const double *width_px, const double *missing_px, int n) {
    int within = 0;
    for (int block = 0; block < n; block++) {
        const double bright = width_px[block], dark = width_px[n + block];
        within += bright > 0 && dark > bright && missing_px[n + block] < NARROWER_PX;
    }
    return within >= MIN_BLOCKS;
}

/* Return how far off the middle is on one side of the wall because one edge fades into the shade, or NaN.

   That edge is blurrier, and detected where it begins to fade: the axis is nearer to it. The shadow of a dark
   shaft may blur an edge just as well. One image measures this badly. */
static double shaded_px(const Edges *edges, int start, int stop, double before_px) {
    const int n = edges->blocks;
    double leans[n];
    int bright = 0, dark = 0;
    for (int block = start; block < stop; block++) {
        dark += edges->width_px[n + block] > 0;
        if (edges->width_px[block] <= 0) continue;
        leans[bright++] = edges->blur_px2[1][block] - edges->blur_px2[0][block];
    }
    if (bright < MIN_BLOCKS && dark < MIN_BLOCKS) return before_px;
    const double lean = bright >= dark ? median(leans, bright) : 0;
    const double shift_px = minimum(LEAN_RATE * maximum(fabs(lean) - MIN_LEAN_PX2, 0), MAX_LEAN_PX);
    const double now_px = -copysign(shift_px, lean);
    return isnan(before_px) ? now_px : before_px + SHADE_RATE * (now_px - before_px);
}

/* Weigh each pair by its inverse variance; return how many have any weight. */
static int weigh(const Pairs *pairs, const double *missing_px, double *weight) {
    int usable = 0;
    for (int pair = 0; pair < 2 * pairs->edges->blocks; pair++) {
        const double variance_px2 = pairs->edges->variance_px2[pair] + square(missing_px[pair] / 2);
        weight[pair] = pairs->width_px[pair] > 0 ? 1 / variance_px2 : 0;
        usable += weight[pair] > 0;
    }
    return usable;
}

/* Mark blocks with edges near the line that are steep enough for the needle's; its shadow's are not.

   Inside the globe the background may be nearly as bright as the needle: edges may be less steep there. */
static void mark_steep(const Pairs *pairs, const Residuals *residuals, uint8_t *is_steep) {
    const Edges *edges = pairs->edges;
    const int n = edges->blocks;
    const double usual = median_where(edges->steepness, residuals->is_inlier, 2 * n);
    uint8_t is_inner[2 * n];
    int inner = 0;
    for (int pair = 0; pair < 2 * n; pair++) {
        is_inner[pair] = residuals->is_inlier[pair] && pair % n >= edges->outside;
        inner += is_inner[pair];
    }
    const double inner_usual =
        inner >= MIN_BLOCKS ? minimum(median_where(edges->steepness, is_inner, 2 * n), usual) : usual;
    for (int block = 0; block < n; block++) {
        const double threshold = MIN_STEEP_SHARE * (block >= edges->outside ? inner_usual : usual);
        is_steep[block] = 0;
        for (int pair = block; pair < 2 * n; pair += n) {
            is_steep[block] |= fabs(residuals->residual_px[pair]) <= NEAR_PX &&
                               edges->steepness[pair] > threshold && residuals->weight[pair] > 0;
        }
    }
}

/* Turn a solution into a fit. */
static void conclude(const Pairs *pairs, const Appearance *appearance, const Residuals *residuals,
                     const Solution *found, LineFit *fit) {
    const int n = pairs->edges->blocks;
    fit->offset_px = found->answer[0];
    fit->slope = found->answer[1] / SCALE_PX;
    fit->covariance[0] = found->covariance[0][0];
    fit->covariance[1] = found->covariance[0][1] / SCALE_PX;
    fit->covariance[2] = found->covariance[1][1] / square(SCALE_PX);
    fit->light_rad = found->light_rad / SCALE_PX;
    fit->width_px = median_where(pairs->width_px, residuals->is_inlier, 2 * n);
    fit->blur_px = sharp_blur_px(median_where(pairs->edges->blur_px2[0], residuals->is_inlier, 2 * n),
                                 median_where(pairs->edges->blur_px2[1], residuals->is_inlier, 2 * n));
    fit->scatter = found->scatter;
    fit->appearance = *appearance;
    if (!isnan(appearance->highlight)) {
        fit->appearance.highlight = found->answer[2];
        fit->appearance.highlight_sd = sqrt(found->covariance[2][2] + square(HIGHLIGHT_CHANGE));
    }
    const double first_px = fit->offset_px + fit->slope * pairs->edges->u_px[0];
    const double last_px = fit->offset_px + fit->slope * pairs->edges->u_px[n - 1];
    fit->max_offset_px = maximum(fabs(first_px), fabs(last_px));
    mark_steep(pairs, residuals, fit->is_steep);
}

/* Fit the line to the pairs within `miss_px` of the strip's middle or, if `is_messy`, to those near the line
   that most pairs are on. Return 0 if too few blocks are on it. */
static int fit_pairs(const Pairs *pairs, double miss_px, Appearance appearance, int is_messy, LineFit *fit) {
    const int n = pairs->edges->blocks;
    double missing_px[2 * n], weight[2 * n], residual_px[2 * n];
    uint8_t is_inlier[2 * n];
    Residuals residuals = {2 * n, weight, residual_px, is_inlier};
    Solution found;
    find_missing_width(pairs->width_px, n, missing_px);
    if (weigh(pairs, missing_px, weight) < MIN_BLOCKS) return 0;
    if (pairs->are_feet) {
        appearance.highlight = NAN;
    } else if (isnan(appearance.highlight) && has_highlight(pairs->width_px, missing_px, n)) {
        appearance.highlight = 0, appearance.highlight_sd = HIGHLIGHT_SD;
    }
    memcpy(residual_px, pairs->middle_px, sizeof residual_px);
    if (is_messy) residuals_of_common_line(pairs, weight, residual_px);
    solve(pairs, &appearance, is_messy ? FROM_COMMON_PX : miss_px, &residuals, &found);
    fit->blocks = n, fit->on_line = 0;
    for (int block = 0; block < n; block++) {
        fit->is_on_line[block] = is_inlier[block] || is_inlier[n + block];
        fit->on_line += fit->is_on_line[block];
    }
    if (fit->on_line < MIN_BLOCKS) return 0;
    conclude(pairs, &appearance, &residuals, &found, fit);
    fit->appearance.images = pairs->are_feet ? 0 : appearance.images + 1;
    return 1;
}

/* Return whether feet lie on one line better than the steepest slopes do.

   If they are further out they may do so worse: then the steepest slopes are a highlight's. If not, they must
   do so much better, and noise alone must not explain it. */
static int are_feet_better(const LineFit *feet, const LineFit *slopes) {
    if (feet->on_line < MIN_ON_LINE_SHARE * slopes->on_line) return 0;
    if (feet->width_px > slopes->width_px + FARTHER_OUT_PX) return feet->scatter < WORSE * slopes->scatter;
    return slopes->scatter > NOISE_SCATTER && feet->scatter < BETTER * slopes->scatter;
}

/* Return whether the line that most pairs are on is better than one that may run along another object. */
static int is_common_better(const LineFit *common, const LineFit *fit) {
    return fit->scatter > MESSY_SCATTER || common->on_line > fit->on_line ||
           (common->on_line == fit->on_line && fit->scatter > common->scatter);
}

static void copy_fit(const LineFit *from, LineFit *to) {
    uint8_t *const is_on_line = to->is_on_line, *const is_steep = to->is_steep;
    memcpy(is_on_line, from->is_on_line, (size_t)from->blocks);
    memcpy(is_steep, from->is_steep, (size_t)from->blocks);
    *to = *from;
    to->is_on_line = is_on_line, to->is_steep = is_steep;
}

/* Fit a line to edges, or to their feet where these are better. Return 0 if there is none. */
static int fit_edges(const Edges *edges, double miss_px, Appearance appearance, LineFit *fit) {
    const int n = edges->blocks;
    double middle_px[2 * n], width_px[2 * n];
    uint8_t masks[2 * n];
    LineFit other = {.is_on_line = masks, .is_steep = masks + n};
    Pairs pairs = {edges, edges->middle_px, edges->width_px, 0};
    appearance.shaded_px[0] = shaded_px(edges, 0, edges->outside, appearance.shaded_px[0]);
    appearance.shaded_px[1] = shaded_px(edges, edges->outside, n, appearance.shaded_px[1]);
    int is_fit = fit_pairs(&pairs, miss_px, appearance, 0, fit);
    const int tries_feet = appearance.images < RETRY_IMAGES || fmod(appearance.images, RETRY_IMAGES) == 0;
    if (tries_feet && find_feet(edges, middle_px, width_px)) {
        const Pairs feet = {edges, middle_px, width_px, 1};
        if (fit_pairs(&feet, miss_px, appearance, 0, &other) && (!is_fit || are_feet_better(&other, fit))) {
            pairs = feet;
            copy_fit(&other, fit);
            is_fit = 1;
        }
    }
    if (is_fit && (fit->scatter > MESSY_SCATTER || fit->max_offset_px > UNEXPECTED_PX)) {
        const int is_other = fit_pairs(&pairs, miss_px, appearance, 1, &other);
        if (is_other && is_common_better(&other, fit)) copy_fit(&other, fit);
    }
    return is_fit;
}

/* Fit a line to blocks of so many stations; write their positions. Return 0 if there is none, -1 if memory
   runs out. */
static int fit_blocks(const Strip *strip, double tip_px, double miss_px, const Appearance *appearance,
                      int size, LineFit *fit, float *u_px) {
    const Blocks blocks = blocks_before(strip, tip_px, size);
    if (blocks.outside + blocks.inside < MIN_BLOCKS) return 0;
    double *memory = malloc(edges_memory(strip, blocks) * sizeof *memory);
    if (!memory) return -1;
    Edges edges;
    find_edges(strip, blocks, memory, &edges);
    const int is_fit = fit_edges(&edges, miss_px, *appearance, fit);
    for (int block = 0; block < edges.blocks; block++) u_px[block] = (float)edges.u_px[block];
    free(memory);
    return is_fit;
}

static double confidence(const LineFit *fit) { return (double)fit->on_line / fit->blocks; }

/* Fit the shaft's middle line to all that is visible of it before an approximate tip.

   miss_px: how far the shaft may be from the strip's middle.
   u_px, is_on_line, is_steep: receive the blocks; room for the stations over BLOCK and one more.

   Return 1, 0 if too few blocks show two edges on one line, -1 if memory runs out. */
EXPORT int fit_line(const Strip *strip, double tip_px, double miss_px, const Appearance *appearance,
                    LineFit *fit, float *u_px, uint8_t *is_on_line, uint8_t *is_steep) {
    *fit = (LineFit){.is_on_line = is_on_line, .is_steep = is_steep};
    int is_fit = fit_blocks(strip, tip_px, miss_px, appearance, BLOCK, fit, u_px);
    if (is_noisy(strip->noise_grey) && is_fit >= 0 && !(is_fit && confidence(fit) >= CLEAR_CONFIDENCE)) {
        const int room = strip->excess.stations / BLOCK + 1;
        uint8_t masks[2 * room];
        float long_px[room];
        LineFit other = {.is_on_line = masks, .is_steep = masks + room};
        const int is_other = fit_blocks(strip, tip_px, miss_px, appearance, LONG_BLOCK, &other, long_px);
        if (is_other > 0 && (!is_fit || confidence(&other) > confidence(fit))) {
            copy_fit(&other, fit);
            memcpy(u_px, long_px, (size_t)other.blocks * sizeof *long_px);
            is_fit = 1;
        }
        if (is_other < 0) is_fit = -1;
    }
    return is_fit;
}
