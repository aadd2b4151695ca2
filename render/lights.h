/* The lights of a scene: what they send to a point, and photons that they send out. */
#ifndef RENDER_LIGHTS_H
#define RENDER_LIGHTS_H

#include "base/picture.h"
#include "render/environment.h"
#include "render/scene.h"
#include "render/vector.h"

struct light;

/* Light that would reach a point if nothing were in between. */
struct light_arrival {
    struct vec3 from;     /* where it comes from */
    double irradiance[3]; /* on the surface, cosine included */
};

/* What its light is looked up in. */
enum light_lookup { LOOKUP_NOTHING, LOOKUP_SLIDE, LOOKUP_SKY, LIGHT_LOOKUPS };

struct light {
    int kind;   /* enum scene_light_kind */
    int lookup; /* enum light_lookup */
    bool soft;  /* shines from more than a point: many samples make its light */
    struct light_arrival (*arrive)(const struct light *light, struct vec3 point, struct vec3 normal,
                                   const double u[2]);
    struct vec3 position;
    struct vec3 forward, right, up; /* orthonormal; right is right as seen from the light */
    double distance_mm;             /* to the point aimed at */
    /* Radiant intensity along `forward` (irradiance times mm^2), of the whole light; where a slide is in front, of
     * the light behind it. */
    double intensity[3];
    double width_mm, height_mm; /* LIGHT_AREA */
    double cos_full, cos_edge;  /* LIGHT_SPOT: full light within, none without */
    double tan_x, tan_y;        /* LIGHT_PROJECTOR: half extents of the picture at unit distance */
    struct picture slide;       /* LIGHT_PROJECTOR: rows from the top down; none: white */
    struct environment environment; /* LIGHT_ENVIRONMENT */
};

/* A photon on its way. */
struct photon {
    struct vec3 origin, direction;
    double flux[3]; /* irradiance times mm^2 */
};

/* Prepare a light; reads or draws its slide. */
int light_make(struct light *light, const struct scene_light *settings, struct nacre_error *error);

/* Prepare the environment as a light; reads its picture. */
int light_make_environment(struct light *light, const struct scene_environment *settings,
                           struct nacre_error *error);

/* Tell an environment where the scene ends, once, before it shines. */
void light_surround(struct light *light, struct vec3 centre, double radius_mm);
void light_finish(struct light *light);

/* One sample, at u[2] in [0, 1)^2 of the light's extent, of the light that falls on `point` with unit `normal`; all of it
 * for a light that is not soft. */
static inline struct light_arrival light_arrive(const struct light *light, struct vec3 point,
                                                struct vec3 normal, const double u[2])
{
    return light->arrive(light, point, normal, u);
}

/* One of the photons that the light sends towards a sphere, by u[4]; the mean over u of the flux of those that meet a
 * surface in the sphere is the flux that the surface receives. */
struct photon light_emit(const struct light *light, struct vec3 centre, double radius_mm,
                         const double u[4]);

#endif
