/* Splitting long edges of a mesh, so that radiance kept at its vertices resolves the material. */
#include "render/mesh.h"

#include <stdlib.h>
#include <string.h>

/* By then an edge is a millionth of a millionth of what it was: a rule that asks for more would never be met. */
enum { ROUNDS_MOST = 40 };

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

double mesh_edge_even(const void *context, const struct mesh *mesh, uint32_t a, uint32_t b)
{
    (void)mesh;
    (void)a;
    (void)b;
    return *(const double *)context;
}

/* What stays as it is from round to round: an edge that is not too long never will be. */
struct splitting {
    mesh_edge_rule *allowed_mm;
    const void *context;
    bool *settled; /* [triangles] */
    size_t unsettled;
};

static bool is_long(const struct mesh *mesh, uint32_t first, uint32_t second,
                    const struct splitting *splitting)
{
    /* In the order of the vertices, so that both neighbours of an edge ask the same. */
    uint32_t a = first < second ? first : second, b = first < second ? second : first;
    struct vec3 edge = vec3_subtract(vec3_from(mesh->positions[a]), vec3_from(mesh->positions[b]));
    return vec3_length(edge) > splitting->allowed_mm(splitting->context, mesh, a, b) * (1 + 1e-6);
}

/* Vertices and triangles that one round would add. `map` gets every long edge; middles are numbered by order. Triangles
 * without one are settled. */
static void plan_round(const struct mesh *mesh, const struct splitting *splitting,
                       struct edge_map *map, size_t *new_vertices, size_t *new_triangles)
{
    *new_vertices = *new_triangles = 0;
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        size_t before = *new_triangles;
        for (int k = 0; !splitting->settled[i] && k < 3; k++) {
            uint32_t a = t[k], b = t[(k + 1) % 3];
            if (!is_long(mesh, a, b, splitting)) {
                continue;
            }
            (*new_triangles)++;
            size_t place = edge_place(map, edge_key(a, b));
            if (!map->keys[place]) {
                map->keys[place] = edge_key(a, b);
                map->middles[place] = (uint32_t)(mesh->vertex_count + (*new_vertices)++);
            }
        }
        splitting->settled[i] = *new_triangles == before;
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

/* Give `out` the mesh's triangles with the planned edges split, and tell those that may have to be split again. */
static int split_triangles(const struct mesh *mesh, const struct edge_map *map, struct mesh *out,
                           struct splitting *splitting, struct nacre_error *error)
{
    bool *settled = calloc(out->triangle_count + 1, sizeof *settled);
    if (!settled) {
        return nacre_fail_memory(error, "splitting the edges of a mesh");
    }
    out->triangle_count = splitting->unsettled = 0;
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        uint32_t middles[3] = {0};
        for (int k = 0; !splitting->settled[i] && k < 3; k++) {
            size_t place = edge_place(map, edge_key(t[k], t[(k + 1) % 3]));
            middles[k] = map->keys[place] ? map->middles[place] : 0;
        }
        size_t before = out->triangle_count;
        settled[before] = splitting->settled[i];
        add_split(out, t, middles);
        splitting->unsettled += splitting->settled[i] ? 0 : out->triangle_count - before;
    }
    free(splitting->settled);
    splitting->settled = settled;
    return NACRE_OK;
}

/* Replace the mesh by one with the planned edges split. */
static int split_round(struct mesh *mesh, const struct edge_map *map, size_t new_vertices,
                       size_t new_triangles, struct splitting *splitting, struct nacre_error *error)
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
    if (split_triangles(mesh, map, &out, splitting, error) != NACRE_OK) {
        mesh_finish(&out);
        return NACRE_FAILED;
    }
    out.degenerate_count = mesh->degenerate_count;
    out.middle = mesh->middle;
    out.scale = mesh->scale;
    out.uv_mm = mesh->uv_mm;
    mesh_finish(mesh);
    *mesh = out;
    return NACRE_OK;
}

static int split_once(struct mesh *mesh, struct splitting *splitting, size_t limit, bool *limited,
                      bool *done, struct nacre_error *error)
{
    size_t new_vertices, new_triangles;
    struct edge_map map = {.mask = 1023};
    int status = NACRE_OK;
    while (map.mask < 6 * splitting->unsettled) {
        map.mask = 2 * map.mask + 1;
    }
    map.keys = calloc(map.mask + 1, sizeof *map.keys);
    map.middles = calloc(map.mask + 1, sizeof *map.middles);
    if (!map.keys || !map.middles) {
        status = nacre_fail_memory(error, "splitting the edges of a mesh");
    } else {
        plan_round(mesh, splitting, &map, &new_vertices, &new_triangles);
        *limited = new_triangles > 0 && mesh->triangle_count + new_triangles > limit;
        *done = new_triangles == 0 || *limited;
        if (!*done) {
            status = split_round(mesh, &map, new_vertices, new_triangles, splitting, error);
        }
    }
    free(map.keys);
    free(map.middles);
    return status;
}

int mesh_subdivide(struct mesh *mesh, mesh_edge_rule *rule, const void *context, size_t limit,
                   bool *limited, struct nacre_error *error)
{
    struct splitting splitting = {rule, context,
                                  calloc(mesh->triangle_count + 1, sizeof *splitting.settled),
                                  mesh->triangle_count};
    int status = NACRE_OK;
    bool done = false;
    *limited = false;
    if (!splitting.settled) {
        return nacre_fail_memory(error, "splitting the edges of a mesh");
    }
    for (int round = 0; status == NACRE_OK && !done; round++) {
        status = split_once(mesh, &splitting, limit, limited, &done, error);
        *limited = *limited || (!done && round == ROUNDS_MOST);
        done = done || *limited;
    }
    free(splitting.settled);
    return status;
}

int mesh_subdivide_once(struct mesh *mesh, mesh_edge_rule *rule, const void *context, size_t limit,
                        bool *limited, bool *done, struct nacre_error *error)
{
    struct splitting splitting = {rule, context,
                                  calloc(mesh->triangle_count + 1, sizeof *splitting.settled),
                                  mesh->triangle_count};
    if (!splitting.settled) {
        return nacre_fail_memory(error, "splitting the edges of a mesh");
    }
    int status = split_once(mesh, &splitting, limit, limited, done, error);
    free(splitting.settled);
    return status;
}
