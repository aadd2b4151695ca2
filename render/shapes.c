/* The built-in shapes. */
#include "render/mesh.h"

#include <stdlib.h>

static const double pi = 3.14159265358979323846;

static void set_vertex(struct mesh *mesh, size_t index, struct vec3 position, struct vec3 normal,
                       double u, double v)
{
    vec3_store(position, mesh->positions[index]);
    vec3_store(normal, mesh->normals[index]);
    mesh->uv[index][0] = (float)u;
    mesh->uv[index][1] = (float)v;
}

/* Triangles of a grid of (columns + 1) x (rows + 1) vertices, counter-clockwise where u runs right and v up. */
static void set_grid(struct mesh *mesh, size_t first_vertex, size_t first_triangle, size_t columns,
                     size_t rows)
{
    size_t triangle = first_triangle;
    for (size_t j = 0; j < rows; j++) {
        for (size_t i = 0; i < columns; i++) {
            uint32_t a = (uint32_t)(first_vertex + j * (columns + 1) + i), b = a + 1;
            uint32_t c = (uint32_t)(a + columns + 1), d = c + 1;
            uint32_t *t = mesh->triangles[triangle++];
            t[0] = a, t[1] = b, t[2] = d;
            t = mesh->triangles[triangle++];
            t[0] = a, t[1] = d, t[2] = c;
        }
    }
}

static size_t steps(double length, double edge)
{
    double count = ceil(length / edge);
    return count < 3 ? 3 : count > 4000 ? 4000 : (size_t)count;
}

int mesh_make_quad(struct mesh *mesh, double width_mm, double depth_mm, struct nacre_error *error)
{
    if (mesh_allocate(mesh, 4, 2, true, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (size_t i = 0; i < 4; i++) {
        double x = (i % 2 ? 0.5 : -0.5) * width_mm, y = (i / 2 ? 0.5 : -0.5) * depth_mm;
        set_vertex(mesh, i, (struct vec3){x, y, 0}, (struct vec3){0, 0, 1}, x, y);
    }
    set_grid(mesh, 0, 0, 1, 1);
    return NACRE_OK;
}

int mesh_make_box(struct mesh *mesh, const double size_mm[3], struct nacre_error *error)
{
    if (mesh_allocate(mesh, 24, 12, true, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (size_t face = 0; face < 6; face++) {
        size_t axis = face / 2;
        double side = face % 2 ? 1 : -1;
        for (size_t i = 0; i < 4; i++) {
            /* right x up = outward on every face */
            double right = (i % 2 ? 0.5 : -0.5) * side, up = i / 2 ? 0.5 : -0.5;
            double p[3], n[3] = {0};
            p[axis] = side / 2;
            p[(axis + 1) % 3] = right;
            p[(axis + 2) % 3] = up;
            n[axis] = side;
            set_vertex(mesh, face * 4 + i,
                       (struct vec3){p[0] * size_mm[0], p[1] * size_mm[1], p[2] * size_mm[2]},
                       (struct vec3){n[0], n[1], n[2]}, right * size_mm[(axis + 1) % 3],
                       up * size_mm[(axis + 2) % 3]);
        }
        set_grid(mesh, face * 4, face * 2, 1, 1);
    }
    return NACRE_OK;
}

int mesh_make_sphere(struct mesh *mesh, double radius_mm, double edge_mm, struct nacre_error *error)
{
    size_t columns = steps(2 * pi * radius_mm, edge_mm), rows = steps(pi * radius_mm, edge_mm);
    if (mesh_allocate(mesh, (columns + 1) * (rows + 1), 2 * columns * rows, true, error) !=
        NACRE_OK) {
        return NACRE_FAILED;
    }
    for (size_t j = 0; j <= rows; j++) {
        double latitude = ((double)j / (double)rows - 0.5) * pi;
        for (size_t i = 0; i <= columns; i++) {
            double longitude = ((double)i / (double)columns - 0.5) * 2 * pi;
            struct vec3 n = {cos(latitude) * cos(longitude), cos(latitude) * sin(longitude),
                             sin(latitude)};
            set_vertex(mesh, j * (columns + 1) + i, vec3_scale(n, radius_mm), n,
                       radius_mm * longitude, radius_mm * latitude);
        }
    }
    set_grid(mesh, 0, 0, columns, rows);
    return mesh_check(mesh, "sphere", error); /* drops the flat triangles at the poles */
}

/* The curve in the tube's middle, t in [0, 2 pi). */
static struct vec3 knot_point(double t)
{
    double ring = 2 + cos(3 * t);
    return (struct vec3){ring * cos(2 * t), ring * sin(2 * t), sin(3 * t)};
}

struct knot_ring {
    struct vec3 middle, side,
        up;       /* side and up span the tube's section, turning as little as can be */
    double along; /* length of the curve up to here */
};

/* One ring for each of `count` equal steps of t and the first once more at the end. */
static struct knot_ring *knot_rings(size_t count)
{
    struct knot_ring *rings = calloc(count + 1, sizeof *rings);
    if (!rings) {
        return NULL;
    }
    for (size_t i = 0; i <= count; i++) {
        double t = 2 * pi * (double)i / (double)count, step = 1e-4;
        struct knot_ring *ring = &rings[i];
        struct vec3 tangent = vec3_unit(vec3_subtract(knot_point(t + step), knot_point(t - step)));
        ring->middle = knot_point(t);
        struct vec3 side = i ? rings[i - 1].side : vec3_perpendicular(tangent);
        ring->side = vec3_unit(vec3_along(side, -vec3_dot(side, tangent), tangent));
        ring->up = vec3_cross(ring->side, tangent);
        ring->along =
            i ? rings[i - 1].along + vec3_length(vec3_subtract(ring->middle, rings[i - 1].middle))
              : 0;
    }
    /* Carried once round, the section has turned; undo that evenly along the way. */
    struct knot_ring *last = &rings[count];
    double turned = atan2(vec3_dot(last->side, rings[0].up), vec3_dot(last->side, rings[0].side));
    for (size_t i = 0; i <= count; i++) {
        double angle = -turned * (double)i / (double)count;
        struct vec3 side = rings[i].side, up = rings[i].up;
        rings[i].side = vec3_along(vec3_scale(side, cos(angle)), sin(angle), up);
        rings[i].up = vec3_along(vec3_scale(up, cos(angle)), -sin(angle), side);
    }
    return rings;
}

int mesh_make_knot(struct mesh *mesh, double size_mm, double thickness, double edge_mm,
                   struct nacre_error *error)
{
    int status = NACRE_FAILED;
    double scale = size_mm / (2 * (3 + thickness)), radius = thickness * scale;
    /* The curve is 27.4 units long and its steps of t differ in length by half. */
    size_t columns = steps(27.4 * 1.2 * scale, edge_mm), rows = steps(2 * pi * radius, edge_mm);
    struct knot_ring *rings = knot_rings(columns);
    *mesh = (struct mesh){0};
    if (!rings) {
        (void)nacre_fail_memory(error, "a torus knot");
        goto out;
    }
    if (mesh_allocate(mesh, (columns + 1) * (rows + 1), 2 * columns * rows, true, error) !=
        NACRE_OK) {
        goto out;
    }
    for (size_t j = 0; j <= rows; j++) {
        double angle = ((double)j / (double)rows - 0.5) * 2 * pi;
        for (size_t i = 0; i <= columns; i++) {
            const struct knot_ring *ring = &rings[i];
            struct vec3 n = vec3_along(vec3_scale(ring->side, cos(angle)), sin(angle), ring->up);
            set_vertex(mesh, j * (columns + 1) + i,
                       vec3_along(vec3_scale(ring->middle, scale), radius, n), n,
                       (ring->along - rings[columns].along / 2) * scale, angle * radius);
        }
    }
    set_grid(mesh, 0, 0, columns, rows);
    status = mesh_check(mesh, "knot", error);
out:
    free(rings);
    return status;
}
