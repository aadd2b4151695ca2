/* Making materials for tests. */
#include "made_material.h"

#include <stdlib.h>
#include <string.h>
#include <unity.h>

static void fill(float *values, size_t count, uint32_t *state)
{
    for (size_t i = 0; values && i < count; i++) {
        *state = *state * 1664525u + 1013904223u;
        values[i] = (float)((*state >> 8) + 1) / 16777216.0f;
    }
}

/* Ids that differ at each point, weights that sum to 1. */
static void fill_clusters(struct nacre_material *material)
{
    size_t points = (size_t)material->width * (size_t)material->height;
    float sum = (float)(material->mixed * (material->mixed + 1)) / 2;
    for (size_t i = 0; i < points; i++) {
        for (int m = 0; m < material->mixed; m++) {
            material->ids[(size_t)m * points + i] =
                (uint32_t)((i / 3 + (size_t)m) % (size_t)material->clusters);
            material->weights[(size_t)m * points + i] = (float)(m + 1) / sum;
        }
    }
}

struct nacre_material made_material(struct made_material wanted)
{
    bool per_term = wanted.layout == NACRE_KERNEL_PER_TERM;
    struct nacre_error error = {0};
    struct nacre_material material = {
        .width = 11,
        .height = 9,
        .channels = wanted.channels,
        .window = 5,
        .terms = 3,
        .clusters = per_term ? 0 : 4,
        .mixed = per_term ? 0 : wanted.mixed,
        .layout = wanted.layout,
        .pixel = wanted.pixel,
        .factor_channels = wanted.factor_channels,
        .pitch_mm = 0.25,
        .epsilon = 0.125,
        .iterations = 17,
        .seed = -3,
        .method = "hals",
        .error_min = 0.25,
        .error_mean = 0.5,
        .error_max = 0.75,
    };
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_allocate(&material, wanted.with_h, wanted.with_centre, &error),
        error.text);
    uint32_t state = 1;
    size_t points = (size_t)material.width * (size_t)material.height;
    size_t factors = 3 * (size_t)material.factor_channels * points;
    fill(material.albedo, (size_t)material.channels * points, &state);
    fill(material.f, factors, &state);
    fill(material.h, factors, &state);
    fill(material.kernels,
         (size_t)nacre_material_kernel_count(&material) * (size_t)material.channels * 25, &state);
    fill(material.centre, (size_t)material.channels * points, &state);
    fill_clusters(&material);
    return material;
}
