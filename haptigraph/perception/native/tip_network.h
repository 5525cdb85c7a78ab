/* The shape of the tip network: what it is given, and what it has learned. */

#pragma once

#include "native.h"

#define TIP_STATIONS 72 /* of its window */
#define TIP_BEHIND 50   /* of these, before the apparent tip */
#define TIP_PLACES 36   /* about it, where a tip may be */
#define SIDE 8          /* lanes on either side of the shaft's middle */
#define ACROSS (2 * SIDE + 1)
#define CHANNELS 3  /* excess, detrended and colour */
#define TIP_STEPS 2 /* how precise the contrast step there may be, if it is the tip */
#define CONTEXT 3   /* numbers that a whole window has: noise, scale, and precision of its step */
#define FEATURES 24
#define TAPS 5
#define LAYERS 4
#define PADDING ((TAPS / 2) << (LAYERS - 1))

/* What a window shows, a row of stations for each lane of each channel; 0 where the globe is not seen. */
typedef struct {
    float seen[CHANNELS][ACROSS][TIP_STATIONS], is_inside[TIP_STATIONS];
} TipWindow;

typedef struct {
    float first[FEATURES][CHANNELS * ACROSS + 1 + CONTEXT + 1], first_bias[FEATURES];
    float layer[LAYERS][FEATURES][FEATURES][TAPS], layer_bias[LAYERS][FEATURES];
    float place[FEATURES], place_bias, elsewhere[FEATURES], elsewhere_bias;
    float step[TIP_STEPS][FEATURES], step_bias[TIP_STEPS];
} TipWeights;

#define TIP_KINDS (TIP_PLACES + 1 + TIP_STEPS) /* of probabilities */
#define TIP_VALUES ((int)(sizeof(TipWindow) / sizeof(float)))
#define TIP_WEIGHTS ((int)(sizeof(TipWeights) / sizeof(float)))
