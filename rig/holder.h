/* Which process has a device open. */
#ifndef RIG_HOLDER_H
#define RIG_HOLDER_H

#include <stddef.h>

/* Write "NAME (process 1234)" of another process that has the device node `path` open, as far as we may look, or
 * "another program". systemd-logind, which opens devices for others, is named only if nobody else is found. */
void holder_find(const char *path, char *holder, size_t size);

#endif
