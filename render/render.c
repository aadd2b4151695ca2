/* The conductor: meshes, lights, baking, POV-Ray. */
#include "render/render.h"

#include "base/clock.h"
#include "render/plain.h"
#include "render/pov.h"
#include "render/povray.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Of translucent meshes, in surface points: the diagonal of a square of one. */
static const double longest_edge = 1.45;

/* One object of the scene, ready to be lit. */
struct prepared {
    struct mesh mesh;
    bool translucent;
    struct appearance appearance;
    struct mapping mapping;
    struct scene_material material; /* as used; owns nothing */
    float (*light)[3]; /* per vertex: radiosity, or of a plain object the area lights' irradiance */
};

struct work {
    const struct scene *scene;
    const struct render_settings *settings;
    struct prepared *objects;
    struct light *lights;
    struct world *world;
    struct pov_object *exported;
    char *temporary; /* folder to remove */
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

static int make_shape(const struct scene_object *object, double edge_mm, struct mesh *mesh,
                      struct nacre_error *error)
{
    const double *size = object->size_mm;
    switch (object->shape) {
    case SHAPE_MESH:
        if (mesh_load(object->file, mesh, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        return mesh_scale(mesh, size[0], object->file, error);
    case SHAPE_KNOT:
        return mesh_make_knot(mesh, size[0], object->thickness, edge_mm, error);
    case SHAPE_SPHERE:
        return mesh_make_sphere(mesh, size[0] / 2, edge_mm, error);
    case SHAPE_BOX:
        return mesh_make_box(mesh, size, error);
    default:
        return mesh_make_quad(mesh, size[0], size[1], error);
    }
}

static int read_material(const char *path, struct appearance *appearance, struct nacre_error *error)
{
    struct nacre_material material = {0};
    if (nacre_material_read(path, &material, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    int status = appearance_make(appearance, &material, error);
    if (status != NACRE_OK) {
        (void)nacre_fail_within(error, "%s", path);
    }
    nacre_material_finish(&material);
    return status;
}

/* Split edges down to the material's surface points. */
static int refine_translucent(const struct work *work, struct prepared *prepared,
                              struct render_object_report *report, struct nacre_error *error)
{
    struct mesh *mesh = &prepared->mesh;
    report->point_mm = prepared->mapping.point_mm;
    double edge_mm = longest_edge * report->point_mm;
    if (mesh_subdivide(mesh, mesh_edge_even, &edge_mm, work->settings->triangle_limit,
                       &report->limited, error) != NACRE_OK ||
        mapping_follow(&prepared->mapping, mesh, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    prepared->light = calloc(mesh->vertex_count + 1, sizeof *prepared->light);
    return prepared->light ? mapping_stretch(&prepared->mapping, mesh, report->stretch, error)
                           : nacre_fail_memory(error, "the light on the mesh");
}

static int refine_plain(const struct work *work, struct prepared *prepared,
                        struct nacre_error *error)
{
    if (work->settings->povray_shadows || !plain_wanted(work->scene)) {
        return NACRE_OK;
    }
    if (plain_refine(&prepared->mesh, work->scene, work->settings->triangle_limit, error) !=
        NACRE_OK) {
        return NACRE_FAILED;
    }
    prepared->light = calloc(prepared->mesh.vertex_count + 1, sizeof *prepared->light);
    return prepared->light ? NACRE_OK : nacre_fail_memory(error, "the light on the mesh");
}

/* Place the mesh, map the material on a translucent one, and split edges so that vertices resolve the light. */
static int place(struct work *work, size_t index, struct render_object_report *report,
                 struct nacre_error *error)
{
    const struct scene_object *object = &work->scene->objects[index];
    struct prepared *prepared = &work->objects[index];
    struct mesh *mesh = &prepared->mesh;
    struct motion motion =
        mesh_placement(mesh, object->rotation_deg, vec3_from_doubles(object->position_mm));
    if (prepared->translucent &&
        mapping_make(&prepared->mapping, &prepared->material, prepared->appearance.width,
                     prepared->appearance.height, prepared->appearance.pitch_mm, mesh, &motion,
                     error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    mesh_move(mesh, &motion);
    return prepared->translucent ? refine_translucent(work, prepared, report, error)
                                 : refine_plain(work, prepared, error);
}

static int prepare_object(struct work *work, size_t index, struct render_object_report *report,
                          struct nacre_error *error)
{
    const struct scene_object *object = &work->scene->objects[index];
    struct prepared *prepared = &work->objects[index];
    double edge = object->size_mm[0] / 60;
    prepared->material = object->material;
    prepared->translucent = object->material.file != NULL;
    if (work->settings->albedo) {
        prepared->material.mode = MODE_ALBEDO;
    }
    if (prepared->translucent) {
        const char *path =
            work->settings->material ? work->settings->material : object->material.file;
        if (read_material(path, &prepared->appearance, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        edge = prepared->material.point_mm > 0 ? prepared->material.point_mm
                                               : prepared->appearance.pitch_mm;
    }
    if (make_shape(object, edge, &prepared->mesh, error) != NACRE_OK ||
        place(work, index, report, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    report->translucent = prepared->translucent;
    report->vertices = prepared->mesh.vertex_count;
    report->triangles = prepared->mesh.triangle_count;
    report->degenerate = prepared->mesh.degenerate_count;
    return NACRE_OK;
}

static int prepare(struct work *work, struct render_report *report, struct nacre_error *error)
{
    const struct scene *scene = work->scene;
    const struct mesh **meshes = calloc(scene->object_count + 1, sizeof *meshes);
    int status = NACRE_FAILED;
    work->objects = calloc(scene->object_count + 1, sizeof *work->objects);
    work->lights = calloc(scene->light_count + 1, sizeof *work->lights);
    work->exported = calloc(scene->object_count + 1, sizeof *work->exported);
    report->objects = calloc(scene->object_count + 1, sizeof *report->objects);
    if (!meshes || !work->objects || !work->lights || !work->exported || !report->objects) {
        (void)nacre_fail_memory(error, "the scene");
        goto out;
    }
    report->object_count = scene->object_count;
    for (size_t i = 0; i < scene->light_count; i++) {
        if (light_make(&work->lights[i], &scene->lights[i], error) != NACRE_OK) {
            (void)nacre_fail_within(error, "the light at line %d", scene->lights[i].line);
            goto out;
        }
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        struct prepared *prepared = &work->objects[i];
        if (prepare_object(work, i, &report->objects[i], error) != NACRE_OK) {
            (void)nacre_fail_within(error, "the object at line %d", scene->objects[i].line);
            goto out;
        }
        meshes[i] = &prepared->mesh;
        const float(*light)[3] = (const float(*)[3])prepared->light;
        work->exported[i] = (struct pov_object){&prepared->mesh, &scene->objects[i],
                                                prepared->translucent ? light : NULL,
                                                prepared->translucent ? NULL : light};
    }
    status = world_new(meshes, scene->object_count, &work->world, error);
out:
    free(meshes);
    return status;
}

static int bake_plain(struct work *work, const struct prepared *prepared,
                      struct render_report *report, struct nacre_error *error)
{
    int64_t start = now_ns();
    struct progress progress = progress_begin("shadows", work->settings->bake.quiet);
    int status = plain_light(&prepared->mesh, work->world, work->lights, work->scene->light_count,
                             work->settings->bake.seed, &progress, prepared->light, error);
    progress_end(&progress);
    report->light_seconds += lap(&start);
    return status;
}

static int bake(struct work *work, const struct opencl *opencl, struct render_report *report,
                struct nacre_error *error)
{
    const struct scene *scene = work->scene;
    int status = NACRE_OK;
    for (size_t i = 0; status == NACRE_OK && i < scene->object_count; i++) {
        struct prepared *prepared = &work->objects[i];
        struct bake_counts *counts = &report->objects[i].counts;
        if (prepared->translucent) {
            status =
                bake_object(&prepared->mesh, &prepared->mapping, &prepared->appearance,
                            &prepared->material, work->world, i, work->lights, scene->light_count,
                            opencl, &work->settings->bake, prepared->light, counts, error);
            report->light_seconds += counts->light_seconds;
            report->gather_seconds += counts->gather_seconds;
        } else if (prepared->light) {
            status = bake_plain(work, prepared, report, error);
        }
    }
    return status;
}

/* The folder for POV-Ray's files: the one asked for, made if need be, or a temporary one. */
static int make_folder(struct work *work, const char **folder, struct nacre_error *error)
{
    const char *parent = getenv("TMPDIR");
    *folder = work->settings->pov_folder;
    if (*folder) {
        return mkdir(*folder, 0777) == 0 || errno == EEXIST
                   ? NACRE_OK
                   : nacre_fail_errno(error, errno, "%s: cannot make the folder", *folder);
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

/* Remove the files that were written there, and the folder. What cannot be removed is left. */
static void remove_temporary(const struct work *work)
{
    const char *const fixed[] = {POV_MAIN, "povray.log", "picture.exr"};
    char path[4096];
    for (size_t i = 0; i < sizeof fixed / sizeof *fixed; i++) {
        (void)snprintf(path, sizeof path, "%s/%s", work->temporary, fixed[i]);
        (void)unlink(path);
    }
    for (size_t i = 0; i < work->scene->object_count; i++) {
        (void)snprintf(path, sizeof path, "%s/object-%zu.inc", work->temporary, i);
        (void)unlink(path);
    }
    for (size_t i = 0; i < work->scene->light_count; i++) {
        (void)snprintf(path, sizeof path, "%s/slide-%zu.exr", work->temporary, i);
        (void)unlink(path);
    }
    (void)rmdir(work->temporary);
}

static void work_finish(struct work *work)
{
    for (size_t i = 0; work->objects && i < work->scene->object_count; i++) {
        mesh_finish(&work->objects[i].mesh);
        mapping_finish(&work->objects[i].mapping);
        appearance_finish(&work->objects[i].appearance);
        free(work->objects[i].light);
    }
    for (size_t i = 0; work->lights && i < work->scene->light_count; i++) {
        light_finish(&work->lights[i]);
    }
    if (work->temporary) {
        remove_temporary(work);
    }
    world_free(work->world);
    free(work->objects);
    free(work->lights);
    free(work->exported);
    free(work->temporary);
}

int render_scene(const struct scene *scene, const struct render_settings *settings,
                 const struct opencl *opencl, struct picture *picture, struct render_report *report,
                 struct nacre_error *error)
{
    struct work work = {.scene = scene, .settings = settings};
    const char *folder;
    int64_t start = now_ns();
    *report = (struct render_report){0};
    *picture = (struct picture){0};
    int status = prepare(&work, report, error);
    report->mesh_seconds = lap(&start);
    if (status != NACRE_OK) {
        goto out;
    }
    status = bake(&work, opencl, report, error);
    if (status != NACRE_OK) {
        goto out;
    }
    (void)lap(&start);
    status = make_folder(&work, &folder, error);
    if (status == NACRE_OK) {
        status = pov_write(folder, scene, work.lights, work.exported, error);
    }
    report->export_seconds = lap(&start);
    if (status == NACRE_OK) {
        struct progress progress = progress_begin("tracing (povray)", settings->bake.quiet);
        status = povray_render(folder, scene->image.width, scene->image.height,
                               !settings->povray_shadows, &progress, picture, error);
        progress_end(&progress);
    }
    report->povray_seconds = lap(&start);
out:
    work_finish(&work);
    return status;
}

void render_report_finish(struct render_report *report)
{
    free(report->objects);
    *report = (struct render_report){0};
}
