/* Looking through /proc for who holds a device. */
#include "rig/holder.h"

#include <glob.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* Whether the open file of /proc/PID/fd/N is the device. */
static bool is_device(const char *path, dev_t device)
{
    struct stat found;
    return stat(path, &found) == 0 && S_ISCHR(found.st_mode) && found.st_rdev == device;
}

/* Write the text for a process; whether it has the device for itself. */
static bool name_process(long process, char *holder, size_t size)
{
    char path[64];
    char name[32] = "";
    (void)snprintf(path, sizeof path, "/proc/%ld/comm", process);
    FILE *file = fopen(path, "r");
    if (file) {
        if (fgets(name, sizeof name, file)) {
            name[strcspn(name, "\n")] = '\0';
        }
        (void)fclose(file);
    }
    (void)snprintf(holder, size, "%s (process %ld)", name[0] ? name : "a program", process);
    return strcmp(name, "systemd-logind") != 0;
}

void holder_find(const char *path, char *holder, size_t size)
{
    struct stat device;
    glob_t files = {0};
    (void)snprintf(holder, size, "another program");
    if (stat(path, &device) != 0 || !S_ISCHR(device.st_mode) ||
        glob("/proc/[0-9]*/fd/*", GLOB_NOSORT, NULL, &files) != 0) {
        globfree(&files);
        return;
    }
    bool named = false;
    for (size_t i = 0; i < files.gl_pathc && !named; i++) {
        long process = strtol(files.gl_pathv[i] + strlen("/proc/"), NULL, 10);
        if (process != (long)getpid() && is_device(files.gl_pathv[i], device.st_rdev)) {
            named = name_process(process, holder, size);
        }
    }
    globfree(&files);
}
