/* The projector's light on the sample: from levels to irradiance. */
#ifndef RIG_VIRTUAL_PROJECTION_H
#define RIG_VIRTUAL_PROJECTION_H

#include "nacre/error.h"
#include "rig/station.h"
#include "rig/virtual/effects.h"
#include "rig/virtual/spread.h"

#include <stdint.h>

/* Zero-initialised it is empty. */
struct projection {
    int width, height;
    double light[256]; /* of a level, in the picture's centre */
    double *falloff;   /* [height][width]; NULL: none */
    struct spread spread;
    float *planes; /* [2][height][width] */
};

int projection_init(const struct station *station, const struct effects *effects,
                    struct projection *projection, struct nacre_error *error);
void projection_finish(struct projection *projection);

/* irradiance[3][height][width] for levels[height][width], 1 where white falls in the centre, and the work of it. */
void projection_draw(struct projection *projection, struct effects *effects, const uint8_t *levels,
                     float *irradiance);

#endif
