/* Whether a PLY file holds all that its header announces: Assimp takes what is missing for zeros, or aborts. */
#ifndef RENDER_MESH_PLY_H
#define RENDER_MESH_PLY_H

#include "nacre/error.h"

#include <stddef.h>

/* text[size] is the whole file. Headers that cannot be followed are left to Assimp's judgement. */
int mesh_ply_check(const char *path, const char *text, size_t size, struct nacre_error *error);

#endif
