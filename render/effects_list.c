/* Listing the effects of a scene, with the lines that call for them. */
#include "render/effects_list.h"

#include "render/convolve_ahead.h"
#include "render/facts.h"
#include "render/gather_cost.h"
#include "render/plain.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

/* Processor seconds of one core of a 3 GHz EPYC, fitted to light baked with OMP_NUM_THREADS=1 (docs/rendering.md): a ray
 * that is cast, a light that is looked at for it, also where it faces away, a slide or a sky looked up, a transmittance,
 * a sample placed on the surface, and for each vertex a sample of a surface point averaged around it. Those of the gather
 * are gather_cost.c's. */
static const double RAY_S = 2.2e-7;
static const double LIGHT_S = 7e-8;
static const double LOOKUP_S = 5e-8;
static const double TRANSMIT_S = 7e-8;
static const double SAMPLE_S = 4e-7;
static const double LOCAL_S = 5.5e-7;

/* Of what gather_cost.c counts: laying out light and checking what summing up changes come on top. */
static const double GATHER_TIMES = 1.6;

/* How light gets through the translucent objects. */
struct through {
    double seconds;
    double fits, convolved, receivers; /* vertices where kernels differ by term */
};

struct list {
    const struct stage *stage;
    struct through through;
    struct effect *effects;
    double samples, translucent_vertices; /* of translucent objects */
    double vertices;                      /* of plain ones that are lit here */
    double soft_lights, hard_lights;
    int plain_line; /* of the first plain object */
};

__attribute__((format(printf, 3, 4))) static void tell(struct effect *effect, bool simulated,
                                                       const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): va_start is above */
    (void)vsnprintf(effect->reason, sizeof effect->reason, format, arguments);
    va_end(arguments);
    effect->simulated = simulated;
}

static double surface_mm2(const struct stage_object *object)
{
    return mesh_area_mm2(&object->mesh);
}

static void count(struct list *list)
{
    const struct stage *stage = list->stage;
    const struct bake_settings *settings = &stage->settings->bake;
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        const struct stage_object *object = &stage->objects[i];
        double point = stage->facts[i].point_mm;
        if (!object->translucent && list->plain_line == 0) {
            list->plain_line = stage->scene->objects[i].line;
        }
        if (object->translucent) {
            list->translucent_vertices += (double)object->mesh.vertex_count;
            list->samples += fmax(surface_mm2(object) / (point * point) * settings->density,
                                  (double)object->mesh.triangle_count);
        } else if (object->light) {
            list->vertices += (double)object->mesh.vertex_count;
        }
    }
    for (size_t i = 0; i < stage->light_count; i++) {
        list->soft_lights += stage->lights[i].soft;
        list->hard_lights += !stage->lights[i].soft;
    }
}

/* Rays to lights: half of them face the surface. */
static double light_rays(const struct list *list)
{
    double rays = list->stage->settings->bake.rays;
    return 0.5 * list->samples * (list->soft_lights * rays + list->hard_lights) +
           0.5 * list->vertices * list->soft_lights * PLAIN_RAYS;
}

static int add_through(const struct stage *stage, size_t index, struct through *through,
                       struct nacre_error *error)
{
    const struct stage_object *object = &stage->objects[index];
    const struct bake_settings *settings = &stage->settings->bake;
    double point = stage->facts[index].point_mm, points = surface_mm2(object) / (point * point);
    double tolerance = settings->tolerance > 0 ? settings->tolerance : BAKE_TOLERANCE;
    double vertices = (double)object->mesh.vertex_count;
    struct levels levels = {0};
    struct convolve_ahead ahead;
    if (!stage->effects.objects[index].subsurface) {
        return NACRE_OK;
    }
    int status = levels_make(&levels, &object->appearance, tolerance, error);
    if (status == NACRE_OK) {
        struct gather_cost cost = gather_cost_ahead(&object->appearance, &levels, vertices,
                                                    points * settings->density, points);
        status = convolve_ahead(&ahead, &object->mesh, &object->mapping, &object->appearance,
                                stage->effects.objects[index].same_side, tolerance,
                                points * settings->density, cost, error);
    }
    if (status == NACRE_OK) {
        bool terms = object->appearance.layout == NACRE_KERNEL_PER_TERM;
        through->seconds += ahead.ns * 1e-9 * GATHER_TIMES;
        through->receivers += terms ? vertices : 0;
        through->fits += ahead.fits;
        through->convolved += ahead.chosen ? ahead.fits : 0;
    }
    levels_finish(&levels);
    return status;
}

static int find_through(const struct stage *stage, struct through *through,
                        struct nacre_error *error)
{
    int status = NACRE_OK;
    *through = (struct through){0};
    for (size_t i = 0; status == NACRE_OK && i < stage->scene->object_count; i++) {
        status = add_through(stage, i, through, error);
    }
    through->seconds *=
        1 + (render_has(&stage->effects, RENDER_BOUNCES) ? stage->scene->bounces : 0);
    return status;
}

/* The first light that is of the kind, or any that is soft; its line. */
static int light_line(const struct scene *scene, int kind)
{
    for (size_t i = 0; i < scene->light_count; i++) {
        if (scene->lights[i].kind == kind) {
            return scene->lights[i].line;
        }
    }
    return 0;
}

/* The first object of which a member of its effects is true. */
#define FIRST_WITH(stage, member) first_with(stage, offsetof(struct render_object_effects, member))

static const struct scene_object *first_with(const struct stage *stage, size_t offset)
{
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        const char *effects = (const char *)&stage->effects.objects[i];
        if (*(const bool *)(effects + offset)) {
            return &stage->scene->objects[i];
        }
    }
    return NULL;
}

static const struct scene_object *first_translucent(const struct stage *stage)
{
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        if (stage->objects[i].translucent) {
            return &stage->scene->objects[i];
        }
    }
    return NULL;
}

static void tell_of_light(struct list *list, enum render_effect id, struct effect *effect)
{
    const struct scene *scene = list->stage->scene;
    bool called = list->stage->effects.called[id];
    double rays = light_rays(list);
    switch (id) {
    case RENDER_SHADOWS:
        effect->line = called && scene->object_count > 1 ? scene->objects[1].line
                       : called                          ? scene->objects[0].line
                                                         : 0;
        effect->seconds = rays * RAY_S;
        tell(effect, called, "%s",
             called                    ? "a ray from each sample to its light"
             : scene->light_count == 0 ? "no light"
                                       : "one convex object: nothing is in the light's way");
        break;
    case RENDER_SOFT_LIGHT:
        effect->line = light_line(scene, LIGHT_AREA);
        effect->seconds = rays * LIGHT_S;
        tell(effect, called, "%s",
             called         ? "many rays to each area light"
             : effect->line ? "area lights are small, far away and unshadowed: points do"
                            : "no area light");
        break;
    case RENDER_PROJECTED:
        effect->line = light_line(scene, LIGHT_PROJECTOR);
        effect->seconds = 0.5 * list->samples * LOOKUP_S;
        tell(effect, called, "%s",
             called ? "looked up where its light falls" : "no light with a texture");
        break;
    case RENDER_ENVIRONMENT:
        effect->line = scene->environment.line;
        effect->seconds =
            (list->samples * list->stage->settings->bake.rays + list->vertices * PLAIN_RAYS) *
            LOOKUP_S;
        tell(effect, called, "%s",
             !called                    ? "no environment"
             : scene->environment.image ? "rays drawn by its picture and by the surface's cosine"
                                        : "rays drawn by the surface's cosine");
        break;
    default:
        effect->line = scene->bounces_line;
        effect->seconds = scene->bounces * RAY_S *
                          (list->samples * list->stage->settings->bake.rays +
                           list->vertices * PLAIN_SURFACE_RAYS);
        tell(effect, called,
             called               ? "light passes on %d times, each time with all of the gather"
             : scene->bounces > 0 ? "one convex object: no light gets from it to it (bounces: %d)"
                                  : "no bounces",
             scene->bounces);
        break;
    }
}

/* Why a scene with materials has no subsurface scattering. */
static void tell_of_no_gather(const struct stage *stage, struct effect *effect)
{
    const struct scene_object *object = first_translucent(stage);
    size_t index = object ? (size_t)(object - stage->scene->objects) : 0;
    const struct render_object_facts *facts = &stage->facts[index];
    effect->line = object ? object->material.line : 0;
    if (!object) {
        tell(effect, false, "no object with a material");
    } else if (stage->settings->albedo || object->material.mode == MODE_ALBEDO) {
        tell(effect, false, "the material is shown by its albedo");
    } else if (!facts->gathers) {
        tell(effect, false, "the material's kernels have no width");
    } else {
        tell(effect, false,
             "kernels of %.2g surface points, %.2g mm, are not seen in pixels of %.2g mm: albedo",
             facts->spread_points, facts->spread_points * facts->point_mm, facts->pixel_mm);
    }
}

static void tell_of_thin(const struct stage *stage, struct effect *effect, bool called)
{
    double share = 0, reach = 0;
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        const struct render_object_effects *effects = &stage->effects.objects[i];
        const struct stage_object *object = &stage->objects[i];
        if (effects->subsurface && !effects->same_side) {
            double own = stage->facts[i].reach_points * stage->facts[i].point_mm;
            double found = facts_thin_share(stage->world, i, &object->mesh, own);
            effect->line = stage->scene->objects[i].material.line;
            reach = found > share || !(reach > 0) ? own : reach;
            share = fmax(share, found);
        }
    }
    if (!called) {
        const struct scene_object *object = FIRST_WITH(stage, same_side);
        effect->line = object ? object->material.line : 0;
        tell(effect, false, "%s", object ? "thin: same-side" : "no subsurface scattering");
    } else if (share > 0) {
        tell(effect, true, "%.0f %% of the surface is thinner than the kernels' reach of %.3g mm",
             100 * share, reach);
    } else {
        tell(effect, false, "nowhere thinner than the kernels' reach of %.3g mm", reach);
    }
}

static void tell_of_gather(const struct list *list, struct effect *effect)
{
    const struct through *through = &list->through;
    double share = 100 / fmax(through->receivers, 1);
    effect->seconds = through->seconds + list->samples * SAMPLE_S;
    if (through->convolved > 0) {
        tell(effect, true,
             "convolution in the texture for %.3g %% of the vertices, where it lies level and that "
             "is sooner; else samples in reach",
             share * through->convolved);
    } else if (through->receivers > 0) {
        tell(effect, true,
             "samples in reach, through F, H and the kernels; convolution in the texture %s (it "
             "lies level for %.3g %% of the vertices)",
             through->fits > 0 ? "would take longer" : "fits nowhere", share * through->fits);
    } else {
        tell(effect, true, "samples in reach, through F, H and the kernels");
    }
}

static void tell_of_material(struct list *list, enum render_effect id, struct effect *effect)
{
    const struct stage *stage = list->stage;
    bool called = stage->effects.called[id];
    const struct scene_object *gathers = FIRST_WITH(stage, subsurface);
    const struct scene_object *object = first_translucent(stage);
    effect->line = gathers ? gathers->material.line : 0;
    switch (id) {
    case RENDER_LOCAL:
        effect->line = object ? object->material.line : list->plain_line;
        effect->seconds = list->translucent_vertices * stage->settings->bake.density * LOCAL_S +
                          (gathers ? 0 : list->samples * SAMPLE_S);
        tell(effect, called, "%s",
             called ? "light that leaves where it entered: plain objects, albedo, kernels' peaks"
                    : "no plain object, and no kernel has a peak");
        break;
    case RENDER_SUBSURFACE:
        if (called) {
            tell_of_gather(list, effect);
        } else {
            tell_of_no_gather(stage, effect);
        }
        break;
    case RENDER_THIN:
        tell_of_thin(stage, effect, called);
        break;
    case RENDER_CLUSTERS: {
        const struct scene_object *many = FIRST_WITH(stage, clusters);
        effect->line = many ? many->material.line : effect->line;
        tell(effect, called, "%s",
             called    ? "kernels are looked up by surface point"
             : gathers ? "one kernel"
                       : "no subsurface scattering");
        break;
    }
    default:
        tell(effect, called, "%s",
             called    ? "three channels"
             : gathers ? "light and material are grey: all channels are the same"
                       : "no subsurface scattering");
        break;
    }
}

static void tell_of_surface(struct list *list, enum render_effect id, struct effect *effect)
{
    const struct stage *stage = list->stage;
    bool called = stage->effects.called[id];
    const struct scene_object *object = id == RENDER_FRESNEL      ? FIRST_WITH(stage, fresnel)
                                        : id == RENDER_HIGHLIGHTS ? FIRST_WITH(stage, highlights)
                                                                  : FIRST_WITH(stage, reflection);
    if (id == RENDER_FRESNEL) {
        effect->line = object ? object->index_line : 0;
        effect->seconds = light_rays(list) * TRANSMIT_S;
        tell(effect, called, "%s",
             called ? "light enters and leaves by its angle"
                    : "no translucent object with an index: light enters and leaves alike");
    } else if (id == RENDER_HIGHLIGHTS) {
        effect->line = object ? object->gloss.specular_line : 0;
        tell(effect, called, "%s", called ? "by POV-Ray" : "no lights, or no specular of a gloss");
    } else {
        effect->line = object ? object->gloss.reflection_line : 0;
        tell(effect, called, "%s",
             called ? "of the surroundings, by POV-Ray" : "no reflection of a gloss");
    }
}

int render_effects_list(const struct stage *stage, struct effect **effects, size_t *number,
                        struct nacre_error *error)
{
    struct list list = {.stage = stage};
    *number = 0;
    *effects = list.effects = calloc(RENDER_EFFECTS, sizeof *list.effects);
    if (!list.effects) {
        return nacre_fail_memory(error, "the list of effects");
    }
    count(&list);
    if (find_through(stage, &list.through, error) != NACRE_OK) {
        free(*effects);
        *effects = NULL;
        return NACRE_FAILED;
    }
    for (int i = 0; i < RENDER_EFFECTS; i++) {
        enum render_effect id = (enum render_effect)i;
        struct effect *effect = &list.effects[(*number)++];
        (void)snprintf(effect->name, sizeof effect->name, "%s", render_effect_names[i]);
        if (render_forbids(stage->scene, id)) {
            tell(effect, false, "without forbids it");
            effect->line = stage->scene->without_line;
        } else if (id <= RENDER_BOUNCES) {
            tell_of_light(&list, id, effect);
        } else if (id == RENDER_FRESNEL || id >= RENDER_HIGHLIGHTS) {
            tell_of_surface(&list, id, effect);
        } else {
            tell_of_material(&list, id, effect);
        }
        if (!effect->simulated) {
            effect->seconds = 0;
        }
    }
    return NACRE_OK;
}
