/* A line through the middles of pairs of edges: robust, inverse-variance-weighted least squares, starting
   from the expected line or from the one that most pairs agree on.

   The light enters as further unknowns with priors. It may shift each side of the wall as a whole, and does
   where one edge fades into the shade. A specular highlight runs beside the axis, the further the thicker the
   shaft: it shifts the middle of a pair by a share of its width. Feet have no highlight. */

#include "least_squares.h"

#include <string.h>

#define SIDE_PX 0.2       /* prior sd of the shift on one side of the wall */
#define BRIGHT_SHARE 0.03 /* of the highlight's, as a share of a bright pair's width */
#define DARK_SHARE 0.015
#define FINEST_PX 2.4 /* width of the finest line, through the lens and the slope filter */
#define TUKEY 4.0
#define ROUNDS 3
#define MAX_REACH_PX 3.0
#define MIN_REACH_PX 0.45
#define COMMON_PX 0.75       /* from the line most pairs are on */
#define MIN_DISTANCE_PX 30.0 /* between the two pairs that define a line */
#define MAX_TRIED 40

/* Write how far each pair is off the line that most of them are on.

   Least squares trust a few wide pairs, as a bubble beside the shaft makes, more than all narrow ones. */
void residuals_of_common_line(const Pairs *pairs, const double *weight, double *residual_px) {
    const int n = pairs->edges->blocks;
    float u[2 * n], v[2 * n];
    int usable = 0;
    for (int pair = 0; pair < 2 * n; pair++) {
        if (weight[pair] > 0) {
            u[usable] = (float)pairs->edges->u_px[pair % n];
            v[usable++] = (float)pairs->middle_px[pair];
        }
    }
    const int every = usable / MAX_TRIED + 1;
    float best = -1, best_offset = 0, best_slope = 0;
    for (int one = 0; one < usable; one += every) {
        for (int other = one + every; other < usable; other += every) {
            const float along_px = u[other] - u[one];
            if (fabsf(along_px) < (float)MIN_DISTANCE_PX) continue;
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
        residual_px[pair] =
            pairs->middle_px[pair] - (best_offset + best_slope * pairs->edges->u_px[pair % n]);
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

/* Write one row of the design matrix: what each unknown does to the middle of a pair. */
static void design_row(const Pairs *pairs, int pair, double design[UNKNOWNS]) {
    const int n = pairs->edges->blocks, block = pair % n;
    const int is_dark = pair >= n, is_inside = block >= pairs->edges->outside;
    const double excess_width_px = maximum(pairs->width_px[pair] - FINEST_PX, 0);
    design[0] = 1;
    design[1] = pairs->edges->u_px[block] / SCALE_PX;
    design[2] = !is_inside;
    design[3] = is_inside;
    design[4] = is_dark ? 0 : excess_width_px;
    design[5] = is_dark ? excess_width_px : 0;
}

/* Begin the normal equations with the priors; `right` is their right-hand side. */
static void set_priors(const Appearance *appearance, double matrix[UNKNOWNS][UNKNOWNS],
                       double right[UNKNOWNS]) {
    const double variances[UNKNOWNS] = {
        1e6, 1e6, square(SIDE_PX), square(SIDE_PX), square(BRIGHT_SHARE), square(DARK_SHARE)};
    memset(matrix, 0, sizeof(double[UNKNOWNS][UNKNOWNS]));
    for (int k = 0; k < UNKNOWNS; k++) matrix[k][k] = 1 / variances[k], right[k] = 0;
    for (int side = 0; side < 2; side++) {
        right[2 + side] = isnan(appearance->shaded_px[side]) ? 0 : matrix[2][2] * appearance->shaded_px[side];
    }
    if (!isnan(appearance->highlight)) {
        matrix[4][4] = 1 / square(appearance->highlight_sd);
        right[4] = matrix[4][4] * appearance->highlight;
    }
}

/* Solve once by least squares, without pairs further than `reach_px` off the line. */
static void solve_once(const Pairs *pairs, const Appearance *appearance, double reach_px,
                       Residuals *residuals, Solution *found) {
    double design[UNKNOWNS], right[UNKNOWNS];
    set_priors(appearance, found->covariance, right);
    for (int pair = 0; pair < residuals->pairs; pair++) {
        const double closeness = maximum(1 - square(residuals->residual_px[pair] / reach_px), 0);
        const double weight = residuals->weight[pair] * square(closeness); /* Tukey's */
        residuals->is_inlier[pair] = weight > 0;
        if (!(weight > 0)) continue;
        design_row(pairs, pair, design);
        for (int row = 0; row < UNKNOWNS; row++) {
            const double by = weight * design[row];
            for (int column = 0; column <= row; column++)
                found->covariance[row][column] += by * design[column];
            right[row] += by * pairs->middle_px[pair];
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
            found->answer[row] += found->covariance[row][column] * right[column];
        }
    }
    for (int pair = 0; pair < residuals->pairs; pair++) {
        design_row(pairs, pair, design);
        double expected_px = 0;
        for (int k = 0; k < UNKNOWNS; k++) expected_px += found->answer[k] * design[k];
        residuals->residual_px[pair] = pairs->middle_px[pair] - expected_px;
    }
}

/* Solve by least squares, reweighted without outliers; starts from the residuals that are given. */
void solve(const Pairs *pairs, const Appearance *appearance, double reach_px, Residuals *residuals,
           Solution *found) {
    double off_px[residuals->pairs];
    for (int round = 0; round < ROUNDS; round++) {
        if (round) {
            int usable = 0;
            for (int pair = 0; pair < residuals->pairs; pair++) {
                if (residuals->weight[pair] > 0) off_px[usable++] = fabs(residuals->residual_px[pair]);
            }
            reach_px = minimum(maximum(TUKEY * 1.4826 * median(off_px, usable), MIN_REACH_PX), MAX_REACH_PX);
        }
        solve_once(pairs, appearance, reach_px, residuals, found);
    }
    double sum = 0;
    int inliers = 0;
    for (int pair = 0; pair < residuals->pairs; pair++) {
        inliers += residuals->is_inlier[pair];
        if (residuals->is_inlier[pair]) sum += residuals->weight[pair] * square(residuals->residual_px[pair]);
    }
    found->scatter = sum / (inliers > 2 ? inliers - 2 : 1);
}
