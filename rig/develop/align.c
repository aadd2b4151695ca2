/* Where the camera sees each surface point: the homography from the dots patterns. */
#include "rig/develop/align.h"

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

/* A dot matches within this share of the distance to its neighbour: below a half, so that no dot matches two. */
static const double reach_share = 0.45;

/* Robust standard deviations at which a match is no longer believed. */
static const double reject_deviations = 4;

/* Distances below this (px) are never rejected: noise-free frames leave nothing but rounding. */
static const double reject_floor_px = 0.02;

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

/* The centroid of the dot's image under the map: not the image of its centre, as perspective enlarges its near
 * half. */
static struct point image_centroid(const struct homography *map, const struct drawn_dot *dot)
{
    struct point corners[4] = {homography_apply(map, (struct point){dot->left, dot->top}),
                               homography_apply(map, (struct point){dot->right, dot->top}),
                               homography_apply(map, (struct point){dot->right, dot->bottom}),
                               homography_apply(map, (struct point){dot->left, dot->bottom})};
    struct point sum = {0, 0};
    double area = 0;
    for (int i = 0; i < 4; i++) {
        /* Relative to the first corner, so that nothing cancels. */
        struct point a = {corners[i].x - corners[0].x, corners[i].y - corners[0].y};
        struct point b = {corners[(i + 1) % 4].x - corners[0].x,
                          corners[(i + 1) % 4].y - corners[0].y};
        double cross = a.x * b.y - b.x * a.y;
        area += cross / 2;
        sum.x += cross * (a.x + b.x) / 6;
        sum.y += cross * (a.y + b.y) / 6;
    }
    return (struct point){corners[0].x + sum.x / area, corners[0].y + sum.y / area};
}

static struct point middle_of(const struct drawn_dot *dot)
{
    return (struct point){(dot->left + dot->right) / 2.0, (dot->top + dot->bottom) / 2.0};
}

/* The smallest distance in the drawing between the first dot and another, over all patterns. */
static double dot_spacing(const struct dots_view *views, size_t count)
{
    double least = INFINITY;
    for (size_t v = 0; v < count; v++) {
        for (size_t i = 1; i < views[v].drawn_count; i++) {
            struct point a = middle_of(&views[v].drawn[0]);
            struct point b = middle_of(&views[v].drawn[i]);
            least = fmin(least, hypot(b.x - a.x, b.y - a.y));
        }
    }
    return least;
}

/* Camera pixels per surface point near a point of the surface. */
static double magnification(const struct homography *map, struct point at)
{
    struct point a = homography_apply(map, (struct point){at.x - 0.5, at.y - 0.5});
    struct point b = homography_apply(map, (struct point){at.x + 0.5, at.y - 0.5});
    struct point c = homography_apply(map, (struct point){at.x - 0.5, at.y + 0.5});
    return sqrt(fabs((b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y)));
}

/* Pair every whole drawn dot with the nearest seen one within reach under the map. What perspective does to a
 * dot's centroid is taken off the camera's point, so that pairs obey a plain homography. `pairs` holds one per
 * drawn dot. Writes the sum of squared distances with misses counted as the reach. */
static size_t match(const struct dots_view *views, size_t count, double spacing,
                    const struct homography *map, struct point_pair *pairs, double *cost)
{
    size_t matched = 0;
    *cost = 0;
    for (size_t v = 0; v < count; v++) {
        for (size_t i = 0; i < views[v].drawn_count; i++) {
            const struct drawn_dot *dot = &views[v].drawn[i];
            struct point centre = middle_of(dot);
            struct point expected = image_centroid(map, dot);
            double reach = reach_share * spacing * magnification(map, centre);
            double least = reach;
            const struct point *nearest = NULL;
            for (size_t k = 0; !dot->cut && k < views[v].seen.count; k++) {
                const struct point *seen = &views[v].seen.centres[k];
                double distance = hypot(seen->x - expected.x, seen->y - expected.y);
                if (distance < least) {
                    least = distance;
                    nearest = seen;
                }
            }
            *cost += dot->cut ? 0 : least * least;
            if (nearest) {
                struct point image = homography_apply(map, centre);
                pairs[matched++] = (struct point_pair){
                    centre,
                    {nearest->x - expected.x + image.x, nearest->y - expected.y + image.y},
                    false};
            }
        }
    }
    return matched;
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
        size_t matched = match(views, count, spacing, map, pairs, &cost);
        if (matched < DOTS_NEEDED || homography_fit(pairs, matched, &next, &ignored) != NACRE_OK) {
            return INFINITY;
        }
        *map = next;
    }
    (void)match(views, count, spacing, map, pairs, &cost);
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
static bool reject(struct point_pair *pairs, size_t count, const struct homography *map,
                   double *scratch)
{
    bool changed = false;
    for (size_t i = 0; i < count; i++) {
        scratch[i] = homography_distance(map, &pairs[i]);
    }
    qsort(scratch, count, sizeof *scratch, compare_doubles);
    /* Distances of a round normal distribution have their median at 1.1774 of its deviation in each axis. */
    double deviation = scratch[count / 2] / 1.1774;
    double limit = fmax(reject_deviations * deviation, reject_floor_px);
    for (size_t i = 0; i < count; i++) {
        bool outlier = homography_distance(map, &pairs[i]) > limit;
        changed = changed || outlier != pairs[i].outlier;
        pairs[i].outlier = outlier;
    }
    return changed;
}

static bool same_map(const struct homography *a, const struct homography *b)
{
    int same = 0;
    for (int i = 0; i < 9; i++) {
        same += a->m[i] == b->m[i] ? 1 : 0;
    }
    return same == 9;
}

static int fit_all(const struct dots_view *views, size_t count, double spacing,
                   struct point_pair *pairs, double *scratch, struct homography *map,
                   struct align_report *report, struct nacre_error *error)
{
    int status = NACRE_OK;
    double cost;
    size_t matched = 0;
    bool changed = true;
    for (int round = 0; status == NACRE_OK && round < FINAL_ROUNDS && changed; round++) {
        matched = match(views, count, spacing, map, pairs, &cost);
        /* match() clears the marks: judge by the map of the round before. */
        if (matched < DOTS_NEEDED) {
            break;
        }
        if (round > 0) {
            (void)reject(pairs, matched, map, scratch);
        } else {
            status = homography_fit(pairs, matched, map, error);
        }
        struct homography before = *map;
        if (status == NACRE_OK) {
            status = homography_refine(pairs, matched, map, error);
        }
        changed = round < 2 || !same_map(&before, map);
    }
    report->matched = 0;
    report->rejected = 0;
    report->worst_px = 0;
    for (size_t i = 0; i < matched; i++) {
        double distance = homography_distance(map, &pairs[i]);
        report->matched += pairs[i].outlier ? 0 : 1;
        report->rejected += pairs[i].outlier ? 1 : 0;
        report->worst_px = pairs[i].outlier ? report->worst_px : fmax(report->worst_px, distance);
    }
    report->rms_px = homography_rms(map, pairs, matched);
    return status;
}

int align_dots(const struct dots_view *views, size_t count, const struct point corners[4],
               int width, int height, struct homography *homography, struct align_report *report,
               struct nacre_error *error)
{
    int status = NACRE_OK;
    size_t drawn = 0;
    size_t seen = 0;
    double spacing = fmin(dot_spacing(views, count), fmax(width, height));
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
        struct homography map;
        double cost =
            try_way(views, count, corners, width, height, way, spacing, pairs, report->dots, &map);
        if (cost < 0.9 * best) { /* a tie goes to the way tried first */
            best = cost;
            *homography = map;
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
    status = fit_all(views, count, spacing, pairs, scratch, homography, report, error);
    if (status == NACRE_OK && 10 * (report->matched + report->rejected) < 9 * report->dots) {
        missed_describe(views, count, homography, spacing, width, height, report->missed,
                        sizeof report->missed);
    }
    if (status == NACRE_OK && 2 * report->matched < report->dots) {
        status = nacre_fail(
            error,
            "only %zu of %zu dots were found where they should be (%zu were seen): %s; is the "
            "picture sharp, and the view of the whole region free? Remove the files of such "
            "patterns from calibration/ and resume the scan",
            report->matched, report->dots, seen, report->missed);
    }
out:
    free(pairs);
    free(scratch);
    return status;
}
