/* Ridges in a B-scan: thin bright lines on dark speckle. Each is found by a Hough transform of a downsampled
   image, then refined to the centre of the ridge in a strip along it. */

#include <stdlib.h>
#include <string.h>

#include "oct/bscan.h"

#define FLANK_STEPS 11 /* half width of a ridge's strip */
#define STRIP_LANES (2 * FLANK_STEPS + 1)
#define TURN 0.0131 /* tangent of half the angle between two directions, 1.5 degrees */
#define MAX_DIRECTIONS 120
#define TURNS 3  /* of the strip of a line that holds the ridge's end, until it lies along the ridge */
#define FITS 2   /* lines that are refined before the search ends without a ridge */
#define BESIDE 2 /* directions, and cells, in which a weaker line counts as the same */
#define FLANK_START 7
#define MIN_SAMPLES 5
#define TAKEN (-16384)
#define METAL_SHARE 0.5 /* of the contrast where a ridge begins */

typedef struct {
    double dx, dy;
} Direction;

/* Part of the image along a line, one row of lanes a station, and its brightness there. */
typedef struct {
    float *lanes; /* (stations, STRIP_LANES) */
    float *core, *mean, *brighter;
    int stations, every; /* steps from station to station */
} Samples;

typedef struct {
    const uint8_t *image;
    int width, height;
} Picture;

/* A ridge's centre at one station: steps along and across its strip, and its weight in the fit. */
typedef struct {
    double at, middle, weight;
} Centre;

/* Return the mean of a square of cells. */
static inline int32_t square_sum(const int32_t *cells, int columns, int row, int column, int low, int high) {
    int32_t sum = 0;
    for (int y = row + low; y <= row + high; y++)
        for (int x = column + low; x <= column + high; x++) sum += cells[(ptrdiff_t)y * columns + x];
    return sum;
}

/* Mark the cells that are brighter than both sides, either left and right or above and below. */
VECTORS static void mark_ridges(const Grid *grid, const RidgeSearch *search, const int32_t *limit_row,
                                int32_t *core, int32_t *sides, uint8_t *mask) {
    const int columns = grid->columns, rows = grid->rows, s = search->side;
    const int32_t min = (int32_t)(search->mask_grey * 36 * CELL_STEPS);
    const int32_t dark = (int32_t)(search->dark_grey * 36 * CELL_STEPS);
    for (int row = 1; row < rows - 1; row++) {
        const int32_t *at = grid->cells + (ptrdiff_t)row * columns;
        for (int x = 1; x < columns - 1; x++) {
            const int32_t left = at[x - 1 - columns] + at[x - 1] + at[x - 1 + columns];
            const int32_t middle = at[x - columns] + at[x] + at[x + columns];
            const int32_t right = at[x + 1 - columns] + at[x + 1] + at[x + 1 + columns];
            sides[(ptrdiff_t)row * columns + x] = 4 * (left + middle + right);
            core[(ptrdiff_t)row * columns + x] =
                9 * (at[x - 1 - columns] + at[x - columns] + at[x - 1] + at[x]);
        }
    }
    for (int row = 1; row < rows - 1; row++) {
        const int has_rows = row > s && row < rows - 1 - s;
        const ptrdiff_t first = (ptrdiff_t)row * columns, off = has_rows ? (ptrdiff_t)s * columns : 0;
        for (int x = s + 1; x < columns - 1 - s; x++) {
            const ptrdiff_t at = first + x;
            const int32_t beside = sides[at - s] > sides[at + s] ? sides[at - s] : sides[at + s];
            const int32_t above = sides[at - off] > sides[at + off] ? sides[at - off] : sides[at + off];
            const int upright = (core[at] - beside > min) & (beside < dark);
            const int flat = has_rows & (core[at] - above > min) & (above < dark);
            mask[at] = (uint8_t)((upright | flat) & (row <= limit_row[x]));
        }
    }
}

/* Write the entry of a line into the image from the top or a side; return whether it enters going down. */
static int entry_of(double x, double y, Direction along, const Picture *picture, const RidgeSearch *search,
                    double *start_px) {
    const double slope = along.dy / maximum(fabs(along.dx), 1e-9);
    if (along.dy <= 0 || slope < search->lowest_slope || slope > search->highest_slope) return 0;
    const double top_px = x - y * along.dx / along.dy;
    const double side_px = minimum(maximum(top_px, 0.0), picture->width - 1.0);
    if (side_px != top_px && (side_px > 0) == (along.dx > 0)) return 0; /* it leaves the image */
    start_px[0] = side_px;
    start_px[1] = along.dx != 0 ? (side_px - top_px) * along.dy / along.dx : 0.0;
    return start_px[1] < picture->height;
}

/* Return the number of steps that a line has within the image. */
static int length_of(const double *start_px, Direction along, const Picture *picture, double step_px) {
    double length_px = (picture->height - 1 - start_px[1]) / along.dy;
    if (along.dx > 0) length_px = minimum(length_px, (picture->width - 1 - start_px[0]) / along.dx);
    if (along.dx < 0) length_px = minimum(length_px, start_px[0] / -along.dx);
    return clamped(length_px / step_px, 0, 4 * MAX_SCAN_PX);
}

/* Return the grey between four pixels, at a position in 65,536ths. */
static inline float grey_between(const uint8_t *above, const uint8_t *below, int left, int right, int32_t x,
                                 int32_t y) {
    const int u = (x >> 8) & 255, v = (y >> 8) & 255;
    const int sum = (above[left] * (256 - u) + above[right] * u) * (256 - v) +
                    (below[left] * (256 - u) + below[right] * u) * v;
    return (float)sum * (1.0f / 65536.0f);
}

/* Return the image between pixels, which repeat beyond its border. */
static inline float pixel_between(const Picture *picture, int32_t x, int32_t y) {
    const int max_x = picture->width - 1, max_y = picture->height - 1, column = x >> 16, row = y >> 16;
    const int left = column < 0 ? 0 : column > max_x ? max_x : column;
    const int upper = row < 0 ? 0 : row > max_y ? max_y : row;
    const int right = column < 0 ? 0 : column >= max_x ? max_x : column + 1;
    const int lower = row < 0 ? 0 : row >= max_y ? max_y : row + 1;
    const uint8_t *above = picture->image + (ptrdiff_t)upper * picture->width;
    const uint8_t *below = picture->image + (ptrdiff_t)lower * picture->width;
    return grey_between(above, below, left, right, x, y);
}

/* Return whether the image has a pixel and those after it, right and below. */
static inline int is_within(const Picture *picture, int32_t x, int32_t y) {
    return (x >= 0) & (y >= 0) & (x >> 16 < picture->width - 1) & (y >> 16 < picture->height - 1);
}

/* Write the image between pixels that it has, at equal steps; reading first lets the rest be vectors. */
static inline void sample_within(const Picture *picture, int32_t x, int32_t y, int32_t step_x, int32_t step_y,
                                 float *lanes) {
    uint8_t upper[STRIP_LANES][2], lower[STRIP_LANES][2];
    for (int lane = 0; lane < STRIP_LANES; lane++) {
        const int32_t row = (y + lane * step_y) >> 16, column = (x + lane * step_x) >> 16;
        const uint8_t *pixel = picture->image + (ptrdiff_t)row * picture->width + column;
        memcpy(upper[lane], pixel, 2);
        memcpy(lower[lane], pixel + picture->width, 2);
    }
    for (int lane = 0; lane < STRIP_LANES; lane++)
        lanes[lane] = grey_between(upper[lane], lower[lane], 0, 1, x + lane * step_x, y + lane * step_y);
}

/* Sample the image along a line, averaged along it, and write core and sides of each station. */
VECTORS static void sample_strip(const Picture *picture, const double *start_px, Direction along,
                                 double step_px, Samples *samples) {
    const double whole = 65536 * step_px;
    const int32_t across_x = (int32_t)(-along.dy * whole), across_y = (int32_t)(along.dx * whole);
    float *lanes = samples->lanes;
    for (int station = 0; station < samples->stations; station++, lanes += STRIP_LANES) {
        const double at = (double)station * samples->every * step_px;
        int32_t x = (int32_t)(65536 * (start_px[0] + at * along.dx)) - FLANK_STEPS * across_x;
        int32_t y = (int32_t)(65536 * (start_px[1] + at * along.dy)) - FLANK_STEPS * across_y;
        const int last = STRIP_LANES - 1;
        if (is_within(picture, x, y) && is_within(picture, x + last * across_x, y + last * across_y))
            sample_within(picture, x, y, across_x, across_y, lanes);
        else
            for (int lane = 0; lane < STRIP_LANES; lane++, x += across_x, y += across_y)
                lanes[lane] = pixel_between(picture, x, y);
    }
}

/* Average each lane over neighbouring stations, those at the ends repeated. */
VECTORS static void average_along(Samples *samples, int count, float *kept) {
    const int half = count / 2, last = samples->stations - 1;
    memcpy(kept, samples->lanes, sizeof *kept * (size_t)samples->stations * STRIP_LANES);
    for (int station = 0; station <= last; station++) {
        float sum[STRIP_LANES] = {0}, *lanes = samples->lanes + (ptrdiff_t)station * STRIP_LANES;
        for (int other = station - half; other <= station + half; other++) {
            const int from = other < 0 ? 0 : other > last ? last : other;
            for (int lane = 0; lane < STRIP_LANES; lane++)
                sum[lane] += kept[(ptrdiff_t)from * STRIP_LANES + lane];
        }
        for (int lane = 0; lane < STRIP_LANES; lane++) lanes[lane] = sum[lane] / (float)count;
    }
}

/* Write the mean of core and sides at each station. */
static void measure_stations(const Samples *samples) {
    const float *lanes = samples->lanes;
    for (int station = 0; station < samples->stations; station++, lanes += STRIP_LANES) {
        float core = 0, one = 0, other = 0;
        for (int lane = FLANK_STEPS - CORE_STEPS / 2; lane <= FLANK_STEPS + CORE_STEPS / 2; lane++)
            core += lanes[lane];
        for (int lane = 0; lane <= FLANK_STEPS - FLANK_START; lane++) {
            one += lanes[lane];
            other += lanes[STRIP_LANES - 1 - lane];
        }
        const float flank = FLANK_STEPS - FLANK_START + 1;
        samples->core[station] = core / CORE_STEPS;
        samples->mean[station] = (one + other) / (2 * flank);
        samples->brighter[station] = (one > other ? one : other) / flank;
    }
}

/* Write the stations on the ridge before its first long gap, unless they are few: beyond the tip is tissue.
   It is less bright than metal is where the ridge begins. */
static int unbroken(const Samples *samples, const RidgeSearch *search, int32_t *on_ridge) {
    const int first = search->run / samples->every;
    double sum = 0, least = search->strip_grey;
    int count = 0, end = 0;
    for (int station = 0; station < samples->stations; station++) {
        const double contrast = samples->core[station] - samples->brighter[station];
        if (contrast <= least) continue;
        if (!end && count && (station - on_ridge[count - 1]) * samples->every > search->gap) end = count;
        on_ridge[count++] = station;
        if (count <= first) sum += contrast;
        if (count == first) least = maximum(least, METAL_SHARE * sum / count);
    }
    return end && end * samples->every >= search->run ? end : count;
}

/* Return the weight of a station in a fit: noise moves its centre in inverse proportion to its contrast. */
static inline double weight_of(const Samples *samples, int station) {
    return square((double)samples->core[station] - samples->brighter[station]);
}

/* Fit a line to the ridge's centre: offset at its start, slope and its standard deviation [rad].

   `centres` has room for each station; `fits` is how often outliers are left out. Return the last station on
   the ridge, in steps; -1 if the ridge is too short. */
static int fit_ridge(const Samples *samples, const RidgeSearch *search, int fits, int32_t *on_ridge,
                     Centre *centres, double *fit) {
    const int count = unbroken(samples, search, on_ridge);
    if (count < MIN_SAMPLES || count * samples->every < search->run) return -1;
    for (int number = 0; number < count; number++) {
        const float *lanes = samples->lanes + (ptrdiff_t)on_ridge[number] * STRIP_LANES;
        const float level = 0.6f * samples->mean[on_ridge[number]] + 0.4f * samples->core[on_ridge[number]];
        double sum = 0, moment = 0;
        for (int across = -FLANK_START; across <= FLANK_START; across++) {
            const double weight = maximum(lanes[FLANK_STEPS + across] - level, 0.0);
            sum += weight;
            moment += weight * across;
        }
        centres[number].at = on_ridge[number] * samples->every;
        centres[number].middle = moment / maximum(sum, 1e-9);
    }
    const Centre *end = centres + count;
    double limit = INFINITY, slope = 0, at_mean = 0, middle_mean = 0, spread = 1, square_miss = 0;
    for (int turn = 0; turn <= fits; turn++) {
        double at_sum = 0, middle_sum = 0, product = 0, total = 0, mean_miss = 0;
        int kept = 0;
        square_miss = 0;
        for (Centre *one = centres; one < end; one++) {
            const double off = one->middle - middle_mean - slope * (one->at - at_mean);
            const int is_outlier = turn && fabs(off) > limit;
            one->weight = is_outlier ? 0 : weight_of(samples, on_ridge[one - centres]);
            kept += !is_outlier;
            total += one->weight;
            square_miss += one->weight * square(off);
            at_sum += one->weight * one->at;
            middle_sum += one->weight * one->middle;
        }
        if (kept < MIN_SAMPLES) return -1;
        square_miss /= total;
        if (turn == fits) break;
        at_mean = at_sum / total;
        middle_mean = middle_sum / total;
        spread = 0;
        for (const Centre *one = centres; one < end; one++) {
            spread += one->weight * square(one->at - at_mean);
            product += one->weight * (one->at - at_mean) * (one->middle - middle_mean);
        }
        slope = product / maximum(spread, 1e-9);
        spread = maximum(spread * kept / total, 1e-9);
        for (const Centre *one = centres; one < end; one++)
            mean_miss += one->weight * fabs(one->middle - middle_mean - slope * (one->at - at_mean)) / total;
        limit = maximum(search->inlier_steps, 2 * mean_miss);
    }
    fit[0] = middle_mean - slope * at_mean;
    fit[1] = slope;
    /* neighbours share pixels */
    fit[2] = sqrt(square_miss * ALONG_STEPS / samples->every / spread);
    return on_ridge[count - 1] * samples->every;
}

/* Refine a line to the centre of its ridge, coarse first. Return whether there is a ridge. */
static int refine(const Picture *picture, const RidgeSearch *search, int longest, RidgeLine *line,
                  Samples *samples, float *kept, int32_t *on_ridge, Centre *centres) {
    for (int every = 3, turns = 0; every > 0;) {
        Direction along = {line->along_px[0], line->along_px[1]};
        const int length = length_of(line->start_px, along, picture, search->step_px);
        samples->every = every;
        samples->stations = (length < longest ? length : longest) / every;
        if (samples->stations < MIN_SAMPLES * ALONG_STEPS / every) return 0;
        sample_strip(picture, line->start_px, along, search->step_px, samples);
        if (every == 1) average_along(samples, ALONG_STEPS, kept);
        measure_stations(samples);
        double fit[3];
        const int last = fit_ridge(samples, search, every == 1 ? 3 : 1, on_ridge, centres, fit);
        if (last < 0) return 0;
        const double moved = maximum(fabs(fit[0]), fabs(fit[0] + fit[1] * last));
        const int seen = samples->stations * every;
        const int is_cut = seen + every <= length && last + search->beyond / 2 > seen;
        longest = last + search->beyond;
        /* a strip that was cut ended with the ridge; one that moved may have lost it at its far end */
        if (!is_cut && (moved <= CORE_STEPS / 2.0 || ++turns >= TURNS)) {
            every -= 2;
            turns = 0;
        }
        const double x = line->start_px[0] - fit[0] * search->step_px * along.dy;
        const double y = line->start_px[1] + fit[0] * search->step_px * along.dx;
        const double length_of_turn = sqrt(1 + fit[1] * fit[1]);
        along = (Direction){(along.dx - fit[1] * along.dy) / length_of_turn,
                            (along.dy + fit[1] * along.dx) / length_of_turn};
        line->along_px[0] = along.dx;
        line->along_px[1] = along.dy;
        line->angle_sd_rad = fit[2];
        if (!entry_of(x, y, along, picture, search, line->start_px)) return 0;
    }
    line->stations = samples->stations;
    return 1;
}

/* Directions of lines through the cells, and how many marked cells lie on each line. */
typedef struct {
    Direction directions[MAX_DIRECTIONS];
    int32_t across_x[MAX_DIRECTIONS], across_y[MAX_DIRECTIONS]; /* in 4,096ths */
    int16_t *counts;                                            /* (MAX_DIRECTIONS, offsets) */
    int offsets; /* of lines from the origin, in cells; the middle one is 0 */
    int count;   /* of directions that a shaft may have */
} Votes;

/* Marked cells of the grid. */
typedef struct {
    int32_t *rows, *columns, *offsets; /* offsets of the lines through them in one direction */
    int count;
} Cells;

/* Write the directions that a shaft may have; arithmetic alone, so that all machines agree. */
static void start_votes(Votes *votes, const RidgeSearch *search) {
    const double c = (1 - TURN * TURN) / (1 + TURN * TURN), s = 2 * TURN / (1 + TURN * TURN);
    Direction next = {1.0, 0.0};
    votes->count = 0;
    for (int number = 0; number < MAX_DIRECTIONS; number++) {
        const double slope = next.dy * search->down / maximum(fabs(next.dx) * search->across, 1e-9);
        if (slope >= search->lowest_slope && slope <= search->highest_slope) {
            votes->directions[votes->count] = next;
            votes->across_x[votes->count] = (int32_t)floor(-4096 * next.dy + 0.5);
            votes->across_y[votes->count++] = (int32_t)floor(4096 * next.dx + 0.5);
        }
        next = (Direction){next.dx * c - next.dy * s, next.dx * s + next.dy * c};
    }
}

/* Write the marked cells of a grid. */
static void list_cells(const Grid *grid, const uint8_t *mask, Cells *cells) {
    cells->count = 0;
    for (int row = 0; row < grid->rows; row++, mask += grid->columns) {
        const uint8_t *at = mask, *end = mask + grid->columns;
        for (; (at = memchr(at, 1, (size_t)(end - at))); at++) {
            cells->rows[cells->count] = row;
            cells->columns[cells->count++] = (int32_t)(at - mask);
        }
    }
}

/* Write the offset of the line through each cell in one direction. */
static inline void offsets_of(const int32_t *restrict columns, const int32_t *restrict rows, int count,
                              int32_t x, int32_t y, int32_t *restrict offsets) {
    for (int cell = 0; cell < count; cell++)
        offsets[cell] = (x * columns[cell] + y * rows[cell] + 2048) >> 12;
}

/* Count cells from the first on for the lines through them, or withdraw them; one direction after the other,
   whose counts the processor keeps at hand. */
VECTORS static void vote(const Votes *votes, const Cells *cells, int first, int16_t weight) {
    int16_t *counts = votes->counts + votes->offsets / 2;
    const int count = cells->count - first;
    for (int number = 0; number < votes->count; number++, counts += votes->offsets) {
        const int32_t *offsets = cells->offsets;
        offsets_of(cells->columns + first, cells->rows + first, count, votes->across_x[number],
                   votes->across_y[number], cells->offsets);
        for (int cell = 0; cell < count; cell++)
            counts[offsets[cell]] = (int16_t)(counts[offsets[cell]] + weight);
    }
}

/* Return the line with most votes; -1 if it has too few. */
VECTORS static int strongest(const int16_t *counts, int count, int least) {
    int16_t most = 0;
    for (int at = 0; at < count; at++) most = counts[at] > most ? counts[at] : most;
    int best = 0;
    while (most >= least && counts[best] != most) best++;
    return most >= least ? best : -1;
}

/* Take the strongest line out of the vote, with its neighbours; write it in pixels. Return 0 if none is left,
   -1 if it does not enter the image. */
static int next_line(const Votes *votes, const Picture *picture, const RidgeSearch *search, RidgeLine *line) {
    const int best = strongest(votes->counts, votes->offsets * votes->count, search->votes);
    if (best < 0) return 0;
    const int number = best / votes->offsets, offset = best % votes->offsets;
    for (int near = number - BESIDE; near <= number + BESIDE; near++)
        for (int other = offset - BESIDE; other <= offset + BESIDE; other++)
            if (near >= 0 && near < votes->count && other >= 0 && other < votes->offsets)
                votes->counts[near * votes->offsets + other] = TAKEN;
    const Direction cells = votes->directions[number];
    const double off = offset - votes->offsets / 2;
    const double x = search->across * (0.5 - off * cells.dy) - 0.5,
                 y = search->down * (0.5 + off * cells.dx) - 0.5;
    const double dx = cells.dx * search->across, dy = cells.dy * search->down, norm = sqrt(dx * dx + dy * dy);
    line->along_px[0] = dx / norm;
    line->along_px[1] = dy / norm;
    return entry_of(x, y, (Direction){dx / norm, dy / norm}, picture, search, line->start_px) ? 1 : -1;
}

/* Withdraw the cells that a ridge accounts for. */
static void withdraw(const Votes *votes, const RidgeSearch *search, const RidgeLine *line, Cells *cells) {
    const double dx = line->along_px[0] / search->across, dy = line->along_px[1] / search->down;
    const double length = sqrt(dx * dx + dy * dy);
    const double start_column = (line->start_px[0] + 0.5) / search->across - 0.5;
    const double start_row = (line->start_px[1] + 0.5) / search->down - 0.5;
    int kept = 0;
    for (int cell = 0; cell < cells->count; cell++) {
        const int row = cells->rows[cell], column = cells->columns[cell];
        if (fabs(dx * (row - start_row) - dy * (column - start_column)) <= search->erased * length) continue;
        cells->rows[cell] = cells->rows[kept];
        cells->columns[cell] = cells->columns[kept];
        cells->rows[kept] = row;
        cells->columns[kept++] = column;
    }
    vote(votes, cells, kept, -1);
    cells->count = kept;
}

int find_ridges(const uint8_t *image, int width, int height, const Grid *grid, const RidgeSearch *search,
                const int32_t *limit_row, int room, RidgeLine *lines, float *contrast, float *brighter) {
    const Picture picture = {image, width, height};
    const size_t cells = (size_t)grid->columns * (size_t)grid->rows, length = (size_t)room;
    const double diagonal = sqrt(square(grid->columns) + square(grid->rows));
    const size_t offsets = 2 * (size_t)diagonal + 5;
    const size_t counts = offsets * MAX_DIRECTIONS;
    char *memory = malloc(length * (sizeof(Centre) + 4 * (2 * STRIP_LANES + 4)) + cells * 13 + counts * 2);
    if (!memory) return -1;
    Centre *centres = (Centre *)memory;
    Samples samples = {.lanes = (float *)(centres + length)};
    float *kept = samples.lanes + length * STRIP_LANES;
    samples.core = kept + length * STRIP_LANES;
    samples.mean = samples.core + length;
    samples.brighter = samples.mean + length;
    int32_t *on_ridge = (int32_t *)(samples.brighter + length), *sums = on_ridge + length;
    Votes votes = {.counts = (int16_t *)(sums + 3 * cells), .offsets = (int)offsets};
    uint8_t *mask = (uint8_t *)(votes.counts + counts);
    memset(mask, 0, cells);
    start_votes(&votes, search);
    memset(votes.counts, 0, 2 * offsets * (size_t)votes.count);
    mark_ridges(grid, search, limit_row, sums, sums + cells, mask);
    Cells marked = {.rows = sums, .columns = sums + cells, .offsets = sums + 2 * cells};
    list_cells(grid, mask, &marked);
    vote(&votes, &marked, 0, 1);
    int count = 0;
    for (int failed = 0; count < MAX_RIDGES && failed < FITS;) {
        const int enters = next_line(&votes, &picture, search, lines + count);
        if (!enters) break;
        if (enters < 0) continue;
        if (!refine(&picture, search, room, lines + count, &samples, kept, on_ridge, centres)) {
            failed++;
            continue;
        }
        for (int station = 0; station < lines[count].stations; station++) {
            *(contrast + (ptrdiff_t)count * room + station) = samples.core[station] - samples.mean[station];
            *(brighter + (ptrdiff_t)count * room + station) = samples.brighter[station];
        }
        if (++count < MAX_RIDGES) withdraw(&votes, search, lines + count - 1, &marked);
        failed = 0;
    }
    free(memory);
    return count;
}
