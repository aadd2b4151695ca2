/* The keys of scene files, as base/settings.h reads them into a struct scene. */
#ifndef RENDER_SCENE_SCHEMA_H
#define RENDER_SCENE_SCHEMA_H

#include "render/scene.h"

extern const struct settings_schema scene_schema;

#endif
