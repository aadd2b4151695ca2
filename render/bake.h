/* The light that leaves every vertex of one translucent object. */
#ifndef RENDER_BAKE_H
#define RENDER_BAKE_H

#include "base/opencl.h"
#include "base/progress.h"
#include "render/appearance.h"
#include "render/gather.h"
#include "render/lights.h"
#include "render/mapping.h"
#include "render/scene.h"
#include "render/world.h"

struct bake_settings {
    double density; /* light samples to one surface point */
    int rays;       /* shadow rays from a sample to an area light */
    size_t photons; /* 0: stratified samples; else this many photons in their place */
    uint64_t seed;
    bool quiet;
};

struct bake_counts {
    size_t samples;
    uint64_t rays;
    struct gather_counts gather;
    double light_seconds, gather_seconds;
};

/* radiosity[vertex][3], zeroed by the caller. `object` is the mesh's number in the world. */
int bake_object(const struct mesh *mesh, const struct mapping *mapping,
                const struct appearance *appearance, const struct scene_material *material,
                const struct world *world, size_t object, const struct light *lights,
                size_t light_count, const struct opencl *opencl,
                const struct bake_settings *settings, float (*radiosity)[3],
                struct bake_counts *counts, struct nacre_error *error);

#endif
