/* Small file systems of a test's own, in a mount namespace: full disks and disks that refuse writing. */
#ifndef TESTS_CMD_MOUNTS_H
#define TESTS_CMD_MOUNTS_H

#include <stdbool.h>
#include <stddef.h>

/* Enter a mount namespace, as root or through a user namespace. To be called before any thread is started. Returns
 * whether mounting is possible now. */
bool mounts_enter(void);

/* Mount a RAM disk of `size` bytes, rounded to pages, on `folder`. */
bool mounts_disk(const char *folder, size_t size);
/* Let nothing be written to it any longer. */
bool mounts_make_read_only(const char *folder);
void mounts_remove(const char *folder);

#endif
