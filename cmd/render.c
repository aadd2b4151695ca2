/* nacre render: a scene to a picture. */
#include "render/render.h"
#include "base/opencl.h"
#include "base/progress.h"
#include "cmd/json_print.h"
#include "cmd/render_explain.h"
#include "cmd/verbs.h"
#include "nacre/whole_file.h"

#include <jansson.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

struct render_options {
    const char *output, *pov, *material;
    double samples;
    int rays, photons, seed, triangles, turntable;
    bool albedo, povray_shadows, preview, explain;
};

static const struct option_spec options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct render_options, output),
     .sentence = "the picture to write: .exr is linear, .png is for looking at"},
    {.name = "material",
     .letter = 'm',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct render_options, material),
     .sentence = "use this material in place of those that the scene names"},
    {.name = "albedo",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct render_options, albedo),
     .sentence = "show the materials' diffuse albedo, without subsurface scattering"},
    {.name = "samples",
     .letter = 's',
     .kind = OPTION_REAL,
     .argument = "N",
     .minimum = 0.01,
     .maximum = 10000,
     .fallback = "12",
     .offset = offsetof(struct render_options, samples),
     .sentence = "light samples to one surface point of the material"},
    {.name = "rays",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = 4096,
     .fallback = "8",
     .offset = offsetof(struct render_options, rays),
     .sentence = "shadow rays from each sample to an area light"},
    {.name = "photons",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = INT_MAX,
     .fallback = "0",
     .offset = offsetof(struct render_options, photons),
     .sentence = "send out this many photons in place of the samples: noisier, but without bias"},
    {.name = "triangles",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 1,
     .maximum = MESH_TRIANGLES_MAXIMUM,
     .fallback = "600000",
     .offset = offsetof(struct render_options, triangles),
     .sentence = "do not split a mesh's edges into more triangles than this"},
    {.name = "povray-shadows",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct render_options, povray_shadows),
     .sentence = "leave area lights on plain objects to POV-Ray: slower, and in coarser steps"},
    {.name = "explain",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct render_options, explain),
     .sentence = "only list which effects the scene calls for, by which line, at what cost"},
    {.name = "seed",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = INT_MAX,
     .fallback = "1",
     .offset = offsetof(struct render_options, seed),
     .sentence = "of the random numbers"},
    {.name = "preview",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct render_options, preview),
     .sentence = "draw by OpenGL in memory in place of POV-Ray: quicker, with plainer shadows"},
    {.name = "turntable",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = 100000,
     .fallback = "0",
     .unit = "frames",
     .offset = offsetof(struct render_options, turntable),
     .sentence = "draw this many previews all around, numbered before the ending of FILE"},
    {.name = "pov",
     .kind = OPTION_STRING,
     .argument = "DIR",
     .offset = offsetof(struct render_options, pov),
     .sentence = "leave the POV-Ray files in this folder, to be edited"},
    {0}};

static uint64_t rays_of(const struct light_work *work)
{
    return work->shadow_rays + work->bounce_rays + work->photons;
}

static void print_object(size_t number, const struct render_object_report *object)
{
    const struct bake_counts *counts = &object->counts;
    (void)printf("object %zu      %zu vertices, %zu triangles", number + 1, object->vertices,
                 object->triangles);
    if (object->degenerate > 0) {
        (void)printf(" (%zu without area left out)", object->degenerate);
    }
    (void)printf("\n");
    if (object->open_edges > 0 || object->crowded_edges > 0) {
        (void)printf("  edges       %zu have one triangle (the mesh is open), %zu more than two\n",
                     object->open_edges, object->crowded_edges);
    }
    if (!object->translucent) {
        return;
    }
    (void)printf("  light       %zu samples, %llu rays\n", counts->samples,
                 (unsigned long long)rays_of(&counts->work));
    (void)printf(
        "  surface point %.3g mm, drawn larger by %.2f / %.2f / %.2f (5 / 50 / 95 %% of the "
        "surface)\n",
        object->point_mm, object->stretch[0], object->stretch[1], object->stretch[2]);
    if (object->limited) {
        (void)printf("  coarse      edges are longer than a surface point; raise --triangles\n");
    }
}

/* Frames a second of drawing alone; 0: POV-Ray drew. */
static double frame_rate(const struct render_options *settings, const struct render_report *report)
{
    int frames = settings->turntable ? settings->turntable : settings->preview;
    return frames ? frames / fmax(report->frame_seconds, 1e-9) : 0;
}

static void print_text(const struct render_options *settings, const struct render_report *report)
{
    for (size_t i = 0; i < report->object_count; i++) {
        print_object(i, &report->objects[i]);
    }
    (void)printf("time          mesh %.1f s, light %.1f s, gather %.1f s", report->mesh_seconds,
                 report->light_seconds, report->gather_seconds);
    if (settings->preview || settings->turntable) {
        (void)printf(", preview %.1f s, then %.1f frames a second\n", report->preview_seconds,
                     frame_rate(settings, report));
    } else {
        (void)printf(", export %.1f s, povray %.1f s\n", report->export_seconds,
                     report->povray_seconds);
    }
    (void)printf("picture       %s\n", settings->output);
}

static int print_json(const struct render_options *settings, const struct render_report *report,
                      struct nacre_error *error)
{
    json_t *objects = json_array();
    json_t *root =
        json_pack("{s:s, s:{s:f, s:f, s:f, s:f, s:f, s:f}, s:f, s:o}", "picture", settings->output,
                  "seconds", "mesh", report->mesh_seconds, "light", report->light_seconds, "gather",
                  report->gather_seconds, "export", report->export_seconds, "povray",
                  report->povray_seconds, "preview", report->preview_seconds, "frames_per_second",
                  frame_rate(settings, report), "objects", objects);
    for (size_t i = 0; root && i < report->object_count; i++) {
        const struct render_object_report *o = &report->objects[i];
        (void)json_array_append_new(
            objects,
            json_pack(
                "{s:I, s:I, s:I, s:I, s:I, s:b, s:I, s:I, s:I, s:f, s:[f, f, f], s:b}", "vertices",
                (json_int_t)o->vertices, "triangles", (json_int_t)o->triangles, "degenerate",
                (json_int_t)o->degenerate, "open_edges", (json_int_t)o->open_edges, "crowded_edges",
                (json_int_t)o->crowded_edges, "translucent", o->translucent, "samples",
                (json_int_t)o->counts.samples, "pairs",
                (json_int_t)o->counts.gather.points + (json_int_t)o->counts.gather.squares, "rays",
                (json_int_t)rays_of(&o->counts.work), "point_mm", o->point_mm, "stretch",
                o->stretch[0], o->stretch[1], o->stretch[2], "limited", o->limited));
    }
    return json_print(root, error);
}

/* Whether the picture can be written at all, told before the work and not after it. */
static int check_output(const char *path, struct nacre_error *error)
{
    struct whole_file probe = {0};
    const char *ending = strrchr(path, '.');
    if (!ending || (strcasecmp(ending, ".exr") != 0 && strcasecmp(ending, ".png") != 0)) {
        return nacre_fail(error, "%s: the picture's name must end in .exr or .png", path);
    }
    int status = whole_file_create(&probe, path, error);
    whole_file_discard(&probe);
    return status;
}

/* "without=highlights, shadows": what the scene forbids, on the heap. */
static char *name_without(const struct scene *scene)
{
    size_t size = sizeof "without=";
    for (size_t i = 0; i < scene->without_count; i++) {
        size += strlen(scene->without[i]) + 2;
    }
    char *text = calloc(size, 1), *end = text ? stpcpy(text, "without=") : NULL;
    for (size_t i = 0; text && i < scene->without_count; i++) {
        end = stpcpy(stpcpy(end, i ? ", " : ""), scene->without[i]);
    }
    return text;
}

static int write_picture(const struct render_options *settings, const char *scene_path,
                         const struct scene *scene, const char *path, const struct picture *picture,
                         struct nacre_error *error)
{
    char *from = NULL, *how = NULL, *without = name_without(scene);
    int status = NACRE_FAILED;
    if (asprintf(&from, "scene=%s", scene_path) < 0) {
        from = NULL;
    }
    if (asprintf(&how, "render=samples %g, rays %d, photons %d, seed %d%s%s", settings->samples,
                 settings->rays, settings->photons, settings->seed,
                 settings->albedo ? ", albedo" : "",
                 settings->preview || settings->turntable ? ", preview" : "") < 0) {
        how = NULL;
    }
    if (from && how && without) {
        const char *const attributes[] = {from, how, scene->without_count ? without : NULL, NULL};
        status = picture_write(path, picture, attributes, error);
    } else {
        (void)nacre_fail_memory(error, "the picture's attributes");
    }
    free(from);
    free(how);
    free(without);
    return status;
}

/* Where frames go. */
struct frames {
    const struct render_options *settings;
    const char *path; /* of the scene */
    const struct scene *scene;
};

static int take_frame(void *context, int number, const struct picture *picture,
                      struct nacre_error *error)
{
    const struct frames *frames = context;
    const char *output = frames->settings->output, *ending = strrchr(output, '.');
    char *path = NULL;
    if (!frames->settings->turntable) {
        return write_picture(frames->settings, frames->path, frames->scene, output, picture, error);
    }
    if (!ending ||
        asprintf(&path, "%.*s-%03d%s", (int)(ending - output), output, number, ending) < 0) {
        return nacre_fail_memory(error, "the name of a frame");
    }
    int status = write_picture(frames->settings, frames->path, frames->scene, path, picture, error);
    free(path);
    return status;
}

/* Render by POV-Ray or OpenGL and write what comes. */
static int render_and_write(const struct render_options *settings, const char *path,
                            const struct scene *scene, const struct render_settings *render,
                            const struct opencl *opencl, struct render_report *report,
                            struct nacre_error *error)
{
    struct frames frames = {settings, path, scene};
    struct picture picture = {0};
    int status;
    if (settings->preview || settings->turntable) {
        int count = settings->turntable ? settings->turntable : 1;
        status = render_preview(scene, render, opencl, count, take_frame, &frames, report, error);
    } else {
        status = render_scene(scene, render, opencl, &picture, report, error);
    }
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "%s", path);
    }
    if (status == NACRE_OK && picture.rgb) {
        status = write_picture(settings, path, scene, settings->output, &picture, error);
    }
    picture_finish(&picture);
    return status;
}

static int run(const void *data, const struct invocation *invocation, struct nacre_error *error)
{
    const struct render_options *settings = data;
    const char *path = invocation->operands[0];
    struct scene scene = {0};
    struct opencl opencl = {0};
    struct render_report report = {0};
    const struct render_settings render = {
        .bake = {.density = settings->samples,
                 .rays = settings->rays,
                 .photons = (size_t)settings->photons,
                 .seed = (uint64_t)settings->seed,
                 .quiet = invocation->quiet},
        .triangle_limit = (size_t)settings->triangles,
        .pov_folder = settings->pov,
        .material = settings->material,
        .albedo = settings->albedo,
        .povray_shadows = settings->povray_shadows,
        .turns = settings->turntable > 1,
    };
    progress_catch_signals();
    if (!settings->output && !settings->explain) {
        (void)nacre_fail(error, "nothing to make; give --output PICTURE or --explain");
        return OPTIONS_WRONG_USAGE;
    }
    int status = settings->explain ? NACRE_OK : check_output(settings->output, error);
    if (status == NACRE_OK) {
        status = scene_read(path, &scene, error);
    }
    if (status != NACRE_OK || settings->explain) {
        status = status ? status : render_explain(path, &scene, &render, invocation->json, error);
        scene_finish(&scene);
        return status;
    }
    status = opencl_open(invocation->device, &opencl, error);
    if (status == NACRE_OK) {
        status = render_and_write(settings, path, &scene, &render, &opencl, &report, error);
    }
    if (status == NACRE_OK && invocation->json) {
        status = print_json(settings, &report, error);
    } else if (status == NACRE_OK && !invocation->quiet) {
        print_text(settings, &report);
    }
    render_report_finish(&report);
    opencl_close(&opencl);
    scene_finish(&scene);
    return status;
}

const struct verb verb_render = {
    .name = "render",
    .operands = "SCENE -o PICTURE",
    .summary = "render a scene with factored materials",
    .text =
        "Reads a scene (YAML), calculates the light that leaves every vertex of the translucent "
        "objects from their factored materials, and has POV-Ray draw the picture with camera, "
        "plain objects, shadows and highlights.\n\nMeshes are split until no edge is longer than a "
        "surface point of the material.\n\nOnly effects that the scene calls for are rendered. "
        "With "
        "--explain nothing is, and they are listed: which are called for, by which line, at what "
        "cost, and why the others are not. `without: [...]` in the scene forbids some, which the "
        "picture's metadata then tell.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = options,
    .settings_size = sizeof(struct render_options),
    .run = run,
};
