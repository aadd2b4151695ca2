/* Which effects a picture is rendered with: those that the scene's things call for, and no others. */
#ifndef RENDER_EFFECTS_H
#define RENDER_EFFECTS_H

#include "nacre/error.h"
#include "render/vector.h"

#include <stdbool.h>
#include <stddef.h>

struct scene;

/* In the order of light's way. */
enum render_effect {
    RENDER_SHADOWS,
    RENDER_SOFT_LIGHT,
    RENDER_PROJECTED,
    RENDER_ENVIRONMENT,
    RENDER_BOUNCES,
    RENDER_FRESNEL,
    RENDER_LOCAL,
    RENDER_SUBSURFACE,
    RENDER_THIN,
    RENDER_CLUSTERS,
    RENDER_COLOR,
    RENDER_HIGHLIGHTS,
    RENDER_REFLECTION,
    RENDER_EFFECTS
};

/* What --explain and `without` call them. */
extern const char *const render_effect_names[RENDER_EFFECTS];

/* What `without` can forbid, NULL-terminated: all but clusters and colour, which are what the material is. */
extern const char *const render_effects_forbiddable[];

/* tests/render/effects_cost.py compiles single effects out, or all that a material can do without (RENDER_EFFECTS), to
 * show that an effect which is not called for costs what one that does not exist costs. */
#ifdef RENDER_EFFECTS_WITHOUT
#define RENDER_EFFECTS_BUILT(id)                                                                   \
    ((RENDER_EFFECTS_WITHOUT) == RENDER_EFFECTS                                                    \
         ? ((id) == RENDER_LOCAL || (id) == RENDER_SUBSURFACE || (id) == RENDER_THIN)              \
         : (id) != (RENDER_EFFECTS_WITHOUT))
#else
#define RENDER_EFFECTS_BUILT(id) true
#endif

/* What decides about the effects of one object, found when it was made ready. */
struct render_object_facts {
    struct vec3 low, high; /* of the mesh */
    /* Light from outside that falls on it meets it nowhere else first; asked of a scene's only object. */
    bool convex;
    double pixel_mm; /* what a pixel of the picture covers where the object is nearest */
    /* Of its material: */
    double point_mm;
    bool local, gathers; /* some light leaves where it entered, some elsewhere */
    bool grey;           /* all channels are the same */
    int kernels, terms;
    double spread_points; /* root mean square of light's way, of the widest kernel */
    double reach_points;  /* its longest */
};

/* Of one object. */
struct render_object_effects {
    bool albedo;            /* all light leaves where it entered; else, as the material says: */
    bool local, subsurface; /* light that leaves where it entered, and elsewhere */
    bool same_side;         /* light that falls on one side does not leave on the other */
    bool clusters, color;   /* false: one kernel, one channel */
    bool fresnel, highlights, reflection;
};

struct render_effects {
    bool called[RENDER_EFFECTS];
    struct render_object_effects *objects; /* [scene.object_count], heap */
};

/* Whether to render it; asked once an object, light or picture, never for each ray or pair. */
static inline bool render_has(const struct render_effects *effects, enum render_effect id)
{
    return RENDER_EFFECTS_BUILT(id) && effects->called[id];
}

/* Whether the scene's `without` names it. */
bool render_forbids(const struct scene *scene, enum render_effect id);

/* The effects that the scene calls for and does not forbid; `albedo`: every material without subsurface scattering. */
int render_effects_plan(const struct scene *scene, const struct render_object_facts *facts,
                        bool albedo, struct render_effects *effects, struct nacre_error *error);
void render_effects_finish(struct render_effects *effects);

#endif
