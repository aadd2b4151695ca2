/* Planar, box, cylinder, sphere and texture-coordinate mapping in real units. */
#include "render/mapping.h"

#include <stdlib.h>

int mapping_make(struct mapping *mapping, const struct scene_material *settings, int width,
                 int height, double pitch_mm, const struct mesh *mesh, const struct motion *motion,
                 struct nacre_error *error)
{
    struct vec3 low, high;
    double sum = 0;
    *mapping = (struct mapping){
        .kind = settings->mapping,
        .axis = settings->axis,
        .point_mm = settings->point_mm > 0 ? settings->point_mm : pitch_mm,
        .offset = {settings->offset[0], settings->offset[1]},
        .mirror = settings->tiling == TILING_MIRROR,
        .width = width,
        .height = height,
        .motion = *motion,
    };
    if (!(mapping->point_mm > 0)) {
        return nacre_fail(error,
                          "the material has no pitch; give the object's material a point_mm");
    }
    if (mapping->kind == MAPPING_UV && !mesh->uv) {
        return nacre_fail(error,
                          "the mesh has no texture coordinates, which `mapping: uv` needs; use "
                          "planar, box, cylinder or sphere");
    }
    mesh_bounds(mesh, &low, &high);
    mapping->centre = vec3_scale(vec3_add(low, high), 0.5);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        struct vec3 p = vec3_subtract(vec3_from(mesh->positions[i]), mapping->centre);
        double c[3] = {p.x, p.y, p.z};
        if (mapping->kind == MAPPING_CYLINDER) {
            c[mapping->axis] = 0;
        }
        sum += sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
    }
    mapping->radius_mm = sum / (double)mesh->vertex_count;
    return NACRE_OK;
}

/* Gradients of u and v over a triangle, in its plane; false where the texture coordinates do not span one. */
static bool uv_gradients(const struct mesh *mesh, const uint32_t t[3], struct vec3 *gu,
                         struct vec3 *gv, double *area)
{
    struct vec3 a = vec3_from(mesh->positions[t[0]]);
    struct vec3 e1 = vec3_subtract(vec3_from(mesh->positions[t[1]]), a);
    struct vec3 e2 = vec3_subtract(vec3_from(mesh->positions[t[2]]), a);
    struct vec3 cross = vec3_cross(e1, e2);
    double square = vec3_dot(cross, cross);
    double u1 = (double)mesh->uv[t[1]][0] - mesh->uv[t[0]][0];
    double u2 = (double)mesh->uv[t[2]][0] - mesh->uv[t[0]][0];
    double v1 = (double)mesh->uv[t[1]][1] - mesh->uv[t[0]][1];
    double v2 = (double)mesh->uv[t[2]][1] - mesh->uv[t[0]][1];
    if (!(square > 0)) {
        return false;
    }
    /* The dual basis of e1, e2 in the plane. */
    struct vec3 d1 = vec3_scale(vec3_cross(e2, cross), 1 / square);
    struct vec3 d2 = vec3_scale(vec3_cross(cross, e1), 1 / square);
    *gu = vec3_along(vec3_scale(d1, u1), u2, d2);
    *gv = vec3_along(vec3_scale(d1, v1), v2, d2);
    *area = sqrt(square) / 2;
    return fabs(u1 * v2 - u2 * v1) > 1e-12 * square;
}

int mapping_follow(struct mapping *mapping, const struct mesh *mesh, struct nacre_error *error)
{
    if (mapping->kind != MAPPING_UV) {
        return NACRE_OK;
    }
    mapping->along_u = calloc(mesh->vertex_count, sizeof *mapping->along_u);
    mapping->along_v = calloc(mesh->vertex_count, sizeof *mapping->along_v);
    if (!mapping->along_u || !mapping->along_v) {
        return nacre_fail_memory(error, "the directions of a mesh's texture coordinates");
    }
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        struct vec3 gu, gv;
        double area;
        for (int k = 0; uv_gradients(mesh, t, &gu, &gv, &area) && k < 3; k++) {
            float *u = mapping->along_u[t[k]], *v = mapping->along_v[t[k]];
            vec3_store(vec3_along(vec3_from(u), area, gu), u);
            vec3_store(vec3_along(vec3_from(v), area, gv), v);
        }
    }
    return NACRE_OK;
}

void mapping_finish(struct mapping *mapping)
{
    free(mapping->along_u);
    free(mapping->along_v);
    *mapping = (struct mapping){0};
}

static struct vec3 unit_axis(int axis)
{
    return (struct vec3){axis == 0, axis == 1, axis == 2};
}

/* What looking along an axis shows as right and up: top view for z, front views for x and y. */
static void plane_axes(int axis, struct vec3 *right, struct vec3 *up)
{
    *right = unit_axis(axis == 0 ? 1 : 0);
    *up = unit_axis(axis == 2 ? 1 : 2);
}

/* A chart from millimetres to the right and up, given in the object's frame. */
static struct mapped chart_from(const struct mapping *mapping, double u, double v,
                                struct vec3 along_u, struct vec3 along_v)
{
    return (struct mapped){
        .x = u / mapping->point_mm + mapping->offset[0],
        .y = -v / mapping->point_mm + mapping->offset[1],
        .along_x = motion_turn(&mapping->motion, along_u),
        .along_y = vec3_scale(motion_turn(&mapping->motion, along_v), -1),
        .weight = 1,
    };
}

static struct mapped chart_planar(const struct mapping *mapping, struct vec3 p, int axis)
{
    struct vec3 right, up;
    plane_axes(axis, &right, &up);
    struct mapped chart = chart_from(mapping, vec3_dot(p, right), vec3_dot(p, up), right, up);
    chart.chart = axis;
    return chart;
}

static int charts_box(const struct mapping *mapping, struct vec3 p, struct vec3 normal,
                      struct mapped charts[MAPPING_CHARTS_MAXIMUM])
{
    /* Charts blend where the normal is within a few degrees of lying between two axes. */
    const double margin = 0.12;
    double size[3] = {fabs(normal.x), fabs(normal.y), fabs(normal.z)}, sum = 0;
    double most = fmax(size[0], fmax(size[1], size[2]));
    int count = 0;
    for (int axis = 0; axis < 3; axis++) {
        double weight = (size[axis] - most + margin) / margin;
        if (weight > 0) {
            struct mapped chart = chart_planar(mapping, p, axis);
            chart.weight = weight * weight * (3 - 2 * weight);
            sum += chart.weight;
            charts[count++] = chart;
            if (chart.weight > charts[0].weight) {
                charts[count - 1] = charts[0];
                charts[0] = chart;
            }
        }
    }
    for (int i = 0; i < count; i++) {
        charts[i].weight /= sum;
    }
    return count;
}

static struct mapped chart_round(const struct mapping *mapping, struct vec3 p)
{
    struct vec3 right, up = unit_axis(mapping->kind == MAPPING_CYLINDER ? mapping->axis : 2);
    struct vec3 d = vec3_subtract(p, mapping->centre);
    int first = mapping->kind == MAPPING_CYLINDER ? (mapping->axis + 1) % 3 : 0;
    right = unit_axis(first);
    struct vec3 back = vec3_cross(up, right);
    double height = vec3_dot(d, up), a = vec3_dot(d, right), b = vec3_dot(d, back);
    double rho = fmax(hypot(a, b), 1e-6 * mapping->radius_mm);
    struct vec3 round = vec3_scale(vec3_along(vec3_scale(right, -b), a, back), 1 / rho);
    double longitude = atan2(b, a), r = mapping->radius_mm;
    if (mapping->kind == MAPPING_CYLINDER) {
        return chart_from(mapping, r * longitude, height, vec3_scale(round, r / rho), up);
    }
    struct vec3 out = vec3_scale(vec3_along(vec3_scale(right, a), b, back), 1 / rho);
    double distance = fmax(hypot(rho, height), 1e-6 * r), latitude = atan2(height, rho);
    struct vec3 north = vec3_along(vec3_scale(up, cos(latitude)), -sin(latitude), out);
    return chart_from(mapping, r * longitude, r * latitude, vec3_scale(round, r / rho),
                      vec3_scale(north, r / distance));
}

int mapping_charts(const struct mapping *mapping, struct vec3 position, struct vec3 normal,
                   const double uv[2], struct vec3 along_u, struct vec3 along_v,
                   struct mapped charts[MAPPING_CHARTS_MAXIMUM])
{
    struct vec3 p = motion_move_back(&mapping->motion, position);
    switch (mapping->kind) {
    case MAPPING_UV:
        charts[0] = chart_from(mapping, uv[0], uv[1], motion_turn_back(&mapping->motion, along_u),
                               motion_turn_back(&mapping->motion, along_v));
        return 1;
    case MAPPING_PLANAR:
        charts[0] = chart_planar(mapping, p, mapping->axis);
        return 1;
    case MAPPING_BOX:
        return charts_box(mapping, p, motion_turn_back(&mapping->motion, normal), charts);
    default:
        charts[0] = chart_round(mapping, p);
        return 1;
    }
}

int mapping_vertex(const struct mapping *mapping, const struct mesh *mesh, size_t vertex,
                   struct mapped charts[MAPPING_CHARTS_MAXIMUM])
{
    double uv[2] = {0};
    struct vec3 along_u = {0}, along_v = {0};
    if (mapping->kind == MAPPING_UV) {
        uv[0] = mesh->uv[vertex][0];
        uv[1] = mesh->uv[vertex][1];
        along_u = vec3_from(mapping->along_u[vertex]);
        along_v = vec3_from(mapping->along_v[vertex]);
    }
    return mapping_charts(mapping, vec3_from(mesh->positions[vertex]),
                          vec3_from(mesh->normals[vertex]), uv, along_u, along_v, charts);
}

/* Corner values of a triangle at barycentric coordinates. */
static struct vec3 inside(const float (*values)[3], const uint32_t t[3], double b1, double b2)
{
    struct vec3 v = vec3_scale(vec3_from(values[t[0]]), 1 - b1 - b2);
    return vec3_along(vec3_along(v, b1, vec3_from(values[t[1]])), b2, vec3_from(values[t[2]]));
}

struct mapped mapping_inside(const struct mapping *mapping, const struct mesh *mesh,
                             size_t triangle, double b1, double b2)
{
    const uint32_t *t = mesh->triangles[triangle];
    struct mapped charts[MAPPING_CHARTS_MAXIMUM];
    double uv[2] = {0};
    for (int k = 0; mapping->kind == MAPPING_UV && k < 2; k++) {
        uv[k] = mesh->uv[t[0]][k] * (1 - b1 - b2) + mesh->uv[t[1]][k] * b1 + mesh->uv[t[2]][k] * b2;
    }
    struct vec3 position = inside((const float(*)[3])mesh->positions, t, b1, b2);
    struct vec3 normal = vec3_unit(inside((const float(*)[3])mesh->normals, t, b1, b2));
    (void)mapping_charts(mapping, position, normal, uv, (struct vec3){0}, (struct vec3){0}, charts);
    return charts[0];
}

struct weighted {
    double stretch, area;
};

static int compare_stretch(const void *a, const void *b)
{
    double one = ((const struct weighted *)a)->stretch, two = ((const struct weighted *)b)->stretch;
    return (one > two) - (one < two);
}

/* A surface that is drawn longer by more is seen from within a thousandth of its plane. */
static const double most_stretch = 1e3;

/* The principal stretches from material to surface, of a triangle whose gradients are given. */
static void principal_stretches(struct vec3 gx, struct vec3 gy, double stretches[2])
{
    /* Singular values of the 2 x 3 Jacobian from space to material are the inverse stretches. */
    double a = vec3_dot(gx, gx), b = vec3_dot(gx, gy), c = vec3_dot(gy, gy);
    double middle = (a + c) / 2, spread = hypot((a - c) / 2, b);
    stretches[0] = 1 / sqrt(middle + spread);
    stretches[1] = 1 / sqrt(fmax(middle - spread, 1e-12 * middle));
}

int mapping_stretch(const struct mapping *mapping, const struct mesh *mesh, double percentiles[3],
                    double *edge_on, struct nacre_error *error)
{
    struct weighted *list = calloc(2 * mesh->triangle_count + 1, sizeof *list);
    size_t count = 0;
    double total = 0, passed = 0, streaks = 0;
    if (!list) {
        return nacre_fail_memory(error, "the stretch of a mapping");
    }
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        struct vec3 gx, gy, a = vec3_from(mesh->positions[t[0]]);
        struct vec3 cross = vec3_cross(vec3_subtract(vec3_from(mesh->positions[t[1]]), a),
                                       vec3_subtract(vec3_from(mesh->positions[t[2]]), a));
        double area = vec3_length(cross) / 2, stretches[2];
        if (mapping->kind == MAPPING_UV) {
            if (!uv_gradients(mesh, t, &gx, &gy, &area)) {
                continue;
            }
        } else {
            struct mapped chart = mapping_inside(mapping, mesh, i, 1.0 / 3, 1.0 / 3);
            struct vec3 n = vec3_unit(cross);
            gx = vec3_along(chart.along_x, -vec3_dot(chart.along_x, n), n);
            gy = vec3_along(chart.along_y, -vec3_dot(chart.along_y, n), n);
        }
        principal_stretches(gx, gy, stretches);
        if (isfinite(stretches[0]) && stretches[1] > most_stretch) {
            streaks += 2 * area;
            continue;
        }
        for (int k = 0; k < 2 && isfinite(stretches[0]); k++) {
            list[count++] = (struct weighted){stretches[k], area};
            total += area;
        }
    }
    qsort(list, count, sizeof *list, compare_stretch);
    percentiles[0] = percentiles[1] = percentiles[2] = count ? list[0].stretch : 1;
    for (size_t i = 0; i < count; i++) {
        const double levels[3] = {0.05, 0.5, 0.95};
        for (int k = 0; k < 3; k++) {
            if (passed <= levels[k] * total) {
                percentiles[k] = list[i].stretch;
            }
        }
        passed += list[i].area;
    }
    *edge_on = streaks > 0 ? streaks / (streaks + total) : 0;
    free(list);
    return NACRE_OK;
}
