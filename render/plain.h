/* Plain objects under soft light: POV-Ray draws soft shadows slowly and in steps, and knows no environment, so this is
 * calculated here, at vertices that lie a few pixels apart in the picture. So is what falls on them from others. */
#ifndef RENDER_PLAIN_H
#define RENDER_PLAIN_H

#include "base/progress.h"
#include "render/irradiance.h"
#include "render/mesh.h"
#include "render/scene.h"
#include "render/world.h"

enum {
    PLAIN_RAYS = 144,         /* to a soft light: the steps of a penumbra vanish between them */
    PLAIN_ROUGH_RAYS = 36,    /* to see where light changes */
    PLAIN_SURFACE_RAYS = 256, /* to other surfaces, of which any may be small */
};

/* Which light. */
enum plain_light {
    PLAIN_SOFT, /* of soft lights */
    PLAIN_HARD, /* of the others, which POV-Ray draws, to be passed on to other surfaces */
    PLAIN_SURFACES,
    PLAIN_ROUGH, /* of soft lights, by fewer rays */
};

/* irradiance[vertex][3], of vertices from `first` on; lighting->rays does not count here. Adds to *work. */
int plain_light(const struct mesh *mesh, size_t first, const struct lighting *lighting,
                enum plain_light which, struct progress *progress, float (*irradiance)[3],
                struct light_work *work, struct nacre_error *error);

/* How a mesh is split. */
struct plain_split {
    const struct scene *scene;
    bool around;  /* the camera goes round what it looks at */
    bool evenly;  /* also what it sees, into pieces as even as those out of the picture */
    size_t limit; /* of triangles */
};

/* Split edges that the camera would see longer than a few pixels, and what is out of the picture into even pieces.
 * *limited: edges stayed longer, as there would be more triangles than the limit. */
int plain_split_seen(struct mesh *mesh, const struct plain_split *split, bool *limited,
                     struct nacre_error *error);

/* Then split edges in the picture on which light falls unequally down to three quarters of a pixel: shadows end there,
 * and vertices below what stands on the mesh are dark. It is the light of soft lights, roughly, or of hard ones where
 * none is soft; the world may hold the mesh as it was before it was split. Adds to *work. */
int plain_split_lit(struct mesh *mesh, const struct plain_split *split,
                    const struct lighting *lighting, struct progress *progress, bool *limited,
                    struct light_work *work, struct nacre_error *error);

#endif
