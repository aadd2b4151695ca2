/* What a scan needs of time and disk, and whether there is room for it. */
#include "rig/sequence.h"

#include <errno.h>
#include <libgen.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

/* More than the header of one part takes in a pattern's file. */
enum { PART_HEADER_BYTES = 4096 };

int sequence_estimate(const struct station *station, const struct plan *plan,
                      const struct session *session, struct sequence_needs *needs,
                      struct nacre_error *error)
{
    struct pattern *patterns = NULL;
    size_t count = 0;
    double turns = 0;
    int status = plan_order(plan, &patterns, &count, error);
    *needs = (struct sequence_needs){0};
    for (size_t i = 0; i < count; i++) {
        if (!session || !session_has(session, patterns[i])) {
            size_t exposures = plan_pattern_exposures(plan, patterns[i]);
            needs->patterns++;
            needs->exposures += exposures;
            for (size_t e = 0; e < exposures; e++) {
                turns += plan->exposure_turns[e];
            }
        }
    }
    uint64_t frame_bytes = (uint64_t)station->camera.width * (uint64_t)station->camera.height * 4;
    needs->seconds = turns / station->projector.wheel_hz;
    needs->bytes = needs->exposures * (frame_bytes + PART_HEADER_BYTES);
    free(patterns);
    return status;
}

/* Of the folder `path`, or of the one that it is to be made in. */
static int find_free_bytes(const char *path, double *bytes, struct nacre_error *error)
{
    struct statvfs disk;
    char *copy = strdup(path);
    if (!copy) {
        return nacre_fail_memory(error, "a path");
    }
    int result = statvfs(path, &disk);
    if (result != 0 && errno == ENOENT) {
        result = statvfs(dirname(copy), &disk);
    }
    int number = errno;
    free(copy);
    if (result != 0) {
        return nacre_fail_errno(error, number, "%s: cannot ask for the disk's free space", path);
    }
    *bytes = (double)disk.f_bavail * (double)disk.f_frsize;
    return NACRE_OK;
}

static const double mebibyte = 1048576;

int sequence_check_disk(const char *path, const struct sequence_needs *needs,
                        struct nacre_error *error)
{
    double free_bytes = 0;
    int status = find_free_bytes(path, &free_bytes, error);
    if (status == NACRE_OK && free_bytes < (double)needs->bytes) {
        status =
            nacre_fail(error,
                       "%s: the disk has %.1f MiB free and the scan may need %.1f MiB; free some "
                       "space or put the session on another disk",
                       path, free_bytes / mebibyte, (double)needs->bytes / mebibyte);
    }
    return status;
}

int sequence_check_room(const char *path, uint64_t next, uint64_t rest, struct nacre_error *error)
{
    double free_bytes = 0;
    int status = find_free_bytes(path, &free_bytes, error);
    if (status == NACRE_OK && free_bytes < (double)next) {
        status = nacre_fail(error,
                            "%s: the disk has %.1f MiB free, too little to go on, and what is "
                            "still to be measured may need %.1f MiB; free some space and resume "
                            "the scan (--resume)",
                            path, free_bytes / mebibyte, (double)rest / mebibyte);
    }
    return status;
}
