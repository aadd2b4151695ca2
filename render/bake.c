/* Light samples, local light and the gather, put together. */
#include "render/bake.h"

#include "base/clock.h"
#include "render/grey.h"
#include "render/local_light.h"
#include "render/receivers.h"

#include <math.h>
#include <stdlib.h>

static double seconds_since(int64_t start_ns)
{
    struct clock clock = clock_monotonic();
    return (double)(clock_now_ns(&clock) - start_ns) * 1e-9;
}

static int64_t now_ns(void)
{
    struct clock clock = clock_monotonic();
    return clock_now_ns(&clock);
}

static int sample_light(const struct lit_surface *surface, const struct lighting *lights,
                        const struct bake_settings *settings, struct light_samples *samples,
                        struct nacre_error *error)
{
    struct progress progress = progress_begin("lighting", settings->quiet);
    progress.deadline = settings->deadline;
    double point = surface->mapping->point_mm;
    struct lighting own = *lights, *lighting = &own;
    own.before = settings->before / (point * point);
    int status =
        settings->photons > 0 && lighting->light_count > 0
            ? samples_shoot(surface, lighting, settings->photons, &progress, samples, error)
            : samples_spread(surface, lighting, settings->density / (point * point), &progress,
                             samples, error);
    progress_end(&progress);
    return status;
}

/* Light that leaves where it fell, by the plane of reflectances. */
static int add_local(const struct mesh *mesh, const struct mapping *mapping,
                     const struct light_samples *samples, const float *plane,
                     const struct bake_settings *settings, float (*radiosity)[3],
                     struct nacre_error *error)
{
    struct progress progress = progress_begin("lighting", settings->quiet);
    progress.deadline = settings->deadline;
    float(*irradiance)[3] = calloc(mesh->vertex_count + 1, sizeof *irradiance);
    if (!irradiance) {
        return nacre_fail_memory(error, "the light on the mesh");
    }
    int status = local_light(mesh, samples, mapping->point_mm, &progress, irradiance, error);
    progress_end(&progress);
    for (size_t i = 0; status == NACRE_OK && i < mesh->vertex_count; i++) {
        double reflectance[3];
        receivers_lookup(mesh, mapping, i, plane, reflectance);
        for (int c = 0; c < 3; c++) {
            radiosity[i][c] += (float)(reflectance[c] * irradiance[i][c]);
        }
    }
    free(irradiance);
    return status;
}

static int add_albedo(const struct mesh *mesh, const struct mapping *mapping,
                      const struct appearance *appearance, const struct light_samples *samples,
                      const struct bake_settings *settings, float (*radiosity)[3],
                      struct nacre_error *error)
{
    float *albedo =
        calloc((size_t)appearance->width * (size_t)appearance->height * 3, sizeof *albedo);
    if (!albedo) {
        return nacre_fail_memory(error, "the material's albedo");
    }
    appearance_albedo(appearance, mapping->mirror, albedo);
    int status = add_local(mesh, mapping, samples, albedo, settings, radiosity, error);
    free(albedo);
    return status;
}

static int check_finite(const struct mesh *mesh, float (*radiosity)[3], struct nacre_error *error)
{
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (int c = 0; c < 3; c++) {
            if (!isfinite(radiosity[i][c])) {
                return nacre_fail(error, "the light that leaves vertex %zu is not finite", i);
            }
            radiosity[i][c] = fmaxf(radiosity[i][c], 0); /* rounding alone can make it negative */
        }
    }
    return NACRE_OK;
}

/* Light that leaves elsewhere than it fell. */
static int add_gathered(const struct gather *gather, const struct opencl *opencl,
                        const struct bake_settings *settings, float (*radiosity)[3],
                        struct gather_counts *counts, struct nacre_error *error)
{
    size_t vertices = gather->mesh->vertex_count;
    bool packed = gather->appearance->packed;
    float(*gathered)[3] = packed ? calloc(vertices + 1, sizeof *gathered) : radiosity;
    if (!gathered) {
        return nacre_fail_memory(error, "the light on the mesh");
    }
    struct progress progress = progress_begin("gathering", settings->quiet);
    progress.deadline = settings->deadline;
    int status = gather_run(gather, opencl, &progress, gathered, counts, error);
    progress_end(&progress);
    if (packed) {
        grey_unpack(gathered, vertices, radiosity);
        free(gathered);
    }
    return status;
}

static void count(const struct light_samples *samples, const struct gather_counts *gather,
                  struct bake_counts *counts)
{
    counts->samples += samples->count;
    for (size_t i = 0; i < samples->count; i++) {
        const float *flux = samples->list[i].flux;
        counts->lit += flux[0] > 0 || flux[1] > 0 || flux[2] > 0;
    }
    light_work_add(&counts->work, &samples->work);
    counts->gather.receivers += gather->receivers;
    counts->gather.samples += gather->samples;
    counts->gather.points += gather->points;
    counts->gather.squares += gather->squares;
    counts->gather.posts += gather->posts;
    counts->gather.convolved += gather->convolved;
    counts->gather.error = fmax(counts->gather.error, gather->error);
}

int bake_object(const struct lit_surface *surface, const struct appearance *appearance,
                const struct render_object_effects *effects, const struct lighting *lighting,
                const struct opencl *opencl, const struct bake_settings *settings,
                float (*radiosity)[3], struct bake_counts *counts, struct nacre_error *error)
{
    const struct mesh *mesh = surface->mesh;
    const struct mapping *mapping = surface->mapping;
    struct light_samples samples = {0};
    struct gather_counts gathered = {0};
    int64_t start = now_ns();
    int status = sample_light(surface, lighting, settings, &samples, error);
    if (status == NACRE_OK && effects->albedo) {
        status = add_albedo(mesh, mapping, appearance, &samples, settings, radiosity, error);
    } else if (status == NACRE_OK && RENDER_EFFECTS_BUILT(RENDER_LOCAL) && effects->local) {
        status = add_local(mesh, mapping, &samples, appearance->local, settings, radiosity, error);
    }
    counts->light_seconds += seconds_since(start);
    start = now_ns();
    if (status == NACRE_OK && RENDER_EFFECTS_BUILT(RENDER_SUBSURFACE) && effects->subsurface) {
        struct gather gather = {mesh,
                                mapping,
                                appearance,
                                &samples,
                                effects->same_side,
                                settings->tolerance > 0 ? settings->tolerance : BAKE_TOLERANCE,
                                GATHER_SOONEST,
                                surface->kept};
        status = add_gathered(&gather, opencl, settings, radiosity, &gathered, error);
        counts->products = 3 * (size_t)appearance->terms;
    }
    counts->gather_seconds += seconds_since(start);
    if (status == NACRE_OK) {
        status = check_finite(mesh, radiosity, error);
    }
    count(&samples, &gathered, counts);
    samples_finish(&samples);
    return status;
}
