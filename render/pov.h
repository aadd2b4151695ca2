/* A scene as a folder of POV-Ray files, which can be rendered and edited on without nacre. */
#ifndef RENDER_POV_H
#define RENDER_POV_H

#include "nacre/error.h"
#include "render/lights.h"
#include "render/mesh.h"
#include "render/scene.h"

#include <stddef.h>

/* Name of the main file in the folder. */
#define POV_MAIN "scene.pov"

struct pov_object {
    const struct mesh *mesh;
    const struct scene_object *settings;
    const float (*radiosity)[3]; /* per vertex: pi times radiance; NULL: a plain object */
    const float (
        *irradiance)[3]; /* plain: of the area lights, per vertex; NULL: all light is POV-Ray's */
};

/* Name of the variable that, at 0, leaves the area lights on plain objects to POV-Ray: `povray Declare=baked=0`. */
#define POV_BAKED "baked"

/* Write scene.pov, an include file for each object and an EXR for each projected picture into an existing folder.
 * Pixel values of what POV-Ray makes of them, with assumed_gamma 1, are the picture's (see scene.h). */
int pov_write(const char *folder, const struct scene *scene, const struct light *lights,
              const struct pov_object *objects, struct nacre_error *error);

#endif
