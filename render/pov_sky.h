/* What POV-Ray shows where there is no object: the environment, or the background's colour. */
#ifndef RENDER_POV_SKY_H
#define RENDER_POV_SKY_H

#include "nacre/error.h"
#include "render/environment.h"
#include "render/scene.h"

#include <stdio.h>

/* Name of the environment's picture in the folder. */
#define POV_SKY "environment.exr"

/* The statements; `environment` may be NULL. */
void pov_sky_put(FILE *file, const struct scene *scene, const struct environment *environment);

/* The environment's picture, times the exposure, as POV-Ray has nothing to multiply it with. */
int pov_sky_write(const char *folder, const struct environment *environment, double exposure,
                  struct nacre_error *error);

#endif
