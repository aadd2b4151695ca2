/* Reading pictures that shine. */
#include "render/light_picture.h"

#include <math.h>

int light_picture_read(const char *path, struct picture *picture, struct nacre_error *error)
{
    if (picture_read(path, picture, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    size_t width = (size_t)picture->width, count = width * (size_t)picture->height * 3;
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(picture->rgb[i])) {
            picture_finish(picture);
            return nacre_fail(error, "%s: pixel (%zu, %zu) is not finite; mend the picture", path,
                              i / 3 % width, i / 3 / width);
        }
        picture->rgb[i] = fmaxf(picture->rgb[i], 0);
    }
    return NACRE_OK;
}
