/* Counting the edges of a mesh that do not have two triangles. */
#include "render/mesh.h"

#include <stdlib.h>
#include <string.h>

struct placed {
    float position[3];
    uint32_t vertex;
};

static int compare_places(const void *a, const void *b)
{
    const struct placed *one = a, *two = b;
    for (int k = 0; k < 3; k++) {
        if (one->position[k] != two->position[k]) {
            return one->position[k] < two->position[k] ? -1 : 1;
        }
    }
    return 0;
}

static int compare_keys(const void *a, const void *b)
{
    uint64_t one = *(const uint64_t *)a, two = *(const uint64_t *)b;
    return (one > two) - (one < two);
}

/* For each vertex a number that those at the same place share. */
static void number_places(const struct mesh *mesh, struct placed *list, uint32_t *numbers)
{
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        memcpy(list[i].position, mesh->positions[i], sizeof list[i].position);
        list[i].vertex = (uint32_t)i;
    }
    qsort(list, mesh->vertex_count, sizeof *list, compare_places);
    uint32_t number = 0;
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        number += i > 0 && compare_places(&list[i - 1], &list[i]) != 0;
        numbers[list[i].vertex] = number;
    }
}

int mesh_count_edges(const struct mesh *mesh, size_t *open, size_t *crowded,
                     struct nacre_error *error)
{
    size_t count = 3 * mesh->triangle_count, same;
    struct placed *list = calloc(mesh->vertex_count + 1, sizeof *list);
    uint32_t *numbers = calloc(mesh->vertex_count + 1, sizeof *numbers);
    uint64_t *edges = calloc(count + 1, sizeof *edges);
    int status = NACRE_OK;
    *open = *crowded = 0;
    if (!list || !numbers || !edges) {
        status = nacre_fail_memory(error, "counting the edges of a mesh");
        goto out;
    }
    number_places(mesh, list, numbers);
    for (size_t i = 0; i < count; i++) {
        uint32_t a = numbers[mesh->triangles[i / 3][i % 3]];
        uint32_t b = numbers[mesh->triangles[i / 3][(i + 1) % 3]];
        edges[i] = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    }
    qsort(edges, count, sizeof *edges, compare_keys);
    for (size_t i = 0; i < count; i += same) {
        for (same = 1; i + same < count && edges[i + same] == edges[i]; same++) {
        }
        *open += same == 1;
        *crowded += same > 2;
    }
out:
    free(list);
    free(numbers);
    free(edges);
    return status;
}
