/* nacre render: a scene to a picture. */
#include "render/render.h"
#include "base/opencl.h"
#include "base/progress.h"
#include "cmd/render_explain.h"
#include "cmd/render_print.h"
#include "cmd/verbs.h"
#include "nacre/whole_file.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

struct render_options {
    const char *output, *pov, *material;
    double samples, error, within;
    int rays, photons, seed, triangles, turntable;
    bool albedo, povray_shadows, preview, explain;
};

/* Light samples to a surface point. */
static const double usual_samples = 12;

static const struct option_spec options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct render_options, output),
     .writes = true,
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
     .offset = offsetof(struct render_options, samples),
     .sentence =
         "light samples to one surface point of the material; default 12, or as --error and "
         "--within need"},
    {.name = "error",
     .kind = OPTION_REAL,
     .argument = "E",
     .minimum = 0,
     .maximum = 1,
     .fallback = "1",
     .offset = offsetof(struct render_options, error),
     .sentence = "take as many light samples, and sum them up as far, that the light's root mean "
                 "square error is at most this (0.01 or 1%); 1: any"},
    {.name = "within",
     .kind = OPTION_SECONDS,
     .argument = "TIME",
     .minimum = 0.001,
     .maximum = INFINITY,
     .offset = offsetof(struct render_options, within),
     .sentence = "be done in this time, reading and drawing included, with as small an error as "
                 "can be had; together with --error, stop by then"},
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
     .sentence =
         "leave the POV-Ray files in this folder, to be edited; edited ones are not overwritten"},
    {0}};

/* That OpenGL draws. */
static int frames_of(const struct render_options *settings)
{
    return settings->turntable ? settings->turntable : settings->preview;
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

/* How the light was made, on the heap. */
static char *name_light(const struct render_options *s, const struct refine_report *refine)
{
    const char *mode = s->albedo ? ", albedo" : "", *drawn = frames_of(s) > 0 ? ", preview" : "";
    char *text = NULL;
    int length;
    if (refine->count > 0) {
        const struct refine_try *last = &refine->steps[refine->count - 1];
        length = asprintf(&text,
                          "render=samples %.4g in two halves, tolerance %.3g, rays %d, seed %d%s%s",
                          last->density, refine->bias, s->rays, s->seed, mode, drawn);
    } else {
        length = asprintf(&text, "render=samples %g, rays %d, photons %d, seed %d%s%s",
                          s->samples > 0 ? s->samples : usual_samples, s->rays, s->photons, s->seed,
                          mode, drawn);
    }
    return length < 0 ? NULL : text;
}

/* The error that was reached, on the heap; empty where it is not known. */
static char *name_error(const struct refine_report *refine)
{
    char *text = NULL;
    int length = asprintf(&text, "error=%.3g estimated (noise %.3g, summing up %.3g), ended by %s",
                          refine->error, refine->noise, refine->bias,
                          refine->stopped_by ? refine->stopped_by : "");
    return length < 0 ? NULL : text;
}

static int write_picture(const struct render_options *settings, const char *scene_path,
                         const struct scene *scene, const struct render_report *report,
                         const char *path, const struct picture *picture, struct nacre_error *error)
{
    char *from = NULL, *without = name_without(scene);
    char *how = name_light(settings, &report->refine), *reached = name_error(&report->refine);
    int status = NACRE_FAILED;
    if (asprintf(&from, "scene=%s", scene_path) < 0) {
        from = NULL;
    }
    if (from && how && reached && without) {
        const char *attributes[5] = {from, how};
        size_t count = 2;
        if (report->refine.count > 0) {
            attributes[count++] = reached;
        }
        if (scene->without_count > 0) {
            attributes[count++] = without;
        }
        status = picture_write(path, picture, attributes, error);
    } else {
        (void)nacre_fail_memory(error, "the picture's attributes");
    }
    free(from);
    free(how);
    free(reached);
    free(without);
    return status;
}

/* Where frames go. */
struct frames {
    const struct render_options *settings;
    const char *path; /* of the scene */
    const struct scene *scene;
    const struct render_report *report;
};

static int take_frame(void *context, int number, const struct picture *picture,
                      struct nacre_error *error)
{
    const struct frames *frames = context;
    const char *output = frames->settings->output, *ending = strrchr(output, '.');
    char *path = NULL;
    if (!frames->settings->turntable) {
        return write_picture(frames->settings, frames->path, frames->scene, frames->report, output,
                             picture, error);
    }
    if (!ending ||
        asprintf(&path, "%.*s-%03d%s", (int)(ending - output), output, number, ending) < 0) {
        return nacre_fail_memory(error, "the name of a frame");
    }
    int status = write_picture(frames->settings, frames->path, frames->scene, frames->report, path,
                               picture, error);
    free(path);
    return status;
}

/* Render by POV-Ray or OpenGL and write what comes. */
static int render_and_write(const struct render_options *settings, const char *path,
                            const struct scene *scene, const struct render_settings *render,
                            const struct opencl *opencl, struct render_report *report,
                            struct nacre_error *error)
{
    struct frames frames = {settings, path, scene, report};
    struct picture picture = {0};
    int status;
    if (frames_of(settings) > 0) {
        status = render_preview(scene, render, opencl, frames_of(settings), take_frame, &frames,
                                report, error);
    } else {
        status = render_scene(scene, render, opencl, &picture, report, error);
    }
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "%s", path);
    }
    if (status == NACRE_OK && picture.rgb) {
        status = write_picture(settings, path, scene, report, settings->output, &picture, error);
    }
    picture_finish(&picture);
    return status;
}

/* Refuse what does not go together before anything is done. */
static int check_options(const struct render_options *s, struct nacre_error *error)
{
    bool chosen = s->error < 1 || s->within > 0;
    if (!s->output && !s->explain) {
        (void)nacre_fail(error, "nothing to make; give --output PICTURE or --explain");
        return OPTIONS_WRONG_USAGE;
    }
    if (chosen && (s->samples > 0 || s->photons > 0)) {
        (void)nacre_fail(error, "--error and --within choose the samples themselves; leave out %s",
                         s->samples > 0 ? "--samples" : "--photons");
        return OPTIONS_WRONG_USAGE;
    }
    if (frames_of(s) > 0 && (s->pov || s->povray_shadows)) {
        (void)nacre_fail(error, "--preview and --turntable draw without POV-Ray; leave out %s",
                         s->pov ? "--pov" : "--povray-shadows");
        return OPTIONS_WRONG_USAGE;
    }
    if (s->error <= 0 && !(s->within > 0)) {
        (void)nacre_fail(error, "no number of samples has an error of 0; give a larger --error, or "
                                "--within a time to come as near as can be");
        return OPTIONS_WRONG_USAGE;
    }
    return NACRE_OK;
}

/* The last word on a picture that was written: a wish that was not met is an error, but one that leaves a file. */
static int judge(const struct render_options *s, const struct refine_goal *goal,
                 const struct render_report *report, struct nacre_error *error)
{
    const struct refine_report *refine = &report->refine;
    double taken = refine_seconds(goal);
    if (s->within > 0 && taken > s->within && refine->count == 1) {
        return nacre_fail(error,
                          "cannot be done in %.3g s: the least that gives a picture took %.3g s, "
                          "and %s holds it with an error of about %.2g %%",
                          s->within, taken, s->output, 100 * refine->error);
    }
    if (!refine->error_held) {
        return nacre_fail(error, "could not reach an error of %.3g %%%s: %s has about %.2g %%",
                          100 * s->error,
                          strcmp(refine->stopped_by, "time") == 0 ? " in the time given" : "",
                          s->output, 100 * refine->error);
    }
    if (s->within > 0 && taken > s->within) {
        return nacre_fail(error, "took %.3g s in place of %.3g s; %s is as it should be", taken,
                          s->within, s->output);
    }
    return NACRE_OK;
}

static struct render_settings to_settings(const struct render_options *s, bool quiet)
{
    return (struct render_settings){
        .bake = {.density = s->samples > 0 ? s->samples : usual_samples,
                 .rays = s->rays,
                 .photons = (size_t)s->photons,
                 .seed = (uint64_t)s->seed,
                 .quiet = quiet},
        .triangle_limit = (size_t)s->triangles,
        .pov_folder = s->pov,
        .material = s->material,
        .albedo = s->albedo,
        .povray_shadows = s->povray_shadows,
        .turns = s->turntable > 1,
    };
}

static int run(const void *data, const struct invocation *invocation, struct nacre_error *error)
{
    const struct render_options *settings = data;
    const char *path = invocation->operands[0];
    struct scene scene = {0};
    struct opencl opencl = {0};
    struct render_report report = {0};
    struct clock clock = clock_monotonic();
    const struct refine_goal goal = {settings->error, settings->within, &clock,
                                     clock_now_ns(&clock)};
    struct render_settings render = to_settings(settings, invocation->quiet);
    render.goal = settings->error < 1 || settings->within > 0 ? &goal : NULL;
    progress_catch_signals();
    int status = check_options(settings, error);
    if (status == NACRE_OK && !settings->explain) {
        status = check_output(settings->output, error);
    }
    if (status == NACRE_OK) {
        status = scene_read(path, &scene, error);
    }
    if (status == NACRE_OK && settings->output &&
        scene_check_output(&scene, settings->output, error) != NACRE_OK) {
        status = OPTIONS_WRONG_USAGE;
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
        status = render_print_json(settings->output, frames_of(settings), &report, error);
    } else if (status == NACRE_OK && !invocation->quiet) {
        render_print_text(settings->output, frames_of(settings), &report);
    }
    if (status == NACRE_OK && render.goal) {
        status = judge(settings, &goal, &report, error);
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
        "picture's metadata then tell.\n\nWith --error or --within, light samples are added step "
        "by step, in two halves whose difference tells the error, until it is small enough or "
        "time is up; the error reached is printed and written into the picture's metadata. When "
        "what was asked for cannot be had, the best picture is written and the exit status is 1.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = options,
    .settings_size = sizeof(struct render_options),
    .run = run,
};
