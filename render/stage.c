/* Preparing the objects of a scene and calculating their light. */
#include "render/stage.h"

#include "base/clock.h"
#include "render/plain.h"

#include <stdlib.h>

/* Of translucent meshes, in surface points: the diagonal of a square of one. */
static const double longest_edge = 1.45;

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
static int refine_translucent(const struct stage *stage, struct stage_object *prepared,
                              struct render_object_report *report, struct nacre_error *error)
{
    struct mesh *mesh = &prepared->mesh;
    report->point_mm = prepared->mapping.point_mm;
    double edge_mm = longest_edge * report->point_mm;
    if (mesh_subdivide(mesh, mesh_edge_even, &edge_mm, stage->settings->triangle_limit,
                       &report->limited, error) != NACRE_OK ||
        mapping_follow(&prepared->mapping, mesh, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    prepared->light = calloc(mesh->vertex_count + 1, sizeof *prepared->light);
    return prepared->light ? mapping_stretch(&prepared->mapping, mesh, report->stretch, error)
                           : nacre_fail_memory(error, "the light on the mesh");
}

static int refine_plain(const struct stage *stage, struct stage_object *prepared,
                        struct nacre_error *error)
{
    if (stage->settings->povray_shadows || !plain_wanted(stage->scene)) {
        return NACRE_OK;
    }
    if (plain_refine(&prepared->mesh, stage->scene, stage->settings->triangle_limit, error) !=
        NACRE_OK) {
        return NACRE_FAILED;
    }
    prepared->light = calloc(prepared->mesh.vertex_count + 1, sizeof *prepared->light);
    return prepared->light ? NACRE_OK : nacre_fail_memory(error, "the light on the mesh");
}

/* Place the mesh, map the material on a translucent one, and split edges so that vertices resolve the light. */
static int place(struct stage *stage, size_t index, struct render_object_report *report,
                 struct nacre_error *error)
{
    const struct scene_object *object = &stage->scene->objects[index];
    struct stage_object *prepared = &stage->objects[index];
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
    return prepared->translucent ? refine_translucent(stage, prepared, report, error)
                                 : refine_plain(stage, prepared, error);
}

static int prepare_object(struct stage *stage, size_t index, struct render_object_report *report,
                          struct nacre_error *error)
{
    const struct scene_object *object = &stage->scene->objects[index];
    struct stage_object *prepared = &stage->objects[index];
    double edge = object->size_mm[0] / 60;
    prepared->material = object->material;
    prepared->translucent = object->material.file != NULL;
    if (stage->settings->albedo) {
        prepared->material.mode = MODE_ALBEDO;
    }
    if (prepared->translucent) {
        const char *path =
            stage->settings->material ? stage->settings->material : object->material.file;
        if (read_material(path, &prepared->appearance, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        edge = prepared->material.point_mm > 0 ? prepared->material.point_mm
                                               : prepared->appearance.pitch_mm;
    }
    if (make_shape(object, edge, &prepared->mesh, error) != NACRE_OK ||
        place(stage, index, report, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    report->translucent = prepared->translucent;
    report->vertices = prepared->mesh.vertex_count;
    report->triangles = prepared->mesh.triangle_count;
    report->degenerate = prepared->mesh.degenerate_count;
    return NACRE_OK;
}

int stage_prepare(struct stage *stage, const struct scene *scene,
                  const struct render_settings *settings, struct render_report *report,
                  struct nacre_error *error)
{
    *stage = (struct stage){.scene = scene, .settings = settings};
    const struct mesh **meshes = calloc(scene->object_count + 1, sizeof *meshes);
    int status = NACRE_FAILED;
    stage->objects = calloc(scene->object_count + 1, sizeof *stage->objects);
    stage->lights = calloc(scene->light_count + 1, sizeof *stage->lights);
    report->objects = calloc(scene->object_count + 1, sizeof *report->objects);
    if (!meshes || !stage->objects || !stage->lights || !report->objects) {
        (void)nacre_fail_memory(error, "the scene");
        goto out;
    }
    report->object_count = scene->object_count;
    for (size_t i = 0; i < scene->light_count; i++) {
        if (light_make(&stage->lights[i], &scene->lights[i], error) != NACRE_OK) {
            (void)nacre_fail_within(error, "the light at line %d", scene->lights[i].line);
            goto out;
        }
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        struct stage_object *prepared = &stage->objects[i];
        if (prepare_object(stage, i, &report->objects[i], error) != NACRE_OK) {
            (void)nacre_fail_within(error, "the object at line %d", scene->objects[i].line);
            goto out;
        }
        meshes[i] = &prepared->mesh;
    }
    status = world_new(meshes, scene->object_count, &stage->world, error);
out:
    free(meshes);
    return status;
}

static int bake_plain(struct stage *stage, const struct stage_object *prepared,
                      struct render_report *report, struct nacre_error *error)
{
    int64_t start = now_ns();
    struct progress progress = progress_begin("shadows", stage->settings->bake.quiet);
    int status =
        plain_light(&prepared->mesh, stage->world, stage->lights, stage->scene->light_count,
                    stage->settings->bake.seed, &progress, prepared->light, error);
    progress_end(&progress);
    report->light_seconds += lap(&start);
    return status;
}

int stage_bake_object(struct stage *stage, size_t index, const struct opencl *opencl,
                      struct render_report *report, struct nacre_error *error)
{
    struct stage_object *prepared = &stage->objects[index];
    struct bake_counts *counts = &report->objects[index].counts;
    if (!prepared->translucent) {
        return prepared->light ? bake_plain(stage, prepared, report, error) : NACRE_OK;
    }
    int status =
        bake_object(&prepared->mesh, &prepared->mapping, &prepared->appearance, &prepared->material,
                    stage->world, index, stage->lights, stage->scene->light_count, opencl,
                    &stage->settings->bake, prepared->light, counts, error);
    report->light_seconds += counts->light_seconds;
    report->gather_seconds += counts->gather_seconds;
    return status;
}

int stage_bake(struct stage *stage, const struct opencl *opencl, struct render_report *report,
               struct nacre_error *error)
{
    int status = NACRE_OK;
    for (size_t i = 0; status == NACRE_OK && i < stage->scene->object_count; i++) {
        status = stage_bake_object(stage, i, opencl, report, error);
    }
    return status;
}

void stage_finish(struct stage *stage)
{
    for (size_t i = 0; stage->objects && i < stage->scene->object_count; i++) {
        mesh_finish(&stage->objects[i].mesh);
        mapping_finish(&stage->objects[i].mapping);
        appearance_finish(&stage->objects[i].appearance);
        free(stage->objects[i].light);
    }
    for (size_t i = 0; stage->lights && i < stage->scene->light_count; i++) {
        light_finish(&stage->lights[i]);
    }
    world_free(stage->world);
    free(stage->objects);
    free(stage->lights);
    *stage = (struct stage){0};
}
