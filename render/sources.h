/* Light samples, summed up by surface points of the material and by squares of 2, 4, 8 and 16 of them.
 *
 * A square's light is held as moments: for each basis kernel and term sum flux F U (basis.h), at its mean place. The
 * pyramid has the material's mean F U over its own squares, for light that falls across a cut in the texture. */
#ifndef RENDER_SOURCES_H
#define RENDER_SOURCES_H

#include "nacre/error.h"
#include "render/appearance.h"
#include "render/levels.h"
#include "render/samples.h"

#include <stddef.h>
#include <stdint.h>

/* Light that is farther spread in space than this many sides of its square is parted. */
#define SOURCES_WIDEST 1.2

/* Read by gather.cl, too. */
struct source {
    float position[3], x, y, flux[3], normal[3];
    /* By which rings are told apart: for samples that of the light of their surface point, if that is summed up. */
    float middle[3];
    int32_t chart;
    uint32_t texel;
};

struct source_set {
    size_t count;
    struct source *list; /* those that follow each other are close together */
};

struct sources {
    int count; /* of levels of squares */
    struct source_set points, squares[LEVELS_MAXIMUM];
    /* Of samples about the place of their surface point's light, along each axis of the surface: mean, points^2. */
    float variance;
    size_t moment_size; /* floats: [parts][terms][4], with a kernel per term [terms][4] */
    float *moments[LEVELS_MAXIMUM]; /* of the squares */
    float *pyramid[LEVELS_MAXIMUM]; /* [height / 2^(i + 1)][width / 2^(i + 1)], rounded up */
};

/* The samples that carry flux, those close together behind each other. */
int sources_take(struct source_set *set, const struct light_samples *samples,
                 struct nacre_error *error);
void source_set_finish(struct source_set *set);

/* Sum them up as far as the levels ask for it, which is more than there is already; `sources` begins as zeros. Samples
 * are told their middles. */
int sources_extend(struct sources *sources, struct source_set *samples,
                   const struct appearance *appearance, const struct levels *levels,
                   double point_mm, struct nacre_error *error);
void sources_finish(struct sources *sources);

#endif
