/* Pairing the dots that were drawn with those that were seen. */
#include "rig/develop/match.h"

#include <math.h>

/* A dot matches within this share of the distance to its neighbour: below a half, so that no dot matches two. */
static const double reach_share = 0.45;

/* The centroid of the dot's image under the map: not the image of its centre, as perspective enlarges its near
 * half. */
static struct point image_centroid(const struct camera_map *map, const struct drawn_dot *dot)
{
    struct point corners[4] = {camera_map_apply(map, (struct point){dot->left, dot->top}),
                               camera_map_apply(map, (struct point){dot->right, dot->top}),
                               camera_map_apply(map, (struct point){dot->right, dot->bottom}),
                               camera_map_apply(map, (struct point){dot->left, dot->bottom})};
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

double match_dot_spacing(const struct dots_view *views, size_t count)
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
static double magnification(const struct camera_map *map, struct point at)
{
    struct point a = camera_map_apply(map, (struct point){at.x - 0.5, at.y - 0.5});
    struct point b = camera_map_apply(map, (struct point){at.x + 0.5, at.y - 0.5});
    struct point c = camera_map_apply(map, (struct point){at.x - 0.5, at.y + 0.5});
    return sqrt(fabs((b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y)));
}

size_t match_dots(const struct dots_view *views, size_t count, double spacing,
                  const struct camera_map *map, struct point_pair *pairs, double *cost)
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
                struct point image = camera_map_apply(map, centre);
                pairs[matched++] = (struct point_pair){
                    centre,
                    {nearest->x - expected.x + image.x, nearest->y - expected.y + image.y},
                    false};
            }
        }
    }
    return matched;
}
