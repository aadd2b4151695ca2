/* Calculates the light of a scene and prints what tells two builds of the renderer apart: the light's hash and the work
 * that was done for each effect. tests/render/effects_cost.py runs it; with `light` it leaves the gather out and runs
 * under callgrind, which counts take_light alone. Usage: probe_effects SCENE all|light */
#include "render/stage.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

__attribute__((noinline, noclone)) static int take_light(struct stage *stage,
                                                         const struct opencl *opencl,
                                                         struct render_report *report,
                                                         struct nacre_error *error)
{
    return stage_bake(stage, opencl, report, error);
}

static uint64_t hash_light(const struct stage *stage)
{
    uint64_t hash = 14695981039346656037U; /* FNV-1a */
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        const struct stage_object *object = &stage->objects[i];
        const unsigned char *bytes = (const unsigned char *)object->light;
        size_t size = bytes ? object->mesh.vertex_count * sizeof *object->light : 0;
        for (size_t k = 0; k < size; k++) {
            hash = (hash ^ bytes[k]) * 1099511628211U;
        }
    }
    return hash;
}

static void print(const struct stage *stage, const struct render_report *report)
{
    struct light_work work = {0};
    struct gather_counts gather = {0};
    for (size_t i = 0; i < report->object_count; i++) {
        const struct bake_counts *counts = &report->objects[i].counts;
        light_work_add(&work, &counts->work);
        gather.receivers += counts->gather.receivers;
        gather.samples += counts->gather.samples;
        gather.points += counts->gather.points;
        gather.squares += counts->gather.squares;
    }
    printf("shadows: %" PRIu64 "\n", work.shadow_rays);
    printf("projected picture: %" PRIu64 "\n", work.lookups[LOOKUP_SLIDE]);
    printf("environment: %" PRIu64 "\n", work.lookups[LOOKUP_SKY]);
    printf("interreflection: %" PRIu64 "\n", work.bounce_rays);
    printf("Fresnel transmission: %" PRIu64 "\n", work.transmittances);
    printf("subsurface scattering: %" PRIu64 "\n", gather.receivers);
    printf("gathered samples: %" PRIu64 "\n", gather.samples);
    printf("gathered points: %" PRIu64 "\n", gather.points);
    printf("gathered squares: %" PRIu64 "\n", gather.squares);
    printf("light: %016" PRIx64 "\n", hash_light(stage));
}

int main(int count, char **arguments)
{
    struct nacre_error error = {0};
    struct scene scene = {0};
    struct stage stage = {0};
    struct opencl opencl = {0};
    struct render_report report = {0};
    const struct render_settings settings = {
        .bake = {.density = 3, .rays = 4, .seed = 1, .quiet = true}, .triangle_limit = 200};
    if (count != 3) {
        (void)fprintf(stderr, "usage: %s SCENE all|light\n", arguments[0]);
        return 2;
    }
    bool all = strcmp(arguments[2], "all") == 0;
    int status = scene_read(arguments[1], &scene, &error);
    if (status == NACRE_OK) {
        status = stage_prepare(&stage, &scene, &settings, &report, &error);
    }
    for (size_t i = 0; status == NACRE_OK && !all && i < scene.object_count; i++) {
        stage.effects.objects[i].subsurface = false;
    }
    if (status == NACRE_OK && all) {
        status = opencl_open(NULL, &opencl, &error);
    }
    if (status == NACRE_OK) {
        status = take_light(&stage, &opencl, &report, &error);
    }
    if (status == NACRE_OK) {
        print(&stage, &report);
    } else {
        (void)fprintf(stderr, "%s\n", error.text);
    }
    opencl_close(&opencl);
    render_report_finish(&report);
    stage_finish(&stage);
    scene_finish(&scene);
    return status == NACRE_OK ? 0 : 1;
}
