/* A scan that was divided by white made one of even light: the projector's fall-off moved to where light enters. */
#ifndef RIG_DEVELOP_EVEN_H
#define RIG_DEVELOP_EVEN_H

#include "nacre/error.h"
#include "nacre/scan.h"
#include "rig/develop/falloff.h"

/* Write the scan at `uneven`, of info's size, evened out as `output`, which appears whole or not at all. */
int even_scan(const char *uneven, const struct falloff *falloff, const struct nacre_scan_info *info,
              const char *output, struct nacre_error *error);

#endif
