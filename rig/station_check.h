/* What a station file is refused for beyond its single keys. */
#ifndef RIG_STATION_CHECK_H
#define RIG_STATION_CHECK_H

#include "nacre/error.h"
#include "rig/station.h"

/* Check what was read from `path`; a message names file and line. */
int station_check(const char *path, const struct station *station, struct nacre_error *error);

#endif
