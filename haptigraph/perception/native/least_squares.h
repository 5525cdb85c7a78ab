/* What other files need of `least_squares.c`. */

#pragma once

#include "edges.h"

#define UNKNOWNS 3     /* offset, slope, and the highlight's place as a share of its width */
#define SCALE_PX 100.0 /* of the slope: keeps the normal equations well conditioned */

/* The pairs that a line is fitted to: edges, or their feet. */
typedef struct {
    const Edges *edges;
    const double *middle_px, *width_px; /* (2 n) */
    int are_feet;
} Pairs;

/* Weights and residuals of all pairs, (2 n). */
typedef struct {
    int pairs;
    double *weight;      /* inverse variance; 0 for pairs that do not exist */
    double *residual_px; /* from the line */
    uint8_t *is_inlier;
} Residuals;

typedef struct {
    double answer[UNKNOWNS], covariance[UNKNOWNS][UNKNOWNS], light_rad, scatter;
} Solution;

void invert(double matrix[UNKNOWNS][UNKNOWNS]);
void multiply(double matrix[UNKNOWNS][UNKNOWNS], const double vector[UNKNOWNS], double product[UNKNOWNS]);
void residuals_of_common_line(const Pairs *pairs, const double *weight, double *residual_px);
void solve(const Pairs *pairs, const Appearance *appearance, double reach_px, Residuals *residuals,
           Solution *found);
