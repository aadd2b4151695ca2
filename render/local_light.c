/* Averaging light samples around vertices, through a hash of cubes. */
#include "render/local_light.h"

#include "render/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct hash {
    size_t mask;
    uint32_t *starts; /* [mask + 2] */
    uint32_t *order;  /* samples by bucket */
    double side_mm;
};

struct cube {
    int64_t x, y, z;
};

static struct cube cube_of(const float p[3], double side)
{
    return (struct cube){(int64_t)floor(p[0] / side), (int64_t)floor(p[1] / side),
                         (int64_t)floor(p[2] / side)};
}

static size_t bucket_of(const struct hash *hash, struct cube cube)
{
    uint64_t mixed = random_mix((uint64_t)cube.x * UINT64_C(0x9e3779b97f4a7c15) ^
                                (uint64_t)cube.y * UINT64_C(0xc2b2ae3d27d4eb4f) ^
                                (uint64_t)cube.z * UINT64_C(0x165667b19e3779f9));
    return (size_t)mixed & hash->mask;
}

static int hash_make(struct hash *hash, const struct light_samples *samples, double side_mm,
                     struct nacre_error *error)
{
    *hash = (struct hash){.mask = 1023, .side_mm = side_mm};
    while (hash->mask < samples->count / 4) {
        hash->mask = 2 * hash->mask + 1;
    }
    hash->starts = calloc(hash->mask + 3, sizeof *hash->starts);
    hash->order = calloc(samples->count + 1, sizeof *hash->order);
    if (!hash->starts || !hash->order) {
        return nacre_fail_memory(error, "looking up the light samples");
    }
    for (size_t i = 0; i < samples->count; i++) {
        hash->starts[bucket_of(hash, cube_of(samples->list[i].position, side_mm)) + 2]++;
    }
    for (size_t i = 2; i <= hash->mask + 2; i++) {
        hash->starts[i] += hash->starts[i - 1];
    }
    for (size_t i = 0; i < samples->count; i++) {
        size_t bucket = bucket_of(hash, cube_of(samples->list[i].position, side_mm));
        hash->order[hash->starts[bucket + 1]++] = (uint32_t)i;
    }
    return NACRE_OK;
}

/* What lies around one vertex. */
struct around {
    double flux[3], area; /* weighted by the cone */
    double nearest_square;
    const struct light_sample *nearest;
};

static void look_into(const struct hash *hash, const struct light_samples *samples,
                      struct cube cube, const float position[3], const float normal[3],
                      double radius, struct around *around)
{
    size_t bucket = bucket_of(hash, cube);
    for (size_t i = hash->starts[bucket]; i < hash->starts[bucket + 1]; i++) {
        const struct light_sample *sample = &samples->list[hash->order[i]];
        struct cube own = cube_of(sample->position, hash->side_mm);
        double square = 0, facing = 0;
        if (own.x != cube.x || own.y != cube.y || own.z != cube.z) {
            continue; /* another cube in the same bucket */
        }
        for (int k = 0; k < 3; k++) {
            double away = (double)sample->position[k] - position[k];
            square += away * away;
            facing += (double)sample->normal[k] * normal[k];
        }
        if (facing <= 0) {
            continue;
        }
        if (square < around->nearest_square) {
            around->nearest_square = square;
            around->nearest = sample;
        }
        double weight = 1 - sqrt(square) / radius;
        for (int c = 0; weight > 0 && c < 3; c++) {
            around->flux[c] += weight * sample->flux[c];
        }
        around->area += weight > 0 ? weight * sample->area_mm2 : 0;
    }
}

static void at_vertex(const struct hash *hash, const struct light_samples *samples,
                      const float position[3], const float normal[3], double radius, float out[3])
{
    struct around around = {.nearest_square = HUGE_VAL};
    struct cube middle = cube_of(position, hash->side_mm);
    for (int k = 0; k < 27; k++) {
        struct cube cube = {middle.x + k % 3 - 1, middle.y + k / 3 % 3 - 1, middle.z + k / 9 - 1};
        look_into(hash, samples, cube, position, normal, radius, &around);
    }
    /* Samples that carry no area are photons: over the cone's own integral, pi r^2 / 3. */
    double area = around.nearest && around.nearest->area_mm2 > 0 ? around.area
                                                                 : acos(-1.0) * radius * radius / 3;
    for (int c = 0; c < 3; c++) {
        if (area > 0) {
            out[c] = (float)(around.flux[c] / area);
        } else {
            out[c] = around.nearest ? around.nearest->flux[c] / around.nearest->area_mm2 : 0;
        }
    }
}

int local_light(const struct mesh *mesh, const struct light_samples *samples, double radius_mm,
                float (*irradiance)[3], struct nacre_error *error)
{
    struct hash hash;
    int status = hash_make(&hash, samples, radius_mm, error);
    if (status == NACRE_OK) {
#pragma omp parallel for schedule(dynamic, 256)
        for (size_t i = 0; i < mesh->vertex_count; i++) {
            at_vertex(&hash, samples, mesh->positions[i], mesh->normals[i], radius_mm,
                      irradiance[i]);
        }
    }
    free(hash.starts);
    free(hash.order);
    return status;
}
