/* Triangle meshes: memory, checking, measuring and placing. */
#include "render/mesh.h"

#include <stdlib.h>
#include <string.h>

int mesh_allocate(struct mesh *mesh, size_t vertices, size_t triangles, bool with_uv,
                  struct nacre_error *error)
{
    *mesh = (struct mesh){
        .vertex_count = vertices, .triangle_count = triangles, .scale = 1, .uv_mm = 1};
    if (vertices > UINT32_MAX || triangles > MESH_TRIANGLES_MAXIMUM) {
        return nacre_fail(
            error, "a mesh of %zu triangles is larger than the limit of %d; take a coarser one",
            triangles, MESH_TRIANGLES_MAXIMUM);
    }
    mesh->positions = calloc(vertices + 1, sizeof *mesh->positions);
    mesh->normals = calloc(vertices + 1, sizeof *mesh->normals);
    mesh->triangles = calloc(triangles + 1, sizeof *mesh->triangles);
    mesh->uv = with_uv ? calloc(vertices + 1, sizeof *mesh->uv) : NULL;
    if (!mesh->positions || !mesh->normals || !mesh->triangles || (with_uv && !mesh->uv)) {
        mesh_finish(mesh);
        return nacre_fail_memory(error, "a mesh");
    }
    return NACRE_OK;
}

void mesh_finish(struct mesh *mesh)
{
    free(mesh->positions);
    free(mesh->normals);
    free(mesh->uv);
    free(mesh->triangles);
    *mesh = (struct mesh){0};
}

/* Twice the triangle's area times its unit normal. */
static struct vec3 triangle_cross(const struct mesh *mesh, size_t index)
{
    const uint32_t *t = mesh->triangles[index];
    struct vec3 a = vec3_from(mesh->positions[t[0]]);
    return vec3_cross(vec3_subtract(vec3_from(mesh->positions[t[1]]), a),
                      vec3_subtract(vec3_from(mesh->positions[t[2]]), a));
}

static int check_vertices(const struct mesh *mesh, const char *name, struct nacre_error *error)
{
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        const float *p = mesh->positions[i];
        bool finite = isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
        if (!finite) {
            return nacre_fail(error,
                              "%s: vertex %zu is (%g, %g, %g), which is no place; repair the mesh",
                              name, i, p[0], p[1], p[2]);
        }
        /* Squares of larger coordinates overflow single precision. */
        if (fabsf(p[0]) > 1e15F || fabsf(p[1]) > 1e15F || fabsf(p[2]) > 1e15F) {
            return nacre_fail(error,
                              "%s: vertex %zu is (%g, %g, %g), too far out to calculate with", name,
                              i, p[0], p[1], p[2]);
        }
        if (mesh->uv && !(isfinite(mesh->uv[i][0]) && isfinite(mesh->uv[i][1]))) {
            return nacre_fail(error, "%s: the texture coordinates of vertex %zu are not finite",
                              name, i);
        }
    }
    return NACRE_OK;
}

static int drop_degenerate(struct mesh *mesh, const char *name, struct nacre_error *error)
{
    size_t kept = 0;
    struct vec3 low, high;
    mesh_bounds(mesh, &low, &high);
    double extent = vec3_length(vec3_subtract(high, low));
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        if (t[0] >= mesh->vertex_count || t[1] >= mesh->vertex_count ||
            t[2] >= mesh->vertex_count) {
            return nacre_fail(error, "%s: triangle %zu names a vertex that is not there", name, i);
        }
        /* Less area than single precision resolves at this extent. */
        if (vec3_length(triangle_cross(mesh, i)) > 1e-14 * extent * extent) {
            memmove(mesh->triangles[kept++], t, sizeof *mesh->triangles);
        }
    }
    mesh->degenerate_count += mesh->triangle_count - kept;
    mesh->triangle_count = kept;
    return kept > 0 ? NACRE_OK
                    : nacre_fail(error, "%s: the mesh has no triangle of any area", name);
}

/* Turn triangles whose corners run against their normals. */
static void turn_triangles(struct mesh *mesh)
{
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        uint32_t *t = mesh->triangles[i];
        struct vec3 sum = vec3_add(vec3_from(mesh->normals[t[0]]), vec3_from(mesh->normals[t[1]]));
        sum = vec3_add(sum, vec3_from(mesh->normals[t[2]]));
        if (vec3_dot(sum, triangle_cross(mesh, i)) < 0) {
            uint32_t second = t[1];
            t[1] = t[2];
            t[2] = second;
        }
    }
}

static int mend_normals(struct mesh *mesh, struct nacre_error *error)
{
    float(*sums)[3] = calloc(mesh->vertex_count, sizeof *sums);
    if (!sums) {
        return nacre_fail_memory(error, "the normals of a mesh");
    }
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        struct vec3 cross = triangle_cross(mesh, i);
        for (int k = 0; k < 3; k++) {
            float *sum = sums[mesh->triangles[i][k]];
            vec3_store(vec3_add(vec3_from(sum), cross), sum);
        }
    }
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        double length = vec3_length(vec3_from(mesh->normals[i]));
        struct vec3 normal =
            length > 1e-6 && isfinite(length) ? vec3_from(mesh->normals[i]) : vec3_from(sums[i]);
        if (!(vec3_length(normal) > 0)) {
            normal = (struct vec3){0, 0, 1}; /* belongs to no triangle */
        }
        vec3_store(vec3_unit(normal), mesh->normals[i]);
    }
    free(sums);
    return NACRE_OK;
}

int mesh_check(struct mesh *mesh, const char *name, struct nacre_error *error)
{
    if (mesh->vertex_count == 0 || mesh->triangle_count == 0) {
        return nacre_fail(error, "%s: the mesh has no triangles", name);
    }
    if (check_vertices(mesh, name, error) != NACRE_OK ||
        drop_degenerate(mesh, name, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (mend_normals(mesh, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    turn_triangles(mesh);
    return NACRE_OK;
}

void mesh_bounds(const struct mesh *mesh, struct vec3 *low, struct vec3 *high)
{
    *low = (struct vec3){HUGE_VAL, HUGE_VAL, HUGE_VAL};
    *high = (struct vec3){-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        struct vec3 p = vec3_from(mesh->positions[i]);
        *low = (struct vec3){fmin(low->x, p.x), fmin(low->y, p.y), fmin(low->z, p.z)};
        *high = (struct vec3){fmax(high->x, p.x), fmax(high->y, p.y), fmax(high->z, p.z)};
    }
}

double mesh_area_mm2(const struct mesh *mesh)
{
    double sum = 0;
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        sum += vec3_length(triangle_cross(mesh, i)) / 2;
    }
    return sum;
}

static double uv_area(const struct mesh *mesh)
{
    double sum = 0;
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        const float *a = mesh->uv[t[0]], *b = mesh->uv[t[1]], *c = mesh->uv[t[2]];
        sum +=
            fabs((double)(b[0] - a[0]) * (c[1] - a[1]) - (double)(b[1] - a[1]) * (c[0] - a[0])) / 2;
    }
    return sum;
}

int mesh_scale(struct mesh *mesh, double size_mm, const char *name, struct nacre_error *error)
{
    struct vec3 low, high;
    mesh_bounds(mesh, &low, &high);
    double extent = fmax(fmax(high.x - low.x, high.y - low.y), high.z - low.z);
    if (!(extent > 0)) {
        return nacre_fail(error, "%s: the mesh has no extent, so it cannot be scaled", name);
    }
    struct vec3 middle = vec3_scale(vec3_add(low, high), 0.5);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        struct vec3 p = vec3_subtract(vec3_from(mesh->positions[i]), middle);
        vec3_store(vec3_scale(p, size_mm / extent), mesh->positions[i]);
    }
    mesh->middle = vec3_along(mesh->middle, 1 / mesh->scale, middle);
    mesh->scale *= size_mm / extent;
    double covered = mesh->uv ? uv_area(mesh) : 0;
    if (mesh->uv && !(covered > 0)) {
        free(mesh->uv);
        mesh->uv = NULL;
    }
    if (mesh->uv) {
        double factor = sqrt(mesh_area_mm2(mesh) / covered);
        mesh->uv_mm *= factor;
        for (size_t i = 0; i < mesh->vertex_count; i++) {
            mesh->uv[i][0] = (float)(mesh->uv[i][0] * factor);
            mesh->uv[i][1] = (float)(mesh->uv[i][1] * factor);
        }
    }
    return NACRE_OK;
}

struct motion mesh_placement(const struct mesh *mesh, const double degrees[3], struct vec3 position)
{
    struct motion motion = motion_make(degrees, (struct vec3){0, 0, 0});
    struct vec3 low = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        struct vec3 p = motion_turn(&motion, vec3_from(mesh->positions[i]));
        low = (struct vec3){fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z)};
        high = (struct vec3){fmax(high.x, p.x), fmax(high.y, p.y), high.z};
    }
    struct vec3 bottom = {(low.x + high.x) / 2, (low.y + high.y) / 2, low.z};
    motion.origin = vec3_subtract(position, bottom);
    return motion;
}

void mesh_move(struct mesh *mesh, const struct motion *motion)
{
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        vec3_store(motion_move(motion, vec3_from(mesh->positions[i])), mesh->positions[i]);
        vec3_store(motion_turn(motion, vec3_from(mesh->normals[i])), mesh->normals[i]);
    }
}
