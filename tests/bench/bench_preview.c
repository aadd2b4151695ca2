/* How many previews a second OpenGL draws in memory: a turntable of the examples' knot, without writing files. */
#include "timing.h"

#include "render/render.h"
#include "tests/nacre/scratch.h"
#include "tests/render/stand.h"

#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

enum { FRAMES = 24 };

struct frames {
    struct moment begun; /* behind the first frame, which also compiles */
    int count;
};

static struct nacre_error error;

static int take(void *context, int number, const struct picture *picture, struct nacre_error *e)
{
    struct frames *frames = context;
    (void)picture;
    (void)e;
    if (number == 0) {
        frames->begun = timing_now();
    }
    frames->count = number;
    return NACRE_OK;
}

static void run(const char *path, const char *material, const struct opencl *opencl)
{
    struct scene scene = {0};
    struct render_report report = {0};
    struct frames frames = {0};
    const struct render_settings settings = {
        .bake = {.density = 0.5, .rays = 4, .seed = 1, .quiet = true},
        .triangle_limit = 600000,
        .material = material,
        .turns = true};
    if (scene_read(path, &scene, &error) != NACRE_OK ||
        render_preview(&scene, &settings, opencl, FRAMES + 1, take, &frames, &report, &error) !=
            NACRE_OK) {
        fail(error.text);
    }
    struct moment taken = timing_since(frames.begun);
    size_t triangles = 0;
    for (size_t i = 0; i < report.object_count; i++) {
        triangles += report.objects[i].triangles;
    }
    printf("%s: %d x %d, %zu triangles: %.1f frames a second, %.3f processor seconds a frame\n",
           path, scene.image.width, scene.image.height, triangles, frames.count / taken.wall,
           taken.processor / frames.count);
    render_report_finish(&report);
    scene_finish(&scene);
}

void setUp(void)
{
}

void tearDown(void)
{
}

int main(int argc, char **argv)
{
    struct opencl opencl = {0};
    struct nacre_material material = stand_even_material(12, 5, 1.2, 0.6);
    scratch_make();
    if (nacre_material_write(scratch_path("material.exr"), &material, &error) != NACRE_OK ||
        opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        fail(error.text);
    }
    for (int i = 1; i < argc; i++) {
        run(argv[i], scratch_path("material.exr"), &opencl);
    }
    opencl_close(&opencl);
    nacre_material_finish(&material);
    scratch_remove();
    return EXIT_SUCCESS;
}
