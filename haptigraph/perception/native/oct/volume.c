/* Volumes against the model of an instrument: axial reduction, and the normal equations of a registration.

   A reduced volume has (columns, slices, cells) floats; the cells of an A-scan are contiguous. */

#include <string.h>

#include "native.h"

#define MAX_CELLS (MAX_VOLUME_ROWS / VOLUME_CELL)
#define TAPS 4        /* of the Gaussian to each side [cells] */
#define CELL_SD 1.4   /* of the Gaussian [cells] */
#define MIN_SHARE 0.4 /* of the Gaussian's weight that must fall on usable rows */
#define CHUNK 256     /* points whose sums are kept in floats */

/* Means of cells of an A-scan, weighed by usable rows. */
static void sum_cells(const uint8_t *scan, ptrdiff_t stride, const float *is_usable, int cells, float *sums) {
    for (int cell = 0; cell < cells; cell++) {
        float sum = 0;
        for (int k = 0; k < VOLUME_CELL; k++) {
            const int row = cell * VOLUME_CELL + k;
            sum += is_usable[row] * (float)scan[row * stride];
        }
        sums[cell + TAPS] = sum;
    }
}

VECTORS
static void smooth_cells(const float *sums, const float *shares, const float *kernel, int cells,
                         float *reduced) {
    float smoothed[MAX_CELLS];
    for (int cell = 0; cell < cells; cell++) smoothed[cell] = 0;
    for (int k = 0; k <= 2 * TAPS; k++)
        for (int cell = 0; cell < cells; cell++) smoothed[cell] += kernel[k] * sums[cell + k];
    for (int cell = 0; cell < cells; cell++) reduced[cell] = 16.0f * sqrtf(smoothed[cell] * shares[cell]);
}

/* Reduce the rows of a volume: box of VOLUME_CELL rows, Gaussian over the usable ones, square root (0 to
   255).

   The strides are in bytes. Cells without usable rows about them are 0 and not in `is_usable_cell`. */
EXPORT void reduce_volume(const uint8_t *volume, ptrdiff_t row_stride, ptrdiff_t slice_stride,
                          ptrdiff_t column_stride, int rows, int slices, int columns,
                          const uint8_t *is_usable, uint8_t *is_usable_cell, float *reduced) {
    const int cells = rows / VOLUME_CELL;
    float usable[MAX_VOLUME_ROWS], kernel[2 * TAPS + 1], counts[MAX_CELLS + 2 * TAPS], shares[MAX_CELLS];
    float sums[MAX_CELLS + 2 * TAPS];
    memset(sums, 0, sizeof sums);
    memset(counts, 0, sizeof counts);
    double whole = 0;
    for (int k = -TAPS; k <= TAPS; k++) {
        kernel[k + TAPS] = (float)exp(-0.5 * k * k / (CELL_SD * CELL_SD));
        whole += kernel[k + TAPS] * VOLUME_CELL;
    }
    for (int row = 0; row < rows; row++) usable[row] = is_usable[row] ? 1.0f : 0.0f;
    for (int row = 0; row < cells * VOLUME_CELL; row++) counts[row / VOLUME_CELL + TAPS] += usable[row];
    for (int cell = 0; cell < cells; cell++) {
        float weight = 0;
        for (int k = 0; k <= 2 * TAPS; k++) weight += kernel[k] * counts[cell + k];
        is_usable_cell[cell] = weight >= MIN_SHARE * whole;
        shares[cell] = is_usable_cell[cell] ? 1.0f / weight : 0.0f;
    }
    for (int column = 0; column < columns; column++)
        for (int slice = 0; slice < slices; slice++) {
            const uint8_t *scan = volume + column * column_stride + slice * slice_stride;
            sum_cells(scan, row_stride, usable, cells, sums);
            smooth_cells(sums, shares, kernel, cells, reduced);
            reduced += cells;
        }
}

/* Sample a reduced volume at a point by trilinear interpolation; return whether the point is inside it. */
static inline int sample(const ReducedVolume *volume, const float *affine, const float *point, float *value) {
    const float x = affine[0] * point[0] + affine[1] * point[1] + affine[2] * point[2] + affine[3];
    const float y = affine[4] * point[0] + affine[5] * point[1] + affine[6] * point[2] + affine[7];
    const float z = affine[8] * point[0] + affine[9] * point[1] + affine[10] * point[2] + affine[11];
    const float last_x = (float)(volume->columns - 1), last_y = (float)volume->last_cell;
    const float first_y = (float)volume->first_cell, last_z = (float)(volume->slices - 1);
    if (!(x >= 0 && x < last_x && y >= first_y && y < last_y && z >= 0 && z < last_z)) return 0;
    const int column = (int)x, cell = (int)y, slice = (int)z;
    const float right = x - (float)column, below = y - (float)cell, behind = z - (float)slice;
    const ptrdiff_t next_slice = volume->cells, next_column = next_slice * volume->slices;
    const float *at = volume->first + column * next_column + slice * next_slice + cell;
    const float *beside = at + next_column;
    const float a = at[0] + below * (at[1] - at[0]);
    const float b = at[next_slice] + below * (at[next_slice + 1] - at[next_slice]);
    const float c = beside[0] + below * (beside[1] - beside[0]);
    const float d = beside[next_slice] + below * (beside[next_slice + 1] - beside[next_slice]);
    const float left_value = a + behind * (b - a), right_value = c + behind * (d - c);
    *value = left_value + right * (right_value - left_value);
    return 1;
}

static void to_floats(const double *affine, float *floats) {
    for (int k = 0; k < 12; k++) floats[k] = (float)affine[k];
}

/* Add the samples at some points, and count those that are inside the volume.

   `affine` (3, 4) turns a point into column, cell and slice. */
EXPORT void add_samples(const ReducedVolume *volume, const float *points, int count, const double *affine,
                        float *sums, float *counts) {
    float matrix[12], value;
    to_floats(affine, matrix);
    for (int i = 0; i < count; i++)
        if (sample(volume, matrix, points + 3 * (ptrdiff_t)i, &value)) {
            sums[i] += value;
            counts[i] += 1;
        }
}

/* Huber's cost of a residual, twice; `weight` receives its weight. */
static inline float huber(float residual, float knee, float *weight) {
    const float size = fabsf(residual);
    if (size <= knee) {
        *weight = 1;
        return residual * residual;
    }
    *weight = knee / size;
    return 2 * knee * size - knee * knee;
}

VECTORS
static void add_products(const float *jacobian, const float *weights, const float *residuals, int count,
                         float *gradient, float *normal) {
    for (int i = 0; i < count; i++) {
        const float *row = jacobian + VOLUME_PADDED * i;
        for (int a = 0; a < VOLUME_PADDED; a++) gradient[a] += residuals[i] * row[a];
        for (int a = 0; a < 6; a++) {
            const float weighted = weights[i] * row[a];
            for (int b = 0; b < VOLUME_PADDED; b++) normal[VOLUME_PADDED * a + b] += weighted * row[b];
        }
    }
}

/* Compare a template with a volume: the normal equations of its motion, with Huber's weights.

   `jacobian` (count, VOLUME_PADDED) has the template's derivatives at the points. Return the mean cost of the
   used points inside the volume; `inside` receives their number, `gradient` 6 values, `normal` (6, 6). */
EXPORT double compare_template(const ReducedVolume *volume, const float *points, const float *values,
                               const float *jacobian, int count, const uint8_t *is_used, const double *affine,
                               double knee, int32_t *inside, double *gradient, double *normal) {
    float matrix[12], rows[CHUNK * VOLUME_PADDED], weights[CHUNK], residuals[CHUNK];
    double cost = 0;
    int total = 0;
    to_floats(affine, matrix);
    memset(gradient, 0, 6 * sizeof *gradient);
    memset(normal, 0, 36 * sizeof *normal);
    for (int first = 0; first < count; first += CHUNK) {
        const int stop = first + CHUNK < count ? first + CHUNK : count;
        float chunk_cost = 0, chunk_gradient[VOLUME_PADDED] = {0}, chunk_normal[6 * VOLUME_PADDED] = {0};
        int kept = 0;
        for (int i = first; i < stop; i++) {
            float value;
            if (!is_used[i] || !sample(volume, matrix, points + 3 * (ptrdiff_t)i, &value)) continue;
            const float residual = value - values[i];
            chunk_cost += huber(residual, (float)knee, weights + kept);
            residuals[kept] = weights[kept] * residual;
            memcpy(rows + VOLUME_PADDED * kept, jacobian + VOLUME_PADDED * (ptrdiff_t)i,
                   VOLUME_PADDED * sizeof *rows);
            kept++;
        }
        add_products(rows, weights, residuals, kept, chunk_gradient, chunk_normal);
        cost += chunk_cost;
        total += kept;
        for (int a = 0; a < 6; a++) {
            gradient[a] += chunk_gradient[a];
            for (int b = 0; b < 6; b++) normal[6 * a + b] += chunk_normal[VOLUME_PADDED * a + b];
        }
    }
    *inside = total;
    return total ? cost / total : INFINITY;
}
