/* A line through the middles of pairs of edges: robust, inverse-variance-weighted least squares, starting
   from the expected line or from the one that most pairs agree on.

   The light shifts the middles, too. On either side of the wall it may shift all of them: by as much as is
   expected where one edge fades into the shade, and by more or less, which no residual shows. A specular
   highlight runs beside the axis, the further the thicker the shaft: it shifts the middle of a bright pair by
   a share of its width, one of the unknowns. Feet have no highlight. */

#include "least_squares.h"

#include <string.h>

#define MIN_WEIGHT 1e-6   /* inverse variance of an unknown that no pair determines */
#define SIDE_PX 0.2       /* sd of the shift on one side of the wall, besides what is expected */
#define BRIGHT_SHARE 0.03 /* of the shift of a bright pair, as a share of its width */
#define FINEST_PX 2.4     /* width of the finest line, through the lens and the slope filter */
#define MIN_SCATTER 0.05  /* mean squared residual over the expected variance */
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
void invert(double matrix[UNKNOWNS][UNKNOWNS]) {
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

/* Multiply a matrix by a vector. */
void multiply(double matrix[UNKNOWNS][UNKNOWNS], const double vector[UNKNOWNS], double product[UNKNOWNS]) {
    for (int row = 0; row < UNKNOWNS; row++) {
        product[row] = 0;
        for (int column = 0; column < UNKNOWNS; column++)
            product[row] += matrix[row][column] * vector[column];
    }
}

/* Write one row of the design matrix: what each unknown does to the middle of a pair. Return whether the
   pair is within the globe. */
static int design_row(const Pairs *pairs, int pair, double design[UNKNOWNS]) {
    const int n = pairs->edges->blocks, block = pair % n;
    design[0] = 1;
    design[1] = pairs->edges->u_px[block] / SCALE_PX;
    design[2] = pair < n ? maximum(pairs->width_px[pair] - FINEST_PX, 0) : 0;
    return block >= pairs->edges->outside;
}

/* By how much the light is expected to shift middles on either side of the wall. */
static double shift_px(const Appearance *appearance, int is_inside) {
    return isnan(appearance->shaded_px[is_inside]) ? 0 : appearance->shaded_px[is_inside];
}

/* The inverse variance of the highlight's share before this image. */
static double highlight_weight(const Appearance *appearance) {
    return 1 / square(isnan(appearance->highlight) ? BRIGHT_SHARE : appearance->highlight_sd);
}

/* Solve once by least squares, without pairs further than `reach_px` off the line. `outside` receives what a
   shift of all pairs outside the globe adds to the right-hand side. */
static void solve_once(const Pairs *pairs, const Appearance *appearance, double reach_px,
                       Residuals *residuals, Solution *found, double outside[UNKNOWNS]) {
    const double weight_before = highlight_weight(appearance);
    double design[UNKNOWNS], right[UNKNOWNS] = {0};
    memset(found->covariance, 0, sizeof found->covariance);
    memset(outside, 0, sizeof right);
    found->covariance[0][0] = found->covariance[1][1] = MIN_WEIGHT, found->covariance[2][2] = weight_before;
    if (!isnan(appearance->highlight)) right[2] = weight_before * appearance->highlight;
    for (int pair = 0; pair < residuals->pairs; pair++) {
        const double closeness = maximum(1 - square(residuals->residual_px[pair] / reach_px), 0);
        const double weight = residuals->weight[pair] * square(closeness); /* Tukey's */
        residuals->is_inlier[pair] = weight > 0;
        if (!(weight > 0)) continue;
        const int is_inside = design_row(pairs, pair, design);
        const double middle_px = pairs->middle_px[pair] - shift_px(appearance, is_inside);
        for (int row = 0; row < UNKNOWNS; row++) {
            const double by = weight * design[row];
            for (int column = 0; column <= row; column++)
                found->covariance[row][column] += by * design[column];
            right[row] += by * middle_px;
            if (!is_inside) outside[row] += by;
        }
    }
    for (int row = 0; row < UNKNOWNS; row++) {
        for (int column = 0; column < row; column++)
            found->covariance[column][row] = found->covariance[row][column];
    }
    invert(found->covariance);
    multiply(found->covariance, right, found->answer);
    for (int pair = 0; pair < residuals->pairs; pair++) {
        double expected_px = shift_px(appearance, design_row(pairs, pair, design));
        for (int k = 0; k < UNKNOWNS; k++) expected_px += found->answer[k] * design[k];
        residuals->residual_px[pair] = pairs->middle_px[pair] - expected_px;
    }
}

/* Turn the covariance for the expected variances of pairs into the one for `times` as large ones. What was
   known of the highlight before does not get more certain by that. */
static void scale_noise(const Appearance *appearance, double times, double covariance[UNKNOWNS][UNKNOWNS]) {
    const double weight_before = highlight_weight(appearance);
    double of_highlight[UNKNOWNS];
    for (int row = 0; row < UNKNOWNS; row++) of_highlight[row] = covariance[row][2];
    for (int row = 0; row < UNKNOWNS; row++) {
        for (int column = 0; column < UNKNOWNS; column++) {
            const double known = weight_before * of_highlight[row] * of_highlight[column];
            covariance[row][column] = times * covariance[row][column] + (1 - times) * known;
        }
    }
}

/* Solve by least squares, reweighted without outliers; starts from the residuals that are given. */
void solve(const Pairs *pairs, const Appearance *appearance, double reach_px, Residuals *residuals,
           Solution *found) {
    double off_px[residuals->pairs], outside[UNKNOWNS], by_outside[UNKNOWNS];
    for (int round = 0; round < ROUNDS; round++) {
        if (round) {
            int usable = 0;
            for (int pair = 0; pair < residuals->pairs; pair++) {
                if (residuals->weight[pair] > 0) off_px[usable++] = fabs(residuals->residual_px[pair]);
            }
            reach_px = minimum(maximum(TUKEY * 1.4826 * median(off_px, usable), MIN_REACH_PX), MAX_REACH_PX);
        }
        solve_once(pairs, appearance, reach_px, residuals, found, outside);
    }
    double sum = 0;
    int inliers = 0;
    for (int pair = 0; pair < residuals->pairs; pair++) {
        inliers += residuals->is_inlier[pair];
        if (residuals->is_inlier[pair]) sum += residuals->weight[pair] * square(residuals->residual_px[pair]);
    }
    found->scatter = sum / (inliers > 2 ? inliers - 2 : 1);
    multiply(found->covariance, outside, by_outside);
    found->light_rad = sqrt(2) * SIDE_PX * fabs(by_outside[1]); /* a shift inside turns the line back */
    scale_noise(appearance, maximum(found->scatter, MIN_SCATTER), found->covariance);
}
