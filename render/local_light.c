/* Averaging light samples around vertices, through a hash of cubes. */
#include "render/local_light.h"

#include "render/random.h"

#include <math.h>
#include <stdlib.h>

enum { VERTICES_A_STEP = 8192 /* between two looks at the user */ };

struct hash {
    size_t mask;
    uint32_t *starts; /* [mask + 3] */
    uint32_t *order;  /* samples by bucket */
    uint64_t *cubes;  /* of these: a bucket has some of other cubes, too */
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

/* Cubes above each other have names, and buckets, that follow each other. Mixed twice, as products with x and with y alone
 * would make (1, 1) and (-1, -1) the same. */
static uint64_t name_of(struct cube cube)
{
    uint64_t y = random_mix((uint64_t)cube.y * UINT64_C(0xc2b2ae3d27d4eb4f));
    return random_mix((uint64_t)cube.x * UINT64_C(0x9e3779b97f4a7c15) ^ y) + (uint64_t)cube.z;
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
    hash->cubes = calloc(samples->count + 1, sizeof *hash->cubes);
    uint64_t *names = calloc(samples->count + 1, sizeof *names);
    if (!hash->starts || !hash->order || !hash->cubes || !names) {
        free(names);
        return nacre_fail_memory(error, "looking up the light samples");
    }
    for (size_t i = 0; i < samples->count; i++) {
        names[i] = name_of(cube_of(samples->list[i].position, side_mm));
        hash->starts[((size_t)names[i] & hash->mask) + 2]++;
    }
    for (size_t i = 2; i <= hash->mask + 2; i++) {
        hash->starts[i] += hash->starts[i - 1];
    }
    for (size_t i = 0; i < samples->count; i++) {
        size_t place = hash->starts[((size_t)names[i] & hash->mask) + 1]++;
        hash->order[place] = (uint32_t)i;
        hash->cubes[place] = names[i];
    }
    free(names);
    return NACRE_OK;
}

static void hash_finish(struct hash *hash)
{
    free(hash->starts);
    free(hash->order);
    free(hash->cubes);
}

/* What lies around one vertex. */
struct around {
    double flux[3], area; /* weighted by the cone */
    float nearest_square;
    const struct light_sample *nearest;
};

/* Most samples of a cube are neither within the radius nor the nearest. */
static void look_at(const struct light_sample *sample, const float position[3],
                    const float normal[3], float radius, struct around *around)
{
    float x = sample->position[0] - position[0], y = sample->position[1] - position[1];
    float z = sample->position[2] - position[2], square = x * x + y * y + z * z;
    if (square >= radius * radius && square >= around->nearest_square) {
        return;
    }
    float facing = sample->normal[0] * normal[0] + sample->normal[1] * normal[1] +
                   sample->normal[2] * normal[2];
    if (facing <= 0) {
        return;
    }
    if (square < around->nearest_square) {
        around->nearest_square = square;
        around->nearest = sample;
    }
    double weight = (double)fmaxf(1 - sqrtf(square) / radius, 0);
    for (int c = 0; c < 3; c++) {
        around->flux[c] += weight * (double)sample->flux[c];
    }
    around->area += weight * (double)sample->area_mm2;
}

static void at_vertex(const struct hash *hash, const struct light_samples *samples,
                      const float position[3], const float normal[3], double radius, float out[3])
{
    struct around around = {.nearest_square = HUGE_VALF};
    struct cube middle = cube_of(position, hash->side_mm);
    for (int k = 0; k < 9; k++) {
        struct cube lowest = {middle.x + k % 3 - 1, middle.y + k / 3 - 1, middle.z - 1};
        uint64_t name = name_of(lowest);
        size_t low = (size_t)name & hash->mask, high = (size_t)(name + 2) & hash->mask;
        /* Buckets of three cubes above each other; in two pieces where they begin anew amid them. */
        size_t end = hash->starts[(low < high ? high : hash->mask) + 1];
        size_t rest = low < high ? 0 : hash->starts[high + 1];
        for (size_t i = hash->starts[low]; i < end + rest; i++) {
            size_t place = i < end ? i : i - end;
            if (hash->cubes[place] - name <= 2) {
                look_at(&samples->list[hash->order[place]], position, normal, (float)radius,
                        &around);
            }
        }
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
                struct progress *progress, float (*irradiance)[3], struct nacre_error *error)
{
    struct hash hash;
    size_t count = mesh->vertex_count;
    int status = hash_make(&hash, samples, radius_mm, error);
    for (size_t begin = 0; status == NACRE_OK && begin < count; begin += VERTICES_A_STEP) {
        size_t end = begin + VERTICES_A_STEP < count ? begin + VERTICES_A_STEP : count;
        status = progress_step(progress, (double)begin, (double)count, NULL, error);
        if (status != NACRE_OK) {
            break;
        }
#pragma omp parallel for schedule(dynamic, 256)
        for (size_t i = begin; i < end; i++) {
            at_vertex(&hash, samples, mesh->positions[i], mesh->normals[i], radius_mm,
                      irradiance[i]);
        }
    }
    hash_finish(&hash);
    return status;
}
