/* What `nacre render --explain` prints. */
#ifndef CMD_RENDER_EXPLAIN_H
#define CMD_RENDER_EXPLAIN_H

#include "nacre/error.h"
#include "render/render.h"

#include <stdbool.h>

/* List the effects of the scene, which was read from `path`, as it would be rendered. */
int render_explain(const char *path, const struct scene *scene,
                   const struct render_settings *settings, bool json, struct nacre_error *error);

#endif
