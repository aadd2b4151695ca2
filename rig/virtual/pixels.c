/* Sensitivities, dead and hot pixels, drawn from the seed and the pixel's number. */
#include "rig/virtual/pixels.h"

#include "rig/virtual/sensor.h"

#include <math.h>
#include <stdlib.h>

enum { KEY_SENSITIVITY = 0x70697865, KEY_DEAD, KEY_HOT };

/* Evenly from 0 to 1, both excluded. */
static double draw(const struct virtual_settings *settings, int what, size_t pixel)
{
    uint64_t key = sensor_key((uint64_t)settings->seed, (uint64_t)what);
    return ((double)(sensor_key(key, pixel) >> 32) + 0.5) * 0x1p-32;
}

double pixels_sensitivity(const struct virtual_settings *settings, size_t pixel)
{
    double deviation = sensor_normal(draw(settings, KEY_SENSITIVITY, pixel));
    return fmax(1 + settings->camera.nonuniformity * deviation, 0);
}

bool pixels_is_dead(const struct virtual_settings *settings, size_t pixel)
{
    return draw(settings, KEY_DEAD, pixel) < settings->camera.dead_pixels;
}

int hot_pixels_init(const struct virtual_settings *settings, size_t pixel_count,
                    struct hot_pixels *hot, struct nacre_error *error)
{
    const struct virtual_camera_settings *camera = &settings->camera;
    size_t count = 0;
    for (size_t i = 0; i < pixel_count; i++) {
        count += draw(settings, KEY_HOT, i) < camera->hot_pixels;
    }
    hot->pixels = calloc(count + 1, sizeof *hot->pixels);
    hot->per_s = calloc(count + 1, sizeof *hot->per_s);
    if (!hot->pixels || !hot->per_s) {
        return nacre_fail_memory(error, "the virtual sensor");
    }
    for (size_t i = 0; i < pixel_count; i++) {
        double drawn = draw(settings, KEY_HOT, i);
        if (drawn < camera->hot_pixels) {
            hot->pixels[hot->count] = i;
            hot->per_s[hot->count++] =
                (float)(-log(drawn / camera->hot_pixels) * camera->hot_per_s);
        }
    }
    return NACRE_OK;
}

void hot_pixels_finish(struct hot_pixels *hot)
{
    free(hot->pixels);
    free(hot->per_s);
    *hot = (struct hot_pixels){0};
}
