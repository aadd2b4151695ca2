/* Splitting plain meshes so that the camera sees no long edge, nor a shadow's end between two vertices. */
#include "render/plain.h"

#include "render/view.h"

#include <stdlib.h>

/* Edges in the picture are no longer, nor those on which light changes; for other reasons they need not be shorter. */
static const double edge_pixels = 8, change_pixels = 0.75, least_pixels = 4;

/* Light changes by more than this share of what falls on the lighter end, and this of the most that falls anywhere:
 * less is drawn well by a straight line, as is a penumbra that fades to nothing. With a tenth, wide penumbras are
 * split, too: three times the triangles for the same picture. */
static const double change_share = 0.3, change_floor = 0.04;

/* Of a turntable's pictures, which are to be drawn quickly. */
static const double turning_pixels = 12;

/* Where surfaces are seen at a flat angle, edges that look shorter may be longer by up to this. */
static const double longest_slant = 3;

/* From the longest edge in a picture to the shortest it takes seven; it would take more right before the camera. */
enum { ROUNDS_MOST = 10 };

/* Of the largest extent, and for what is out of the picture, too: it lights other surfaces. */
static const double even_share = 1.0 / 48;

/* What counts as in the picture, of its half extents. */
static const double margin = 1.05;

struct looking {
    struct view view; /* widened by the margin */
    double pixel;     /* its width at unit distance */
    double edge_pixels;
    double even_mm;
    bool around;  /* the camera goes round the vertical through `at` */
    bool evenly;  /* no edge may be longer than even_mm */
    bool upright; /* and sees verticals upright */
    struct vec3 at;
};

/* Light at vertices, while edges on which it changes are split. */
struct following {
    struct looking looking;
    float (*light)[3];
    bool *changes; /* on an edge of the vertex */
    double most;   /* of any vertex and colour */
};

/* What lies ahead of a camera that goes round, hangs on x alone, the cosine of the angle about the vertical between the
 * camera and a point: distance^2 = square - 2 swing x, depth = base - slope x, height = lift - tilt x. */
struct round {
    double square, swing, base, slope, lift, tilt;
};

static struct round round_of(const struct looking *looking, struct vec3 point)
{
    struct vec3 arm = vec3_subtract(looking->view.position, looking->at);
    struct vec3 p = vec3_subtract(point, looking->at);
    double away = hypot(arm.x, arm.y), r = hypot(p.x, p.y), rise = p.z - arm.z;
    double c = away / vec3_length(arm), s = arm.z / vec3_length(arm);
    return (struct round){.square = r * r + away * away + rise * rise,
                          .swing = r * away,
                          .base = c * away - s * rise,
                          .slope = c * r,
                          .lift = s * away + c * rise,
                          .tilt = s * r};
}

/* Of the angle, at most a right one, that a sphere and the cone round the picture take from the axis. */
static double cos_together(const struct view *view, double distance, double radius)
{
    double tangent = hypot(view->tan_x, view->tan_y), sine = fmin(radius / distance, 1);
    double cosine = (sqrt(1 - sine * sine) - sine * tangent) / hypot(1, tangent);
    return fmax(cosine, 0);
}

/* The largest x, at most 1, at which depth >= k distance; below it that holds as well. Less than -1: nowhere. */
static double end_of_cone(const struct round *round, double k)
{
    double a = round->slope * round->slope;
    double b = k * k * round->swing - round->base * round->slope;
    double c = round->base * round->base - k * k * round->square;
    if (round->base - round->slope >= k * sqrt(fmax(round->square - 2 * round->swing, 0))) {
        return 1;
    }
    return a > 0 ? (-b - sqrt(fmax(b * b - a * c, 0))) / a : -2;
}

/* Leave the part of low to high where gain x <= most. */
static void narrow(double gain, double most, double *low, double *high)
{
    if (gain > 0) {
        *high = fmin(*high, most / gain);
    } else if (gain < 0) {
        *low = fmax(*low, most / gain);
    } else if (most < 0) {
        *high = -2;
    }
}

/* How near a camera on its round comes to a sphere while it sees it; HUGE_VAL: it never does. */
static double distance_around(const struct looking *looking, struct vec3 point, double radius)
{
    const struct view *view = &looking->view;
    const struct round round = round_of(looking, point);
    double nearest = sqrt(fmax(round.square - 2 * round.swing, 0)), low = -1;
    if (nearest <= radius) {
        return nearest;
    }
    double x = end_of_cone(&round, cos_together(view, nearest, radius));
    if (looking->upright) {
        double reach = view->tan_y * round.base + radius * hypot(1, view->tan_y);
        narrow(view->tan_y * round.slope - round.tilt, reach - round.lift, &low, &x);
        narrow(view->tan_y * round.slope + round.tilt, reach + round.lift, &low, &x);
    }
    return x < low ? HUGE_VAL : sqrt(round.square - 2 * round.swing * x);
}

/* What is seen from nowhere is *hidden, and the distance is any. */
static double find_distance(const struct looking *looking, struct vec3 point, double radius,
                            bool *hidden)
{
    double distance = looking->around ? distance_around(looking, point, radius) : HUGE_VAL;
    *hidden = looking->around ? distance == HUGE_VAL : !view_meets(&looking->view, point, radius);
    return distance < HUGE_VAL ? distance
                               : vec3_length(vec3_subtract(point, looking->view.position));
}

/* How much longer an edge is than it looks; of one that is seen from all around, nothing is known. */
static double slant(const struct looking *looking, struct vec3 a, struct vec3 b)
{
    struct vec3 edge = vec3_unit(vec3_subtract(b, a));
    struct vec3 way =
        vec3_unit(vec3_subtract(vec3_scale(vec3_add(a, b), 0.5), looking->view.position));
    double across = vec3_length(vec3_cross(edge, way));
    return looking->around ? 1 : 1 / fmax(across, 1 / longest_slant);
}

/* What a pixel covers where an edge comes nearest to the camera. */
static double pixel_at(const struct looking *looking, struct vec3 a, struct vec3 b, bool *hidden)
{
    double length = vec3_length(vec3_subtract(b, a));
    double distance = find_distance(looking, vec3_scale(vec3_add(a, b), 0.5), length / 2, hidden);
    return fmax(distance - length / 2, distance / 4) * looking->pixel;
}

/* A triangle lies within the spheres over its edges, so what is seen of it has an edge that counts as seen. Parts of an
 * edge that counts may not: were they allowed less, splitting would go on without end. */
static double allowed_in_view(const void *context, const struct mesh *mesh, uint32_t first,
                              uint32_t second)
{
    const struct looking *looking = context;
    struct vec3 a = vec3_from(mesh->positions[first]), b = vec3_from(mesh->positions[second]);
    double even = looking->even_mm;
    bool hidden;
    double pixel_mm = pixel_at(looking, a, b, &hidden), most = looking->edge_pixels * pixel_mm;
    if (hidden) {
        return looking->evenly ? even : fmax(even, longest_slant * most);
    }
    double allowed = fmin(fmax(even, least_pixels * pixel_mm), most) * slant(looking, a, b);
    return looking->evenly ? fmin(allowed, even) : allowed;
}

static bool differ(const struct following *following, uint32_t first, uint32_t second)
{
    const float *one = following->light[first], *other = following->light[second];
    bool found = false;
    for (int c = 0; c < 3; c++) {
        double lighter = fmax((double)one[c], (double)other[c]);
        found = found || fabs((double)one[c] - (double)other[c]) >
                             change_share * lighter + change_floor * following->most;
    }
    return found;
}

/* Of a triangle with light that changes all edges are split: a shadow may cross that between its two dark corners, too. */
static double allowed_by_light(const void *context, const struct mesh *mesh, uint32_t first,
                               uint32_t second)
{
    const struct following *following = context;
    if (!following->changes[first] || !following->changes[second]) {
        return HUGE_VAL;
    }
    struct vec3 a = vec3_from(mesh->positions[first]), b = vec3_from(mesh->positions[second]);
    bool hidden;
    double pixel_mm = pixel_at(&following->looking, a, b, &hidden);
    return hidden ? HUGE_VAL : change_pixels * pixel_mm * slant(&following->looking, a, b);
}

static struct looking looking_at(const struct mesh *mesh, const struct plain_split *split)
{
    const struct scene *scene = split->scene;
    struct vec3 low, high;
    struct looking looking = {.view = view_make(scene, 0),
                              .around = split->around,
                              .evenly = split->evenly,
                              .at = vec3_from_doubles(scene->camera.at_mm)};
    mesh_bounds(mesh, &low, &high);
    looking.even_mm = even_share * vec3_length(vec3_subtract(high, low));
    looking.upright = fabs(looking.view.right.z) < 1e-6;
    looking.edge_pixels = split->around ? turning_pixels : edge_pixels;
    looking.pixel = 2 * looking.view.tan_x / scene->image.width;
    looking.view.tan_x *= margin;
    looking.view.tan_y *= margin;
    return looking;
}

int plain_split_seen(struct mesh *mesh, const struct plain_split *split, bool *limited,
                     struct nacre_error *error)
{
    struct looking looking = looking_at(mesh, split);
    return mesh_subdivide(mesh, allowed_in_view, &looking, split->limit, limited, error);
}

/* Light vertices from `first` on, and find where it changes. */
static int follow(struct following *following, const struct mesh *mesh, size_t first,
                  const struct lighting *lighting, enum plain_light which,
                  struct progress *progress, struct light_work *work, struct nacre_error *error)
{
    float(*light)[3] = realloc(following->light, (mesh->vertex_count + 1) * sizeof *light);
    following->light = light ? light : following->light;
    free(following->changes);
    following->changes = calloc(mesh->vertex_count + 1, sizeof *following->changes);
    if (!light || !following->changes) {
        return nacre_fail_memory(error, "the light on the mesh");
    }
    if (plain_light(mesh, first, lighting, which, progress, light, work, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (size_t i = 3 * first; i < 3 * mesh->vertex_count; i++) {
        following->most = fmax(following->most, (double)light[i / 3][i % 3]);
    }
    for (size_t i = 0; i < 3 * mesh->triangle_count; i++) {
        uint32_t a = mesh->triangles[i / 3][i % 3], b = mesh->triangles[i / 3][(i + 1) % 3];
        if (differ(following, a, b)) {
            following->changes[a] = following->changes[b] = true;
        }
    }
    return NACRE_OK;
}

static bool has_soft(const struct lighting *lighting)
{
    bool soft = false;
    for (size_t l = 0; l < lighting->light_count; l++) {
        soft = soft || lighting->lights[l].soft;
    }
    return soft;
}

int plain_split_lit(struct mesh *mesh, const struct plain_split *split,
                    const struct lighting *lighting, struct progress *progress, bool *limited,
                    struct light_work *work, struct nacre_error *error)
{
    struct following following = {.looking = looking_at(mesh, split)};
    const enum plain_light which = has_soft(lighting) ? PLAIN_ROUGH : PLAIN_HARD;
    size_t first = 0;
    bool done = false;
    int status = NACRE_OK;
    for (int round = 0; status == NACRE_OK && !done && round < ROUNDS_MOST; round++) {
        status = follow(&following, mesh, first, lighting, which, progress, work, error);
        first = mesh->vertex_count;
        if (status == NACRE_OK) {
            status = mesh_subdivide_once(mesh, allowed_by_light, &following, split->limit, limited,
                                         &done, error);
        }
    }
    free(following.light);
    free(following.changes);
    return status;
}
