/* What Python reads when it loads the library: the sources that it was compiled from, the layouts of the
   structs and the constants that both share. `library.py` refuses a library that does not fit. */

#include "oct/bscan.h"
#include "tip_network.h"

#ifndef SOURCES
#error "compile with: python hatch_build.py"
#endif

/* A constant with its value, a struct with its size, or a field with its offset and size. */
typedef struct {
    const char *name;
    int32_t value, size;
} Entry;

#define VALUE(name) {#name, (int32_t)(name), 0}
#define SIZE(type) {#type, sizeof(type), 0}
#define FIELD(type, field) {#type "." #field, offsetof(type, field), sizeof(((type *)0)->field)}

/* clang-format off */
EXPORT const Entry entries[] = {
    VALUE(STATION_PX), VALUE(BLOCK), VALUE(CELL), VALUE(AROUND_PX), VALUE(BEHIND_PX), VALUE(MIN_LANES), VALUE(MAX_LANES),
    VALUE(MAX_STATIONS), VALUE(MAX_PX), VALUE(TIP_STATIONS), VALUE(TIP_PLACES), VALUE(TIP_KINDS), VALUE(TIP_VALUES), VALUE(TIP_WEIGHTS), VALUE(VOLUME_CELL), VALUE(VOLUME_PADDED), VALUE(MAX_VOLUME_ROWS),
    VALUE(MAX_RIDGES), VALUE(MAX_SQUARE_PX), VALUE(CELL_STEPS), VALUE(MAX_SCAN_PX), VALUE(MAX_STEP_ROWS),
    VALUE(ALONG_STEPS), VALUE(CORE_STEPS), VALUE(MAX_CELLS), VALUE(MAX_SUM_CELLS),
#define F(field) FIELD(Strip, field)
    SIZE(Strip), F(excess.first), F(excess.stride), F(excess.lanes), F(excess.stations), F(detrended.first),
    F(detrended.stride), F(detrended.lanes), F(detrended.stations), F(u_px), F(is_known), F(noise_grey),
    F(outside_stop), F(inside_start), F(inside_stop), F(chroma.first), F(chroma.stride), F(chroma.lanes),
    F(chroma.stations),
#undef F
#define F(field) FIELD(ReducedVolume, field)
    SIZE(ReducedVolume), F(first), F(columns), F(slices), F(cells), F(first_cell), F(last_cell),
#undef F
#define F(field) FIELD(SearchGrid, field)
    SIZE(SearchGrid), F(pixels), F(is_inside), F(sampled), F(samples), F(flanks), F(is_observable),
    F(pixel_count), F(sampled_count), F(rows), F(cells), F(trocar),
#undef F
#define F(field) FIELD(Marked, field)
    SIZE(Marked), F(count), F(first_row), F(last_row), F(first_column), F(last_column),
#undef F
#define F(field) FIELD(JawPatch, field)
    SIZE(JawPatch), F(grey), F(pixels), F(background), F(is_other), F(light), F(center_px), F(radius_px),
    F(min_length_px), F(max_difference_px), F(lanes), F(stations), F(core), F(visible),
#undef F
#define F(field) FIELD(Run, field)
    SIZE(Run), F(lane), F(first), F(stop), F(part), F(on_line),
#undef F
#define F(field) FIELD(LineFit, field)
    SIZE(LineFit), F(offset_px), F(slope), F(covariance), F(light_rad), F(width_px), F(blur_px), F(scatter),
    F(appearance), F(is_on_line), F(is_steep), F(blocks), F(on_line), F(max_offset_px),
#undef F
#define F(field) FIELD(Appearance, field)
    SIZE(Appearance), F(highlight), F(highlight_sd), F(images), F(shaded_px),
#undef F
#define F(field) FIELD(TipPatch, field)
    SIZE(TipPatch), F(middle_px), F(blur_px), F(fading_share), F(start), F(stop), F(continues), F(about),
    F(is_outside), F(uses_chroma),
#undef F
#define F(field) FIELD(Grid, field)
    SIZE(Grid), F(cells), F(rows), F(columns), F(group),
#undef F
#define F(field) FIELD(SurfaceSearch, field)
    SIZE(SurfaceSearch), F(edge), F(deep), F(thinnest), F(thickest), F(band), F(most), F(min_columns),
    F(step_grey), F(rpe_step_grey), F(saturation_grey), F(body_share), F(dark_grey), F(top_grey),
    F(min_rise_grey), F(min_rise_share), F(min_band_grey), F(min_band_share), F(border_rows), F(ilm.window),
    F(ilm.reach), F(ilm.least_sd_rows), F(ilm.scatter_share), F(rpe.window), F(rpe.reach), F(rpe.least_sd_rows),
    F(rpe.scatter_share),
#undef F
#define F(field) FIELD(RidgeSearch, field)
    SIZE(RidgeSearch), F(step_px), F(dark_grey), F(mask_grey), F(strip_grey), F(lowest_slope), F(highest_slope),
    F(inlier_steps), F(below_ilm_px), F(across), F(down), F(side), F(votes), F(erased), F(gap), F(run), F(beyond),
#undef F
#define F(field) FIELD(SurfacePair, field)
    SIZE(SurfacePair), F(x_px), F(ilm_px), F(rpe_px), F(ilm_visible), F(rpe_visible), F(columns),
#undef F
#define F(field) FIELD(ShaftSearch, field)
    SIZE(ShaftSearch), F(min_contrast_grey), F(equal_share), F(start_steps), F(gap_steps), F(least_steps),
    F(min_ridge_share), F(on_ridge_rows), F(below_shaft_rows), F(dark_rows), F(margin_px), F(max_tissue_share),
    F(floor_grey), F(tissue_grey),
#undef F
#define F(field) FIELD(Shaft, field)
    SIZE(Shaft), F(line.start_px), F(line.along_px), F(line.angle_sd_rad), F(line.stations), F(share),
    F(typical_grey), F(end_steps), F(number),
#undef F
#define F(field) FIELD(BevelSearch, field)
    SIZE(BevelSearch), F(wall_rows), F(spot_rows), F(above_rows), F(below_rows), F(smooth_rows), F(half_px), F(ahead_px),
    F(bright_share), F(equal_share), F(spot_sd_rows), F(lit_share), F(min_gain), F(floor_grey),
    F(apart_rows),
#undef F
#define F(field) FIELD(EdgeSearch, field)
    SIZE(EdgeSearch), F(start_px), F(along_px), F(end_x), F(margin_px), F(window_px), F(max_distance_px),
    F(thick_rows), F(most_rows), F(below_rows), F(below_shaft_rows), F(deep_rows), F(below_rpe_rows),
    F(min_contrast_grey), F(halved_grey), F(rise_share), F(slope_columns), F(run), F(half),
#undef F
#define F(field) FIELD(Columns, field)
    SIZE(Columns), F(x_px), F(row_px), F(sd_px), F(is_visible), F(count),
#undef F
#define F(field) FIELD(LineLimits, field)
    SIZE(LineLimits), F(tip_px), F(beyond_px), F(alone_px), F(parallel_px), F(slope_sd), F(center_px), F(right_mm),
    F(down_mm), F(shares), F(slope_columns),
    {0}};

EXPORT const uint32_t sources = SOURCES;
