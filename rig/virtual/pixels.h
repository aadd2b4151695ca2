/* What the making of the virtual sensor left different from pixel to pixel; fixed by the seed. */
#ifndef RIG_VIRTUAL_PIXELS_H
#define RIG_VIRTUAL_PIXELS_H

#include "nacre/error.h"
#include "rig/virtual/settings.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A pixel's sensitivity over the sensor's mean, and whether it sees nothing. */
double pixels_sensitivity(const struct virtual_settings *settings, size_t pixel);
bool pixels_is_dead(const struct virtual_settings *settings, size_t pixel);

/* Pixels with a dark current of their own, in raw units a second: exponentially distributed. Zero-initialised there are
 * none. */
struct hot_pixels {
    size_t count;
    size_t *pixels;
    float *per_s;
};

int hot_pixels_init(const struct virtual_settings *settings, size_t pixel_count,
                    struct hot_pixels *hot, struct nacre_error *error);
void hot_pixels_finish(struct hot_pixels *hot);

#endif
