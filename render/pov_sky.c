/* Writing POV-Ray's sky. */
#include "render/pov_sky.h"

#include "render/pov_digest.h"

#include <stdlib.h>

/* HALF's largest value: a sun may be brighter than a picture can show. */
static const float brightest = 65504;

void pov_sky_put(FILE *file, const struct scene *scene, const struct environment *environment)
{
    const double *colour = environment ? environment->color : scene->image.background;
    double factor = environment ? scene->image.exposure : 1;
    if (environment && environment->picture.rgb) {
        (void)fprintf(file,
                      "// POV-Ray's own picture begins at x and turns with y up; this one's middle "
                      "is at y, with z up.\n"
                      "sky_sphere {\n  pigment { image_map { exr \"" POV_SKY
                      "\" map_type 1 interpolate 2 } }\n"
                      "  matrix <0, -1, 0, 0, 0, 1, -1, 0, 0, 0, 0, 0>\n  rotate %.9g*z\n}\n\n",
                      scene->environment.rotation_deg);
        return;
    }
    (void)fprintf(file, "background { rgb <%.6g, %.6g, %.6g> }\n\n", colour[0] * factor,
                  colour[1] * factor, colour[2] * factor);
}

int pov_sky_write(const char *folder, const struct environment *environment, double exposure,
                  struct nacre_error *error)
{
    const struct picture *picture = &environment->picture;
    struct picture exposed = {0};
    char *path = NULL;
    size_t count = (size_t)picture->width * (size_t)picture->height * 3;
    int status = picture_allocate(&exposed, picture->width, picture->height, error);
    if (status != NACRE_OK) {
        return status;
    }
    for (size_t i = 0; i < count; i++) {
        exposed.rgb[i] = fminf(picture->rgb[i] * (float)exposure, brightest);
    }
    if (asprintf(&path, "%s/" POV_SKY, folder) < 0) {
        path = NULL;
    }
    status = pov_picture_write(path, &exposed, error);
    picture_finish(&exposed);
    return status;
}
