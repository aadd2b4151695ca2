/* Plain objects under area lights: POV-Ray draws their soft shadows slowly and in steps, so they are calculated here, at
 * vertices that lie a few pixels apart in the picture. */
#ifndef RENDER_PLAIN_H
#define RENDER_PLAIN_H

#include "base/progress.h"
#include "render/lights.h"
#include "render/mesh.h"
#include "render/scene.h"
#include "render/world.h"

/* Whether the scene has an area light. */
bool plain_wanted(const struct scene *scene);

/* Split edges that the camera would see longer than a few pixels. */
int plain_refine(struct mesh *mesh, const struct scene *scene, size_t limit,
                 struct nacre_error *error);

/* irradiance[vertex][3] of the area lights alone. */
int plain_light(const struct mesh *mesh, const struct world *world, const struct light *lights,
                size_t light_count, uint64_t seed, struct progress *progress,
                float (*irradiance)[3], struct nacre_error *error);

#endif
