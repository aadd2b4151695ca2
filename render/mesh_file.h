/* Whether a mesh file can be what it says, told before it is read. */
#ifndef RENDER_MESH_FILE_H
#define RENDER_MESH_FILE_H

#include "nacre/error.h"

/* Refuses what is missing, no file, empty, larger than 4 GB, or a PLY that
 * holds less than its header says. */
int mesh_file_check(const char *path, struct nacre_error *error);

#endif
