/* The cameras of this machine. */
#ifndef RIG_CAMERA_LIST_H
#define RIG_CAMERA_LIST_H

#include "nacre/error.h"
#include "rig/camera_format.h"

enum { CAMERA_LISTED_FORMATS = 40 };

struct camera_listed {
    char path[64];                                              /* of the device node */
    char card[33];                                              /* what its driver calls it */
    const struct camera_format *formats[CAMERA_LISTED_FORMATS]; /* raw ones that nacre reads */
    size_t format_count;
    struct nacre_error problem; /* why no more is known; no text: none */
};

/* All nodes that stream pictures, and those that may not be opened; the caller frees *cameras. */
int camera_list(struct camera_listed **cameras, size_t *count, struct nacre_error *error);

#endif
