/* What `--within` and `--error` promise of a scene's picture against what it took and the light's true error: printed. */
#include "timing.h"

#include "base/clock.h"
#include "render/refine.h"
#include "render/render.h"
#include "render/stage.h"
#include "render/stage_refine.h"
#include "tests/nacre/scratch.h"
#include "tests/render/stand.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static const double reference_density = 60; /* samples to a surface point */

static struct nacre_error error;
static struct clock the_clock;

static void check(int status)
{
    if (status != NACRE_OK) {
        fail(error.text);
    }
}

static struct render_settings settings_of(const char *material, const struct refine_goal *goal)
{
    return (struct render_settings){.bake = {.rays = 8, .seed = 1, .quiet = true},
                                    .triangle_limit = 600000,
                                    .material = material,
                                    .goal = goal};
}

/* A whole picture by a time, on the wall's clock from reading the scene on. */
static void keep_time(const char *path, const char *material, const struct opencl *opencl,
                      double seconds)
{
    const struct refine_goal goal = {1, seconds, &the_clock, clock_now_ns(&the_clock)};
    const struct render_settings settings = settings_of(material, &goal);
    struct scene scene = {0};
    struct picture picture = {0};
    struct render_report report = {0};
    check(scene_read(path, &scene, &error));
    check(render_scene(&scene, &settings, opencl, &picture, &report, &error));
    double taken = refine_seconds(&goal);
    printf("  within %5.0f s: %6.1f s taken (%3.0f %%), %d steps%s, error told %.2f %%, %s\n",
           seconds, taken, 100 * taken / seconds, report.refine.count,
           report.refine.cut ? " and one given up" : "", 100 * report.refine.error,
           taken <= seconds ? "held" : "missed");
    picture_finish(&picture);
    render_report_finish(&report);
    scene_finish(&scene);
}

static int no_closing(void *context, double *seconds, struct nacre_error *e)
{
    (void)context;
    (void)e;
    *seconds = 1;
    return NACRE_OK;
}

/* The first object's light, by a goal or by so many samples that it can be compared with. Free it. */
static float *light_of(const char *path, const char *material, const struct opencl *opencl,
                       const struct refine_goal *goal, struct render_report *report, size_t *count)
{
    struct render_settings settings = settings_of(material, goal);
    struct scene scene = {0};
    struct stage stage = {0};
    settings.bake.density = reference_density;
    settings.bake.tolerance = 2e-4;
    settings.bake.seed = goal ? 1 : 12345;
    check(scene_read(path, &scene, &error));
    check(stage_prepare(&stage, &scene, &settings, report, &error));
    check(goal ? stage_bake_refined(&stage, opencl, no_closing, NULL, report, &error)
               : stage_bake(&stage, opencl, report, &error));
    *count = 3 * stage.objects[0].mesh.vertex_count;
    float *light = allocate(*count * sizeof *light);
    memcpy(light, stage.objects[0].light, *count * sizeof *light);
    stage_finish(&stage);
    scene_finish(&scene);
    return light;
}

static void keep_error(const char *path, const char *material, const struct opencl *opencl,
                       double wanted, const float *reference)
{
    const struct refine_goal goal = {wanted, 0, &the_clock, clock_now_ns(&the_clock)};
    struct render_report report = {0};
    size_t count;
    double square = 0, sum = 0;
    struct moment begun = timing_now();
    float *light = light_of(path, material, opencl, &goal, &report, &count);
    double seconds = timing_since(begun).processor;
    for (size_t i = 0; i < count; i++) {
        square += ((double)light[i] - reference[i]) * ((double)light[i] - reference[i]);
        sum += (double)reference[i] * reference[i];
    }
    printf("  error %5.2f %%: %5.2f %% told (noise %.2f %%, summing up %.2f %%), %5.2f %% against "
           "%.0f samples a "
           "surface point, %d steps, %.1f processor seconds of light\n",
           100 * wanted, 100 * report.refine.error, 100 * report.refine.noise,
           100 * report.refine.bias, 100 * sqrt(square / sum), reference_density,
           report.refine.count, seconds);
    free(light);
    render_report_finish(&report);
}

void setUp(void)
{
}

void tearDown(void)
{
}

int main(int argc, char **argv)
{
    static const double times[] = {10, 20, 40}, errors[] = {0.03, 0.01};
    struct opencl opencl = {0};
    struct nacre_material material = stand_even_material(12, 5, 1.2, 0.6);
    the_clock = clock_monotonic();
    (void)setvbuf(stdout, NULL, _IOLBF, 0);
    scratch_make();
    if (nacre_material_write(scratch_path("material.exr"), &material, &error) != NACRE_OK ||
        opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        fail(error.text);
    }
    char *path = strdup(scratch_path("material.exr"));
    for (int i = 1; path && i < argc; i++) {
        struct render_report report = {0};
        size_t count;
        printf("%s\n", argv[i]);
        float *reference = light_of(argv[i], path, &opencl, NULL, &report, &count);
        render_report_finish(&report);
        for (size_t k = 0; k < sizeof errors / sizeof *errors; k++) {
            keep_error(argv[i], path, &opencl, errors[k], reference);
        }
        for (size_t k = 0; k < sizeof times / sizeof *times; k++) {
            keep_time(argv[i], path, &opencl, times[k]);
        }
        free(reference);
    }
    free(path);
    opencl_close(&opencl);
    nacre_material_finish(&material);
    scratch_remove();
    return EXIT_SUCCESS;
}
