/* The sub-pixel tip: the contrast step from needle to no needle along a tip patch, a station per pixel. */

#include <string.h>

#include "native.h"

#define MAX_PATCH 64 /* stations; the tip patches of subpixel_tip.py have less than half of that */
#define CORE 4       /* lanes about the shaft's middle, as wide as three: it lies between two of them */
#define NOISE_PER_REACH 3.0
#define MAX_REACH 2
#define WIDTH_PX 3
#define BLUNT_PX 2
#define NEAR_PX 7      /* over which a needle's contrast is measured again, behind the first step */
#define TIP_LEVEL 0.36 /* between beyond and behind: the point is thin, half would be too early */
#define ONE_TONE 0.8   /* share of the contrast that is of one sign, below which a point fades at its rims */
#define PI 3.14159265358979323846
#define FOCUSED_PX 0.8     /* standard deviation of the blur of an edge in focus */
#define MAX_FOCUSED_PX 0.2 /* more of it than that: out of focus */
#define BLUR_SHARE 0.4     /* of the defocus: it takes the level beyond the point */
#define POINT_PX 4         /* length of a point over which its contrast is measured */
#define POINT_ROUNDS 4     /* how often it is followed further */
#define FOLLOWED_PX 4.0    /* from the first contrast step */
#define MIN_ONE_TONE 0.2   /* of a point that is followed: where rims and middle differ, so do their ends */
#define FAINT_LEVEL 0.12   /* the same as TIP_LEVEL for the last, faint part of a point */
#define MAX_FAINT_PX 6
#define FAINT_SHARP 0.65     /* sharpness of a narrow part, as a share of its contrast */
#define FAINT_BLUR_PX 0.65   /* how far blur takes it beyond the point */
#define FAINT_BLUR_RATE 2.5  /* and how much further per px of defocus */
#define MAX_STEP 0.6         /* contrast beyond a step, as a share of that behind it, */
#define MAX_STEP_UNKNOWN 0.4 /* and before a wall whose background is unknown */
#define BEYOND_PX 4          /* the blurred end of the tip */
#define WALL_PX 2            /* of the wall's edge */
#define FLOOR_PX 0.1
#define FLOOR_GREY 1e-3

/* Contrast along the shaft in a tip patch, one value per station [grey levels]. */
typedef struct {
    int count;
    float along[MAX_PATCH];
    double tones[MAX_PATCH];    /* mean difference from the background, with its sign */
    int has_tones;              /* whether that matters */
    uint8_t is_sure[MAX_PATCH]; /* where a contrast means something */
    int continues;              /* whether the strip shows more beyond the last station */
    double noise_grey;          /* standard deviation of a pixel, averaged along the shaft */
    int reach;                  /* stations on either side that are averaged, in noise */
    Rows around;                /* excess in the lanes around the shaft's middle */
    double fading_share;
} Profile;

/* Where the contrast falls. */
typedef struct {
    int end;          /* the last station before */
    double u_px;      /* from the first station on */
    double slope;     /* grey levels per px */
    double high_grey; /* contrast behind it */
    double fall_grey; /* how much less there is beyond it */
    double one_tone;  /* whether what is behind is of one sign, 1, or its rims and its middle differ, 0 */
} ContrastStep;

typedef struct {
    int start, stop; /* stations from the first to before the last */
} Part;

/* Return the stations over which the contrast behind one is measured, without a blunt end. */
static Part behind(const Profile *profile, int end, int behind_px, int blunt_px) {
    const int start = end > behind_px ? end - behind_px : 0, stop = end > blunt_px ? end - blunt_px : 1;
    return (Part){start, stop < profile->count ? stop : profile->count};
}

static double median_of(const Profile *profile, Part part) {
    double values[MAX_PATCH];
    for (int n = part.start; n < part.stop; n++) values[n - part.start] = profile->along[n];
    return median(values, part.stop - part.start);
}

static int all_sure(const Profile *profile, int start) {
    for (int n = start; n < profile->count; n++)
        if (!profile->is_sure[n]) return 0;
    return 1;
}

/* Return the contrast of unknown background: the wall has some, without that at its blurred edge. */
static double min_along(const Profile *profile, int start) {
    const int stop = profile->count - WALL_PX;
    double lowest = start < stop ? profile->along[start] : 0;
    for (int n = start; n < stop; n++) lowest = minimum(lowest, profile->along[n]);
    return lowest;
}

/* Insert a value into so many sorted ones. */
static void insert(double *values, int count, double value) {
    while (count > 0 && values[count - 1] > value) {
        values[count] = values[count - 1];
        count--;
    }
    values[count] = value;
}

/* Return the contrast beyond a tip: a quartile, for a longer tip may reach in. */
static double beyond(const Profile *profile, int start) {
    double sure[MAX_PATCH];
    int count = 0;
    for (int n = start + BEYOND_PX; n < profile->count; n++)
        if (profile->is_sure[n]) insert(sure, count++, profile->along[n]);
    if (count) return sure[count / 4];
    return all_sure(profile, start) ? 0 : min_along(profile, start);
}

/* Return whether a shaft is darker or brighter throughout, 1, or its rims and its middle differ, 0. */
static double one_tone(const Profile *profile, Part part) {
    double tones = 0, contrasts = 0;
    if (!profile->has_tones) return 1;
    for (int n = part.start; n < part.stop; n++) {
        tones += profile->tones[n];
        contrasts += profile->along[n];
    }
    const double share = fabs(tones) / maximum(contrasts, FLOOR_GREY);
    return minimum(maximum((share - ONE_TONE) / (1 - ONE_TONE), 0), 1);
}

/* Return the last station with so much contrast, -1 if there is none. After a gap, only sure ones count: the
   wall looks like a needle where its background is unknown. */
static int last_above(const Profile *profile, double level) {
    int last = -1, is_gap = 0;
    for (int n = 0; n < profile->count; n++) {
        const int is_above = profile->along[n] >= level;
        if (is_above && (!is_gap || profile->is_sure[n])) last = n;
        is_gap |= last >= 0 && !is_above;
    }
    return last;
}

/* Return where, after a station, the contrast crosses a level, and its slope there [grey levels per px]. */
static double crossing(const Profile *profile, int end, double level, double *slope) {
    const float *along = profile->along;
    *slope = 1;
    if (end == profile->count - 1) return end;
    *slope = maximum((double)along[end] - along[end + 1], 1);
    return end + (along[end] - level) / *slope;
}

/* Find where, about a station, the contrast falls from that behind it; return whether it does. */
static int find_step(const Profile *profile, int about, int behind_px, int blunt_px, ContrastStep *step) {
    const Part shaft = behind(profile, about, behind_px, blunt_px);
    if (shaft.start >= shaft.stop) return 0;
    const double high = median_of(profile, shaft), low = beyond(profile, about);
    if (low > (all_sure(profile, about) ? MAX_STEP : MAX_STEP_UNKNOWN) * high) return 0;
    const double tone = one_tone(profile, shaft);
    const double share = profile->fading_share + tone * (TIP_LEVEL - profile->fading_share);
    const double noise_grey = noise_threshold_grey(profile->noise_grey, WIDTH_PX);
    const double level = maximum(low + share * (high - low), noise_grey);
    const int end = last_above(profile, level);
    if (end < 0 || (end == profile->count - 1 && profile->continues)) return 0;
    *step = (ContrastStep){.end = end, .high_grey = high, .fall_grey = high - low, .one_tone = tone};
    step->u_px = crossing(profile, end, level, &step->slope);
    return 1;
}

/* Return where a point ends that gets thin or dim beyond the first contrast step. */
static ContrastStep follow_point(const Profile *profile, ContrastStep step) {
    ContrastStep point = step, further;
    for (int n = 0; n < POINT_ROUNDS; n++) {
        if (!find_step(profile, point.end, POINT_PX, 0, &further) || further.one_tone < MIN_ONE_TONE) break;
        if (further.u_px <= point.u_px || further.u_px > step.u_px + FOLLOWED_PX) break;
        point = further;
    }
    return point;
}

/* Return whether stations are narrow, which a blurred end, a shadow and a bubble are not. */
static int is_narrow(const Profile *profile, int start, int stop) {
    const Rows around = profile->around;
    return is_sharp(around.first + start, around.stride, around.lanes, stop - start, FAINT_SHARP,
                    profile->noise_grey);
}

/* Return where a point ends that has a faint, narrow part beyond its contrast step. */
static double follow_faint(const Profile *profile, const ContrastStep *point, double defocus_px) {
    const double high = median_of(profile, behind(profile, point->end, POINT_PX, 0));
    const double low = beyond(profile, point->end);
    const double noise_grey = noise_threshold_grey(profile->noise_grey, WIDTH_PX);
    const double level = maximum(low + FAINT_LEVEL * (high - low), noise_grey);
    const int start = point->end + 1;
    int stop = start;
    while (stop < profile->count && profile->along[stop] >= level) stop++;
    if (stop == start || stop - start > MAX_FAINT_PX) return point->u_px;
    if (stop == profile->count && profile->continues) return point->u_px;
    double slope, end_px = crossing(profile, stop - 1, level, &slope);
    end_px -= FAINT_BLUR_PX + FAINT_BLUR_RATE * defocus_px;
    return end_px > point->u_px && is_narrow(profile, start, stop) ? end_px : point->u_px;
}

/* Return a strip's lanes from one to before another, from a station on. */
static Rows crop(Rows strip, int first_lane, int last_lane, int start) {
    const int first = first_lane > 0 ? first_lane : 0;
    const int last = last_lane < strip.lanes ? last_lane : strip.lanes;
    const float *here = strip.first + first * strip.stride + start;
    return (Rows){here, strip.stride, last - first, strip.stations - start};
}

static void add_tones(Profile *profile, Rows core, const float *weights) {
    profile->has_tones = 1;
    for (int lane = 0; lane < CORE; lane++)
        for (int n = 0; n < profile->count; n++)
            profile->tones[n] += (double)weights[lane] * core.first[lane * core.stride + n];
}

/* Measure the profile in the lanes about the shaft's middle; return whether the strip has them all. */
static int measure_profile(const Strip *strip, const TipPatch *patch, Profile *profile) {
    const double middle = patch->middle_px;
    const int lane = middle >= 1 && middle < strip->excess.lanes - 2 ? (int)middle : 0;
    const int start = patch->start;
    const float third = 1.0f / WIDTH_PX, rest = (float)(middle - lane);
    const float weights[CORE] = {(1 - rest) / WIDTH_PX, third, third, rest / WIDTH_PX};
    if (!lane) return 0;
    Strip seen = *strip;
    if (!patch->uses_chroma) seen.chroma.lanes = 0;
    contrast_along(&seen, lane - 1, weights, CORE, start, patch->stop, profile->reach, profile->along);
    if (patch->is_outside) {
        memcpy(profile->is_sure, strip->is_known + start, (size_t)profile->count);
    } else {
        memset(profile->is_sure, 1, sizeof profile->is_sure);
        add_tones(profile, crop(strip->excess, lane - 1, lane - 1 + CORE, start), weights);
    }
    profile->around = crop(strip->excess, lane - AROUND_PX, lane + 1 + AROUND_PX, start);
    return 1;
}

/* Return how much more than in focus a step is blurred along the shaft: motion may blur its edges alone. */
static double defocus_along_px(const ContrastStep *step) {
    return maximum(step->fall_grey / (sqrt(2 * PI) * step->slope) - FOCUSED_PX, 0);
}

/* Locate the tip in a patch. `tip` receives the position from the first station on [px], its sd [px] and the
   needle's contrast [grey levels]. Return whether the contrast falls there. */
EXPORT int refine_tip(const Strip *strip, const TipPatch *patch, double *tip) {
    const int count = patch->stop - patch->start;
    Profile profile = {.count = count, .continues = patch->continues, .noise_grey = strip->noise_grey};
    profile.reach = clamped(strip->noise_grey / NOISE_PER_REACH, 0, MAX_REACH);
    profile.noise_grey /= sqrt(2 * profile.reach + 1);
    profile.fading_share = patch->fading_share;
    ContrastStep step = {.end = patch->about > 0 ? patch->about : 0};
    if (count < 2 || count > MAX_PATCH || !measure_profile(strip, patch, &profile)) return 0;
    if (!find_step(&profile, step.end, BEHIND_PX, BLUNT_PX, &step)) return 0;
    if (!find_step(&profile, step.end, NEAR_PX, BLUNT_PX, &step)) return 0;
    const double defocus_px = minimum(maximum(patch->blur_px - FOCUSED_PX, 0), defocus_along_px(&step));
    const int is_focused = defocus_px < MAX_FOCUSED_PX;
    const ContrastStep point = is_focused ? follow_point(&profile, step) : step;
    const double noise_px = strip->noise_grey / sqrt(WIDTH_PX) / point.slope;
    const int follows_faint =
        is_focused && !patch->is_outside; /* outside, more is visible on the background */
    tip[0] = follows_faint ? follow_faint(&profile, &point, defocus_px) : point.u_px;
    tip[0] -= BLUR_SHARE * defocus_px;
    tip[1] = sqrt(FLOOR_PX * FLOOR_PX + noise_px * noise_px);
    tip[2] = step.high_grey;
    return 1;
}
