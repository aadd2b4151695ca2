/* Where the camera sees each surface point: homography and lens from the dots patterns. */
#include "rig/develop/align.h"

#include "rig/develop/match.h"
#include "rig/develop/missed.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    WAYS = 8,          /* four turns, each plain and mirrored */
    DOTS_NEEDED = 8,   /* twice what a homography takes */
    TRIAL_ROUNDS = 4,  /* of matching and fitting while the ways compete */
    FINAL_ROUNDS = 12, /* of fitting and rejecting */
};

/* How far beyond chance (F) and by how much a lens's distortion must lessen the residuals to be used. With one more parameter
 * and a hundred dots chance passes 30 once in 10^7 times; if only one dot in eight erred independently, F would be an
 * eighth, and chance still would pass that once in 20 times. And less than a tenth of the goal of 0.05 pixels cannot
 * matter. */
static const double lens_certainty = 30;
static const double lens_gain_px = 0.005;

/* Robust standard deviations at which a match is no longer believed. */
static const double reject_deviations = 4;

/* Distances below this (px) are never rejected: noise-free frames leave nothing but rounding. */
static const double reject_floor_px = 0.02;

/* What all fits work on. */
struct alignment {
    const struct dots_view *views;
    size_t count;
    double spacing;
    struct point_pair *pairs; /* one per drawn dot */
    double *scratch;          /* the same */
};

int align_find_drawn(const uint8_t *levels, int width, int height, struct drawn_dot **drawn,
                     size_t *count, struct nacre_error *error)
{
    size_t capacity = 0;
    *drawn = NULL;
    *count = 0;
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            const uint8_t *at = levels + (size_t)y * (size_t)width + (size_t)x;
            /* Only the upper left pixel of a rectangle has no lit one to its left and above. */
            if (!*at || (x > 0 && at[-1]) || (y > 0 && at[-width])) {
                continue;
            }
            struct drawn_dot dot = {x, y, x, y, false};
            while (dot.right < width && at[dot.right - x]) {
                dot.right++;
            }
            while (dot.bottom < height && at[(ptrdiff_t)(dot.bottom - y) * width]) {
                dot.bottom++;
            }
            dot.cut = x == 0 || y == 0 || dot.right == width || dot.bottom == height;
            if (*count == capacity) {
                capacity = capacity ? 2 * capacity : 64;
                struct drawn_dot *more = realloc(*drawn, capacity * sizeof *more);
                if (!more) {
                    free(*drawn);
                    *drawn = NULL;
                    return nacre_fail_memory(error, "the drawn dots");
                }
                *drawn = more;
            }
            (*drawn)[(*count)++] = dot;
        }
    }
    return NACRE_OK;
}

void dots_view_finish(struct dots_view *view)
{
    if (view) {
        free(view->drawn);
        dots_finish(&view->seen);
        *view = (struct dots_view){0};
    }
}

/* The map that sends the surface's corners to the lit area's in one of the eight ways. */
static int map_corners(const struct point corners[4], int width, int height, int way,
                       struct homography *map, struct nacre_error *error)
{
    const struct point surface[4] = {{0, 0}, {width, 0}, {width, height}, {0, height}};
    struct point_pair pairs[4];
    for (int i = 0; i < 4; i++) {
        int turned = way < 4 ? (i + way) % 4 : (4 + way - i) % 4;
        pairs[i] = (struct point_pair){surface[i], corners[turned], false};
    }
    return homography_fit(pairs, 4, map, error);
}

/* How far the map leaves the corners, squared and summed. */
static double corner_cost(const struct point corners[4], int width, int height, int way,
                          const struct homography *map)
{
    const struct point surface[4] = {{0, 0}, {width, 0}, {width, height}, {0, height}};
    double cost = 0;
    for (int i = 0; i < 4; i++) {
        const struct point *corner = &corners[way < 4 ? (i + way) % 4 : (4 + way - i) % 4];
        struct point image = homography_apply(map, surface[i]);
        cost += (image.x - corner->x) * (image.x - corner->x) +
                (image.y - corner->y) * (image.y - corner->y);
    }
    return cost;
}

/* A way's cost in px: mean distance of dots, and a tenth of that of the corners to decide between equals. The map is
 * the best found; INFINITY where the dots do not fit this way at all. */
static double try_way(const struct dots_view *views, size_t count, const struct point corners[4],
                      int width, int height, int way, double spacing, struct point_pair *pairs,
                      size_t expected, struct homography *map)
{
    double cost = INFINITY;
    struct nacre_error ignored;
    if (map_corners(corners, width, height, way, map, &ignored) != NACRE_OK) {
        return INFINITY;
    }
    for (int round = 0; round < TRIAL_ROUNDS; round++) {
        struct homography next;
        const struct camera_map ideal = {.plane = *map};
        size_t matched = match_dots(views, count, spacing, &ideal, pairs, &cost);
        if (matched < DOTS_NEEDED || homography_fit(pairs, matched, &next, &ignored) != NACRE_OK) {
            return INFINITY;
        }
        *map = next;
    }
    const struct camera_map ideal = {.plane = *map};
    (void)match_dots(views, count, spacing, &ideal, pairs, &cost);
    return sqrt(cost / (double)expected) +
           0.1 * sqrt(corner_cost(corners, width, height, way, map) / 4);
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Mark pairs that lie too far off; returns whether any mark changed. `scratch` holds `count` numbers. */
static bool reject(struct point_pair *pairs, size_t count, const struct camera_map *map,
                   double *scratch)
{
    bool changed = false;
    for (size_t i = 0; i < count; i++) {
        scratch[i] = camera_map_distance(map, &pairs[i]);
    }
    qsort(scratch, count, sizeof *scratch, compare_doubles);
    /* Distances of a round normal distribution have their median at 1.1774 of its deviation in each axis. */
    double deviation = scratch[count / 2] / 1.1774;
    double limit = fmax(reject_deviations * deviation, reject_floor_px);
    for (size_t i = 0; i < count; i++) {
        bool outlier = camera_map_distance(map, &pairs[i]) > limit;
        changed = changed || outlier != pairs[i].outlier;
        pairs[i].outlier = outlier;
    }
    return changed;
}

static bool same_map(const struct camera_map *a, const struct camera_map *b)
{
    int same = a->lens.k1 == b->lens.k1 && a->lens.k2 == b->lens.k2 ? 1 : 0;
    for (int i = 0; i < 9; i++) {
        same += a->plane.m[i] == b->plane.m[i] ? 1 : 0;
    }
    return same == 10;
}

static int refine(const struct point_pair *pairs, size_t count, enum lens_model model,
                  struct camera_map *map, struct nacre_error *error)
{
    return model == LENS_IDEAL ? homography_refine(pairs, count, &map->plane, error)
                               : camera_map_refine(pairs, count, model, map, error);
}

/* Match, fit and reject until nothing changes, beginning with *map. */
static int fit_all(const struct alignment *alignment, enum lens_model model, struct camera_map *map,
                   size_t *matched, struct nacre_error *error)
{
    int status = NACRE_OK;
    double cost;
    bool changed = true;
    *matched = 0;
    for (int round = 0; status == NACRE_OK && round < FINAL_ROUNDS && changed; round++) {
        *matched = match_dots(alignment->views, alignment->count, alignment->spacing, map,
                              alignment->pairs, &cost);
        /* match_dots() clears the marks: judge by the map of the round before. */
        if (*matched < DOTS_NEEDED) {
            break;
        }
        struct camera_map before = *map;
        if (round > 0) {
            (void)reject(alignment->pairs, *matched, map, alignment->scratch);
        } else if (model == LENS_IDEAL) {
            status = homography_fit(alignment->pairs, *matched, &map->plane, error);
        }
        if (status == NACRE_OK) {
            status = refine(alignment->pairs, *matched, model, map, error);
        }
        changed = round < 2 || !same_map(&before, map);
    }
    return status;
}

/* Whether `richer`, with `more` parameters, leaves less of the pairs than chance would let it: an F test far beyond any
 * chance, and by what matters at all. */
static bool is_called_for(const struct point_pair *pairs, size_t count,
                          const struct camera_map *plainer, const struct camera_map *richer,
                          int more)
{
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        used += pairs[i].outlier ? 0 : 1;
    }
    double freedom = 2 * (double)used - 12;
    double before = pow(camera_map_rms(plainer, pairs, count), 2);
    double after = pow(camera_map_rms(richer, pairs, count), 2);
    return freedom > 0 && before - after > lens_gain_px * lens_gain_px &&
           (before - after) / more > lens_certainty * after / freedom;
}

/* Try lenses of more and more parameters, and keep each only where the residuals of the one before call for it. */
static int choose_lens(const struct alignment *alignment, struct point middle,
                       struct camera_map *map, struct align_report *report,
                       struct nacre_error *error)
{
    static const int more[] = {0, 1, 3};
    size_t matched;
    struct camera_map best = *map;
    report->lens = LENS_IDEAL;
    for (int model = LENS_RADIAL; model <= LENS_SHIFTED; model++) {
        struct camera_map richer = best;
        if (model == LENS_RADIAL) {
            richer.lens = (struct lens){.centre = middle, .unit = hypot(middle.x, middle.y)};
        }
        int status = fit_all(alignment, (enum lens_model)model, &richer, &matched, error);
        /* The plainer one on the same pairs. */
        struct camera_map plainer = best;
        if (status == NACRE_OK) {
            status =
                refine(alignment->pairs, matched, (enum lens_model)(model - 1), &plainer, error);
        }
        if (status != NACRE_OK) {
            return status;
        }
        if (is_called_for(alignment->pairs, matched, &plainer, &richer, more[model])) {
            best = richer;
            report->lens = (enum lens_model)model;
        } else {
            break;
        }
    }
    *map = best;
    return NACRE_OK;
}

/* The largest distance between what this lens and an ideal one see, over the region's border. */
static double lens_shift(const struct camera_map *map, int width, int height)
{
    double most = 0;
    for (int k = 0; k <= 8; k++) {
        const struct point border[4] = {{width * k / 8.0, 0},
                                        {width * k / 8.0, height},
                                        {0, height * k / 8.0},
                                        {width, height * k / 8.0}};
        for (int side = 0; side < 4; side++) {
            struct point seen = camera_map_apply(map, border[side]);
            struct point ideal = homography_apply(&map->plane, border[side]);
            most = fmax(most, hypot(seen.x - ideal.x, seen.y - ideal.y));
        }
    }
    return most;
}

/* Counts and residuals of the matched pairs. */
static void note_residuals(const struct point_pair *pairs, size_t count,
                           const struct camera_map *map, int width, int height,
                           struct align_report *report)
{
    double squares[ALIGN_TILES * ALIGN_TILES] = {0};
    size_t used[ALIGN_TILES * ALIGN_TILES] = {0};
    for (size_t i = 0; i < count; i++) {
        double distance = camera_map_distance(map, &pairs[i]);
        int column = (int)fmin(ALIGN_TILES * pairs[i].surface.x / width, ALIGN_TILES - 1);
        int row = (int)fmin(ALIGN_TILES * pairs[i].surface.y / height, ALIGN_TILES - 1);
        report->rejected += pairs[i].outlier ? 1 : 0;
        if (!pairs[i].outlier) {
            report->matched++;
            report->worst_px = fmax(report->worst_px, distance);
            squares[row * ALIGN_TILES + column] += distance * distance;
            used[row * ALIGN_TILES + column]++;
        }
    }
    for (int tile = 0; tile < ALIGN_TILES * ALIGN_TILES; tile++) {
        report->map_px[tile / ALIGN_TILES][tile % ALIGN_TILES] =
            used[tile] ? sqrt(squares[tile] / (double)used[tile]) : NAN;
    }
    report->rms_px = camera_map_rms(map, pairs, count);
    report->lens_px = lens_shift(map, width, height);
}

/* Say where dots are missing, and refuse a map that few of them speak for. */
static int judge_count(const struct alignment *alignment, const struct camera_map *map, int width,
                       int height, size_t seen, struct align_report *report,
                       struct nacre_error *error)
{
    if (10 * (report->matched + report->rejected) >= 9 * report->dots) {
        return NACRE_OK;
    }
    missed_describe(alignment->views, alignment->count, map, alignment->spacing, width, height,
                    report->missed, sizeof report->missed);
    return 2 * report->matched >= report->dots
               ? NACRE_OK
               : nacre_fail(
                     error,
                     "only %zu of %zu dots were found where they should be (%zu were seen): %s; is "
                     "the picture sharp, and the view of the whole region free? Remove the files "
                     "of such patterns from calibration/ and resume the scan",
                     report->matched, report->dots, seen, report->missed);
}

int align_dots(const struct dots_view *views, size_t count, const struct point corners[4],
               int width, int height, struct point middle, struct camera_map *map,
               struct align_report *report, struct nacre_error *error)
{
    int status = NACRE_OK;
    size_t drawn = 0;
    size_t seen = 0;
    double spacing = fmin(match_dot_spacing(views, count), fmax(width, height));
    double best = INFINITY;
    *report = (struct align_report){0};
    for (size_t v = 0; v < count; v++) {
        drawn += views[v].drawn_count;
        seen += views[v].seen.count;
        for (size_t i = 0; i < views[v].drawn_count; i++) {
            report->dots += views[v].drawn[i].cut ? 0 : 1;
        }
    }
    struct point_pair *pairs = malloc((drawn + 1) * sizeof *pairs);
    double *scratch = malloc((drawn + 1) * sizeof *scratch);
    if (!pairs || !scratch) {
        status = nacre_fail_memory(error, "the dots' matches");
        goto out;
    }
    if (report->dots < DOTS_NEEDED) {
        status = nacre_fail(error,
                            "the dots patterns hold %zu dots where %d are needed; use a narrower "
                            "dot_spacing or dot_shift, or resume the scan to measure all of them",
                            report->dots, DOTS_NEEDED);
        goto out;
    }
    for (int way = 0; way < WAYS; way++) {
        struct homography plane;
        double cost = try_way(views, count, corners, width, height, way, spacing, pairs,
                              report->dots, &plane);
        if (cost < 0.9 * best) { /* a tie goes to the way tried first */
            best = cost;
            *map = (struct camera_map){.plane = plane};
        }
    }
    if (isinf(best)) {
        char missed[256];
        missed_describe(views, count, NULL, spacing, width, height, missed, sizeof missed);
        status =
            nacre_fail(error,
                       "the dots do not fit the region: %zu were seen where %zu should be (%s); is "
                       "the picture sharp, the white layer on, and the spacing that of the plan?",
                       seen, report->dots, missed);
        goto out;
    }
    const struct alignment alignment = {views, count, spacing, pairs, scratch};
    size_t matched = 0;
    status = fit_all(&alignment, LENS_IDEAL, map, &matched, error);
    if (status == NACRE_OK && matched >= DOTS_NEEDED) {
        status = choose_lens(&alignment, middle, map, report, error);
    }
    if (status == NACRE_OK) {
        status = fit_all(&alignment, report->lens, map, &matched, error);
        note_residuals(pairs, matched, map, width, height, report);
    }
    if (status == NACRE_OK) {
        status = judge_count(&alignment, map, width, height, seen, report, error);
    }
out:
    free(pairs);
    free(scratch);
    return status;
}
