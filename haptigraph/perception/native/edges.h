/* Edges of a shaft, as `edges.c` detects them and `shaft_line.c` fits a line to them. */

#pragma once

#include "native.h"

#define MIN_BLOCKS 3 /* that make a line */

/* Both edges of the shaft in some blocks, as pairs: the n bright ones first, then the n dark ones. */
typedef struct {
    int blocks, outside; /* number of blocks, and of those outside the wall, which come first */
    int lanes;
    double noise_grey;    /* standard deviation of the mean of a block's stations */
    double *u_px;         /* middle of each block along the strip, (n) */
    double *axis_px;      /* approximate middle of the shaft, from the second lane on, (n) */
    double *slope;        /* across the shaft [grey levels per px], (lanes, n) */
    double *middle_px;    /* of a pair, across the strip from its middle, (2 n) */
    double *variance_px2; /* of that, (2 n) */
    double *width_px;     /* of a pair, (2 n); negative where there is none */
    double *steepness;    /* slope of its fainter edge [grey levels per px], (2 n) */
    double *blur_px2[2];  /* variance of the left and the right edge's blur, with the slope filter's, (2 n) */
} Edges;

/* Whole blocks before a tip. */
typedef struct {
    int size, outside, inside;
} Blocks;

Blocks blocks_before(const Strip *strip, double tip_px, int size);
size_t edges_memory(const Strip *strip, Blocks blocks);
void find_edges(const Strip *strip, Blocks blocks, double *memory, Edges *edges);
int find_feet(const Edges *edges, double *middle_px, double *width_px);
int is_noisy(double noise_grey);
double sharp_blur_px(double left_px2, double right_px2);
