/* A mesh as OpenGL draws it: cut into compact pieces, of which those out of view are left out. */
#ifndef RENDER_PREVIEW_MESH_H
#define RENDER_PREVIEW_MESH_H

#include "nacre/error.h"
#include "render/mesh.h"
#include "render/osmesa.h"
#include "render/view.h"

struct preview_piece {
    size_t first, count; /* indices */
    struct vec3 middle;  /* of a sphere around it */
    double radius_mm;
};

struct preview_mesh {
    GLuint array;
    struct preview_piece *pieces;
    size_t piece_count;
};

/* Hand a mesh and the light at its vertices (NULL: none) to OpenGL. Finish it whatever is returned. */
int preview_mesh_make(struct preview_mesh *made, const struct osmesa *gl, const struct mesh *mesh,
                      const float (*light)[3], struct nacre_error *error);
void preview_mesh_finish(struct preview_mesh *made);

/* Draw what can lie within the view's pyramid. */
void preview_mesh_draw(const struct preview_mesh *made, const struct osmesa *gl,
                       const struct view *view);

#endif
