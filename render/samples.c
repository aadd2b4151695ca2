/* Stratified surface samples with shadow rays, and photons. */
#include "render/samples.h"

#include "render/effects.h"
#include "render/fresnel.h"
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

/* Samples of a triangle from the start on, at a density. */
static size_t samples_in(double area_mm2, double density)
{
    return density > 0 ? (size_t)fmin(fmax(round(area_mm2 * density), 1), SAMPLES_MAXIMUM) : 0;
}

/* `had`: samples of the surface before those of the list. */
static void fill_triangle(const struct lit_surface *surface, const struct lighting *lighting,
                          irradiance_way *find, size_t triangle, struct light_sample *list,
                          size_t first, size_t end, size_t had, struct light_work *work)
{
    struct vec3 cross = mesh_triangle_cross(surface->mesh, triangle);
    struct vec3 normal = vec3_unit(cross);
    double whole = vec3_length(cross) / 2, area = whole / (double)(end - first);
    size_t before = samples_in(whole, lighting->before);
    for (size_t k = first; k < end; k++) {
        double b1, b2, light[3];
        triangle_point(lighting->seed, triangle, before + k - first, &b1, &b2);
        place(&list[k], surface, triangle, normal, b1, b2);
        const struct lit_point point = {vec3_from(list[k].position), normal, surface->index,
                                        had + k};
        find(lighting, &point, light, work);
        list[k].area_mm2 = (float)area;
        for (int c = 0; c < 3; c++) {
            list[k].flux[c] = (float)(light[c] * area);
        }
    }
}

/* Where each triangle's samples begin; the last entry is their number. Those that came before are counted too. */
static size_t *sample_starts(const struct mesh *mesh, double before, double density,
                             size_t *had_before)
{
    size_t *starts = calloc(mesh->triangle_count + 1, sizeof *starts);
    for (size_t i = 0; starts && i < mesh->triangle_count; i++) {
        double area = vec3_length(mesh_triangle_cross(mesh, i)) / 2;
        size_t had = samples_in(area, before), all = samples_in(area, before + density);
        starts[i + 1] = starts[i] + (all > had ? all - had : 1);
        *had_before += had;
    }
    return starts;
}

int samples_spread(const struct lit_surface *surface, const struct lighting *lighting,
                   double density, struct progress *progress, struct light_samples *samples,
                   struct nacre_error *error)
{
    int status = NACRE_FAILED;
    size_t triangles = surface->mesh->triangle_count;
    size_t had = 0, *starts = sample_starts(surface->mesh, lighting->before, density, &had);
    irradiance_way *find = irradiance_choose(lighting, surface->index);
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
        struct light_work work = {0};
        status = progress_step(progress, (double)begin, (double)triangles, NULL, error);
        if (status != NACRE_OK) {
            goto out;
        }
#pragma omp parallel
        {
            struct light_work own = {0};
#pragma omp for schedule(dynamic, 64)
            for (size_t i = begin; i < end; i++) {
                fill_triangle(surface, lighting, find, i, samples->list, starts[i], starts[i + 1],
                              had, &own);
            }
#pragma omp critical(samples_work)
            light_work_add(&work, &own);
        }
        light_work_add(&samples->work, &work);
    }
    status = NACRE_OK;
out:
    free(starts);
    if (status != NACRE_OK) {
        samples_finish(samples);
    }
    return status;
}

/* Photons of one light, as many as `each` would be of all of it. */
struct shot {
    const struct lit_surface *surface;
    const struct lighting *lighting;
    struct vec3 centre; /* of the sphere that they are sent towards */
    double radius_mm;
    size_t each;
};

/* Keep a photon where it met the surface. */
static void keep(const struct shot *shot, const struct photon *photon, const struct world_hit *hit,
                 struct vec3 normal, struct light_sample *sample, struct light_work *work)
{
    const struct lit_surface *surface = shot->surface;
    double share = 1.0 / (double)shot->each;
    if (RENDER_EFFECTS_BUILT(RENDER_FRESNEL) && surface->index != 1) {
        share *= fresnel_transmitted(surface->index, -vec3_dot(photon->direction, normal));
        work->transmittances++;
    }
    *sample = (struct light_sample){0};
    place(sample, surface, hit->triangle, normal, hit->b1, hit->b2);
    for (int c = 0; c < 3; c++) {
        sample->flux[c] = (float)(photon->flux[c] * share);
    }
}

/* Send the photon on from where it met a surface, by u[2]. Returns whether something is left of it. */
static bool pass_on(const struct lighting *lighting, const struct world_hit *hit,
                    struct vec3 normal, const double u[2], struct photon *photon)
{
    const struct reflector *reflector = &lighting->reflectors[hit->object];
    struct vec3 place = world_place(reflector->mesh, hit);
    double reflectance[3];
    reflector_reflectance(reflector, hit, reflectance);
    photon->direction = vec3_by_cosine(normal, u);
    photon->origin = place;
    for (int c = 0; c < 3; c++) {
        photon->flux[c] *= reflectance[c];
    }
    return photon->flux[0] + photon->flux[1] + photon->flux[2] > 0;
}

/* Follow one photon. Returns how often it was kept, up to bounces + 1 times. */
static int shoot(const struct shot *shot, const struct light *light, uint64_t number,
                 struct light_sample *list, struct light_work *work)
{
    const struct lighting *lighting = shot->lighting;
    const struct reflector *reflectors = lighting->reflectors;
    double u[4];
    int kept = 0;
    struct world_hit hit;
    for (unsigned k = 0; k < 4; k++) {
        u[k] = random_uniform(lighting->seed, number, k);
    }
    struct photon photon = light_emit(light, shot->centre, shot->radius_mm, u);
    work->photons++;
    work->lookups[light->lookup]++;
    if (photon.flux[0] + photon.flux[1] + photon.flux[2] <= 0 ||
        !world_trace(lighting->world, photon.origin, photon.direction, &hit)) {
        return 0;
    }
    for (unsigned bounce = 0;; bounce++) {
        bool ours = hit.object == shot->surface->object;
        if (!ours && !(RENDER_EFFECTS_BUILT(RENDER_BOUNCES) && reflectors)) {
            return kept;
        }
        const struct mesh *mesh = ours ? shot->surface->mesh : reflectors[hit.object].mesh;
        struct vec3 normal = vec3_unit(mesh_triangle_cross(mesh, hit.triangle));
        if (vec3_dot(normal, photon.direction) >= 0) {
            return kept; /* the inner side is dark */
        }
        if (ours) {
            keep(shot, &photon, &hit, normal, &list[kept++], work);
        }
        if (!(RENDER_EFFECTS_BUILT(RENDER_BOUNCES) && reflectors) ||
            bounce == (unsigned)lighting->bounces) {
            return kept;
        }
        u[0] = random_uniform(lighting->seed, number, 4 + 2 * bounce);
        u[1] = random_uniform(lighting->seed, number, 5 + 2 * bounce);
        if (!pass_on(lighting, &hit, normal, u, &photon)) {
            return kept;
        }
        work->bounce_rays++;
        if (!world_look(lighting->world, photon.origin, normal, photon.direction, &hit)) {
            return kept;
        }
    }
}

/* Photons begin to begin + step - 1 into the slots of each, then close the gaps after those that are there already. */
static int shoot_some(const struct shot *shot, size_t begin, size_t step, size_t slots,
                      struct light_sample *landed, int *counts, struct light_samples *samples,
                      struct nacre_error *error)
{
    size_t kept = 0;
#pragma omp parallel
    {
        struct light_work own = {0};
#pragma omp for schedule(dynamic, 1024)
        for (size_t i = 0; i < step; i++) {
            const struct light *light = &shot->lighting->lights[(begin + i) / shot->each];
            counts[i] = shoot(shot, light, begin + i, landed + i * slots, &own);
        }
#pragma omp critical(samples_work)
        light_work_add(&samples->work, &own);
    }
    for (size_t i = 0; i < step; i++) {
        kept += (size_t)counts[i];
    }
    struct light_sample *list =
        realloc(samples->list, (samples->count + kept + 1) * sizeof *samples->list);
    if (!list) {
        return nacre_fail_memory(error, "the photons");
    }
    samples->list = list;
    for (size_t i = 0; i < step; i++) {
        memcpy(list + samples->count, landed + i * slots, (size_t)counts[i] * sizeof *list);
        samples->count += (size_t)counts[i];
    }
    return NACRE_OK;
}

int samples_shoot(const struct lit_surface *surface, const struct lighting *lighting, size_t count,
                  struct progress *progress, struct light_samples *samples,
                  struct nacre_error *error)
{
    int status = NACRE_OK;
    bool bounces = RENDER_EFFECTS_BUILT(RENDER_BOUNCES) && lighting->reflectors;
    size_t each = lighting->light_count ? count / lighting->light_count : 0;
    size_t all = each * lighting->light_count, slots = bounces ? (size_t)lighting->bounces + 1 : 1;
    struct shot shot = {.surface = surface, .lighting = lighting, .each = each};
    struct light_sample *landed = calloc(PHOTONS_A_STEP * slots, sizeof *landed);
    int *counts = calloc(PHOTONS_A_STEP, sizeof *counts);
    *samples = (struct light_samples){0};
    samples->list = calloc(1, sizeof *samples->list);
    if (!landed || !counts || !samples->list) {
        status = nacre_fail_memory(error, "the photons");
    }
    if (bounces) { /* whatever they meet may pass them on to the surface */
        world_bounds(lighting->world, &shot.centre, &shot.radius_mm);
    } else {
        world_sphere(&surface->mesh, 1, &shot.centre, &shot.radius_mm);
    }
    for (size_t begin = 0; status == NACRE_OK && begin < all; begin += PHOTONS_A_STEP) {
        size_t step = all - begin < PHOTONS_A_STEP ? all - begin : PHOTONS_A_STEP;
        status = progress_step(progress, (double)begin, (double)all, NULL, error);
        if (status == NACRE_OK) {
            status = shoot_some(&shot, begin, step, slots, landed, counts, samples, error);
        }
    }
    free(landed);
    free(counts);
    if (status != NACRE_OK) {
        samples_finish(samples);
    }
    return status;
}
