/* What decides about the effects of an object, found in its material and its mesh. */
#ifndef RENDER_FACTS_H
#define RENDER_FACTS_H

#include "nacre/material.h"
#include "render/appearance.h"
#include "render/effects.h"
#include "render/mesh.h"
#include "render/scene.h"
#include "render/world.h"

void facts_of_material(struct render_object_facts *facts, const struct nacre_material *material,
                       const struct appearance *appearance);

/* The mesh in its place, before its edges are split. */
void facts_of_mesh(struct render_object_facts *facts, const struct mesh *mesh,
                   const struct scene *scene);

/* The share of the surface where a ray inward meets the other side within `reach_mm`; a few thousand triangles are
 * looked at. `object` is the mesh's number in the world. */
double facts_thin_share(const struct world *world, size_t object, const struct mesh *mesh,
                        double reach_mm);

#endif
