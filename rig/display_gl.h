/* Patterns drawn by OpenGL ES into buffers that a display shows, every pixel exactly where and what it should be. */
#ifndef RIG_DISPLAY_GL_H
#define RIG_DISPLAY_GL_H

#include "rig/display_choice.h"

struct display_gl;

/* Draw for the card that `file` has open, which outlives it, frames of width x height pixels. `name` begins messages.
 * Refuses a card that does not draw exactly. It may be used by any thread, one at a time. */
int display_gl_new(int file, const char *name, int width, int height,
                   const struct display_region *region, struct display_gl **gl,
                   struct nacre_error *error);
void display_gl_free(struct display_gl *gl); /* NULL is allowed */

/* What draws, as it calls itself. */
const char *display_gl_renderer(const struct display_gl *gl);

/* Draw levels[region.height][region.width] with black around (NULL: all black), and write the framebuffer that holds
 * it. It stays as it is until the next but one is drawn. */
int display_gl_draw(struct display_gl *gl, const uint8_t *levels, uint32_t *framebuffer,
                    struct nacre_error *error);

#endif
