/* A scene as a folder of POV-Ray files, which can be rendered and edited on without nacre. */
#ifndef RENDER_POV_H
#define RENDER_POV_H

#include "nacre/error.h"
#include "render/lights.h"
#include "render/mesh.h"
#include "render/scene.h"

#include <stdbool.h>
#include <stddef.h>

/* Names of the main file in the folder, and of those of an object and of a projector, by number. */
#define POV_MAIN   "scene.pov"
#define POV_OBJECT "object-%zu.inc"
#define POV_SLIDE  "slide-%zu.exr"

struct pov_object {
    const struct mesh *mesh;
    const struct scene_object *settings;
    bool fresnel, highlights, reflection; /* effects that the object has */
    const float (*radiosity)[3];          /* per vertex: pi times radiance; NULL: a plain object */
    /* Plain: irradiance per vertex that POV-Ray does not find, and the part of it that is of soft lights, which it can
     * find; NULL: all light is POV-Ray's. */
    const float (*irradiance)[3], (*soft)[3];
};

/* Name of the variable that, at 0, leaves the soft lights on plain objects to POV-Ray: `povray Declare=baked=0`. */
#define POV_BAKED "baked"

/* Write scene.pov, an include file for each object and an EXR for each projected picture and the environment's into an
 * existing folder, over what is there (pov_folder.h). `lights` are those of the scene, and then, if `environment` is not
 * NULL, so is that.
 * Pixel values of what POV-Ray makes of them, with assumed_gamma 1, are the picture's (see scene.h). */
int pov_write(const char *folder, const struct scene *scene, const struct light *lights,
              const struct environment *environment, const struct pov_object *objects,
              struct nacre_error *error);

#endif
