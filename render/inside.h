/* Lights inside translucent objects, whose surfaces answer to light from outside alone. */
#ifndef RENDER_INSIDE_H
#define RENDER_INSIDE_H

#include "nacre/error.h"
#include "render/stage.h"

/* Refuses a light that a translucent object closes in on all sides. The stage has its world. */
int lights_check_outside(const struct stage *stage, struct nacre_error *error);

#endif
