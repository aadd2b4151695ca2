/* The program povray as a subprocess. */
#ifndef RENDER_POVRAY_H
#define RENDER_POVRAY_H

#include "base/picture.h"
#include "base/progress.h"
#include "nacre/error.h"

#include <stdbool.h>

/* Whether there is a povray to run, told before long work. */
int povray_probe(struct nacre_error *error);

/* Render scene.pov in `folder` at the given size and read the picture; leaves povray.log and picture.exr there. `baked`
 * is the variable of pov.h. When povray fails, the error carries its own message. Stops it when the user asks to stop. */
int povray_render(const char *folder, int width, int height, bool baked, struct progress *progress,
                  struct picture *picture, struct nacre_error *error);

/* Wall seconds that povray spent on pixels alone, by the povray.log that it left; 0 where it does not tell. */
double povray_trace_seconds(const char *folder);

#endif
