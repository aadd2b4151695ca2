/* Which files a folder for POV-Ray holds, and whether they may be overwritten. */
#ifndef RENDER_POV_FOLDER_H
#define RENDER_POV_FOLDER_H

#include "nacre/error.h"
#include "render/scene.h"

/* Refuse a folder of which files that the scene would be written over are not as nacre left them. */
int pov_folder_check(const char *folder, const struct scene *scene, struct nacre_error *error);

/* Remove what is written for the scene, what povray leaves, and the folder; what cannot be removed is left. */
void pov_folder_remove(const char *folder, const struct scene *scene);

#endif
