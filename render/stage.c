/* Preparing the objects of a scene and calculating their light. */
#include "render/stage.h"

#include "render/facts.h"
#include "render/grey.h"
#include "render/inside.h"
#include "render/plain.h"

#include <math.h>
#include <stdlib.h>

/* Of translucent meshes, in surface points: the diagonal of a square of one. */
static const double longest_edge = 1.45;

static const double pi = 3.14159265358979323846;

/* An edge of a knot or a sphere with which it has no more triangles than the limit. */
static double edge_within(const struct scene_object *object, double edge_mm, size_t limit)
{
    double tube = object->thickness, wide = 2 * (3 + tube);
    /* Triangles of edge 1 on one of size 1: two to each square of rings and columns (shapes.c). */
    double count =
        object->shape == SHAPE_KNOT ? 2 * 27.4 * 1.2 * 2 * pi * tube / (wide * wide) : pi * pi;
    return limit > 0 ? fmax(edge_mm, object->size_mm[0] * sqrt(count / (double)limit)) : edge_mm;
}

static int make_shape(const struct scene_object *object, double edge_mm, size_t limit,
                      struct mesh *mesh, struct nacre_error *error)
{
    const double *size = object->size_mm;
    edge_mm = edge_within(object, edge_mm, limit);
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

static int read_material(const char *path, struct appearance *appearance,
                         struct render_object_facts *facts, struct nacre_error *error)
{
    struct nacre_material material = {0};
    if (nacre_material_read(path, &material, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    int status = appearance_make(appearance, &material, error);
    if (status == NACRE_OK) {
        facts_of_material(facts, &material, appearance);
    }
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
    const struct render_object_effects *effects =
        &stage->effects.objects[prepared - stage->objects];
    if (effects->subsurface && !effects->color &&
        grey_pack(&prepared->appearance, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    prepared->light = calloc(mesh->vertex_count + 1, sizeof *prepared->light);
    return prepared->light
               ? mapping_stretch(&prepared->mapping, mesh, report->stretch, &report->edge_on, error)
               : nacre_fail_memory(error, "the light on the mesh");
}

/* Whether plain objects are lit here and not by POV-Ray alone. */
static bool lights_plain(const struct stage *stage)
{
    const struct render_effects *effects = &stage->effects;
    return render_has(effects, RENDER_ENVIRONMENT) || render_has(effects, RENDER_BOUNCES) ||
           (render_has(effects, RENDER_SOFT_LIGHT) && !stage->settings->povray_shadows);
}

static struct plain_split splitting_of(const struct stage *stage)
{
    return (struct plain_split){stage->scene, stage->settings->turns,
                                render_has(&stage->effects, RENDER_BOUNCES),
                                stage->settings->triangle_limit};
}

static int split_seen(const struct stage *stage, struct stage_object *prepared, bool *limited,
                      struct nacre_error *error)
{
    const struct plain_split split = splitting_of(stage);
    return lights_plain(stage) ? plain_split_seen(&prepared->mesh, &split, limited, error)
                               : NACRE_OK;
}

/* Split a plain object where shadows end, and make room for its light. */
static int split_lit(const struct stage *stage, size_t index, struct render_object_report *report,
                     struct nacre_error *error)
{
    struct stage_object *prepared = &stage->objects[index];
    const struct plain_split split = splitting_of(stage);
    const struct lighting lighting = stage_lighting(stage);
    struct progress progress = progress_begin("shadows' ends", stage->settings->bake.quiet);
    int status = report->limited ? NACRE_OK
                                 : plain_split_lit(&prepared->mesh, &split, &lighting, &progress,
                                                   &report->limited, &report->counts.work, error);
    progress_end(&progress);
    if (status != NACRE_OK) {
        return status;
    }
    prepared->light = calloc(prepared->mesh.vertex_count + 1, sizeof *prepared->light);
    prepared->soft = calloc(prepared->mesh.vertex_count + 1, sizeof *prepared->soft);
    return prepared->light && prepared->soft ? NACRE_OK
                                             : nacre_fail_memory(error, "the light on the mesh");
}

/* Place the mesh and map the material on a translucent one. */
static int place(struct stage *stage, size_t index, struct nacre_error *error)
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
    return NACRE_OK;
}

static int prepare_object(struct stage *stage, size_t index, struct nacre_error *error)
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
        if (read_material(path, &prepared->appearance, &stage->facts[index], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        edge = prepared->material.point_mm > 0 ? prepared->material.point_mm
                                               : prepared->appearance.pitch_mm;
        stage->facts[index].point_mm = edge;
    }
    if (make_shape(object, edge, stage->settings->triangle_limit, &prepared->mesh, error) !=
            NACRE_OK ||
        place(stage, index, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    facts_of_mesh(&stage->facts[index], &prepared->mesh, stage->scene);
    return NACRE_OK;
}

/* Split edges so that vertices resolve the material and the picture. */
static int refine_object(struct stage *stage, size_t index, struct render_object_report *report,
                         struct nacre_error *error)
{
    struct stage_object *prepared = &stage->objects[index];
    if (stage->scene->objects[index].shape == SHAPE_MESH &&
        mesh_count_edges(&prepared->mesh, &report->open_edges, &report->crowded_edges, error) !=
            NACRE_OK) {
        return NACRE_FAILED;
    }
    int status = prepared->translucent ? refine_translucent(stage, prepared, report, error)
                                       : split_seen(stage, prepared, &report->limited, error);
    return status;
}

/* The lights that the effects leave. */
static int make_lights(struct stage *stage, struct nacre_error *error)
{
    const struct scene *scene = stage->scene;
    for (size_t i = 0; i < scene->light_count; i++) {
        struct light *light = &stage->lights[stage->light_count++];
        if (light_make(light, &scene->lights[i], error) != NACRE_OK) {
            return nacre_fail_within(error, "the light at line %d, column %d",
                                     scene->lights[i].line, scene->lights[i].column);
        }
        light->soft = light->soft && render_has(&stage->effects, RENDER_SOFT_LIGHT);
        if (!render_has(&stage->effects, RENDER_PROJECTED)) {
            picture_finish(&light->slide);
            light->lookup = LOOKUP_NOTHING;
        }
    }
    if (render_has(&stage->effects, RENDER_ENVIRONMENT)) {
        struct light *light = &stage->lights[stage->light_count++];
        if (light_make_environment(light, &scene->environment, error) != NACRE_OK) {
            return nacre_fail_within(error, "the environment at line %d, column %d",
                                     scene->environment.line, scene->environment.column);
        }
    }
    return NACRE_OK;
}

static int make_world(struct stage *stage, struct nacre_error *error)
{
    const struct scene *scene = stage->scene;
    const struct mesh **meshes = calloc(scene->object_count + 1, sizeof *meshes);
    if (!meshes) {
        return nacre_fail_memory(error, "the scene");
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        meshes[i] = &stage->objects[i].mesh;
    }
    world_free(stage->world);
    int status = world_new(meshes, scene->object_count, &stage->world, error);
    free(meshes);
    return status;
}

/* Lights shine on surfaces that are there. */
static int place_lights(struct stage *stage, struct nacre_error *error)
{
    struct vec3 centre;
    double radius_mm;
    world_bounds(stage->world, &centre, &radius_mm);
    for (size_t i = 0; i < stage->light_count; i++) {
        light_surround(&stage->lights[i], centre, radius_mm);
    }
    return lights_check_outside(stage, error);
}

/* Split plain objects by their light. Shadow rays need not know of it, but what is seen of them by others does. */
static int split_by_light(struct stage *stage, struct render_report *report,
                          struct nacre_error *error)
{
    int status = NACRE_OK;
    for (size_t i = 0; status == NACRE_OK && i < stage->scene->object_count; i++) {
        if (!stage->objects[i].translucent && lights_plain(stage)) {
            status = split_lit(stage, i, &report->objects[i], error);
        }
    }
    return status == NACRE_OK && render_has(&stage->effects, RENDER_BOUNCES)
               ? make_world(stage, error)
               : status;
}

static void report_objects(const struct stage *stage, struct render_report *report)
{
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        const struct stage_object *object = &stage->objects[i];
        report->objects[i].translucent = object->translucent;
        report->objects[i].vertices = object->mesh.vertex_count;
        report->objects[i].triangles = object->mesh.triangle_count;
        report->objects[i].degenerate = object->mesh.degenerate_count;
    }
}

static int prepare_objects(struct stage *stage, struct render_report *report,
                           struct nacre_error *error)
{
    const struct scene *scene = stage->scene;
    struct progress progress = progress_begin("meshes", stage->settings->bake.quiet);
    double done = 0, steps = 2 * (double)scene->object_count;
    int status = NACRE_OK;
    for (size_t i = 0; status == NACRE_OK && i < scene->object_count; i++) {
        status = progress_step(&progress, done++, steps, NULL, error);
        if (status == NACRE_OK && prepare_object(stage, i, error) != NACRE_OK) {
            status = nacre_fail_within(error, "the object at line %d, column %d",
                                       scene->objects[i].line, scene->objects[i].column);
        }
    }
    if (status == NACRE_OK) {
        status = render_effects_plan(scene, stage->facts, stage->settings->albedo, &stage->effects,
                                     error);
    }
    for (size_t i = 0; status == NACRE_OK && i < scene->object_count; i++) {
        status = progress_step(&progress, done++, steps, NULL, error);
        if (status == NACRE_OK && refine_object(stage, i, &report->objects[i], error) != NACRE_OK) {
            status = nacre_fail_within(error, "the object at line %d, column %d",
                                       scene->objects[i].line, scene->objects[i].column);
        }
    }
    progress_end(&progress);
    return status;
}

int stage_prepare(struct stage *stage, const struct scene *scene,
                  const struct render_settings *settings, struct render_report *report,
                  struct nacre_error *error)
{
    *stage = (struct stage){.scene = scene, .settings = settings};
    stage->objects = calloc(scene->object_count + 1, sizeof *stage->objects);
    stage->facts = calloc(scene->object_count + 1, sizeof *stage->facts);
    stage->lights = calloc(scene->light_count + 1, sizeof *stage->lights);
    report->objects = calloc(scene->object_count + 1, sizeof *report->objects);
    if (!stage->objects || !stage->facts || !stage->lights || !report->objects) {
        return nacre_fail_memory(error, "the scene");
    }
    report->object_count = scene->object_count;
    int status = prepare_objects(stage, report, error);
    if (status == NACRE_OK) {
        status = make_lights(stage, error);
    }
    if (status == NACRE_OK) {
        status = make_world(stage, error);
    }
    if (status == NACRE_OK) {
        status = place_lights(stage, error);
    }
    if (status == NACRE_OK) {
        status = split_by_light(stage, report, error);
    }
    report_objects(stage, report);
    return status;
}

void stage_finish(struct stage *stage)
{
    for (size_t i = 0; stage->objects && i < stage->scene->object_count; i++) {
        mesh_finish(&stage->objects[i].mesh);
        mapping_finish(&stage->objects[i].mapping);
        appearance_finish(&stage->objects[i].appearance);
        free(stage->objects[i].light);
        free(stage->objects[i].soft);
        free(stage->objects[i].albedo);
        gather_surface_finish(&stage->objects[i].gathering);
    }
    for (size_t i = 0; i < stage->light_count; i++) {
        light_finish(&stage->lights[i]);
    }
    world_free(stage->world);
    free(stage->objects);
    free(stage->lights);
    free(stage->facts);
    render_effects_finish(&stage->effects);
    *stage = (struct stage){0};
}
