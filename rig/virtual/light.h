/* The way of light in the virtual station: from the levels that the projector shows to the raw values of a frame. */
#ifndef RIG_VIRTUAL_LIGHT_H
#define RIG_VIRTUAL_LIGHT_H

#include "nacre/error.h"
#include "rig/station.h"
#include "rig/virtual/effects.h"

#include <stdbool.h>
#include <stdint.h>

struct light;

struct light_exposure {
    int64_t begin_ns, exposure_ns; /* on the station's clock */
    uint64_t key;                  /* of the noise */
};

/* Reads the sample that station->simulated names, and plans the effects. Of `station` nothing is kept. */
int light_new(const struct station *station, struct light **light, struct nacre_error *error);
void light_free(struct light *light); /* NULL is allowed */

/* What is simulated, and the work done for it so far. */
const struct effects *light_effects(const struct light *light);

/* Show levels[height][width] of the surface points. */
void light_show(struct light *light, const uint8_t *levels);

/* Lay the white diffuse layer on the sample or take it off. */
void light_lay_white_layer(struct light *light, bool on);

/* Expose what is shown: raw[height][width]. */
int light_expose(struct light *light, const struct light_exposure *exposure, uint16_t *raw,
                 struct nacre_error *error);

#endif
