/* The objects of a scene, placed, split finely enough and lit: what pictures and baked files are made of. */
#ifndef RENDER_STAGE_H
#define RENDER_STAGE_H

#include "render/effects.h"
#include "render/gather_surface.h"
#include "render/irradiance.h"
#include "render/render.h"

struct stage_object {
    struct mesh mesh;
    bool translucent;
    struct appearance appearance;
    struct mapping mapping;
    struct scene_material material; /* as used; owns nothing */
    /* Per vertex: radiosity, or of a plain object the irradiance that POV-Ray is not left to find, or NULL. */
    float (*light)[3];
    /* Plain: the part of `light` that soft lights of the scene's list make, which POV-Ray can draw too. */
    float (*soft)[3];
    float *albedo;                   /* of each surface point, where photons are passed on */
    struct gather_surface gathering; /* filled where light is gathered more than once */
};

struct stage {
    const struct scene *scene;
    const struct render_settings *settings;
    struct stage_object *objects; /* one for each of the scene */
    struct light *lights;
    size_t light_count; /* with the environment, which is the last */
    struct world *world;
    struct render_object_facts *facts; /* of each object */
    struct render_effects effects;
    bool plain_lit; /* what lights make of plain objects stands in their light already */
};

/* Place meshes and lights and plan the effects; light is zero so far. Allocates report->objects. The scene and the
 * settings must outlive the stage, which is to be finished whatever is returned. */
int stage_prepare(struct stage *stage, const struct scene *scene,
                  const struct render_settings *settings, struct render_report *report,
                  struct nacre_error *error);

/* All lights of a stage, to be used while it lives. */
struct lighting stage_lighting(const struct stage *stage);

/* Calculate the light of one object, or of all; of all in any case where light passes on from one to the other. */
int stage_bake_object(struct stage *stage, size_t index, const struct opencl *opencl,
                      struct render_report *report, struct nacre_error *error);
int stage_bake(struct stage *stage, const struct opencl *opencl, struct render_report *report,
               struct nacre_error *error);
void stage_finish(struct stage *stage);

#endif
