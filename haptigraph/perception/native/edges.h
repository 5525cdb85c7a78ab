/* Edges of a shaft, as `edges.c` finds them and `shaft_line.c` lays a line through them. */

#ifndef HAPTIGRAPH_EDGES_H
#define HAPTIGRAPH_EDGES_H

#include "native.h"

#define BLOCK 3        /* stations that are looked at together */
#define LEAST_BLOCKS 3 /* fewer make no line */

/* Both edges of the shaft in some blocks, as pairs: first those that rise first, then those that fall. */
typedef struct {
    int blocks, outside; /* of the blocks so many are before the wall; they come first */
    int lanes;
    double noise_grey;    /* standard deviation of a block's sum over its stations' number */
    double *u_px;         /* middle of every block along the strip, (n) */
    double *about_px;     /* where, from the second lane on, the steep places lie by and large, (n) */
    double *rising;       /* slopes across the shaft [grey levels per px], (lanes, n) */
    double *middle_px;    /* half-way between a pair's edges, across the strip from its middle, (2 n) */
    double *variance_px2; /* of that, (2 n) */
    double *width_px;     /* between them, (2 n); negative where there is no such pair */
    double *steepness;    /* slope of the fainter one [grey levels per px], (2 n) */
    double *blur_px2[2];  /* variance of the blur of the left and the right one, the slope filter's too */
} Edges;

/* Whole blocks before a tip. */
typedef struct {
    int size, outside, inside;
} Blocks;

Blocks blocks_before(const Strip *strip, double tip_px, int size);
size_t edges_memory(const Strip *strip, Blocks blocks);
void find_edges(const Strip *strip, Blocks blocks, double *memory, Edges *edges);
int at_feet(const Edges *edges, double *middle_px, double *width_px);
int is_noisy(double noise_grey);
double sharp_blur_px(double left_px2, double right_px2);

#endif
