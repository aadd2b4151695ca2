/* nacre bake: the light that leaves an object, as a file for other renderers. */
#include "base/opencl.h"
#include "base/progress.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "nacre/whole_file.h"
#include "render/radiance.h"

#include <jansson.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { FRAME_SCENE, FRAME_MESH };

static const char *const frame_words[] = {"scene", "mesh", NULL};

struct bake_options {
    const char *scene, *output, *material;
    double samples, tolerance;
    int object, rays, seed, triangles, texels, padding, frame;
    bool keep;
};

static const struct option_spec options[] = {
    {.name = "scene",
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct bake_options, scene),
     .sentence = "lights, surroundings, and the object with its material"},
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct bake_options, output),
     .writes = true,
     .sentence = "the file to write: .ply holds radiance per vertex, .exr per texel"},
    {.name = "object",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = INT_MAX,
     .fallback = "0",
     .offset = offsetof(struct bake_options, object),
     .sentence = "the scene's object to bake, from 1; 0: the first with a material"},
    {.name = "material",
     .letter = 'm',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct bake_options, material),
     .sentence = "use this material in place of those that the scene names"},
    {.name = "frame",
     .kind = OPTION_CHOICE,
     .words = frame_words,
     .fallback = "scene",
     .offset = offsetof(struct bake_options, frame),
     .sentence = "vertices as placed in the scene, in mm, or as in the mesh's own file"},
    {.name = "keep",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct bake_options, keep),
     .sentence = "keep the mesh's triangles, even those larger than a surface point"},
    {.name = "texels",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = 16384,
     .fallback = "0",
     .offset = offsetof(struct bake_options, texels),
     .sentence = "width of the .exr; 0: a texel is as large as a surface point"},
    {.name = "padding",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = 64,
     .fallback = "4",
     .unit = "texels",
     .offset = offsetof(struct bake_options, padding),
     .sentence = "how far colours go on beyond the borders of charts"},
    {.name = "samples",
     .letter = 's',
     .kind = OPTION_REAL,
     .argument = "N",
     .minimum = 0.01,
     .maximum = 10000,
     .fallback = "12",
     .offset = offsetof(struct bake_options, samples),
     .sentence = "light samples to one surface point of the material"},
    {.name = "rays",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = 4096,
     .fallback = "8",
     .offset = offsetof(struct bake_options, rays),
     .sentence = "shadow rays from each sample to an area light"},
    {.name = "tolerance",
     .kind = OPTION_REAL,
     .argument = "SHARE",
     .minimum = 1e-9,
     .maximum = 0.1,
     .fallback = "0.2 %",
     .offset = offsetof(struct bake_options, tolerance),
     .sentence = "error that summing up far light may make; a very small one: none is summed up"},
    {.name = "triangles",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = MESH_TRIANGLES_MAXIMUM,
     .fallback = "600000",
     .offset = offsetof(struct bake_options, triangles),
     .sentence = "do not split a mesh's edges into more triangles than this"},
    {.name = "seed",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = INT_MAX,
     .fallback = "1",
     .offset = offsetof(struct bake_options, seed),
     .sentence = "of the random numbers"},
    {0}};

/* What run() holds. */
struct work {
    const struct bake_options *settings;
    struct scene scene;
    struct opencl opencl;
    struct stage stage;
    struct render_report report;
    struct radiance radiance;
    struct texel_counts texels;
    struct picture picture;
    char *comments[4];
    size_t object;
};

static bool ends_with(const char *path, const char *ending)
{
    const char *dot = strrchr(path, '.');
    return dot && strcasecmp(dot, ending) == 0;
}

static int check_output(const char *path, struct nacre_error *error)
{
    struct whole_file probe = {0};
    if (!ends_with(path, ".ply") && !ends_with(path, ".exr")) {
        return nacre_fail(error, "%s: what is baked must be named .ply or .exr", path);
    }
    int status = whole_file_create(&probe, path, error);
    whole_file_discard(&probe);
    return status;
}

static int choose_object(struct work *work, struct nacre_error *error)
{
    const struct scene *scene = &work->scene;
    size_t asked = (size_t)work->settings->object;
    if (asked > scene->object_count) {
        return nacre_fail(error, "%s: there is no object %zu: the scene has %zu",
                          work->settings->scene, asked, scene->object_count);
    }
    work->object = asked ? asked - 1 : 0;
    while (!asked && work->object < scene->object_count &&
           !scene->objects[work->object].material.file) {
        work->object++;
    }
    if (work->object == scene->object_count) {
        return nacre_fail(error, "%s: no object has a material, so there is nothing to bake",
                          work->settings->scene);
    }
    if (!scene->objects[work->object].material.file) {
        return nacre_fail(error, "%s:%d: object %zu is plain; give it a material to bake it",
                          work->settings->scene, scene->objects[work->object].line, asked);
    }
    return NACRE_OK;
}

/* Put the mesh in the place of the chosen object's shape. */
static int take_mesh(struct work *work, const char *mesh, struct nacre_error *error)
{
    struct scene_object *object = &work->scene.objects[work->object];
    char *file = strdup(mesh);
    if (!file) {
        return nacre_fail_memory(error, "the name of a mesh");
    }
    free(object->file);
    object->file = file;
    object->shape = SHAPE_MESH;
    return NACRE_OK;
}

static int bake(struct work *work, const struct invocation *invocation, struct nacre_error *error)
{
    const struct bake_options *options_given = work->settings;
    const struct render_settings render = {
        .bake = {.density = options_given->samples,
                 .rays = options_given->rays,
                 .tolerance = options_given->tolerance,
                 .seed = (uint64_t)options_given->seed,
                 .quiet = invocation->quiet},
        .triangle_limit = options_given->keep ? 0 : (size_t)options_given->triangles,
        .material = options_given->material,
        .povray_shadows = true, /* plain objects only cast shadows here */
    };
    int status = stage_prepare(&work->stage, &work->scene, &render, &work->report, error);
    if (status == NACRE_OK) {
        status = stage_bake_object(&work->stage, work->object, &work->opencl, &work->report, error);
    }
    if (status == NACRE_OK) {
        status = radiance_take(&work->radiance, &work->stage, work->object,
                               options_given->frame == FRAME_MESH, error);
    }
    return status == NACRE_FAILED ? nacre_fail_within(error, "%s", options_given->scene) : status;
}

/* What the file says of itself. */
static int make_comments(struct work *work, struct nacre_error *error)
{
    const struct bake_options *settings = work->settings;
    const char *const unit =
        "radiance=linear, in the unit of the scene's irradiance per steradian; "
        "white under irradiance 1 has 1/pi; without the scene's exposure";
    if (asprintf(&work->comments[0], "scene=%s", settings->scene) < 0) {
        work->comments[0] = NULL;
    }
    if (asprintf(&work->comments[1], "bake=object %zu, samples %g, rays %d, seed %d",
                 work->object + 1, settings->samples, settings->rays, settings->seed) < 0) {
        work->comments[1] = NULL;
    }
    work->comments[2] = strdup(unit);
    return work->comments[0] && work->comments[1] && work->comments[2]
               ? NACRE_OK
               : nacre_fail_memory(error, "what a baked file says of itself");
}

static int write_output(struct work *work, struct nacre_error *error)
{
    const struct bake_options *settings = work->settings;
    const char *const *comments = (const char *const *)work->comments;
    if (make_comments(work, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (ends_with(settings->output, ".ply")) {
        return radiance_write_ply(settings->output, &work->radiance, comments, error);
    }
    int width = settings->texels ? settings->texels : radiance_texel_width(&work->radiance);
    if (radiance_draw_texels(&work->radiance, width, settings->padding, &work->picture,
                             &work->texels, error) != NACRE_OK) {
        return nacre_fail_within(error, "object %zu", work->object + 1);
    }
    return radiance_write_exr(settings->output, &work->picture, comments, error);
}

static void print_text(const struct work *work)
{
    const struct render_object_report *object = &work->report.objects[work->object];
    (void)printf("object %zu      %zu vertices, %zu triangles\n", work->object + 1,
                 object->vertices, object->triangles);
    if (object->limited) {
        (void)printf("  coarse      edges are longer than a surface point of %.3g mm\n",
                     object->point_mm);
    }
    if (work->picture.rgb) {
        (void)printf("picture       %d x %d texels: %zu covered, %zu of padding\n",
                     work->picture.width, work->picture.height, work->texels.covered,
                     work->texels.padded);
    }
    if (work->texels.overlapped > 0) {
        (void)printf("  overlap     %zu times two triangles share a texel: the texture "
                     "coordinates overlap, and the first is drawn\n",
                     work->texels.overlapped);
    }
    (void)printf("time          light %.1f s, gather %.1f s\n", work->report.light_seconds,
                 work->report.gather_seconds);
    (void)printf("baked         %s\n", work->settings->output);
}

static int print_json(const struct work *work, struct nacre_error *error)
{
    const struct render_object_report *object = &work->report.objects[work->object];
    json_t *root = json_pack(
        "{s:s, s:I, s:I, s:I, s:b, s:f, s:{s:i, s:i, s:I, s:I, s:I}, s:{s:f, s:f}}", "baked",
        work->settings->output, "object", (json_int_t)work->object + 1, "vertices",
        (json_int_t)object->vertices, "triangles", (json_int_t)object->triangles, "limited",
        object->limited, "point_mm", object->point_mm, "texels", "width", work->picture.width,
        "height", work->picture.height, "covered", (json_int_t)work->texels.covered, "padded",
        (json_int_t)work->texels.padded, "overlapped", (json_int_t)work->texels.overlapped,
        "seconds", "light", work->report.light_seconds, "gather", work->report.gather_seconds);
    return json_print(root, error);
}

static int run(const void *data, const struct invocation *invocation, struct nacre_error *error)
{
    struct work work = {.settings = data};
    progress_catch_signals();
    int status = check_output(work.settings->output, error);
    if (status == NACRE_OK) {
        status = scene_read(work.settings->scene, &work.scene, error);
    }
    if (status == NACRE_OK &&
        scene_check_output(&work.scene, work.settings->output, error) != NACRE_OK) {
        status = OPTIONS_WRONG_USAGE;
    }
    if (status == NACRE_OK) {
        status = choose_object(&work, error);
    }
    if (status == NACRE_OK && invocation->operand_count > 0) {
        status = take_mesh(&work, invocation->operands[0], error);
    }
    if (status == NACRE_OK) {
        status = opencl_open(invocation->device, &work.opencl, error);
    }
    if (status == NACRE_OK) {
        status = bake(&work, invocation, error);
    }
    if (status == NACRE_OK) {
        status = write_output(&work, error);
    }
    if (status == NACRE_OK && invocation->json) {
        status = print_json(&work, error);
    } else if (status == NACRE_OK && !invocation->quiet) {
        print_text(&work);
    }
    for (size_t i = 0; i < sizeof work.comments / sizeof *work.comments; i++) {
        free(work.comments[i]);
    }
    picture_finish(&work.picture);
    radiance_finish(&work.radiance);
    render_report_finish(&work.report);
    stage_finish(&work.stage);
    opencl_close(&work.opencl);
    scene_finish(&work.scene);
    return status;
}

const struct verb verb_bake = {
    .name = "bake",
    .operands = "[MESH] --scene SCENE -o FILE",
    .summary = "write the light that leaves an object, for other renderers",
    .text =
        "Calculates the light that leaves a translucent object of the scene, as nacre render does, "
        "and writes it as radiance: per vertex into a binary PLY (float red, green and blue), or "
        "per texel into a linear EXR of floats by the mesh's texture coordinates. A MESH takes the "
        "place of the object's shape, at the size and place that the scene gives the object.\n\n"
        "The radiance is the same in all directions, so another renderer shows it as emission. Its "
        "unit is that of the scene's irradiance per steradian; the scene's exposure is not "
        "applied.",
    .operand_minimum = 0,
    .operand_maximum = 1,
    .options = options,
    .settings_size = sizeof(struct bake_options),
    .run = run,
};
