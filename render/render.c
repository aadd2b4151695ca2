/* From a lit scene to a picture by POV-Ray. */
#include "render/render.h"

#include "base/clock.h"
#include "render/half_range.h"
#include "render/pov.h"
#include "render/pov_folder.h"
#include "render/povray.h"
#include "render/preview.h"
#include "render/stage_refine.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* The picture at 1 / 4 of its width and height foretells how long it takes. */
enum { PROBE_SHRINK = 4 };

/* Of writing a picture's file, by pixel, and of all that is not foreseen. */
static const double write_seconds = 1e-6, spare_seconds = 0.2;

struct work {
    const struct scene *scene;
    const struct render_settings *settings;
    struct stage stage;
    char *temporary; /* folder to remove */
    const char *folder;
    bool made; /* it was not there before */
};

static int64_t now_ns(void)
{
    struct clock clock = clock_monotonic();
    return clock_now_ns(&clock);
}

static double lap(int64_t *start_ns)
{
    int64_t now = now_ns();
    double seconds = (double)(now - *start_ns) * 1e-9;
    *start_ns = now;
    return seconds;
}

/* The folder that was asked for, made if need be. */
static int make_asked_folder(struct work *work, struct nacre_error *error)
{
    const char *folder = work->settings->pov_folder;
    struct stat status;
    work->made = mkdir(folder, 0777) == 0;
    if (!work->made && errno != EEXIST) {
        return nacre_fail_errno(error, errno, "%s: cannot make the folder for POV-Ray's files",
                                folder);
    }
    if (stat(folder, &status) != 0 || !S_ISDIR(status.st_mode)) {
        return nacre_fail(error, "%s: POV-Ray's files need a folder, and this is none", folder);
    }
    return access(folder, W_OK | X_OK) == 0
               ? pov_folder_check(folder, work->scene, error)
               : nacre_fail_errno(error, errno, "%s: POV-Ray's files cannot be written there",
                                  folder);
}

/* The folder for POV-Ray's files: the one asked for, or a temporary one. */
static int make_folder(struct work *work, const char **folder, struct nacre_error *error)
{
    const char *parent = getenv("TMPDIR");
    *folder = work->settings->pov_folder;
    if (*folder) {
        return make_asked_folder(work, error);
    }
    if (asprintf(&work->temporary, "%s/nacre-render-XXXXXX", parent && *parent ? parent : "/tmp") <
        0) {
        work->temporary = NULL;
        return nacre_fail_memory(error, "the name of a temporary folder");
    }
    if (!mkdtemp(work->temporary)) {
        int number = errno;
        (void)nacre_fail_errno(error, number, "%s: cannot make a temporary folder",
                               work->temporary);
        free(work->temporary);
        work->temporary = NULL;
        return NACRE_FAILED;
    }
    *folder = work->temporary;
    return NACRE_OK;
}

/* The scene for POV-Ray, brighter by `scale`. */
static int export_scene(const struct work *work, const char *folder, double scale,
                        struct nacre_error *error)
{
    struct scene scaled = *work->scene; /* shares what it points to */
    const struct scene *scene = &scaled;
    scaled.image.exposure *= scale;
    for (int c = 0; c < 3; c++) {
        scaled.image.background[c] *= scale;
    }
    struct pov_object *exported = calloc(scene->object_count + 1, sizeof *exported);
    if (!exported) {
        return nacre_fail_memory(error, "the scene for POV-Ray");
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct stage_object *object = &work->stage.objects[i];
        const struct render_effects *effects = &work->stage.effects;
        const float(*light)[3] = (const float(*)[3])object->light;
        exported[i] = (struct pov_object){
            .mesh = &object->mesh,
            .settings = &scene->objects[i],
            .fresnel = effects->objects[i].fresnel && render_has(effects, RENDER_FRESNEL),
            .highlights = effects->objects[i].highlights && render_has(effects, RENDER_HIGHLIGHTS),
            .reflection = effects->objects[i].reflection && render_has(effects, RENDER_REFLECTION),
            .radiosity = object->translucent ? light : NULL,
            .irradiance = object->translucent ? NULL : light,
            .soft = (const float(*)[3])object->soft};
    }
    const struct environment *environment =
        work->stage.light_count > scene->light_count
            ? &work->stage.lights[scene->light_count].environment
            : NULL;
    int status = pov_write(folder, scene, work->stage.lights, environment, exported, error);
    free(exported);
    return status;
}

/* Have povray draw what the stage holds, at the picture's size over `shrink`. Values are the picture's. */
static int trace(struct work *work, int shrink, struct picture *picture,
                 struct render_report *report, struct nacre_error *error)
{
    const struct scene_image *image = &work->scene->image;
    int64_t start = now_ns();
    double scale = half_range_scale(&work->stage);
    int width = (image->width + shrink - 1) / shrink,
        height = (image->height + shrink - 1) / shrink;
    int status = work->folder ? NACRE_OK : make_folder(work, &work->folder, error);
    if (status == NACRE_OK) {
        status = export_scene(work, work->folder, scale, error);
    }
    report->export_seconds += lap(&start);
    if (status == NACRE_OK) {
        struct progress progress = progress_begin("tracing (povray)", work->settings->bake.quiet);
        status = povray_render(work->folder, width, height, !work->settings->povray_shadows,
                               &progress, picture, error);
        progress_end(&progress);
    }
    for (size_t i = 0; status == NACRE_OK && scale != 1 &&
                       i < 3 * (size_t)picture->width * (size_t)picture->height;
         i++) {
        picture->rgb[i] = (float)(picture->rgb[i] / scale);
    }
    report->povray_seconds += lap(&start);
    return status;
}

/* Before any light there is nothing to trace; then everything but the pixels takes what it will take. */
static int foresee_trace(void *context, double *seconds, struct nacre_error *error)
{
    struct work *work = context;
    struct render_report unused = {0};
    struct picture picture = {0};
    int64_t start = now_ns();
    int status = trace(work, PROBE_SHRINK, &picture, &unused, error);
    double whole = lap(&start), pixels = status ? 0 : povray_trace_seconds(work->folder);
    double count = (double)work->scene->image.width * work->scene->image.height;
    *seconds =
        whole + (PROBE_SHRINK * PROBE_SHRINK - 1) * pixels + write_seconds * count + spare_seconds;
    picture_finish(&picture);
    return status;
}

/* Light, by the samples that are asked for or by those that the goal needs. */
static int bake(struct stage *stage, const struct opencl *opencl, stage_closing *closing,
                void *context, struct render_report *report, struct nacre_error *error)
{
    return stage->settings->goal
               ? stage_bake_refined(stage, opencl, closing, context, report, error)
               : stage_bake(stage, opencl, report, error);
}

int render_scene(const struct scene *scene, const struct render_settings *settings,
                 const struct opencl *opencl, struct picture *picture, struct render_report *report,
                 struct nacre_error *error)
{
    struct work work = {.scene = scene, .settings = settings};
    int64_t start = now_ns();
    *report = (struct render_report){0};
    *picture = (struct picture){0};
    int status = povray_probe(error);
    if (status == NACRE_OK && settings->pov_folder) {
        status = make_folder(&work, &work.folder, error);
    }
    if (status == NACRE_OK) {
        status = stage_prepare(&work.stage, scene, settings, report, error);
    }
    report->mesh_seconds = lap(&start);
    if (status == NACRE_OK) {
        status = bake(&work.stage, opencl, foresee_trace, &work, report, error);
    }
    if (status == NACRE_OK) {
        status = trace(&work, 1, picture, report, error);
    }
    if (work.temporary) {
        pov_folder_remove(work.temporary, scene);
    } else if (work.made && settings->pov_folder && status != NACRE_OK) {
        (void)rmdir(settings->pov_folder); /* where it is still empty */
    }
    free(work.temporary);
    stage_finish(&work.stage);
    return status;
}

static int draw_frames(struct preview *preview, int frames, bool quiet, render_frame_taker *take,
                       void *context, struct render_report *report, struct nacre_error *error)
{
    struct progress progress = progress_begin("drawing", quiet);
    int status = NACRE_OK;
    for (int i = 0; i < frames && status == NACRE_OK; i++) {
        struct picture picture = {0};
        int64_t start = now_ns();
        status = progress_step(&progress, i, frames, NULL, error);
        if (status == NACRE_OK) {
            status = preview_draw(preview, 360.0 * i / frames, &picture, error);
        }
        report->frame_seconds += lap(&start);
        if (status == NACRE_OK) {
            status = take(context, i, &picture, error);
        }
        picture_finish(&picture);
    }
    progress_end(&progress);
    return status;
}

struct preview_work {
    const struct stage *stage;
    int frames;
};

static int foresee_frames(void *context, double *seconds, struct nacre_error *error)
{
    const struct preview_work *work = context;
    const struct scene_image *image = &work->stage->scene->image;
    struct preview *preview = NULL;
    struct picture picture = {0};
    int64_t start = now_ns();
    int status = preview_open(work->stage, work->frames == 1, &preview, error);
    *seconds = lap(&start);
    if (status == NACRE_OK) {
        status = preview_draw(preview, 0, &picture, error);
    }
    *seconds +=
        spare_seconds + work->frames * (lap(&start) + write_seconds * image->width * image->height);
    picture_finish(&picture);
    preview_close(preview);
    return status;
}

int render_preview(const struct scene *scene, const struct render_settings *settings,
                   const struct opencl *opencl, int frames, render_frame_taker *take, void *context,
                   struct render_report *report, struct nacre_error *error)
{
    struct stage stage = {0};
    struct preview_work work = {&stage, frames};
    struct preview *preview = NULL;
    int64_t start = now_ns();
    *report = (struct render_report){0};
    int status = preview_probe(error);
    if (status == NACRE_OK) {
        status = stage_prepare(&stage, scene, settings, report, error);
    }
    report->mesh_seconds = lap(&start);
    if (status == NACRE_OK) {
        status = bake(&stage, opencl, foresee_frames, &work, report, error);
    }
    (void)lap(&start);
    if (status == NACRE_OK) {
        status = preview_open(&stage, frames == 1, &preview, error);
    }
    report->preview_seconds = lap(&start);
    if (status == NACRE_OK) {
        status = draw_frames(preview, frames, settings->bake.quiet, take, context, report, error);
    }
    preview_close(preview);
    stage_finish(&stage);
    return status;
}

void render_report_finish(struct render_report *report)
{
    free(report->objects);
    *report = (struct render_report){0};
}
