/* Colour pictures in memory, linear and scene-referred, read from and written to EXR and PNG. */
#ifndef BASE_PICTURE_H
#define BASE_PICTURE_H

#include "nacre/error.h"

#include <stddef.h>

struct picture {
    int width, height;
    float *rgb; /* [height][width][3], linear; heap */
};

/* Zeroed pixels. */
int picture_allocate(struct picture *picture, int width, int height, struct nacre_error *error);
void picture_finish(struct picture *picture);

/* Read by the ending of the name: .exr (R G B or Y of the first part) or .png of any kind (decoded from sRGB, or by its
 * gAMA where that says something else; what is transparent is black). */
int picture_read(const char *path, struct picture *picture, struct nacre_error *error);

/* Write by the ending of the name: .exr (HALF, or FLOAT where a value passes 65504; ZIP, with `key=value` string
 * attributes "nacre.KEY" from the NULL-terminated list, which may be NULL) or .png (sRGB, values clipped to 0..1, NaN
 * as magenta, the attributes as text). */
int picture_write(const char *path, const struct picture *picture, const char *const *attributes,
                  struct nacre_error *error);

/* The PNG file of the picture in memory; *bytes is heap memory. */
int picture_encode_png(const struct picture *picture, unsigned char **bytes, size_t *size,
                       struct nacre_error *error);

#endif
