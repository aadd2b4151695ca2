/* The map of a camera's pixels that cannot be trusted, in memory and as a file that other sessions can use. */
#ifndef RIG_DEVELOP_PIXEL_MAP_H
#define RIG_DEVELOP_PIXEL_MAP_H

#include "nacre/error.h"
#include "rig/bayer.h"

#include <stddef.h>
#include <stdint.h>

/* All but good pixels are left out from the flat field on: what they see is NaN. */
enum pixel_class {
    PIXEL_GOOD,
    PIXEL_DEAD,      /* answers far less than nearly all of its neighbours of the same colour */
    PIXEL_HOT,       /* counts in the dark, in proportion to time, so that it is noisier */
    PIXEL_NONLINEAR, /* does not answer in proportion to light, or begins elsewhere than others */
    PIXEL_NOISY,     /* varies in the dark more than noise explains */
    PIXEL_CLASSES
};

/* Words in the order of the enum, NULL-terminated. */
extern const char *const pixel_class_names[];

/* Zero-initialised it is empty; pixel_map_finish frees. */
struct pixel_map {
    int width, height;
    enum bayer bayer;
    uint8_t *classes; /* [height][width], enum pixel_class */
    float *slope;     /* of white over time, raw units a second; NaN where not known */
    float *offset;    /* of the same line at no time, raw units above the pedestal */
    float *dark;      /* growth of black over time, raw units a second */
};

int pixel_map_init(struct pixel_map *map, int width, int height, enum bayer bayer,
                   struct nacre_error *error);
void pixel_map_finish(struct pixel_map *map);

/* How many pixels are of a class. */
size_t pixel_map_count(const struct pixel_map *map, enum pixel_class which);

/* Write as EXR: channel `class` UINT, `slope`, `offset` and `dark` FLOAT (docs/formats.md). */
int pixel_map_write(const struct pixel_map *map, const char *path, struct nacre_error *error);

/* Give pixels that `map` holds for good the class that the file at `path` gives them. The file must be of a camera of the
 * same size and Bayer order; channels other than `class` are not needed. */
int pixel_map_add_known(struct pixel_map *map, const char *path, struct nacre_error *error);

#endif
