/* Splitting long edges of a mesh, so that radiance kept at its vertices resolves the material. */
#include "render/mesh.h"

#include <stdlib.h>
#include <string.h>

/* From an edge to the vertex in its middle: open addressing, never more than half full. */
struct edge_map {
    size_t mask;
    uint64_t *keys; /* lesser vertex << 32 | greater vertex, plus 1; 0: free */
    uint32_t *middles;
};

static uint64_t edge_key(uint32_t a, uint32_t b)
{
    return (a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a) + 1;
}

/* The place of the edge, or the free place where it belongs. */
static size_t edge_place(const struct edge_map *map, uint64_t key)
{
    size_t place = (size_t)(key * UINT64_C(0x9e3779b97f4a7c15) >> 20) & map->mask;
    while (map->keys[place] && map->keys[place] != key) {
        place = (place + 1) & map->mask;
    }
    return place;
}

double mesh_edge_even(const void *context, struct vec3 a, struct vec3 b)
{
    (void)a;
    (void)b;
    return *(const double *)context;
}

struct rule {
    mesh_edge_rule *allowed_mm;
    const void *context;
};

static bool is_long(const struct mesh *mesh, uint32_t first, uint32_t second,
                    const struct rule *rule)
{
    /* In the order of the vertices, so that both neighbours of an edge ask the same. */
    struct vec3 a = vec3_from(mesh->positions[first < second ? first : second]);
    struct vec3 b = vec3_from(mesh->positions[first < second ? second : first]);
    return vec3_length(vec3_subtract(a, b)) > rule->allowed_mm(rule->context, a, b) * (1 + 1e-6);
}

/* Vertices and triangles that one round would add. `map` gets every long edge; middles are numbered by order. */
static void plan_round(const struct mesh *mesh, const struct rule *rule, struct edge_map *map,
                       size_t *new_vertices, size_t *new_triangles)
{
    *new_vertices = *new_triangles = 0;
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        for (int k = 0; k < 3; k++) {
            uint32_t a = t[k], b = t[(k + 1) % 3];
            if (!is_long(mesh, a, b, rule)) {
                continue;
            }
            (*new_triangles)++;
            size_t place = edge_place(map, edge_key(a, b));
            if (!map->keys[place]) {
                map->keys[place] = edge_key(a, b);
                map->middles[place] = (uint32_t)(mesh->vertex_count + (*new_vertices)++);
            }
        }
    }
}

static void set_middle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t middle)
{
    struct vec3 p = vec3_add(vec3_from(mesh->positions[a]), vec3_from(mesh->positions[b]));
    struct vec3 n = vec3_add(vec3_from(mesh->normals[a]), vec3_from(mesh->normals[b]));
    vec3_store(vec3_scale(p, 0.5), mesh->positions[middle]);
    vec3_store(vec3_length(n) > 1e-6 ? vec3_unit(n) : vec3_from(mesh->normals[a]),
               mesh->normals[middle]);
    for (int k = 0; mesh->uv && k < 2; k++) {
        mesh->uv[middle][k] = (mesh->uv[a][k] + mesh->uv[b][k]) / 2;
    }
}

static void add_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t *t = mesh->triangles[mesh->triangle_count++];
    t[0] = a, t[1] = b, t[2] = c;
}

/* Add triangle t[3] to `out` in as many pieces as it has long edges, and one. m[k]: middle of edge k, or 0. */
static void add_split(struct mesh *out, const uint32_t t[3], const uint32_t m[3])
{
    int split = (m[0] != 0) + (m[1] != 0) + (m[2] != 0);
    int k = 0;
    if (split == 0) {
        add_triangle(out, t[0], t[1], t[2]);
    } else if (split == 3) {
        add_triangle(out, t[0], m[0], m[2]);
        add_triangle(out, m[0], t[1], m[1]);
        add_triangle(out, m[2], m[1], t[2]);
        add_triangle(out, m[0], m[1], m[2]);
    } else if (split == 1) {
        while (!m[k]) {
            k++;
        }
        uint32_t a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
        add_triangle(out, a, m[k], c);
        add_triangle(out, m[k], b, c);
    } else {
        while (m[k]) {
            k++; /* the short edge */
        }
        uint32_t a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
        uint32_t bc = m[(k + 1) % 3], ca = m[(k + 2) % 3];
        add_triangle(out, ca, bc, c);
        struct vec3 one =
            vec3_subtract(vec3_from(out->positions[a]), vec3_from(out->positions[bc]));
        struct vec3 two =
            vec3_subtract(vec3_from(out->positions[b]), vec3_from(out->positions[ca]));
        if (vec3_dot(one, one) < vec3_dot(two, two)) {
            add_triangle(out, a, b, bc);
            add_triangle(out, a, bc, ca);
        } else {
            add_triangle(out, a, b, ca);
            add_triangle(out, b, bc, ca);
        }
    }
}

/* Replace the mesh by one with the planned edges split. */
static int split_round(struct mesh *mesh, const struct edge_map *map, size_t new_vertices,
                       size_t new_triangles, struct nacre_error *error)
{
    struct mesh out;
    if (mesh_allocate(&out, mesh->vertex_count + new_vertices, mesh->triangle_count + new_triangles,
                      mesh->uv != NULL, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    memcpy(out.positions, mesh->positions, mesh->vertex_count * sizeof *mesh->positions);
    memcpy(out.normals, mesh->normals, mesh->vertex_count * sizeof *mesh->normals);
    if (mesh->uv) {
        memcpy(out.uv, mesh->uv, mesh->vertex_count * sizeof *mesh->uv);
    }
    for (size_t place = 0; place <= map->mask; place++) {
        if (map->keys[place]) {
            uint64_t key = map->keys[place] - 1;
            set_middle(&out, (uint32_t)(key >> 32), (uint32_t)key, map->middles[place]);
        }
    }
    out.triangle_count = 0;
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        uint32_t middles[3];
        for (int k = 0; k < 3; k++) {
            size_t place = edge_place(map, edge_key(t[k], t[(k + 1) % 3]));
            middles[k] = map->keys[place] ? map->middles[place] : 0;
        }
        add_split(&out, t, middles);
    }
    out.degenerate_count = mesh->degenerate_count;
    out.middle = mesh->middle;
    out.scale = mesh->scale;
    out.uv_mm = mesh->uv_mm;
    mesh_finish(mesh);
    *mesh = out;
    return NACRE_OK;
}

int mesh_subdivide(struct mesh *mesh, mesh_edge_rule *rule, const void *context, size_t limit,
                   bool *limited, struct nacre_error *error)
{
    const struct rule limits = {rule, context};
    int status = NACRE_OK;
    *limited = false;
    while (status == NACRE_OK) {
        struct edge_map map = {.mask = 1023};
        size_t new_vertices, new_triangles;
        while (map.mask < 6 * mesh->triangle_count) {
            map.mask = 2 * map.mask + 1;
        }
        map.keys = calloc(map.mask + 1, sizeof *map.keys);
        map.middles = calloc(map.mask + 1, sizeof *map.middles);
        if (!map.keys || !map.middles) {
            status = nacre_fail_memory(error, "splitting the edges of a mesh");
            new_triangles = 0;
        } else {
            plan_round(mesh, &limits, &map, &new_vertices, &new_triangles);
            *limited = new_triangles > 0 && mesh->triangle_count + new_triangles > limit;
            if (new_triangles > 0 && !*limited) {
                status = split_round(mesh, &map, new_vertices, new_triangles, error);
            }
        }
        free(map.keys);
        free(map.middles);
        if (new_triangles == 0 || *limited) {
            break;
        }
    }
    return status;
}
