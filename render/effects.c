/* The plan of effects: what the scene calls for and does not forbid. */
#include "render/effects.h"

#include "render/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SHADOWS_TO_THIN                                                                            \
    "shadows", "soft light", "projected picture", "environment", "interreflection",                \
        "Fresnel transmission", "local reflection", "subsurface scattering", "thin parts"
#define SURFACE "highlights", "mirror reflection"

const char *const render_effect_names[RENDER_EFFECTS] = {SHADOWS_TO_THIN, "clusters", "colour",
                                                         SURFACE};
const char *const render_effects_forbiddable[] = {SHADOWS_TO_THIN, SURFACE, NULL};

/* A light this much smaller than it is far counts as a point: the error of its middle in place of the mean over it is
 * about the square, 1e-3, which no picture of 8 bits shows. */
static const double small_light = 0.03;

bool render_forbids(const struct scene *scene, enum render_effect id)
{
    for (size_t i = 0; i < scene->without_count; i++) {
        if (strcmp(scene->without[i], render_effect_names[id]) == 0) {
            return true;
        }
    }
    return false;
}

/* What the build lacks is forbidden always. */
static bool forbids(const struct scene *scene, enum render_effect id)
{
    return !RENDER_EFFECTS_BUILT(id) || render_forbids(scene, id);
}

static bool is_grey(const double color[3])
{
    return color[0] == color[1] && color[1] == color[2];
}

/* All light that falls on objects, also from other objects. */
static bool light_is_grey(const struct scene *scene, const struct render_object_facts *facts)
{
    bool grey = scene->environment.line == 0 ||
                (!scene->environment.image && is_grey(scene->environment.color));
    for (size_t i = 0; i < scene->light_count; i++) {
        const struct scene_light *light = &scene->lights[i];
        const struct scene_texture *texture = &light->texture;
        grey = grey && is_grey(light->irradiance) && !texture->image && is_grey(texture->bright) &&
               is_grey(texture->dark);
    }
    for (size_t i = 0; scene->bounces > 0 && i < scene->object_count; i++) {
        grey = grey &&
               (scene->objects[i].material.file ? facts[i].grey : is_grey(scene->objects[i].color));
    }
    return grey;
}

/* Whether an area light is large for its distance to the nearest object, or something stands in its way. */
static bool light_is_soft(const struct scene *scene, const struct render_object_facts *facts,
                          const struct scene_light *light, bool shadows)
{
    double nearest = HUGE_VAL;
    if (light->kind != LIGHT_AREA) {
        return false;
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        struct vec3 p = vec3_from_doubles(light->position_mm);
        struct vec3 low = facts[i].low, high = facts[i].high;
        struct vec3 out = {fmax(fmax(low.x - p.x, p.x - high.x), 0),
                           fmax(fmax(low.y - p.y, p.y - high.y), 0),
                           fmax(fmax(low.z - p.z, p.z - high.z), 0)};
        nearest = fmin(nearest, vec3_length(out));
    }
    return shadows || hypot(light->size_mm[0], light->size_mm[1]) > small_light * nearest;
}

/* Of the whole scene. */
static void plan_light(const struct scene *scene, const struct render_object_facts *facts,
                       struct render_effects *effects)
{
    bool *called = effects->called;
    bool lit = scene->light_count > 0 || scene->environment.line > 0;
    called[RENDER_SHADOWS] =
        lit && !(scene->object_count == 1 && facts[0].convex) && !forbids(scene, RENDER_SHADOWS);
    for (size_t i = 0; i < scene->light_count; i++) {
        const struct scene_light *light = &scene->lights[i];
        called[RENDER_SOFT_LIGHT] =
            called[RENDER_SOFT_LIGHT] || light_is_soft(scene, facts, light, called[RENDER_SHADOWS]);
        called[RENDER_PROJECTED] = called[RENDER_PROJECTED] || light->kind == LIGHT_PROJECTOR;
    }
    called[RENDER_ENVIRONMENT] = scene->environment.line > 0;
    called[RENDER_BOUNCES] =
        scene->bounces > 0 && lit && !(scene->object_count == 1 && facts[0].convex);
}

/* Kernels narrower than this, in surface points or pixels, are not told from light that leaves where it entered. */
static const double narrow = 0.5;

static void plan_object(const struct scene *scene, size_t index,
                        const struct render_object_facts *facts, bool albedo, bool grey_light,
                        struct render_effects *effects)
{
    const struct scene_object *object = &scene->objects[index];
    struct render_object_effects *own = &effects->objects[index];
    bool *called = effects->called;
    if (object->material.file) {
        bool wide = facts->gathers && facts->spread_points > narrow &&
                    facts->spread_points * facts->point_mm > narrow * facts->pixel_mm;
        own->albedo = albedo || object->material.mode == MODE_ALBEDO || (facts->gathers && !wide) ||
                      forbids(scene, RENDER_SUBSURFACE);
        own->local = !own->albedo && facts->local && !forbids(scene, RENDER_LOCAL);
        own->subsurface = !own->albedo && facts->gathers;
        own->albedo = own->albedo && !forbids(scene, RENDER_LOCAL);
        own->same_side = own->subsurface &&
                         (object->material.thin == THIN_SAME_SIDE || forbids(scene, RENDER_THIN));
        own->clusters = own->subsurface && facts->kernels > 1;
        own->color = own->subsurface && !(facts->grey && grey_light);
        own->fresnel = object->index > 1 && !forbids(scene, RENDER_FRESNEL);
    }
    own->highlights =
        object->gloss.specular > 0 && scene->light_count > 0 && !forbids(scene, RENDER_HIGHLIGHTS);
    own->reflection = object->gloss.reflection > 0 && !forbids(scene, RENDER_REFLECTION);
    called[RENDER_LOCAL] =
        called[RENDER_LOCAL] || own->local || own->albedo || !object->material.file;
    called[RENDER_SUBSURFACE] = called[RENDER_SUBSURFACE] || own->subsurface;
    called[RENDER_THIN] = called[RENDER_THIN] || (own->subsurface && !own->same_side);
    called[RENDER_CLUSTERS] = called[RENDER_CLUSTERS] || own->clusters;
    called[RENDER_COLOR] = called[RENDER_COLOR] || own->color;
    called[RENDER_FRESNEL] = called[RENDER_FRESNEL] || own->fresnel;
    called[RENDER_HIGHLIGHTS] = called[RENDER_HIGHLIGHTS] || own->highlights;
    called[RENDER_REFLECTION] = called[RENDER_REFLECTION] || own->reflection;
}

int render_effects_plan(const struct scene *scene, const struct render_object_facts *facts,
                        bool albedo, struct render_effects *effects, struct nacre_error *error)
{
    *effects = (struct render_effects){0};
    effects->objects = calloc(scene->object_count + 1, sizeof *effects->objects);
    if (!effects->objects) {
        return nacre_fail_memory(error, "the plan of effects");
    }
    plan_light(scene, facts, effects);
    bool grey_light = light_is_grey(scene, facts);
    for (size_t i = 0; i < scene->object_count; i++) {
        plan_object(scene, i, &facts[i], albedo, grey_light, effects);
    }
    for (int i = 0; i < RENDER_EFFECTS; i++) {
        enum render_effect id = (enum render_effect)i;
        effects->called[i] = effects->called[i] && !forbids(scene, id);
    }
    return NACRE_OK;
}

void render_effects_finish(struct render_effects *effects)
{
    free(effects->objects);
    *effects = (struct render_effects){0};
}
