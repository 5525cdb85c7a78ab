/* What explains where pairs of edges lie, as `shaft_line.c` needs it of `least_squares.c`. */

#ifndef HAPTIGRAPH_SOLVE_H
#define HAPTIGRAPH_SOLVE_H

#include "edges.h"

#define UNKNOWNS 6     /* place, slope, a shift on either side of the wall, one by the width of either pair */
#define SCALE_PX 100.0 /* of the slope: keeps the normal equations well conditioned */

/* What earlier images told of how a needle looks (`shaft.Appearance`); NaN for what is not known. */
typedef struct {
    double share, share_sd; /* of the highlight */
    double images;
    double shaded_px[2];
} Appearance;

/* Pairs as the line is laid through them: edges, or their feet. */
typedef struct {
    const Edges *edges;
    const double *middle_px, *width_px; /* (2 n) */
    int are_feet;
} Pairs;

/* What least squares need of every pair, (2 n). */
typedef struct {
    int pairs;
    double *trust;   /* one over the variance; 0 of those that are not there */
    double *miss_px; /* off the line */
    uint8_t *is_on;
} Weighed;

/* What is found, and how sure it is. */
typedef struct {
    double answer[UNKNOWNS], covariance[UNKNOWNS][UNKNOWNS], scatter;
} Solution;

void miss_common_line(const Pairs *pairs, const double *trust, double *miss_px);
void solve(const Pairs *pairs, const Appearance *look, double reach_px, Weighed *weighed, Solution *found);

#endif
