/* Finding patches: triangles that lie in the texture as in space, joined by their vertices. */
#include "render/convolve_patches.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Smaller patches are left to the gather, and those whose box is mostly empty. */
enum { LEAST_RECEIVERS = 256, BOX_A_RECEIVER = 12 };

/* By how much an edge may be longer or shorter in the texture. */
static const double stretch_most = 1.4;

struct finder {
    const struct mesh *mesh;
    const struct receivers *receivers;
    double point_mm;
    uint32_t *first;  /* [vertices]: its first receiver */
    bool *alone;      /* [receivers]: the vertex has no other */
    uint32_t *parent; /* [receivers] */
    float *areas;     /* [receivers] */
};

static void find_first(const struct finder *finder)
{
    const struct receivers *receivers = finder->receivers;
    for (size_t i = 0; i < receivers->count; i++) {
        bool begins = i == 0 || receivers->vertices[i] != receivers->vertices[i - 1];
        bool ends =
            i + 1 == receivers->count || receivers->vertices[i] != receivers->vertices[i + 1];
        if (begins) {
            finder->first[receivers->vertices[i]] = (uint32_t)i;
        }
        finder->alone[i] = begins && ends;
        finder->parent[i] = (uint32_t)i;
    }
}

static uint32_t root_of(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

/* Whether two receivers lie as far from each other in the texture as in space. */
static bool edge_fits(const struct receiver *a, const struct receiver *b, double point_mm)
{
    double length = vec3_length(vec3_subtract(vec3_from(a->position), vec3_from(b->position)));
    double drawn =
        hypot((double)a->along_x[3] - b->along_x[3], (double)a->along_y[3] - b->along_y[3]) *
        point_mm;
    return a->chart == b->chart && drawn <= stretch_most * length && length <= stretch_most * drawn;
}

/* Whether a triangle is turned in the texture as the texture is turned on the surface. */
static bool turned_alike(const struct receiver *const corners[3])
{
    double x[3], y[3];
    for (int k = 0; k < 3; k++) {
        x[k] = corners[k]->along_x[3];
        y[k] = corners[k]->along_y[3];
    }
    double drawn = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    struct vec3 across = vec3_cross(vec3_from(corners[0]->along_x), vec3_from(corners[0]->along_y));
    return drawn * vec3_dot(across, vec3_from(corners[0]->normal)) > 0;
}

static void join_triangle(const struct finder *finder, size_t triangle)
{
    const uint32_t *t = finder->mesh->triangles[triangle];
    const struct receiver *corners[3];
    uint32_t index[3];
    float share = (float)(vec3_length(mesh_triangle_cross(finder->mesh, triangle)) / 6);
    bool fits = true;
    for (int k = 0; k < 3; k++) {
        index[k] = finder->first[t[k]];
        finder->areas[index[k]] += share;
        corners[k] = &finder->receivers->list[index[k]];
        fits = fits && finder->alone[index[k]];
    }
    for (int k = 0; k < 3; k++) {
        fits = fits && edge_fits(corners[k], corners[(k + 1) % 3], finder->point_mm);
    }
    for (int k = 1; fits && turned_alike(corners) && k < 3; k++) {
        uint32_t a = root_of(finder->parent, index[0]), b = root_of(finder->parent, index[k]);
        finder->parent[a > b ? a : b] = a > b ? b : a;
    }
}

static void grow_box(struct convolve_patch *patch, const struct receiver *receiver)
{
    int x = (int)floorf(receiver->along_x[3]), y = (int)floorf(receiver->along_y[3]);
    int right = patch->x + patch->width, down = patch->y + patch->height;
    right = right > x + 1 ? right : x + 1;
    down = down > y + 1 ? down : y + 1;
    patch->x = patch->x < x ? patch->x : x;
    patch->y = patch->y < y ? patch->y : y;
    patch->width = right - patch->x;
    patch->height = down - patch->y;
}

/* Number the largest patches that there are, by their first receivers. */
static int number_patches(struct convolve_patches *patches, const struct finder *finder)
{
    size_t count = finder->receivers->count;
    uint32_t *sizes = calloc(count + 1, sizeof *sizes);
    int *numbers = calloc(count + 1, sizeof *numbers);
    if (!sizes || !numbers) {
        free(sizes);
        free(numbers);
        return -1;
    }
    for (size_t i = 0; i < count; i++) {
        sizes[root_of(finder->parent, (uint32_t)i)]++;
    }
    for (uint32_t least = LEAST_RECEIVERS;; least *= 2) {
        patches->count = 0;
        for (size_t i = 0; i < count; i++) {
            patches->count += sizes[i] >= least;
        }
        if (patches->count <= CONVOLVE_PATCHES) {
            int number = 0;
            for (size_t i = 0; i < count; i++) {
                numbers[i] = sizes[i] >= least ? number++ : -1;
            }
            break;
        }
    }
    for (size_t i = 0; i < count; i++) {
        patches->of[i] = (int16_t)numbers[root_of(finder->parent, (uint32_t)i)];
    }
    free(sizes);
    free(numbers);
    return 0;
}

/* Far enough for light not to be there at all: texture coordinates reach that far where they mean nothing. */
static bool within_reason(const struct receiver *receiver)
{
    return fabsf(receiver->along_x[3]) < 1e6F && fabsf(receiver->along_y[3]) < 1e6F;
}

static void make_boxes(struct convolve_patches *patches, const struct receivers *receivers)
{
    for (size_t i = 0; i < receivers->count; i++) {
        const struct receiver *receiver = &receivers->list[i];
        if (!within_reason(receiver)) {
            patches->of[i] = -1;
        }
        if (patches->of[i] < 0) {
            continue;
        }
        struct convolve_patch *patch = &patches->list[patches->of[i]];
        if (patch->receivers++ == 0) {
            patch->chart = receiver->chart;
            patch->x = (int)floorf(receiver->along_x[3]);
            patch->y = (int)floorf(receiver->along_y[3]);
        }
        grow_box(patch, receiver);
    }
}

static size_t cell_of(const struct convolve_patch *patch, double x, double y)
{
    int column = (int)(floor(x) - patch->x) / patch->cell;
    int row = (int)(floor(y) - patch->y) / patch->cell;
    return (size_t)row * (size_t)patch->columns + (size_t)column;
}

uint32_t convolve_place(const struct convolve_patch *patch, const struct receiver *receiver)
{
    return patch->places[cell_of(patch, receiver->along_x[3], receiver->along_y[3])];
}

static double apart(const float a[3], const float b[3])
{
    return vec3_length(vec3_subtract(vec3_from(a), vec3_from(b)));
}

/* Give each cell its place; a patch that lies on itself in the texture is none. */
static void fill_cells(struct convolve_patches *patches, const struct finder *finder, bool *none)
{
    const struct receivers *receivers = finder->receivers;
    for (size_t i = 0; i < receivers->count; i++) {
        if (patches->of[i] < 0 || none[patches->of[i]]) {
            continue;
        }
        const struct receiver *receiver = &receivers->list[i];
        struct convolve_patch *patch = &patches->list[patches->of[i]];
        double far = 2 * stretch_most * patch->cell * finder->point_mm;
        uint32_t *place =
            &patch->places[cell_of(patch, receiver->along_x[3], receiver->along_y[3])];
        if (*place == CONVOLVE_NONE) {
            *place = (uint32_t)i;
        } else if (apart(receivers->list[*place].position, receiver->position) > far) {
            none[patches->of[i]] = true;
        }
    }
}

static int make_cells(struct convolve_patches *patches, const struct finder *finder, int window)
{
    bool none[CONVOLVE_PATCHES] = {false};
    for (size_t i = 0; i < patches->count; i++) {
        struct convolve_patch *patch = &patches->list[i];
        double box = (double)patch->width * patch->height;
        patch->cell = window / 8 > 2 ? window / 8 : 2;
        patch->columns = (patch->width + patch->cell - 1) / patch->cell;
        patch->rows = (patch->height + patch->cell - 1) / patch->cell;
        if (box > BOX_A_RECEIVER * (double)patch->receivers) {
            none[i] = true;
            continue;
        }
        size_t count = (size_t)patch->columns * (size_t)patch->rows;
        patch->places = malloc((count + 1) * sizeof *patch->places);
        if (!patch->places) {
            return -1;
        }
        for (size_t k = 0; k < count; k++) {
            patch->places[k] = CONVOLVE_NONE;
        }
    }
    fill_cells(patches, finder, none);
    for (size_t i = 0; i < finder->receivers->count; i++) {
        patches->of[i] = patches->of[i] >= 0 && none[patches->of[i]] ? (int16_t)-1 : patches->of[i];
    }
    for (size_t i = 0; i < patches->count; i++) {
        patches->list[i].receivers = none[i] ? 0 : patches->list[i].receivers;
    }
    return 0;
}

/* Cells without a vertex, which triangles may reach into all the same, take a neighbour's place. */
static int widen(struct convolve_patches *patches)
{
    for (size_t i = 0; i < patches->count; i++) {
        struct convolve_patch *patch = &patches->list[i];
        size_t count = patch->places ? (size_t)patch->columns * (size_t)patch->rows : 0;
        uint32_t *places = calloc(count + 1, sizeof *places);
        if (!places) {
            return NACRE_FAILED;
        }
        for (size_t k = 0; k < count; k++) {
            int x = (int)(k % (size_t)patch->columns), y = (int)(k / (size_t)patch->columns);
            places[k] = patch->places[k];
            for (int j = 0; places[k] == CONVOLVE_NONE && j < 9; j++) {
                int column = x + j % 3 - 1, row = y + j / 3 - 1;
                bool inside =
                    column >= 0 && row >= 0 && column < patch->columns && row < patch->rows;
                places[k] =
                    inside ? patch->places[(size_t)row * (size_t)patch->columns + (size_t)column]
                           : CONVOLVE_NONE;
            }
        }
        free(patch->places);
        patch->places = places;
    }
    return NACRE_OK;
}

static bool any_patch(const struct convolve_patches *patches)
{
    bool any = false;
    for (size_t i = 0; i < patches->count; i++) {
        any = any || patches->list[i].receivers > 0;
    }
    return any;
}

static void clear_misfits(struct convolve_patches *patches, size_t receivers)
{
    for (size_t i = 0; i < receivers; i++) {
        patches->misfit[i] = HUGE_VALF;
    }
}

int convolve_patches_make(struct convolve_patches *patches, const struct mesh *mesh,
                          const struct mapping *mapping, const struct appearance *appearance,
                          const struct receivers *receivers, bool same_side,
                          struct nacre_error *error)
{
    size_t count = receivers->count;
    struct finder finder = {mesh,
                            receivers,
                            mapping->point_mm,
                            calloc(mesh->vertex_count + 1, sizeof *finder.first),
                            calloc(count + 1, sizeof *finder.alone),
                            calloc(count + 1, sizeof *finder.parent),
                            calloc(count + 1, sizeof *finder.areas)};
    int status = NACRE_FAILED;
    *patches = (struct convolve_patches){.of = calloc(count + 1, sizeof *patches->of),
                                         .misfit = calloc(count + 1, sizeof *patches->misfit)};
    if (!finder.first || !finder.alone || !finder.parent || !finder.areas || !patches->of ||
        !patches->misfit) {
        goto out;
    }
    find_first(&finder);
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        join_triangle(&finder, i);
    }
    if (number_patches(patches, &finder) != 0) {
        goto out;
    }
    make_boxes(patches, receivers);
    if (make_cells(patches, &finder, appearance->window) != 0) {
        goto out;
    }
    /* Without a patch there is nothing to survey; no receiver is in one then. */
    if (!any_patch(patches)) {
        clear_misfits(patches, count);
        status = NACRE_OK;
    } else if (convolve_misfit(patches, mapping, appearance, receivers, finder.areas, same_side) ==
               0) {
        status = widen(patches);
    }
out:
    free(finder.first);
    free(finder.alone);
    free(finder.parent);
    free(finder.areas);
    if (status != NACRE_OK) {
        convolve_patches_finish(patches);
        return nacre_fail_memory(error, "the level parts of a surface");
    }
    return NACRE_OK;
}

int convolve_patches_copy(struct convolve_patches *copy, const struct convolve_patches *patches,
                          size_t receivers, struct nacre_error *error)
{
    *copy = (struct convolve_patches){.of = malloc((receivers + 1) * sizeof *copy->of),
                                      .misfit = malloc((receivers + 1) * sizeof *copy->misfit)};
    bool made = copy->of && copy->misfit;
    for (size_t i = 0; made && i < patches->count; i++) {
        const struct convolve_patch *patch = &patches->list[i];
        size_t size = (size_t)patch->columns * (size_t)patch->rows * sizeof *patch->places;
        copy->list[i] = *patch;
        copy->list[i].places = patch->places ? malloc(size + 1) : NULL;
        copy->count++;
        made = !patch->places || copy->list[i].places;
        if (patch->places && made) {
            memcpy(copy->list[i].places, patch->places, size);
        }
    }
    if (!made) {
        convolve_patches_finish(copy);
        return nacre_fail_memory(error, "the level parts of a surface");
    }
    memcpy(copy->of, patches->of, receivers * sizeof *copy->of);
    memcpy(copy->misfit, patches->misfit, receivers * sizeof *copy->misfit);
    return NACRE_OK;
}

void convolve_patches_finish(struct convolve_patches *patches)
{
    for (size_t i = 0; i < patches->count; i++) {
        free(patches->list[i].places);
    }
    free(patches->of);
    free(patches->misfit);
    *patches = (struct convolve_patches){0};
}

int convolve_patch_at(const struct convolve_patches *patches, const struct receiver *receivers,
                      int32_t chart, double x, double y, const float position[3],
                      const float normal[3], double point_mm)
{
    double nearest = HUGE_VAL;
    int found = -1;
    for (size_t i = 0; i < patches->count; i++) {
        const struct convolve_patch *patch = &patches->list[i];
        bool inside = patch->receivers > 0 && patch->chart == chart && x >= patch->x &&
                      y >= patch->y && x < patch->x + patch->width && y < patch->y + patch->height;
        uint32_t place = inside ? patch->places[cell_of(patch, x, y)] : CONVOLVE_NONE;
        if (place == CONVOLVE_NONE) {
            continue;
        }
        double far = 2 * stretch_most * (2 * patch->cell) * point_mm;
        double away = apart(receivers[place].position, position);
        bool faces = vec3_dot(vec3_from(receivers[place].normal), vec3_from(normal)) > 0;
        if (faces && away <= far && away < nearest) {
            nearest = away;
            found = (int)i;
        }
    }
    return found;
}
