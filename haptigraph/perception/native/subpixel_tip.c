/* Where a tip is, sub-pixel: the step from needle to no needle along a close-up, a station per pixel. */

#include <string.h>

#include "native.h"

#define LONGEST 64 /* stations; closeup.py shows less than half of that */
#define CORE 4     /* lanes about the shaft's middle, as wide as three: it lies between two of them */
#define WIDTH_PX 3
#define BLUNT_PX 2
#define TIP_LEVEL 0.36  /* between beyond and behind: the point is thin, half is seen too early */
#define ONE_TONE 0.8    /* share of the contrast that is of one sign, below which a point fades at its rims */
#define BLUR_SHARE 0.4  /* of more blur than in focus: it takes the level beyond the point */
#define POINT_PX 4      /* how much of a point tells its contrast */
#define POINT_ROUNDS 4  /* how often it is followed further */
#define FOLLOWED_PX 4.0 /* from where the contrast first fell */
#define LEAST_ONE_TONE 0.2 /* of a point that is followed: where rims and middle differ, so do their ends */
#define FAINT_LEVEL 0.12   /* the same as TIP_LEVEL for the last, faint part of a point */
#define LONGEST_FAINT_PX 6
#define FAINT_SHARP 0.65    /* of its contrast: so much a narrow part differs from what is beside it */
#define FAINT_BLUR_PX 0.65  /* how far blur takes it beyond the point */
#define FAINT_BLUR_RATE 2.5 /* and how much further per px of more blur than in focus */
#define LEAST_FALL 0.6      /* what is beyond has less than this share of the contrast behind */
#define UNKNOWN_FALL 0.4    /* the same before a wall that was never seen without a needle */
#define BEYOND_PX 4         /* the blurred end of the tip */
#define WALL_PX 2           /* of the wall's edge */
#define FLOOR_PX 0.1
#define FLOOR_GREY 1e-3

/* What Python hands over besides the strip, packed in this order. */
typedef struct {
    double middle;                      /* lane at which the shaft's middle lies, may be between two */
    double unfocused_px;                /* how much more blur there is than in focus */
    double fading_level;                /* the same as TIP_LEVEL where rims and middle differ */
    int start, stop;                    /* stations that are looked at */
    int goes_on;                        /* whether there is more to see beyond them */
    int about;                          /* roughly the tip, from the first of them on */
    int is_outside;                     /* before the wall, where ground may be unknown */
    int is_followed, is_faint_followed; /* whether the point is where it gets thin, and its faint part */
    int around_px; /* to either side of a shaft's middle, that tells how sharp its point is */
} Closeup;

/* A close-up's contrast along the shaft, one value per station [grey levels]. */
typedef struct {
    int count;
    float along[LONGEST];
    double tones[LONGEST];    /* mean difference from the empty eye, with its sign */
    int has_tones;            /* whether that matters */
    uint8_t is_sure[LONGEST]; /* where a contrast means something */
    int goes_on;              /* whether there is more to see beyond its last station */
    double noise_grey;        /* standard deviation of a pixel */
    Rows around;              /* difference from the empty eye in the lanes around the shaft's middle */
    double fading_level;
} Profile;

/* Where the contrast falls off. */
typedef struct {
    int end;          /* the last station before */
    double place_px;  /* from the first station on */
    double slope;     /* grey levels per px */
    double high_grey; /* contrast behind it */
    double one_tone;  /* whether what is behind is of one sign, 1, or its rims and its middle differ, 0 */
} Fall;

/* Stations from the first to before the last. */
typedef struct {
    int start, stop;
} Part;

/* Return the stations that tell the contrast of what is behind one, but for a blunt end. */
static Part behind(const Profile *profile, int end, int behind_px, int blunt_px) {
    const int start = end > behind_px ? end - behind_px : 0, stop = end > blunt_px ? end - blunt_px : 1;
    return (Part){start, stop < profile->count ? stop : profile->count};
}

static double median_of(const Profile *profile, Part part) {
    double values[LONGEST];
    for (int n = part.start; n < part.stop; n++) values[n - part.start] = profile->along[n];
    return median(values, part.stop - part.start);
}

static int all_sure(const Profile *profile, int start) {
    for (int n = start; n < profile->count; n++)
        if (!profile->is_sure[n]) return 0;
    return 1;
}

/* Return the contrast of unknown ground: the wall has some, but not that at its blurred edge. */
static double least_along(const Profile *profile, int start) {
    const int stop = profile->count - WALL_PX;
    double lowest = start < stop ? profile->along[start] : 0;
    for (int n = start; n < stop; n++) lowest = least(lowest, profile->along[n]);
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
    double sure[LONGEST];
    int count = 0;
    for (int n = start + BEYOND_PX; n < profile->count; n++)
        if (profile->is_sure[n]) insert(sure, count++, profile->along[n]);
    if (count) return sure[count / 4];
    return all_sure(profile, start) ? 0 : least_along(profile, start);
}

/* Return whether a shaft is darker or brighter throughout, 1, or its rims and its middle differ, 0. */
static double one_tone(const Profile *profile, Part part) {
    double tones = 0, contrasts = 0;
    if (!profile->has_tones) return 1;
    for (int n = part.start; n < part.stop; n++) {
        tones += profile->tones[n];
        contrasts += profile->along[n];
    }
    const double share = fabs(tones) / largest(contrasts, FLOOR_GREY);
    return least(largest((share - ONE_TONE) / (1 - ONE_TONE), 0), 1);
}

/* Return the last station with so much contrast, -1 if there is none. After a gap, only sure ones count: the
   wall looks like a needle where it is not known. */
static int last_above(const Profile *profile, double level) {
    int last = -1, is_gap = 0;
    for (int n = 0; n < profile->count; n++) {
        const int is_above = profile->along[n] >= level;
        if (is_above && (!is_gap || profile->is_sure[n])) last = n;
        is_gap |= last >= 0 && !is_above;
    }
    return last;
}

/* Return where, after a station, a contrast crosses a level, and its slope there [grey levels per px]. */
static double crossing(const Profile *profile, int end, double level, double *slope) {
    const float *along = profile->along;
    *slope = 1;
    if (end == profile->count - 1) return end;
    *slope = largest((double)along[end] - along[end + 1], 1);
    return end + (along[end] - level) / *slope;
}

/* Return the least contrast that noise does not explain. */
static double least_contrast(const Profile *profile) {
    return above_noise_grey(profile->noise_grey, WIDTH_PX);
}

/* Find where, about a station, the contrast falls off from what it is behind; return whether it does. */
static int find_fall(const Profile *profile, int about, int behind_px, int blunt_px, Fall *fall) {
    const Part shaft = behind(profile, about, behind_px, blunt_px);
    if (shaft.start >= shaft.stop) return 0;
    const double high = median_of(profile, shaft), low = beyond(profile, about);
    if (low > (all_sure(profile, about) ? LEAST_FALL : UNKNOWN_FALL) * high) return 0;
    const double tone = one_tone(profile, shaft);
    const double share = profile->fading_level + tone * (TIP_LEVEL - profile->fading_level);
    const double level = largest(low + share * (high - low), least_contrast(profile));
    const int end = last_above(profile, level);
    if (end < 0 || (end == profile->count - 1 && profile->goes_on)) return 0;
    *fall = (Fall){.end = end, .high_grey = high, .one_tone = tone};
    fall->place_px = crossing(profile, end, level, &fall->slope);
    return 1;
}

/* Return where a point ends that gets thin or dim beyond where its contrast first falls. */
static Fall followed(const Profile *profile, Fall fall) {
    Fall point = fall, further;
    for (int n = 0; n < POINT_ROUNDS; n++) {
        if (!find_fall(profile, point.end, POINT_PX, 0, &further) || further.one_tone < LEAST_ONE_TONE) break;
        if (further.place_px <= point.place_px || further.place_px > fall.place_px + FOLLOWED_PX) break;
        point = further;
    }
    return point;
}

/* Tell whether some stations, start to stop, are narrow: a blurred end, a shadow and a bubble are not. */
static int is_narrow(const Profile *profile, int start, int stop) {
    const Rows around = profile->around;
    return is_sharp(around.first + start, around.stride, around.lanes, stop - start, FAINT_SHARP,
                    profile->noise_grey);
}

/* Return where a point ends of which a faint, narrow part is left beyond where its contrast falls. */
static double faint_end(const Profile *profile, const Fall *point, double unfocused_px) {
    const double high = median_of(profile, behind(profile, point->end, POINT_PX, 0));
    const double low = beyond(profile, point->end);
    const double level = largest(low + FAINT_LEVEL * (high - low), least_contrast(profile));
    const int start = point->end + 1;
    int stop = start;
    while (stop < profile->count && profile->along[stop] >= level) stop++;
    if (stop == start || stop - start > LONGEST_FAINT_PX || point->one_tone < LEAST_ONE_TONE)
        return point->place_px;
    if (stop == profile->count && profile->goes_on) return point->place_px;
    double slope, end_px = crossing(profile, stop - 1, level, &slope);
    end_px -= FAINT_BLUR_PX + FAINT_BLUR_RATE * unfocused_px;
    return end_px > point->place_px && is_narrow(profile, start, stop) ? end_px : point->place_px;
}

/* Return a strip's lanes from one to before another, from a station on. */
static Rows cut(Rows strip, int first_lane, int last_lane, int start) {
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

/* Appearance at the lanes about the shaft's middle; return whether they are all there. */
static int look(const Strip *strip, const Closeup *closeup, Profile *profile) {
    const double middle = closeup->middle;
    const int lane = middle >= 1 && middle < strip->excess.lanes - 2 ? (int)middle : 0;
    const int start = closeup->start;
    const float third = 1.0f / WIDTH_PX, rest = (float)(middle - lane);
    const float weights[CORE] = {(1 - rest) / WIDTH_PX, third, third, rest / WIDTH_PX};
    if (!lane) return 0;
    contrast_along(strip, lane - 1, weights, CORE, start, closeup->stop, profile->along);
    if (closeup->is_outside) {
        memcpy(profile->is_sure, strip->is_known + start, (size_t)profile->count);
    } else {
        memset(profile->is_sure, 1, sizeof profile->is_sure);
        add_tones(profile, cut(strip->excess, lane - 1, lane - 1 + CORE, start), weights);
    }
    profile->around = cut(strip->excess, lane - closeup->around_px, lane + 1 + closeup->around_px, start);
    return 1;
}

/* Find a tip in a close-up; from one look to the next, so much of the needle tells what its contrast is.
   Write the tip's place from the first station on [px], its deviation [px] and the needle's contrast
   [grey levels]; return whether that falls there. */
EXPORT int refine_tip(const Strip *strip, const Closeup *closeup, const int *behinds_px, int looks,
                      double *tip) {
    const double unfocused_px = closeup->unfocused_px;
    const int count = closeup->stop - closeup->start;
    Profile profile = {.count = count, .goes_on = closeup->goes_on, .noise_grey = strip->noise_grey};
    profile.fading_level = closeup->fading_level;
    Fall fall = {.end = closeup->about > 0 ? closeup->about : 0};
    if (looks < 1 || closeup->start < 0 || closeup->stop > strip->excess.stations) return 0;
    if (count < 2 || count > LONGEST || !look(strip, closeup, &profile)) return 0;
    for (int n = 0; n < looks; n++) {
        if (behinds_px[n] < 0 || !find_fall(&profile, fall.end, behinds_px[n], BLUNT_PX, &fall)) return 0;
    }
    const Fall point = closeup->is_followed ? followed(&profile, fall) : fall;
    const double noise_px = strip->noise_grey / sqrt(WIDTH_PX) / point.slope;
    tip[0] = closeup->is_faint_followed ? faint_end(&profile, &point, unfocused_px) : point.place_px;
    tip[0] -= BLUR_SHARE * point.one_tone * unfocused_px;
    tip[1] = sqrt(FLOOR_PX * FLOOR_PX + noise_px * noise_px);
    tip[2] = fall.high_grey;
    return 1;
}
