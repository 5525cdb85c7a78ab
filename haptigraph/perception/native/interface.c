/* What Python reads when it loads the library: the sources that it was compiled from, the layouts of the
   structs and the constants that both share. `library.py` refuses a library that does not fit. */

#include "native.h"

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
    VALUE(STATION_PX), VALUE(BLOCK), VALUE(CELL), VALUE(AROUND_PX), VALUE(MIN_LANES), VALUE(MAX_LANES),
    VALUE(MAX_STATIONS), VALUE(MAX_PX), VALUE(VOLUME_CELL), VALUE(VOLUME_PADDED), VALUE(MAX_VOLUME_ROWS),
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
#define F(field) FIELD(LineFit, field)
    SIZE(LineFit), F(offset_px), F(slope), F(covariance), F(width_px), F(blur_px), F(scatter), F(appearance),
    F(is_on_line), F(is_steep), F(blocks), F(on_line), F(max_offset_px),
#undef F
#define F(field) FIELD(Appearance, field)
    SIZE(Appearance), F(highlight), F(highlight_sd), F(images), F(shaded_px),
#undef F
#define F(field) FIELD(TipPatch, field)
    SIZE(TipPatch), F(middle_px), F(defocus_px), F(fading_share), F(start), F(stop), F(continues), F(about),
    F(is_outside), F(follows_point), F(follows_faint), F(uses_chroma),
    {0}};

EXPORT const uint32_t sources = SOURCES;
