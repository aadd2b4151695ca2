/* Stratified surface samples with shadow rays, and photons. */
#include "render/samples.h"

#include "render/irradiance.h"
#include "render/random.h"

#include <stdlib.h>
#include <string.h>

enum { SAMPLES_MAXIMUM = 100000000, TRIANGLES_A_STEP = 4096, PHOTONS_A_STEP = 65536 };

void samples_finish(struct light_samples *samples)
{
    free(samples->list);
    *samples = (struct light_samples){0};
}

static struct vec3 corner(const struct mesh *mesh, size_t triangle, int k)
{
    return vec3_from(mesh->positions[mesh->triangles[triangle][k]]);
}

static struct vec3 triangle_cross(const struct mesh *mesh, size_t triangle)
{
    struct vec3 a = corner(mesh, triangle, 0);
    return vec3_cross(vec3_subtract(corner(mesh, triangle, 1), a),
                      vec3_subtract(corner(mesh, triangle, 2), a));
}

/* Fill in where a sample lies. */
static void place(struct light_sample *sample, const struct lit_surface *surface, size_t triangle,
                  struct vec3 normal, double b1, double b2)
{
    const struct mesh *mesh = surface->mesh;
    const struct mapping *mapping = surface->mapping;
    struct vec3 p = vec3_scale(corner(mesh, triangle, 0), 1 - b1 - b2);
    p = vec3_along(vec3_along(p, b1, corner(mesh, triangle, 1)), b2, corner(mesh, triangle, 2));
    struct mapped chart = mapping_inside(mapping, mesh, triangle, b1, b2);
    int column = mapping_wrap((int64_t)floor(chart.x), mapping->width, mapping->mirror);
    int row = mapping_wrap((int64_t)floor(chart.y), mapping->height, mapping->mirror);
    vec3_store(p, sample->position);
    vec3_store(normal, sample->normal);
    sample->x = (float)chart.x;
    sample->y = (float)chart.y;
    sample->chart = chart.chart;
    sample->texel = (uint32_t)row * (uint32_t)mapping->width + (uint32_t)column;
}

/* Number k of a sequence that fills the unit square evenly (Roberts' R2), moved by a shift of its own for each
 * triangle, folded into barycentric weights. */
static void triangle_point(uint64_t seed, size_t triangle, size_t k, double *b1, double *b2)
{
    double u = random_uniform(seed, triangle, UINT64_MAX) + (double)(k + 1) * 0.7548776662466927;
    double v =
        random_uniform(seed, triangle, UINT64_MAX - 1) + (double)(k + 1) * 0.5698402909980532;
    u -= floor(u);
    v -= floor(v);
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    *b1 = u;
    *b2 = v;
}

static uint64_t fill_triangle(const struct lit_surface *surface, const struct world *world,
                              const struct light *lights, size_t light_count, size_t triangle,
                              int rays, uint64_t seed, struct light_sample *list, size_t first,
                              size_t end)
{
    struct vec3 cross = triangle_cross(surface->mesh, triangle);
    struct vec3 normal = vec3_unit(cross);
    double area = vec3_length(cross) / 2 / (double)(end - first);
    uint64_t cast = 0;
    for (size_t k = first; k < end; k++) {
        double b1, b2, light[3];
        triangle_point(seed, triangle, k - first, &b1, &b2);
        place(&list[k], surface, triangle, normal, b1, b2);
        cast += irradiance_at(world, lights, light_count, vec3_from(list[k].position), normal, rays,
                              seed ^ UINT64_C(0x5bd1e995), k, light);
        list[k].area_mm2 = (float)area;
        for (int c = 0; c < 3; c++) {
            list[k].flux[c] = (float)(light[c] * area);
        }
    }
    return cast;
}

/* Where each triangle's samples begin; the last entry is their number. */
static size_t *sample_starts(const struct mesh *mesh, double density)
{
    size_t *starts = calloc(mesh->triangle_count + 1, sizeof *starts);
    for (size_t i = 0; starts && i < mesh->triangle_count; i++) {
        double count = round(vec3_length(triangle_cross(mesh, i)) / 2 * density);
        count = fmin(fmax(count, 1), SAMPLES_MAXIMUM);
        starts[i + 1] = starts[i] + (size_t)count;
    }
    return starts;
}

int samples_spread(const struct lit_surface *surface, const struct world *world,
                   const struct light *lights, size_t light_count, double density, int rays,
                   uint64_t seed, struct progress *progress, struct light_samples *samples,
                   struct nacre_error *error)
{
    int status = NACRE_FAILED;
    size_t triangles = surface->mesh->triangle_count;
    size_t *starts = sample_starts(surface->mesh, density);
    *samples = (struct light_samples){0};
    if (!starts) {
        (void)nacre_fail_memory(error, "the light samples");
        goto out;
    }
    samples->count = starts[triangles];
    if (samples->count > SAMPLES_MAXIMUM) {
        (void)nacre_fail(error,
                         "the surface needs %zu light samples, more than the limit of %d; lower "
                         "--samples or make the object smaller",
                         samples->count, SAMPLES_MAXIMUM);
        goto out;
    }
    samples->list = calloc(samples->count + 1, sizeof *samples->list);
    if (!samples->list) {
        (void)nacre_fail_memory(error, "the light samples");
        goto out;
    }
    for (size_t begin = 0; begin < triangles; begin += TRIANGLES_A_STEP) {
        size_t end = begin + TRIANGLES_A_STEP < triangles ? begin + TRIANGLES_A_STEP : triangles;
        uint64_t cast = 0;
        status = progress_step(progress, (double)begin, (double)triangles, NULL, error);
        if (status != NACRE_OK) {
            goto out;
        }
#pragma omp parallel for schedule(dynamic, 64) reduction(+ : cast)
        for (size_t i = begin; i < end; i++) {
            cast += fill_triangle(surface, world, lights, light_count, i, rays, seed, samples->list,
                                  starts[i], starts[i + 1]);
        }
        samples->rays += cast;
    }
    status = NACRE_OK;
out:
    free(starts);
    if (status != NACRE_OK) {
        samples_finish(samples);
    }
    return status;
}

/* Follow one photon. Returns whether it ended on the surface from its outer side. */
static bool shoot(const struct lit_surface *surface, const struct world *world,
                  const struct light *light, struct vec3 centre, double radius, double share,
                  uint64_t seed, uint64_t number, struct light_sample *sample)
{
    double u[4];
    struct world_hit hit;
    for (unsigned k = 0; k < 4; k++) {
        u[k] = random_uniform(seed, number, k);
    }
    struct photon photon = light_emit(light, centre, radius, u);
    if (photon.flux[0] + photon.flux[1] + photon.flux[2] <= 0 ||
        !world_trace(world, photon.origin, photon.direction, &hit) ||
        hit.object != surface->object) {
        return false;
    }
    struct vec3 normal = vec3_unit(triangle_cross(surface->mesh, hit.triangle));
    if (vec3_dot(normal, photon.direction) >= 0) {
        return false;
    }
    *sample = (struct light_sample){0};
    place(sample, surface, hit.triangle, normal, hit.b1, hit.b2);
    for (int c = 0; c < 3; c++) {
        sample->flux[c] = (float)(photon.flux[c] * share);
    }
    return true;
}

int samples_shoot(const struct lit_surface *surface, const struct world *world,
                  const struct light *lights, size_t light_count, size_t count, uint64_t seed,
                  struct progress *progress, struct light_samples *samples,
                  struct nacre_error *error)
{
    int status = NACRE_FAILED;
    struct vec3 centre;
    double radius;
    size_t each = light_count ? count / light_count : 0, kept = 0;
    bool *landed = calloc(PHOTONS_A_STEP, sizeof *landed);
    *samples = (struct light_samples){.rays = each * light_count};
    samples->list = calloc(each * light_count + PHOTONS_A_STEP, sizeof *samples->list);
    if (!landed || !samples->list) {
        (void)nacre_fail_memory(error, "the photons");
        goto out;
    }
    world_sphere(&surface->mesh, 1, &centre, &radius);
    for (size_t begin = 0; begin < each * light_count; begin += PHOTONS_A_STEP) {
        size_t left = each * light_count - begin;
        size_t step = left < PHOTONS_A_STEP ? left : PHOTONS_A_STEP;
        struct light_sample *list = samples->list + kept;
        status = progress_step(progress, (double)begin, (double)(each * light_count), NULL, error);
        if (status != NACRE_OK) {
            goto out;
        }
#pragma omp parallel for schedule(dynamic, 1024)
        for (size_t i = 0; i < step; i++) {
            landed[i] = shoot(surface, world, &lights[(begin + i) / each], centre, radius,
                              1.0 / (double)each, seed, begin + i, &list[i]);
        }
        for (size_t i = 0; i < step; i++) {
            if (landed[i]) {
                samples->list[kept++] = list[i];
            }
        }
    }
    samples->count = kept;
    status = NACRE_OK;
out:
    free(landed);
    if (status != NACRE_OK) {
        samples_finish(samples);
    }
    return status;
}
