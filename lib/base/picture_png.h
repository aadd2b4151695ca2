/* Pictures as PNG files. Private to picture*.c; encoding is in picture.h. */
#ifndef BASE_PICTURE_PNG_H
#define BASE_PICTURE_PNG_H

#include "base/picture.h"

int picture_read_png(const char *path, struct picture *picture, struct nacre_error *error);

#endif
