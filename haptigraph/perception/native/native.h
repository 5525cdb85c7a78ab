/* The compiled part of perception: loops over pixels, edges and contrasts.

   The Python modules beside it call it, one function each, and say what it is for; so do the comments here,
   of what is in between. Everything is plain C11 without state: no globals, no allocation that outlives a
   call. Doubles, but for pixels of strips: floats. Sums run in the order of the indices and nothing is
   contracted or reassociated (see hatch_build.py), so the same image makes the same digits wherever there is
   IEEE 754. */

#ifndef HAPTIGRAPH_NATIVE_H
#define HAPTIGRAPH_NATIVE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define STATION_PX 2.0 /* from station to station of a strip; of a close-up it is 1 */

/* Rows of pixels: lanes across the shaft, one value per station along it. */
typedef struct {
    const float *first;
    ptrdiff_t stride; /* from lane to lane, in values */
    int lanes, stations;
} Rows;

/* Straightened pixels along an expected line, as `strip.Strip` packs it. */
typedef struct {
    Rows excess;             /* what differs from the empty eye and from the flanks [grey levels] */
    Rows beside;             /* what differs from the flanks alone */
    const float *u_px;       /* where each station lies along the line */
    const uint8_t *is_known; /* stations where the empty eye is known */
    double noise_grey;       /* standard deviation of a pixel of `excess` without needle */
    int before_stop, inside_start, inside_stop; /* stations before the wall begin with the first */
} Strip;

static inline double largest(double one, double other) { return one > other ? one : other; }
static inline double least(double one, double other) { return one < other ? one : other; }
static inline double square(double value) { return value * value; }

/* Grey as OpenCV has it (ITU-R BT.601), in so many parts of a grey level: whole numbers are faster. */
#define WHOLE 65536
#define BLUE 7471
#define GREEN 38470
#define RED 19595

static inline int whole_share(double share) { return (int)(WHOLE * share); }

/* Return the grey of a pixel of BGR, with so much of blue less red in it. */
static inline int grey_of(const uint8_t *pixel, int more) {
    const int most = 255 * WHOLE;
    const int grey = (BLUE + more) * pixel[0] + GREEN * pixel[1] + (RED - more) * pixel[2];
    return grey < 0 ? 0 : grey > most ? most : grey;
}

/* Return the (upper) median of some values; their order is lost. */
double median(double *values, int count);

/* Write how much a shaft's middle differs from what is beside and was behind it [grey levels], stop - start
   values. `weights` are those of so many lanes from one on; lanes beyond either side count as 0. The stations
   must all be there. */
void contrast_along(const Strip *strip, int lane, const float *weights, int count, int start, int stop,
                    float *contrast_grey);

/* The same of the middle lanes of a strip (`tip.core_contrast`). Return more than noise makes of it. */
EXPORT double core_contrast(const Strip *strip, int start, int stop, float *contrast_grey);

/* Return more than noise makes of a mean of so many values [grey levels]. */
double above_noise_grey(double noise_grey, int count);

/* Tell whether the mean of all stations is sharper across the shaft than noise, and than a share of its own
   contrast. */
EXPORT int is_sharp(const float *excess, ptrdiff_t stride, int lanes, int stations, double share,
                    double noise_grey);

#endif
