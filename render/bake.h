/* The light that leaves every vertex of one translucent object. */
#ifndef RENDER_BAKE_H
#define RENDER_BAKE_H

#include "base/opencl.h"
#include "base/progress.h"
#include "render/appearance.h"
#include "render/effects.h"
#include "render/gather.h"
#include "render/irradiance.h"
#include "render/mapping.h"
#include "render/scene.h"

/* See gather.h. Samples scatter by more: 0.5 % at what `nacre render` takes (docs/rendering.md). */
#define BAKE_TOLERANCE 2e-3

struct bake_settings {
    double density;   /* light samples to one surface point */
    double before;    /* those behind so many that the same seed made; 0: the first */
    double tolerance; /* of the gather; 0: BAKE_TOLERANCE */
    int rays;         /* shadow rays from a sample to an area light */
    size_t photons;   /* 0: stratified samples; else this many photons in their place */
    uint64_t seed;
    bool quiet;
    struct progress_deadline *deadline; /* when to give up; NULL: never */
};

struct bake_counts {
    size_t samples, lit; /* all; those on which light falls */
    struct light_work work;
    struct gather_counts gather;
    size_t
        products; /* of F by H, that each pair in the gather takes: colours times terms, filled up */
    double light_seconds, gather_seconds;
};

/* Add to radiosity[vertex][3] what leaves the surface under the lighting, of which rays and seed are the settings'.
 * Photons are sent out where there are lights. Adds to *counts. */
int bake_object(const struct lit_surface *surface, const struct appearance *appearance,
                const struct render_object_effects *effects, const struct lighting *lighting,
                const struct opencl *opencl, const struct bake_settings *settings,
                float (*radiosity)[3], struct bake_counts *counts, struct nacre_error *error);

#endif
