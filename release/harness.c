/* Load the compiled part of perception, run its functions on images made here, and print a checksum of what
   each of them returns: `harness LIBRARY`. The same lines everywhere mean the same digits. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "native.h"

#ifdef _WIN32
#include <windows.h>
static void *opened(const char *file) { return (void *)LoadLibraryA(file); }
static void *found(void *library, const char *name) { return (void *)GetProcAddress(library, name); }
#else
#include <dlfcn.h>
static void *opened(const char *file) { return dlopen(file, RTLD_NOW); }
static void *found(void *library, const char *name) { return dlsym(library, name); }
#endif

enum { LANES = 49, STATIONS = 200, ROWS = 256, SLICES = 4, COLUMNS = 32, CELLS = ROWS / VOLUME_CELL };

static void *library;

static void *function(const char *name) {
    void *address = found(library, name);
    if (!address) {
        fprintf(stderr, "the library lacks %s\n", name);
        exit(1);
    }
    return address;
}

/* Return a number of 0 to 1, the next of a sequence that is the same everywhere (Knuth's MMIX). */
static double chance(void) {
    static uint64_t state = 20260101;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 40) / (1 << 24);
}

/* Print a name and the FNV-1a checksum of some bytes. */
static void report(const char *name, const void *bytes, size_t size) {
    uint64_t sum = 14695981039346656037u;
    for (size_t at = 0; at < size; at++) sum = (sum ^ ((const uint8_t *)bytes)[at]) * 1099511628211u;
    printf("%s %08x%08x\n", name, (unsigned)(sum >> 32), (unsigned)sum);
}

/* A dark shaft with soft edges, which ends at three quarters of the strip. */
static void draw_strip(float *excess, float *detrended, float *u_px, uint8_t *is_known) {
    for (int station = 0; station < STATIONS; station++) {
        u_px[station] = (float)(STATION_PX * station);
        is_known[station] = 1;
        for (int lane = 0; lane < LANES; lane++) {
            const double off = lane - LANES / 2 - 0.01 * station, body = 1 / (1 + off * off * off * off / 400);
            const double noise = 4 * (chance() - 0.5), grey = station < 3 * STATIONS / 4 ? -60 * body : 0;
            excess[lane * STATIONS + station] = (float)(grey + noise);
            detrended[lane * STATIONS + station] = (float)(grey + noise);
        }
    }
}

static void needle_in_a_strip(void) {
    static float excess[LANES * STATIONS], detrended[LANES * STATIONS], u_px[STATIONS], along[STATIONS];
    static uint8_t is_known[STATIONS], is_on_line[STATIONS], is_steep[STATIONS];
    int (*coarse)(const Strip *, double, double, double, double *) = function("estimate_coarse_tip");
    int (*fit)(const Strip *, double, double, const Appearance *, LineFit *, float *, uint8_t *, uint8_t *) =
        function("fit_line");
    int (*refine)(const Strip *, const TipPatch *, const int *, int, double *) = function("refine_tip");
    double (*contrast)(const Strip *, int, int, float *) = function("core_contrast");
    draw_strip(excess, detrended, u_px, is_known);
    const Strip strip = {{excess, STATIONS, LANES, STATIONS}, {detrended, STATIONS, LANES, STATIONS},
                         u_px, is_known, 1.2, 20, 24, STATIONS, {0}};
    float contrast_grey[STATIONS];
    double tip[3] = {0}, noise_grey = contrast(&strip, 0, STATIONS, contrast_grey);
    report("core_contrast", contrast_grey, sizeof contrast_grey);
    report("core_contrast's noise", &noise_grey, sizeof noise_grey);
    printf("estimate_coarse_tip returns %d\n", coarse(&strip, 0, 0, 20, tip));
    report("estimate_coarse_tip", tip, 2 * sizeof *tip);
    const Appearance unknown = {NAN, NAN, 0, {NAN, NAN}};
    LineFit line = {0};
    printf("fit_line returns %d\n", fit(&strip, 300, 10, &unknown, &line, along, is_on_line, is_steep));
    const double fitted[] = {line.offset_px, line.slope,   line.covariance[0], line.covariance[1],
                             line.width_px,  line.blur_px, line.scatter,       line.max_offset_px};
    report("fit_line", fitted, sizeof fitted);
    report("fit_line's blocks", is_on_line, (size_t)line.blocks);
    const TipPatch patch = {LANES / 2 + 1.5, 0, 0.5, 120, 180, 0, 30, 0, 1, 0, 0};
    const int behind_px[] = {24, 12};
    printf("refine_tip returns %d\n", refine(&strip, &patch, behind_px, 2, tip));
    report("refine_tip", tip, sizeof tip);
}

static void background_of_an_image(void) {
    enum { WIDTH = 160, HEIGHT = 48 };
    static uint8_t image[3 * WIDTH * HEIGHT], inside[WIDTH * HEIGHT], is_free[WIDTH * HEIGHT],
        visible[WIDTH * HEIGHT];
    static float grey[WIDTH * HEIGHT], chroma[WIDTH * HEIGHT];
    void (*learn)(const uint8_t *, int, ptrdiff_t, int, int, double, const uint8_t *, const uint8_t *,
                  uint8_t *, float *, float *) = function("learn_background");
    for (int turn = 0; turn < 3; turn++) {
        for (int at = 0; at < 3 * WIDTH * HEIGHT; at++) image[at] = (uint8_t)(255 * chance());
        for (int at = 0; at < WIDTH * HEIGHT; at++) {
            inside[at] = at % WIDTH > 40;
            is_free[at] = chance() < 0.8;
        }
        learn(image, 3, WIDTH, HEIGHT, WIDTH, 0.18, inside, is_free, visible, grey, chroma);
    }
    report("learn_background", grey, sizeof grey);
    report("learn_background's colour", chroma, sizeof chroma);
}

static void path_in_a_scan(void) {
    enum { PATH_ROWS = 100, PATH_COLUMNS = 64, MOST = 3 };
    static float reward[PATH_ROWS * PATH_COLUMNS], cost[2 * MOST + 1];
    static int32_t path[PATH_COLUMNS];
    int (*best)(const float *, int, int, int, const float *, int32_t *) = function("best_path");
    for (int at = 0; at < PATH_ROWS * PATH_COLUMNS; at++) reward[at] = (float)chance();
    for (int step = -MOST; step <= MOST; step++) cost[step + MOST] = (float)(step * step) * 0.1f;
    printf("best_path returns %d\n", best(reward, PATH_COLUMNS, PATH_ROWS, MOST, cost, path));
    report("best_path", path, sizeof path);
}

static void volume(void) {
    static uint8_t grey[ROWS * SLICES * COLUMNS], usable[ROWS], usable_cells[CELLS];
    static float reduced[COLUMNS * SLICES * CELLS], points[3 * 500], values[500],
        jacobian[500 * VOLUME_PADDED];
    static uint8_t is_used[500];
    void (*reduce)(const uint8_t *, ptrdiff_t, ptrdiff_t, ptrdiff_t, int, int, int, const uint8_t *, uint8_t *,
                   float *) = function("reduce_volume");
    double (*compare)(const ReducedVolume *, const float *, const float *, const float *, int,
                      const uint8_t *, const double *, double, int32_t *, double *, double *) =
        function("compare_template");
    for (int at = 0; at < ROWS * SLICES * COLUMNS; at++) grey[at] = (uint8_t)(255 * chance());
    for (int row = 0; row < ROWS; row++) usable[row] = row > 20;
    reduce(grey, SLICES * COLUMNS, COLUMNS, 1, ROWS, SLICES, COLUMNS, usable, usable_cells, reduced);
    report("reduce_volume", reduced, sizeof reduced);
    for (int at = 0; at < 500; at++) {
        points[3 * at] = (float)(chance() * COLUMNS);
        points[3 * at + 1] = (float)(chance() * CELLS);
        points[3 * at + 2] = (float)(chance() * SLICES);
        values[at] = (float)(255 * chance());
        is_used[at] = chance() < 0.9;
        for (int k = 0; k < 6; k++) jacobian[at * VOLUME_PADDED + k] = (float)(chance() - 0.5);
    }
    const ReducedVolume whole = {reduced, COLUMNS, SLICES, CELLS, 6, CELLS - 1};
    const double affine[] = {0.9, 0.01, 0, 1, -0.01, 0.9, 0, 3, 0, 0, 0.8, 0.1};
    double gradient[6], normal[36];
    int32_t inside;
    const double cost = compare(&whole, points, values, jacobian, 500, is_used, affine, 20, &inside, gradient,
                                normal);
    printf("compare_template finds %d inside\n", (int)inside);
    report("compare_template", &cost, sizeof cost);
    report("compare_template's normal equations", normal, sizeof normal);
}

static void needles_in_a_volume(void) {
    enum { SCANS = 400, POSES = 5 };
    static double at[3 * SCANS], poses[13 * POSES], scores[POSES];
    static float stops[SCANS * ROWS];
    void (*judge)(const double *, int, const float *, int, double, const double *, int, const double *, int,
                  double *) = function("needle_scores");
    for (int scan = 0; scan < SCANS; scan++) {
        at[3 * scan] = 4 * chance() - 2;
        at[3 * scan + 1] = 0.6 * chance() - 0.3;
        at[3 * scan + 2] = chance();
    }
    for (int value = 0; value < SCANS * ROWS; value++) stops[value] = (float)chance();
    for (int pose = 0; pose < POSES; pose++) {
        const double values[13] = {0.8, -0.6, 0, 0.1 * pose, 0.1, 0.02, 0.6, 0.8, 0, 0.5, -0.3, 0, 0.25};
        memcpy(poses + 13 * pose, values, sizeof values);
    }
    const double beam[] = {0, 0, 0.01, 0.01, -0.01, 0.01};
    judge(at, SCANS, stops, ROWS, 0.01, poses, POSES, beam, 3, scores);
    report("needle_scores", scores, sizeof scores);
}

int main(int count, char **arguments) {
    library = count == 2 ? opened(arguments[1]) : NULL;
    if (!library) {
        fprintf(stderr, "use: harness LIBRARY, a library that loads here\n");
        return 1;
    }
    printf("sources %u\n", (unsigned)*(const uint32_t *)function("sources"));
    needle_in_a_strip();
    background_of_an_image();
    path_in_a_scan();
    volume();
    needles_in_a_volume();
    return 0;
}
