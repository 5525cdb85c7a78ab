/* A line through places of which some are not on it: least squares without outliers, from a line that is
   expected or from the one that most places agree on.

   What is known of the light comes in as further unknowns with priors. It differs on the two sides of the
   wall: each side as a whole may be off by SIDE_PX, and is where one edge fades into the shade. A highlight
   runs beside the axis, the further the thicker the shaft: the middle of a pair may be off by a share of its
   width, a larger one where a bright pair was seen within a dark one. Where feet tell, there is none. */

#include "least_squares.h"

#include <string.h>

#define SIDE_PX 0.2       /* how far the light may shift the middle on one side of the wall as a whole */
#define BRIGHT_ASIDE 0.03 /* the same, as a share of a pair's width */
#define DARK_ASIDE 0.015
#define FINEST_PX 2.4 /* how wide the finest line looks through the lens and the slope filter */
#define TUKEY 4.0
#define ROUNDS 3
#define MISS_PX 3.0
#define LEAST_MISS_PX 0.45
#define COMMON_PX 0.75      /* from the line most pairs are on */
#define LEAST_APART_PX 30.0 /* of the pairs it is drawn through */
#define MOST_TRIED 40

/* Put how far every pair is off the line that most of them are on into `miss_px`.

   Least squares trust a few wide pairs, as a bubble beside the shaft makes, more than all narrow ones. */
void miss_common_line(const Pairs *pairs, const double *trust, double *miss_px) {
    const int n = pairs->edges->blocks;
    float u[2 * n], v[2 * n];
    int usable = 0;
    for (int pair = 0; pair < 2 * n; pair++) {
        if (trust[pair] > 0) {
            u[usable] = (float)pairs->edges->u_px[pair % n];
            v[usable++] = (float)pairs->middle_px[pair];
        }
    }
    const int every = usable / MOST_TRIED + 1;
    float best = -1, best_offset = 0, best_slope = 0;
    for (int one = 0; one < usable; one += every) {
        for (int other = one + every; other < usable; other += every) {
            const float along_px = u[other] - u[one];
            if (fabsf(along_px) < (float)LEAST_APART_PX) continue;
            const float slope = (v[other] - v[one]) / along_px, offset = v[one] - slope * u[one];
            float agree[4] = {0};
            for (int pair = 0; pair < usable; pair++) {
                const float off = (v[pair] - offset - slope * u[pair]) * (float)(1 / COMMON_PX);
                const float close = 1 - off * off;
                agree[pair & 3] += close > 0 ? close : 0;
            }
            const float all = agree[0] + agree[1] + agree[2] + agree[3];
            if (all > best) best = all, best_offset = offset, best_slope = slope;
        }
    }
    for (int pair = 0; pair < 2 * n; pair++) {
        miss_px[pair] = pairs->middle_px[pair] - (best_offset + best_slope * pairs->edges->u_px[pair % n]);
    }
}

/* Turn a symmetric matrix into its inverse (Cholesky). */
static void invert(double matrix[UNKNOWNS][UNKNOWNS]) {
    double lower[UNKNOWNS][UNKNOWNS] = {{0}}, back[UNKNOWNS][UNKNOWNS] = {{0}};
    for (int row = 0; row < UNKNOWNS; row++) {
        for (int column = 0; column <= row; column++) {
            double rest = matrix[row][column];
            for (int k = 0; k < column; k++) rest -= lower[row][k] * lower[column][k];
            lower[row][column] = row == column ? sqrt(rest) : rest / lower[column][column];
        }
    }
    for (int column = 0; column < UNKNOWNS; column++) {
        for (int row = column; row < UNKNOWNS; row++) {
            double rest = row == column;
            for (int k = column; k < row; k++) rest -= lower[row][k] * back[k][column];
            back[row][column] = rest / lower[row][row];
        }
    }
    for (int row = 0; row < UNKNOWNS; row++) {
        for (int column = 0; column <= row; column++) {
            double sum = 0;
            for (int k = row; k < UNKNOWNS; k++) sum += back[k][row] * back[k][column];
            matrix[row][column] = matrix[column][row] = sum;
        }
    }
}

/* Put what each unknown does to the middle of a pair into `design`. */
static void explain(const Pairs *pairs, int pair, double design[UNKNOWNS]) {
    const int n = pairs->edges->blocks, block = pair % n;
    const int is_dark = pair >= n, is_inside = block >= pairs->edges->outside;
    const double aside_px = largest(pairs->width_px[pair] - FINEST_PX, 0);
    design[0] = 1;
    design[1] = pairs->edges->u_px[block] / SCALE_PX;
    design[2] = !is_inside;
    design[3] = is_inside;
    design[4] = is_dark ? 0 : aside_px;
    design[5] = is_dark ? aside_px : 0;
}

/* Begin the normal equations with what is known before; `pull` is that times one over its variance. */
static void begin(const Appearance *look, double matrix[UNKNOWNS][UNKNOWNS], double pull[UNKNOWNS]) {
    const double variances[UNKNOWNS] = {
        1e6, 1e6, square(SIDE_PX), square(SIDE_PX), square(BRIGHT_ASIDE), square(DARK_ASIDE)};
    memset(matrix, 0, sizeof(double[UNKNOWNS][UNKNOWNS]));
    for (int k = 0; k < UNKNOWNS; k++) matrix[k][k] = 1 / variances[k], pull[k] = 0;
    for (int side = 0; side < 2; side++) {
        pull[2 + side] = isnan(look->shaded_px[side]) ? 0 : matrix[2][2] * look->shaded_px[side];
    }
    if (!isnan(look->share)) {
        matrix[4][4] = 1 / square(look->share_sd);
        pull[4] = matrix[4][4] * look->share;
    }
}

/* Solve for the unknowns by least squares once; pairs further than `reach_px` off the line do not count. */
static void solve_once(const Pairs *pairs, const Appearance *look, double reach_px, Weighed *weighed,
                       Solution *found) {
    double design[UNKNOWNS], pull[UNKNOWNS];
    begin(look, found->covariance, pull);
    for (int pair = 0; pair < weighed->pairs; pair++) {
        const double closeness = largest(1 - square(weighed->miss_px[pair] / reach_px), 0);
        const double weight = weighed->trust[pair] * square(closeness); /* Tukey's */
        weighed->is_on[pair] = weight > 0;
        if (!(weight > 0)) continue;
        explain(pairs, pair, design);
        for (int row = 0; row < UNKNOWNS; row++) {
            const double by = weight * design[row];
            for (int column = 0; column <= row; column++)
                found->covariance[row][column] += by * design[column];
            pull[row] += by * pairs->middle_px[pair];
        }
    }
    for (int row = 0; row < UNKNOWNS; row++) {
        for (int column = 0; column < row; column++)
            found->covariance[column][row] = found->covariance[row][column];
    }
    invert(found->covariance);
    for (int row = 0; row < UNKNOWNS; row++) {
        found->answer[row] = 0;
        for (int column = 0; column < UNKNOWNS; column++) {
            found->answer[row] += found->covariance[row][column] * pull[column];
        }
    }
    for (int pair = 0; pair < weighed->pairs; pair++) {
        explain(pairs, pair, design);
        double expected_px = 0;
        for (int k = 0; k < UNKNOWNS; k++) expected_px += found->answer[k] * design[k];
        weighed->miss_px[pair] = pairs->middle_px[pair] - expected_px;
    }
}

/* Solve for the unknowns, leaving out pairs that are off the line; `miss_px` is that it begins with. */
void solve(const Pairs *pairs, const Appearance *look, double reach_px, Weighed *weighed, Solution *found) {
    double off_px[weighed->pairs];
    for (int round = 0; round < ROUNDS; round++) {
        if (round) {
            int usable = 0;
            for (int pair = 0; pair < weighed->pairs; pair++) {
                if (weighed->trust[pair] > 0) off_px[usable++] = fabs(weighed->miss_px[pair]);
            }
            reach_px = least(largest(TUKEY * 1.4826 * median(off_px, usable), LEAST_MISS_PX), MISS_PX);
        }
        solve_once(pairs, look, reach_px, weighed, found);
    }
    double sum = 0;
    int on = 0;
    for (int pair = 0; pair < weighed->pairs; pair++) {
        on += weighed->is_on[pair];
        if (weighed->is_on[pair]) sum += weighed->trust[pair] * square(weighed->miss_px[pair]);
    }
    found->scatter = sum / (on > 2 ? on - 2 : 1);
}
