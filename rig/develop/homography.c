/* The plane-to-plane map between surface points and camera pixels, and finding it from pairs of points. */
#include "rig/develop/homography.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PARAMETERS = 8, ROUNDS = 50 };

struct point homography_apply(const struct homography *homography, struct point point)
{
    const double *m = homography->m;
    double w = m[6] * point.x + m[7] * point.y + m[8];
    return (struct point){(m[0] * point.x + m[1] * point.y + m[2]) / w,
                          (m[3] * point.x + m[4] * point.y + m[5]) / w};
}

static void multiply(const double a[9], const double b[9], double product[9])
{
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            product[3 * i + j] =
                a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
        }
    }
}

bool homography_invert(const struct homography *homography, struct homography *inverse)
{
    const double *m = homography->m;
    double adjugate[9] = {
        m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
        m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
        m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
    double determinant = m[0] * adjugate[0] + m[1] * adjugate[3] + m[2] * adjugate[6];
    if (!isnormal(determinant)) {
        return false;
    }
    for (int i = 0; i < 9; i++) {
        inverse->m[i] = adjugate[i] / determinant;
    }
    return true;
}

double homography_distance(const struct homography *homography, const struct point_pair *pair)
{
    struct point seen = homography_apply(homography, pair->surface);
    return hypot(seen.x - pair->camera.x, seen.y - pair->camera.y);
}

double homography_rms(const struct homography *homography, const struct point_pair *pairs,
                      size_t count)
{
    double sum = 0;
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        if (!pairs[i].outlier) {
            double distance = homography_distance(homography, &pairs[i]);
            sum += distance * distance;
            used++;
        }
    }
    return used ? sqrt(sum / (double)used) : NAN;
}

/* Moves the mean to the origin and scales the mean distance from it to sqrt 2 (Hartley): without it the columns of
 * the linear system differ by the fourth power of the frame's size. */
struct normalisation {
    double x, y, scale;
};

static struct normalisation normalise(const struct point_pair *pairs, size_t count, bool camera)
{
    struct normalisation to = {0, 0, 0};
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        if (!pairs[i].outlier) {
            to.x += camera ? pairs[i].camera.x : pairs[i].surface.x;
            to.y += camera ? pairs[i].camera.y : pairs[i].surface.y;
            used++;
        }
    }
    to.x /= (double)used;
    to.y /= (double)used;
    for (size_t i = 0; i < count; i++) {
        if (!pairs[i].outlier) {
            struct point p = camera ? pairs[i].camera : pairs[i].surface;
            to.scale += hypot(p.x - to.x, p.y - to.y);
        }
    }
    to.scale = to.scale > 0 ? sqrt(2) * (double)used / to.scale : 1;
    return to;
}

static struct point normalised(struct normalisation to, struct point point)
{
    return (struct point){(point.x - to.x) * to.scale, (point.y - to.y) * to.scale};
}

/* The map between normalised coordinates as one between the coordinates themselves, and back. */
static void leave_normalised(struct normalisation surface, struct normalisation camera,
                             struct homography *homography)
{
    double in[9] = {surface.scale,
                    0,
                    -surface.scale * surface.x,
                    0,
                    surface.scale,
                    -surface.scale * surface.y,
                    0,
                    0,
                    1};
    double out[9] = {1 / camera.scale, 0, camera.x, 0, 1 / camera.scale, camera.y, 0, 0, 1};
    double half[9];
    multiply(homography->m, in, half);
    multiply(out, half, homography->m);
}

static void enter_normalised(struct normalisation surface, struct normalisation camera,
                             struct homography *homography)
{
    double in[9] = {camera.scale,
                    0,
                    -camera.scale * camera.x,
                    0,
                    camera.scale,
                    -camera.scale * camera.y,
                    0,
                    0,
                    1};
    double out[9] = {1 / surface.scale, 0, surface.x, 0, 1 / surface.scale, surface.y, 0, 0, 1};
    double half[9];
    multiply(homography->m, out, half);
    multiply(in, half, homography->m);
}

static size_t count_used(const struct point_pair *pairs, size_t count)
{
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        used += pairs[i].outlier ? 0 : 1;
    }
    return used;
}

int homography_fit(const struct point_pair *pairs, size_t count, struct homography *homography,
                   struct nacre_error *error)
{
    int status = NACRE_OK;
    size_t used = count_used(pairs, count);
    double *system = NULL;
    double singular[9];
    double right[81];
    double rest[9];
    if (used < 4) {
        return nacre_fail(error, "a homography needs 4 pairs of points, there are %zu", used);
    }
    struct normalisation surface = normalise(pairs, count, false);
    struct normalisation camera = normalise(pairs, count, true);
    /* A row of zeros is added where 4 pairs give but 8: the SVD then still returns all 9 right vectors. */
    size_t rows = used == 4 ? 9 : 2 * used;
    system = calloc(rows * 9, sizeof *system);
    if (!system) {
        status = nacre_fail_memory(error, "the homography's equations");
        goto out;
    }
    double *row = system;
    for (size_t i = 0; i < count; i++) {
        if (!pairs[i].outlier) {
            struct point s = normalised(surface, pairs[i].surface);
            struct point c = normalised(camera, pairs[i].camera);
            double equations[18] = {-s.x, -s.y, -1, 0,    0,    0,  c.x * s.x, c.x * s.y, c.x,
                                    0,    0,    0,  -s.x, -s.y, -1, c.y * s.x, c.y * s.y, c.y};
            memcpy(row, equations, sizeof equations);
            row += 18;
        }
    }
    if (LAPACKE_dgesvd(LAPACK_ROW_MAJOR, 'N', 'S', (lapack_int)rows, 9, system, 9, singular, NULL,
                       1, right, 9, rest) != 0) {
        status =
            nacre_fail(error, "the homography's equations have no singular value decomposition");
        goto out;
    }
    /* One null vector is the map; a second one means that the points lie on a line. */
    if (!(singular[7] > 1e-9 * singular[0])) {
        status = nacre_fail(error, "the points of the homography lie on a line");
        goto out;
    }
    memcpy(homography->m, right + 72, sizeof homography->m);
    leave_normalised(surface, camera, homography);
out:
    free(system);
    return status;
}

/* One round's linear system in the 8 parameters (the ninth is 1): returns the sum of squared distances. */
static double accumulate(const struct homography *h, const struct point_pair *pairs, size_t count,
                         struct normalisation surface, struct normalisation camera,
                         double normal[PARAMETERS * PARAMETERS], double gradient[PARAMETERS])
{
    double sum = 0;
    memset(normal, 0, sizeof(double) * PARAMETERS * PARAMETERS);
    memset(gradient, 0, sizeof(double) * PARAMETERS);
    for (size_t i = 0; i < count; i++) {
        if (pairs[i].outlier) {
            continue;
        }
        struct point s = normalised(surface, pairs[i].surface);
        struct point c = normalised(camera, pairs[i].camera);
        struct point p = homography_apply(h, s);
        double w = h->m[6] * s.x + h->m[7] * s.y + h->m[8];
        double slopes[2][PARAMETERS] = {
            {s.x / w, s.y / w, 1 / w, 0, 0, 0, -p.x * s.x / w, -p.x * s.y / w},
            {0, 0, 0, s.x / w, s.y / w, 1 / w, -p.y * s.x / w, -p.y * s.y / w}};
        double residuals[2] = {c.x - p.x, c.y - p.y};
        for (int axis = 0; axis < 2; axis++) {
            sum += residuals[axis] * residuals[axis];
            for (int a = 0; a < PARAMETERS; a++) {
                gradient[a] += slopes[axis][a] * residuals[axis];
                for (int b = 0; b < PARAMETERS; b++) {
                    normal[PARAMETERS * a + b] += slopes[axis][a] * slopes[axis][b];
                }
            }
        }
    }
    return sum;
}

int homography_refine(const struct point_pair *pairs, size_t count, struct homography *homography,
                      struct nacre_error *error)
{
    if (count_used(pairs, count) < 4) {
        return nacre_fail(error, "a homography needs 4 pairs of points, there are %zu",
                          count_used(pairs, count));
    }
    struct normalisation surface = normalise(pairs, count, false);
    struct normalisation camera = normalise(pairs, count, true);
    struct homography best = *homography;
    enter_normalised(surface, camera, &best);
    double last = best.m[8];
    if (!isnormal(last)) {
        return nacre_fail(
            error, "the homography to be refined sends the middle of the points to infinity");
    }
    for (int i = 0; i < 9; i++) {
        best.m[i] /= last;
    }
    double normal[PARAMETERS * PARAMETERS];
    double gradient[PARAMETERS];
    double ignored_normal[PARAMETERS * PARAMETERS];
    double ignored_gradient[PARAMETERS];
    double damping = 1e-3;
    double cost = accumulate(&best, pairs, count, surface, camera, normal, gradient);
    for (int round = 0; round < ROUNDS && damping < 1e12; round++) {
        double system[PARAMETERS * PARAMETERS];
        double step[PARAMETERS];
        struct homography next = best;
        memcpy(system, normal, sizeof system);
        memcpy(step, gradient, sizeof step);
        for (int a = 0; a < PARAMETERS; a++) {
            system[(PARAMETERS + 1) * a] *= 1 + damping;
        }
        if (LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', PARAMETERS, 1, system, PARAMETERS, step, 1) != 0) {
            damping *= 10;
            continue;
        }
        for (int a = 0; a < PARAMETERS; a++) {
            next.m[a] += step[a];
        }
        double after =
            accumulate(&next, pairs, count, surface, camera, ignored_normal, ignored_gradient);
        if (!(after < cost)) {
            damping *= 10;
            continue;
        }
        bool settled = cost - after <= 1e-14 * cost;
        best = next;
        cost = accumulate(&best, pairs, count, surface, camera, normal, gradient);
        damping *= 0.1;
        if (settled) {
            break;
        }
    }
    leave_normalised(surface, camera, &best);
    *homography = best;
    return NACRE_OK;
}
