/* Plain objects under soft light: POV-Ray draws soft shadows slowly and in steps, and knows no environment, so this is
 * calculated here, at vertices that lie a few pixels apart in the picture. So is what falls on them from others. */
#ifndef RENDER_PLAIN_H
#define RENDER_PLAIN_H

#include "base/progress.h"
#include "render/irradiance.h"
#include "render/mesh.h"
#include "render/scene.h"
#include "render/world.h"

/* Split edges that the camera would see longer than a few pixels, also while it goes `around` what it looks at, and what is
 * out of the picture into even pieces (`evenly`: all, as what lights other surfaces needs); and where one of the `others` (or NULL) cuts an edge, as it does where it stands on
 * the mesh, longer than half of a pixel: a vertex below it is dark, and would draw a dark tooth out from under it.
 * *limited: edges stayed longer, as there would be more triangles than `limit`. */
int plain_refine(struct mesh *mesh, const struct scene *scene, bool around, bool evenly,
                 const struct world *others, size_t limit, bool *limited,
                 struct nacre_error *error);

enum {
    PLAIN_RAYS = 144,         /* to a soft light: the steps of a penumbra vanish between them */
    PLAIN_SURFACE_RAYS = 256, /* to other surfaces, of which any may be small */
};

/* Which light. */
enum plain_light {
    PLAIN_SOFT, /* of soft lights */
    PLAIN_HARD, /* of the others, which POV-Ray draws, to be passed on to other surfaces */
    PLAIN_SURFACES,
};

/* irradiance[vertex][3]; lighting->rays does not count here. Adds to *work. */
int plain_light(const struct mesh *mesh, const struct lighting *lighting, enum plain_light which,
                struct progress *progress, float (*irradiance)[3], struct light_work *work,
                struct nacre_error *error);

#endif
