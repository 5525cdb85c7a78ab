/* Surfaces in the slices of an OCT volume: rewards by row, and the best path through each slice. */

#include "native.h"

#define SATURATION_GREY 45.0f /* limits the reward of metal and floaters, which are brighter than tissue */
#define BODY_SHARE 0.25f
#define FALL_SHARE 0.5f
#define EXCLUDED -1e9f

static inline float saturating(float grey) { return grey / (1 + fabsf(grey) / SATURATION_GREY); }

/* Average each slice of a row with both of its neighbours. */
static inline void across_slices(const float *raw, int slices, int cells, float *smooth) {
    for (int z = 0; z < slices; z++) {
        const float *here = raw + (ptrdiff_t)z * cells;
        const float *before = z > 0 ? here - cells : here, *after = z < slices - 1 ? here + cells : here;
        for (int x = 0; x < cells; x++)
            smooth[(ptrdiff_t)z * cells + x] = 0.5f * here[x] + 0.25f * (before[x] + after[x]);
    }
}

/* Write running sums of rows, the first and the last repeated `above` and `below` times. */
EXPORT void row_sums(const float *grey, int rows, int count, int above, int below, float *sums) {
    for (int n = 0; n < count; n++) sums[n] = 0;
    for (int row = 0; row < above + rows + below; row++) {
        const int from = row < above ? 0 : row - above < rows ? row - above : rows - 1;
        const float *here = grey + (ptrdiff_t)from * count, *before = sums + (ptrdiff_t)row * count;
        float *after = sums + (ptrdiff_t)(row + 1) * count;
        for (int n = 0; n < count; n++) after[n] = before[n] + here[n];
    }
}

/* Write rewards of the ILM, its step from dark to bright, and the contrast of what is below it.
   sums: (rows + 2 * deep + 1, slices * cells); buffer: two rows. */
VECTORS EXPORT void ilm_rewards(const float *sums, int rows, int slices, int cells, int edge, int deep,
                                float dark, float *buffer, float *reward, float *step, float *rise) {
    const ptrdiff_t count = (ptrdiff_t)slices * cells;
    const int half = deep / 2;
    float *raw = buffer, *raw_step = buffer + count;
    for (int row = 0; row < rows; row++) {
        const float *at = sums + (row + deep) * count;
        const float *up = at - edge * count, *down = at + edge * count, *middle = at + half * count;
        const float *top = at - deep * count, *bottom = at + deep * count;
        for (ptrdiff_t n = 0; n < count; n++) {
            const float first = (middle[n] - at[n]) / half, second = (bottom[n] - middle[n]) / (deep - half);
            const float body = (first < second ? first : second) - dark; /* metal is bright too, but thin */
            const float over = (at[n] - top[n]) / deep - dark;
            const float contrast = body - (over > 0 ? over : 0);
            raw_step[n] = (down[n] - 2 * at[n] + up[n]) / edge;
            rise[row * count + n] = contrast;
            raw[n] =
                saturating(raw_step[n]) + saturating(contrast) + BODY_SHARE * body; /* haze has no body */
        }
        across_slices(raw, slices, cells, reward + row * count);
        across_slices(raw_step, slices, cells, step + row * count);
    }
}

/* Write rewards of the RPE, and how it rises from what is above it, smoothed and not, and falls below it.
   sums: (band + rows + 4 * band + 1, slices * cells); buffer: one row. */
VECTORS EXPORT void rpe_rewards(const float *sums, int rows, int slices, int cells, int edge, int band,
                                float *buffer, float *reward, float *smooth_rise, float *rise, float *fall) {
    const ptrdiff_t count = (ptrdiff_t)slices * cells;
    for (int row = 0; row < rows; row++) {
        const float *at = sums + (row + band) * count;
        const float *up = at - edge * count, *down = at + edge * count, *top = at - band * count;
        const float *bottom = at + band * count, *deep = at + 2 * band * count,
                    *deepest = at + 4 * band * count;
        float *rises = rise + row * count, *falls = fall + row * count;
        for (ptrdiff_t n = 0; n < count; n++) {
            const float body = (bottom[n] - at[n]) / band, step = (down[n] - 2 * at[n] + up[n]) / edge;
            rises[n] = body - (at[n] - top[n]) / band;
            falls[n] = body - (deepest[n] - deep[n]) / (2 * band);
            buffer[n] = saturating(step) + saturating(rises[n]) + FALL_SHARE * saturating(falls[n]);
        }
        across_slices(buffer, slices, cells, reward + row * count);
        across_slices(rises, slices, cells, smooth_rise + row * count);
    }
}

/* Write the row of the best path in each cell of each slice: the sum of rewards less the cost of steps is
   greatest (Bellman 1957). reward: (rows, slices, cells); cost: of -half to half rows;
   buffer: (cells, rows + 2 * half). */
VECTORS EXPORT void volume_paths(const float *reward, int rows, int slices, int cells, const float *cost,
                                 int half, float *buffer, int32_t *paths) {
    const ptrdiff_t width = rows + 2 * half, count = (ptrdiff_t)slices * cells;
    for (ptrdiff_t n = 0; n < cells * width; n++) buffer[n] = EXCLUDED;
    for (int slice = 0; slice < slices; slice++) {
        for (int x = 0; x < cells; x++) {
            const float *before = buffer + (x - 1) * width;
            const float *worth = reward + (ptrdiff_t)slice * cells + x;
            float *best = buffer + x * width + half;
            if (x == 0) {
                for (int y = 0; y < rows; y++) best[y] = worth[y * count];
                continue;
            }
            for (int y = 0; y < rows; y++) best[y] = before[y] - cost[0];
            for (int k = 1; k <= 2 * half; k++)
                for (int y = 0; y < rows; y++) {
                    const float choice = before[y + k] - cost[k];
                    best[y] = choice > best[y] ? choice : best[y];
                }
            for (int y = 0; y < rows; y++) best[y] += worth[y * count];
        }
        int row = 0;
        const float *last = buffer + (cells - 1) * width + half;
        for (int y = 1; y < rows; y++) row = last[y] > last[row] ? y : row;
        int32_t *path = paths + (ptrdiff_t)slice * cells;
        path[cells - 1] = row;
        for (int x = cells - 2; x >= 0; x--) {
            const float *near = buffer + x * width + row;
            int to = 0;
            for (int k = 1; k <= 2 * half; k++) to = near[k] - cost[k] > near[to] - cost[to] ? k : to;
            row += to - half;
            path[x] = row;
        }
    }
}
