/* Making surfaces and light for tests. */
#include "stand.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct nacre_error error;

const struct opencl *stand_opencl(void)
{
    static struct opencl opencl; /* until the program ends */
    if (!opencl.context) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, opencl_open(NULL, &opencl, &error), error.text);
    }
    return &opencl;
}

struct stand stand_make(const struct nacre_material *material, struct mesh mesh,
                        const struct scene_material *settings)
{
    struct stand stand = {.mesh = mesh};
    const double none[3] = {0};
    struct motion still = motion_make(none, (struct vec3){0, 0, 0});
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, appearance_make(&stand.appearance, material, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK,
                                  mapping_make(&stand.mapping, settings, material->width,
                                               material->height, material->pitch_mm, &stand.mesh,
                                               &still, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, mapping_follow(&stand.mapping, &stand.mesh, &error),
                                  error.text);
    stand.radiosity = calloc(mesh.vertex_count, sizeof *stand.radiosity);
    TEST_ASSERT_NOT_NULL(stand.radiosity);
    return stand;
}

void stand_finish(struct stand *stand)
{
    appearance_finish(&stand->appearance);
    mesh_finish(&stand->mesh);
    mapping_finish(&stand->mapping);
    samples_finish(&stand->samples);
    free(stand->radiosity);
    *stand = (struct stand){0};
}

struct mesh stand_grid(int columns, int rows, double point_mm)
{
    struct mesh mesh;
    size_t w = (size_t)columns, h = (size_t)rows, triangle = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, mesh_allocate(&mesh, w * h, 2 * (w - 1) * (h - 1), true, &error), error.text);
    for (size_t i = 0; i < w * h; i++) {
        /* Rows of the material run down, y of the scene up. */
        size_t x = i % w, y = i / w;
        mesh.positions[i][0] = (float)(((double)x + 0.5) * point_mm);
        mesh.positions[i][1] = (float)(-((double)y + 0.5) * point_mm);
        mesh.positions[i][2] = 0;
        mesh.normals[i][2] = 1;
        mesh.uv[i][0] = mesh.positions[i][0];
        mesh.uv[i][1] = mesh.positions[i][1];
    }
    for (size_t y = 0; y + 1 < h; y++) {
        for (size_t x = 0; x + 1 < w; x++) {
            uint32_t a = (uint32_t)(y * w + x), b = a + 1, c = (uint32_t)(a + w), d = c + 1;
            const uint32_t pair[2][3] = {{a, c, d}, {a, d, b}};
            memcpy(mesh.triangles[triangle], pair, sizeof pair);
            triangle += 2;
        }
    }
    return mesh;
}

void stand_add_sample(struct stand *stand, size_t triangle, double b1, double b2)
{
    struct light_samples *samples = &stand->samples;
    const struct mapping *mapping = &stand->mapping;
    const uint32_t *t = stand->mesh.triangles[triangle];
    double area = mapping->point_mm * mapping->point_mm, b[3] = {1 - b1 - b2, b1, b2};
    samples->list = realloc(samples->list, (samples->count + 1) * sizeof *samples->list);
    TEST_ASSERT_NOT_NULL(samples->list);
    struct light_sample *sample = &samples->list[samples->count++];
    struct mapped chart = mapping_inside(mapping, &stand->mesh, triangle, b1, b2);
    *sample = (struct light_sample){
        .area_mm2 = (float)area, .x = (float)chart.x, .y = (float)chart.y, .chart = chart.chart};
    struct vec3 p = {0, 0, 0}, n = {0, 0, 0};
    for (int k = 0; k < 3; k++) {
        p = vec3_along(p, b[k], vec3_from(stand->mesh.positions[t[k]]));
        n = vec3_along(n, b[k], vec3_from(stand->mesh.normals[t[k]]));
        sample->flux[k] = (float)area;
    }
    vec3_store(p, sample->position);
    vec3_store(vec3_unit(n), sample->normal);
    int x = mapping_wrap((int64_t)floor(chart.x), mapping->width, mapping->mirror);
    int y = mapping_wrap((int64_t)floor(chart.y), mapping->height, mapping->mirror);
    sample->texel = (uint32_t)(y * mapping->width + x);
}

void stand_add_sample_at(struct stand *stand, size_t vertex)
{
    for (size_t i = 0; i < stand->mesh.triangle_count; i++) {
        for (int k = 0; k < 3; k++) {
            if (stand->mesh.triangles[i][k] == vertex) {
                stand_add_sample(stand, i, k == 1, k == 2);
                return;
            }
        }
    }
    TEST_FAIL_MESSAGE("the vertex belongs to no triangle");
}

void stand_light_evenly(struct stand *stand, double density)
{
    /* A far point light over every facet would not be even on a curved surface, so the flux is set by hand. */
    const struct mesh *meshes[1] = {&stand->mesh};
    struct lit_surface surface = {&stand->mesh, &stand->mapping, 0, 1, NULL};
    struct world *world = NULL;
    double point = stand->mapping.point_mm;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, world_new(meshes, 1, &world, &error), error.text);
    samples_finish(&stand->samples);
    const struct lighting dark = {.world = world, .rays = 1, .seed = 1};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK,
        samples_spread(&surface, &dark, density / (point * point), NULL, &stand->samples, &error),
        error.text);
    for (size_t i = 0; i < stand->samples.count; i++) {
        for (int c = 0; c < 3; c++) {
            stand->samples.list[i].flux[c] = stand->samples.list[i].area_mm2;
        }
    }
    world_free(world);
}

static struct gather gather_of(struct stand *stand, double tolerance)
{
    memset(stand->radiosity, 0, stand->mesh.vertex_count * sizeof *stand->radiosity);
    return (struct gather){.mesh = &stand->mesh,
                           .mapping = &stand->mapping,
                           .appearance = &stand->appearance,
                           .samples = &stand->samples,
                           .tolerance = tolerance};
}

static struct gather_counts run(struct stand *stand, double tolerance, enum gather_way way)
{
    struct gather gather = gather_of(stand, tolerance);
    struct gather_counts counts;
    gather.way = way;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, gather_run(&gather, stand_opencl(), NULL, stand->radiosity, &counts, &error),
        error.text);
    return counts;
}

struct gather_counts stand_gather(struct stand *stand, double tolerance)
{
    return run(stand, tolerance, GATHER_SOONEST);
}

struct gather_counts stand_gather_summed(struct stand *stand, double tolerance)
{
    return run(stand, tolerance, GATHER_SUMMED);
}

struct gather_counts stand_gather_convolved(struct stand *stand, double tolerance)
{
    return run(stand, tolerance, GATHER_CONVOLVED);
}

void stand_gather_reference(struct stand *stand)
{
    struct gather gather = gather_of(stand, 0);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, gather_reference(&gather, stand->radiosity, &error),
                                  error.text);
}

struct nacre_material stand_even_material(int size, int window, double reach, double albedo)
{
    struct nacre_material material = {.width = size,
                                      .height = size,
                                      .channels = 1,
                                      .window = window,
                                      .terms = 1,
                                      .clusters = 1,
                                      .mixed = 1,
                                      .layout = NACRE_KERNEL_SINGLE,
                                      .pixel = NACRE_FLOAT,
                                      .factor_channels = 1,
                                      .pitch_mm = 0.5,
                                      .method = "made"};
    size_t count = (size_t)size * (size_t)size;
    double sum = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_allocate(&material, false, false, &error), error.text);
    for (int i = 0; i < window * window; i++) {
        int x = i % window - window / 2, y = i / window - window / 2;
        material.kernels[i] = (float)exp(-hypot(x, y) / reach);
        sum += material.kernels[i];
    }
    for (int i = 0; i < window * window; i++) {
        material.kernels[i] = (float)(material.kernels[i] * albedo / sum);
    }
    for (size_t i = 0; i < count; i++) {
        material.f[i] = 1;
        material.weights[i] = 1;
        material.albedo[i] = (float)albedo;
    }
    return material;
}
