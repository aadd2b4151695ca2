/* Pictures that shine: what a projector shows, and an environment. */
#ifndef RENDER_LIGHT_PICTURE_H
#define RENDER_LIGHT_PICTURE_H

#include "base/picture.h"
#include "nacre/error.h"

/* Read a picture, of which negative values count as 0. One that is not finite somewhere is refused, wherever its light
 * would fall. */
int light_picture_read(const char *path, struct picture *picture, struct nacre_error *error);

#endif
