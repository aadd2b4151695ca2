/* Pictures as PNG files. Private to picture*.c; encoding is in picture.h. */
#ifndef BASE_PICTURE_PNG_H
#define BASE_PICTURE_PNG_H

#include "base/picture.h"

/* The PNG file in memory, with the `key=value` strings as text chunks "nacre.KEY"; `attributes` may be NULL. */
int picture_encode_png_text(const struct picture *picture, const char *const *attributes,
                            unsigned char **bytes, size_t *size, struct nacre_error *error);

int picture_read_png(const char *path, struct picture *picture, struct nacre_error *error);

#endif
