/* What nacre render tells of its work, as text and as JSON. */
#ifndef CMD_RENDER_PRINT_H
#define CMD_RENDER_PRINT_H

#include "render/render.h"

/* `frames`: that OpenGL drew; 0: POV-Ray drew. */
void render_print_text(const char *picture, int frames, const struct render_report *report);
int render_print_json(const char *picture, int frames, const struct render_report *report,
                      struct nacre_error *error);

#endif
