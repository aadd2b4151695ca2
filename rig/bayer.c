/* Names of the Bayer orders. */
#include "rig/bayer.h"

#include <stddef.h>

const char *const bayer_names[] = {"RGGB", "BGGR", "GRBG", "GBRG", "mono", NULL};
