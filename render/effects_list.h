/* What a picture is rendered with, what is left out, why, and at what cost: for people. */
#ifndef RENDER_EFFECTS_LIST_H
#define RENDER_EFFECTS_LIST_H

#include "base/effect.h"
#include "nacre/error.h"
#include "render/stage.h"

/* Every effect of a prepared scene, in the order of light's way; *effects is heap memory, *number of them. */
int render_effects_list(const struct stage *stage, struct effect **effects, size_t *number,
                        struct nacre_error *error);

#endif
