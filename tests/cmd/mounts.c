/* Small file systems of a test's own, in a mount namespace: full disks and disks that refuse writing. */
#include "tests/cmd/mounts.h"

#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/mount.h>
#include <unistd.h>

static bool write_text(const char *path, const char *text)
{
    int descriptor = open(path, O_WRONLY | O_CLOEXEC);
    bool written =
        descriptor >= 0 && write(descriptor, text, strlen(text)) == (ssize_t)strlen(text);
    if (descriptor >= 0) {
        (void)close(descriptor);
    }
    return written;
}

/* Become root of a user namespace, mapped to the user that we are. */
static bool enter_as_user(void)
{
    char map[64];
    uid_t user = geteuid();
    gid_t group = getegid();
    if (unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) {
        return false;
    }
    (void)snprintf(map, sizeof map, "0 %u 1", user);
    if (!write_text("/proc/self/uid_map", map) || !write_text("/proc/self/setgroups", "deny")) {
        return false;
    }
    (void)snprintf(map, sizeof map, "0 %u 1", group);
    return write_text("/proc/self/gid_map", map);
}

bool mounts_enter(void)
{
    bool entered = unshare(CLONE_NEWNS) == 0 || enter_as_user();
    /* What is mounted here must not appear outside. */
    return entered && mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) == 0;
}

bool mounts_disk(const char *folder, size_t size)
{
    char options[64];
    (void)snprintf(options, sizeof options, "size=%zu", size);
    return mount("nacre-test", folder, "tmpfs", 0, options) == 0;
}

bool mounts_make_read_only(const char *folder)
{
    return mount(NULL, folder, NULL, MS_REMOUNT | MS_RDONLY, NULL) == 0;
}

void mounts_remove(const char *folder)
{
    (void)umount2(folder, MNT_DETACH); /* the namespace ends with the test anyway */
}
