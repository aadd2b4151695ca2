/* Quick pictures of a lit scene by OpenGL, in memory: same camera and same light as POV-Ray's pictures, from any side. */
#ifndef RENDER_PREVIEW_H
#define RENDER_PREVIEW_H

#include "base/picture.h"
#include "nacre/error.h"
#include "render/stage.h"

struct preview;

enum { PREVIEW_LIGHTS_MAXIMUM = 8 };

/* Whether OpenGL can be had at all, to be told before the work. */
int preview_probe(struct nacre_error *error);

/* Hand the stage, which was baked and must stay, to OpenGL, and draw the maps of depths that shadows are taken from.
 * `smooth`: edges are, for four times the pixels. To be used in the thread that opened it. */
int preview_open(const struct stage *stage, bool smooth, struct preview **preview,
                 struct nacre_error *error);
void preview_close(struct preview *preview); /* NULL is allowed */

/* The picture as the scene's camera sees it after it has gone round the vertical through what it looks at. Values as
 * render_scene makes them. */
int preview_draw(struct preview *preview, double turn_deg, struct picture *picture,
                 struct nacre_error *error);

#endif
