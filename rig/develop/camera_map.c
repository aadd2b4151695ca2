/* The map from surface points to camera pixels: a homography, and the lens's radial distortion where it has one. */
#include "rig/develop/camera_map.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

enum { PLANE = 8, ALL = 12, ROUNDS = 60, UNDISTORT_ROUNDS = 40 };

const char *const lens_model_names[] = {"ideal", "radial", "shifted", NULL};

static struct point distort(const struct lens *lens, struct point ideal)
{
    if (!(lens->unit > 0)) {
        return ideal;
    }
    double x = (ideal.x - lens->centre.x) / lens->unit;
    double y = (ideal.y - lens->centre.y) / lens->unit;
    double s = x * x + y * y;
    double stretch = lens->unit * (1 + s * (lens->k1 + s * lens->k2));
    return (struct point){lens->centre.x + stretch * x, lens->centre.y + stretch * y};
}

struct point lens_undistort(const struct lens *lens, struct point seen)
{
    if (!(lens->unit > 0)) {
        return seen;
    }
    double x = (seen.x - lens->centre.x) / lens->unit;
    double y = (seen.y - lens->centre.y) / lens->unit;
    double r = hypot(x, y);
    double ideal = r;
    for (int round = 0; round < UNDISTORT_ROUNDS; round++) {
        double s = ideal * ideal;
        double slope = 1 + s * (3 * lens->k1 + 5 * s * lens->k2);
        double step = (ideal * (1 + s * (lens->k1 + s * lens->k2)) - r) / slope;
        ideal -= step;
        if (fabs(step) < 1e-12) {
            break;
        }
    }
    double shrink = r > 0 ? ideal / r : 1;
    return (struct point){lens->centre.x + shrink * x * lens->unit,
                          lens->centre.y + shrink * y * lens->unit};
}

struct point camera_map_apply(const struct camera_map *map, struct point surface)
{
    return distort(&map->lens, homography_apply(&map->plane, surface));
}

double camera_map_distance(const struct camera_map *map, const struct point_pair *pair)
{
    struct point seen = camera_map_apply(map, pair->surface);
    return hypot(seen.x - pair->camera.x, seen.y - pair->camera.y);
}

double camera_map_rms(const struct camera_map *map, const struct point_pair *pairs, size_t count)
{
    double sum = 0;
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        if (!pairs[i].outlier) {
            double distance = camera_map_distance(map, &pairs[i]);
            sum += distance * distance;
            used++;
        }
    }
    return used ? sqrt(sum / (double)used) : NAN;
}

/* Surface coordinates moved and scaled to about -1 to 1, camera ones relative to the frame's middle in its unit: all
 * parameters are then of like size. */
struct frame {
    struct point middle; /* of the surface's points */
    double scale;
    struct point centre; /* of the camera's frame */
    double unit;
};

/* The parameters: eight of the homography between such coordinates (the ninth is 1), k1, k2, and the lens's centre. */
struct parameters {
    double p[ALL];
};

static struct frame frame_of(const struct point_pair *pairs, size_t count, const struct lens *lens)
{
    double left = INFINITY;
    double top = INFINITY;
    double right = -INFINITY;
    double bottom = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        left = fmin(left, pairs[i].surface.x);
        right = fmax(right, pairs[i].surface.x);
        top = fmin(top, pairs[i].surface.y);
        bottom = fmax(bottom, pairs[i].surface.y);
    }
    return (struct frame){{(left + right) / 2, (top + bottom) / 2},
                          2 / fmax(fmax(right - left, bottom - top), 1e-9),
                          lens->centre,
                          lens->unit};
}

static void multiply(const double a[9], const double b[9], double product[9])
{
    for (int i = 0; i < 9; i++) {
        product[i] = a[i / 3 * 3] * b[i % 3] + a[i / 3 * 3 + 1] * b[3 + i % 3] +
                     a[i / 3 * 3 + 2] * b[6 + i % 3];
    }
}

/* Between pixels and points, and the frame's coordinates. */
static void enter(const struct frame *frame, const struct camera_map *map,
                  struct parameters *parameters)
{
    const double in[9] = {
        1 / frame->scale, 0, frame->middle.x, 0, 1 / frame->scale, frame->middle.y, 0, 0, 1};
    const double out[9] = {1 / frame->unit,
                           0,
                           -frame->centre.x / frame->unit,
                           0,
                           1 / frame->unit,
                           -frame->centre.y / frame->unit,
                           0,
                           0,
                           1};
    double half[9];
    double whole[9];
    multiply(map->plane.m, in, half);
    multiply(out, half, whole);
    for (int i = 0; i < PLANE; i++) {
        parameters->p[i] = whole[i] / whole[8];
    }
    parameters->p[8] = map->lens.k1;
    parameters->p[9] = map->lens.k2;
    parameters->p[10] = parameters->p[11] = 0;
}

static void leave(const struct frame *frame, const struct parameters *parameters,
                  struct camera_map *map)
{
    const double in[9] = {frame->scale,
                          0,
                          -frame->scale * frame->middle.x,
                          0,
                          frame->scale,
                          -frame->scale * frame->middle.y,
                          0,
                          0,
                          1};
    const double out[9] = {frame->unit, 0, frame->centre.x, 0, frame->unit, frame->centre.y, 0,
                           0,           1};
    double half[9];
    double inner[9];
    memcpy(inner, parameters->p, PLANE * sizeof *inner);
    inner[8] = 1;
    multiply(inner, in, half);
    multiply(out, half, map->plane.m);
    map->lens.k1 = parameters->p[8];
    map->lens.k2 = parameters->p[9];
    map->lens.centre = (struct point){frame->centre.x + frame->unit * parameters->p[10],
                                      frame->centre.y + frame->unit * parameters->p[11]};
}

/* Where a surface point is seen, and by how much each parameter moves that: slopes[axis][parameter]. */
static struct point project(const struct parameters *parameters, struct point s,
                            double slopes[2][ALL])
{
    const double *p = parameters->p;
    double w = p[6] * s.x + p[7] * s.y + 1;
    struct point q = {(p[0] * s.x + p[1] * s.y + p[2]) / w, (p[3] * s.x + p[4] * s.y + p[5]) / w};
    const double plane[2][PLANE] = {
        {s.x / w, s.y / w, 1 / w, 0, 0, 0, -q.x * s.x / w, -q.x * s.y / w},
        {0, 0, 0, s.x / w, s.y / w, 1 / w, -q.y * s.x / w, -q.y * s.y / w}};
    struct point e = {q.x - p[10], q.y - p[11]};
    double r = e.x * e.x + e.y * e.y;
    double stretch = 1 + r * (p[8] + r * p[9]);
    double growth = 2 * p[8] + 4 * r * p[9];
    const double lens[2][2] = {{stretch + growth * e.x * e.x, growth * e.x * e.y},
                               {growth * e.x * e.y, stretch + growth * e.y * e.y}};
    for (int axis = 0; axis < 2; axis++) {
        double along = axis == 0 ? e.x : e.y;
        for (int i = 0; i < PLANE; i++) {
            slopes[axis][i] = lens[axis][0] * plane[0][i] + lens[axis][1] * plane[1][i];
        }
        slopes[axis][8] = along * r;
        slopes[axis][9] = along * r * r;
        slopes[axis][10] = (axis == 0 ? 1 : 0) - lens[axis][0];
        slopes[axis][11] = (axis == 1 ? 1 : 0) - lens[axis][1];
    }
    return (struct point){p[10] + stretch * e.x, p[11] + stretch * e.y};
}

static double accumulate(const struct point_pair *pairs, size_t count, const struct frame *frame,
                         const struct parameters *parameters, double normal[ALL * ALL],
                         double gradient[ALL])
{
    double sum = 0;
    memset(normal, 0, sizeof(double) * ALL * ALL);
    memset(gradient, 0, sizeof(double) * ALL);
    for (size_t i = 0; i < count; i++) {
        if (pairs[i].outlier) {
            continue;
        }
        double slopes[2][ALL];
        struct point s = {(pairs[i].surface.x - frame->middle.x) * frame->scale,
                          (pairs[i].surface.y - frame->middle.y) * frame->scale};
        struct point seen = project(parameters, s, slopes);
        const double residuals[2] = {(pairs[i].camera.x - frame->centre.x) / frame->unit - seen.x,
                                     (pairs[i].camera.y - frame->centre.y) / frame->unit - seen.y};
        for (int axis = 0; axis < 2; axis++) {
            sum += residuals[axis] * residuals[axis];
            for (int a = 0; a < ALL; a++) {
                gradient[a] += slopes[axis][a] * residuals[axis];
                for (int b = 0; b < ALL; b++) {
                    normal[ALL * a + b] += slopes[axis][a] * slopes[axis][b];
                }
            }
        }
    }
    return sum;
}

/* The step of the parameters that the model frees; false where the damped system has none. */
static bool solve(const double normal[ALL * ALL], const double gradient[ALL], int free_count,
                  double damping, double step[ALL])
{
    double system[ALL * ALL];
    memset(step, 0, sizeof(double) * ALL);
    for (int a = 0; a < free_count; a++) {
        for (int b = 0; b < free_count; b++) {
            system[free_count * a + b] = normal[ALL * a + b];
        }
        /* An ideal lens has no centre to be moved: its columns are 0. */
        system[(free_count + 1) * a] += damping * (normal[(ALL + 1) * a] + 1e-9 * normal[0]);
        step[a] = gradient[a];
    }
    return LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', free_count, 1, system, free_count, step, 1) == 0;
}

int camera_map_refine(const struct point_pair *pairs, size_t count, enum lens_model model,
                      struct camera_map *map, struct nacre_error *error)
{
    static const int free_counts[] = {PLANE, PLANE + 1, ALL};
    struct frame frame = frame_of(pairs, count, &map->lens);
    struct parameters best;
    double normal[ALL * ALL];
    double gradient[ALL];
    double damping = 1e-3;
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        used += pairs[i].outlier ? 0 : 1;
    }
    if (2 * used < ALL || !(map->lens.unit > 0)) {
        return nacre_fail(error, "the camera's map needs 6 pairs of points, there are %zu", used);
    }
    enter(&frame, map, &best);
    double cost = accumulate(pairs, count, &frame, &best, normal, gradient);
    for (int round = 0; round < ROUNDS && damping < 1e12; round++) {
        double step[ALL];
        double next_normal[ALL * ALL];
        double next_gradient[ALL];
        struct parameters next = best;
        if (!solve(normal, gradient, free_counts[model], damping, step)) {
            damping *= 10;
            continue;
        }
        for (int a = 0; a < ALL; a++) {
            next.p[a] += step[a];
        }
        double after = accumulate(pairs, count, &frame, &next, next_normal, next_gradient);
        if (!(after < cost)) {
            damping *= 10;
            continue;
        }
        bool settled = cost - after <= 1e-12 * cost;
        best = next;
        cost = after;
        memcpy(normal, next_normal, sizeof normal);
        memcpy(gradient, next_gradient, sizeof gradient);
        damping *= 0.1;
        if (settled) {
            break;
        }
    }
    leave(&frame, &best, map);
    return NACRE_OK;
}
