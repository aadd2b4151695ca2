/* Which surface points each camera pixel sees, and how much of its view each takes. */
#include "rig/develop/footprint.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

enum { CORNERS = 16 }; /* a quadrilateral cut by four lines has at most 8 */

struct polygon {
    int count;
    struct point corners[CORNERS];
};

/* Keep the part where sign * (x or y) <= sign * limit. */
static struct polygon cut(const struct polygon *polygon, bool vertical, double sign, double limit)
{
    struct polygon rest = {0};
    for (int i = 0; i < polygon->count; i++) {
        struct point a = polygon->corners[i];
        struct point b = polygon->corners[(i + 1) % polygon->count];
        double over_a = sign * ((vertical ? a.y : a.x) - limit);
        double over_b = sign * ((vertical ? b.y : b.x) - limit);
        if (over_a <= 0) {
            rest.corners[rest.count++] = a;
        }
        if ((over_a < 0 && over_b > 0) || (over_a > 0 && over_b < 0)) {
            double t = over_a / (over_a - over_b);
            rest.corners[rest.count++] =
                (struct point){a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
        }
    }
    return rest;
}

static double area_of(const struct polygon *polygon)
{
    double twice = 0;
    for (int i = 1; i + 1 < polygon->count; i++) {
        struct point o = polygon->corners[0];
        struct point a = polygon->corners[i];
        struct point b = polygon->corners[i + 1];
        twice += (a.x - o.x) * (b.y - o.y) - (b.x - o.x) * (a.y - o.y);
    }
    return fabs(twice) / 2;
}

/* The squares that a polygon may touch, kept to the surface: right and bottom exclusive. */
struct range {
    int left, top, right, bottom;
};

static struct range range_of(const struct polygon *polygon, int width, int height)
{
    double left = width;
    double top = height;
    double right = 0;
    double bottom = 0;
    for (int i = 0; i < polygon->count; i++) {
        left = fmin(left, polygon->corners[i].x);
        right = fmax(right, polygon->corners[i].x);
        top = fmin(top, polygon->corners[i].y);
        bottom = fmax(bottom, polygon->corners[i].y);
    }
    return (struct range){(int)floor(fmax(left, 0)), (int)floor(fmax(top, 0)),
                          (int)ceil(fmin(right, width)), (int)ceil(fmin(bottom, height))};
}

/* The border of a pixel on the surface; `back` is from the ideal camera. */
static struct polygon view_of(const struct homography *back, const struct lens *lens, int x, int y)
{
    struct polygon view = {.count = 4};
    for (int i = 0; i < 4; i++) {
        struct point corner = {x + (i == 1 || i == 2), y + (i >= 2)};
        view.corners[i] = homography_apply(back, lens_undistort(lens, corner));
    }
    return view;
}

/* Append the row of one pixel at footprints->start[pixel]. Returns false when memory runs out. */
static bool add_row(struct footprints *footprints, size_t *capacity, size_t pixel,
                    const struct polygon *view, int width, int height)
{
    struct range range = range_of(view, width, height);
    size_t used = footprints->start[pixel];
    double whole = area_of(view);
    double seen = 0;
    for (int y = range.top; y < range.bottom; y++) {
        for (int x = range.left; x < range.right; x++) {
            struct polygon part = cut(view, false, -1, x);
            part = cut(&part, false, 1, x + 1);
            part = cut(&part, true, -1, y);
            part = cut(&part, true, 1, y + 1);
            double area = area_of(&part);
            if (area <= 1e-6 * whole) {
                continue;
            }
            if (used == *capacity) {
                size_t more = 2 * *capacity;
                uint32_t *points = realloc(footprints->points, more * sizeof *points);
                footprints->points = points ? points : footprints->points;
                float *share = realloc(footprints->share, more * sizeof *share);
                footprints->share = share ? share : footprints->share;
                if (!points || !share) {
                    return false;
                }
                *capacity = more;
            }
            footprints->points[used] = (uint32_t)y * (uint32_t)width + (uint32_t)x;
            footprints->share[used++] = (float)area;
            seen += area;
        }
    }
    for (size_t k = footprints->start[pixel]; k < used; k++) {
        footprints->share[k] = (float)(footprints->share[k] / seen);
    }
    footprints->inside[pixel] = (float)fmin(whole > 0 ? seen / whole : 0, 1);
    footprints->start[pixel + 1] = used;
    return true;
}

int footprints_init(struct footprints *footprints, const struct camera_map *surface_to_camera,
                    int width, int height, int surface_width, int surface_height,
                    struct nacre_error *error)
{
    struct homography back;
    size_t pixels = (size_t)width * (size_t)height;
    size_t capacity = 2 * pixels + 16;
    if (!homography_invert(&surface_to_camera->plane, &back)) {
        return nacre_fail(error, "the map from surface to camera is singular");
    }
    *footprints = (struct footprints){.pixels = pixels,
                                      .start = calloc(pixels + 1, sizeof *footprints->start),
                                      .points = malloc(capacity * sizeof *footprints->points),
                                      .share = malloc(capacity * sizeof *footprints->share),
                                      .inside = calloc(pixels, sizeof *footprints->inside)};
    bool enough =
        footprints->start && footprints->points && footprints->share && footprints->inside;
    for (size_t i = 0; enough && i < pixels; i++) {
        struct polygon view = view_of(&back, &surface_to_camera->lens, (int)(i % (size_t)width),
                                      (int)(i / (size_t)width));
        enough = add_row(footprints, &capacity, i, &view, surface_width, surface_height);
    }
    if (!enough) {
        footprints_finish(footprints);
        return nacre_fail_memory(error, "the camera's footprints");
    }
    return NACRE_OK;
}

void footprints_finish(struct footprints *footprints)
{
    if (footprints) {
        free(footprints->start);
        free(footprints->points);
        free(footprints->share);
        free(footprints->inside);
        *footprints = (struct footprints){0};
    }
}
