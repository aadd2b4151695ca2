/* Which dots were not found where they should be: words for an error. */
#include "rig/develop/missed.h"

#include <math.h>
#include <stdio.h>

/* Below a half, so that no dot seen counts for two. */
static const double reach_share = 0.45;

struct tally {
    size_t dots, found;
};

static double share_missing(struct tally tally)
{
    return tally.dots ? 1 - (double)tally.found / (double)tally.dots : -1;
}

static bool was_found(const struct dots *seen, const struct camera_map *map, struct point centre,
                      double spacing)
{
    struct point at = camera_map_apply(map, centre);
    struct point right = camera_map_apply(map, (struct point){centre.x + spacing, centre.y});
    struct point below = camera_map_apply(map, (struct point){centre.x, centre.y + spacing});
    double reach = reach_share * fmin(hypot(right.x - at.x, right.y - at.y),
                                      hypot(below.x - at.x, below.y - at.y));
    for (size_t k = 0; k < seen->count; k++) {
        if (hypot(seen->centres[k].x - at.x, seen->centres[k].y - at.y) < reach) {
            return true;
        }
    }
    return false;
}

static int ninth_of(struct point centre, int width, int height)
{
    int column = (int)fmin(3 * centre.x / width, 2);
    int row = (int)fmin(3 * centre.y / height, 2);
    return 3 * row + column;
}

static struct tally tally_view(const struct dots_view *view, const struct camera_map *map,
                               double spacing, int width, int height, struct tally ninths[9])
{
    struct tally tally = {0, 0};
    for (size_t i = 0; i < view->drawn_count; i++) {
        const struct drawn_dot *dot = &view->drawn[i];
        if (dot->cut) {
            continue;
        }
        tally.dots++;
        if (map) {
            struct point centre = {(dot->left + dot->right) / 2.0, (dot->top + dot->bottom) / 2.0};
            struct tally *ninth = &ninths[ninth_of(centre, width, height)];
            size_t found = was_found(&view->seen, map, centre, spacing) ? 1 : 0;
            ninth->dots++;
            ninth->found += found;
            tally.found += found;
        }
    }
    if (!map) {
        tally.found = view->seen.count < tally.dots ? view->seen.count : tally.dots;
    }
    return tally;
}

void missed_describe(const struct dots_view *views, size_t count, const struct camera_map *map,
                     double spacing, int width, int height, char *text, size_t size)
{
    static const char *const names[9] = {"upper left", "upper middle", "upper right",
                                         "left",       "middle",       "right",
                                         "lower left", "lower middle", "lower right"};
    struct tally ninths[9] = {{0, 0}};
    struct tally worst = {0, 0};
    size_t pattern = 0;
    int ninth = 0;
    for (size_t v = 0; v < count; v++) {
        struct tally tally = tally_view(&views[v], map, spacing, width, height, ninths);
        if (share_missing(tally) > share_missing(worst)) {
            worst = tally;
            pattern = v;
        }
    }
    int used =
        snprintf(text, size, "dots pattern %zu shows %zu of %zu", pattern, worst.found, worst.dots);
    for (int k = 1; k < 9; k++) {
        ninth = share_missing(ninths[k]) > share_missing(ninths[ninth]) ? k : ninth;
    }
    if (map && used > 0 && (size_t)used < size) {
        (void)snprintf(text + used, size - (size_t)used,
                       ", and in the %s of the region %zu of %zu were found over all patterns",
                       names[ninth], ninths[ninth].found, ninths[ninth].dots);
    }
}
