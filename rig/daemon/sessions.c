/* Looking through the folder of sessions. */
#include "rig/daemon/sessions.h"

#include "rig/sequence.h"
#include "rig/session.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LONGEST_NAME = 128 };

int sessions_check_name(const char *name, struct nacre_error *error)
{
    static const char allowed[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-";
    size_t length = strlen(name);
    if (length == 0 || length > LONGEST_NAME || name[0] == '.' || strspn(name, allowed) != length) {
        return nacre_fail(error,
                          "'%.*s' cannot be a session's name: use up to %d letters, digits and . _ "
                          "-, and no dot in front",
                          LONGEST_NAME, name, LONGEST_NAME);
    }
    return NACRE_OK;
}

char *sessions_path(const char *folder, const char *name)
{
    char *path = NULL;
    return asprintf(&path, "%s/%s", folder, name) < 0 ? NULL : path;
}

enum session_found sessions_find(const char *path)
{
    struct stat found;
    char *plan = sessions_path(path, "plan.yaml"); /* which is written last */
    enum session_found answer = SESSION_ABSENT;
    if (lstat(path, &found) == 0) {
        answer = plan && access(plan, F_OK) != 0 ? SESSION_UNFINISHED : SESSION_THERE;
    }
    free(plan);
    return answer;
}

/* When the newest file of a session's folder of frames was put there. */
static long long changed_ns(const char *path)
{
    static const char *const folders[] = {"calibration", "frames"};
    long long newest = 0;
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        struct stat found;
        char *folder = sessions_path(path, folders[i]);
        if (folder && stat(folder, &found) == 0) {
            long long changed = found.st_mtim.tv_sec * 1000000000LL + found.st_mtim.tv_nsec;
            newest = changed > newest ? changed : newest;
        }
        free(folder);
    }
    return newest;
}

/* Whether the session at `path` lacks patterns; how many it has. */
static bool is_incomplete(const char *path, struct incomplete *found)
{
    struct session session = {0};
    struct sequence_needs all;
    struct sequence_needs missing;
    bool incomplete = false;
    if (session_open(path, &session, NULL) != NACRE_OK ||
        sequence_estimate(&session.station, &session.plan, NULL, &all, NULL) != NACRE_OK ||
        sequence_estimate(&session.station, &session.plan, &session, &missing, NULL) != NACRE_OK) {
        goto out;
    }
    incomplete = missing.patterns > 0;
    found->patterns = all.patterns;
    found->done = all.patterns - missing.patterns;
    found->changed_ns = changed_ns(path);
out:
    session_finish(&session);
    return incomplete;
}

static int by_age(const void *a, const void *b)
{
    long long one = ((const struct incomplete *)a)->changed_ns;
    long long other = ((const struct incomplete *)b)->changed_ns;
    return (one < other) - (one > other);
}

void incomplete_free(struct incomplete *list, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        free(list[i].name);
    }
    free(list);
}

/* Look at one name in the folder, and add it if it is an incomplete session. */
static int look_at(const char *folder, const char *name, struct incomplete **list, size_t *count,
                   struct nacre_error *error)
{
    struct incomplete found = {0};
    struct incomplete *longer = NULL;
    char *path = NULL;
    int status = NACRE_OK;
    if (sessions_check_name(name, NULL) != NACRE_OK) {
        goto out;
    }
    path = sessions_path(folder, name);
    if (!path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    if (!is_incomplete(path, &found)) {
        goto out;
    }
    longer = realloc(*list, (*count + 1) * sizeof **list);
    found.name = strdup(name);
    *list = longer ? longer : *list;
    if (!longer || !found.name) {
        free(found.name);
        status = nacre_fail_memory(error, "the list of sessions");
        goto out;
    }
    (*list)[(*count)++] = found;
out:
    free(path);
    return status;
}

int sessions_list_incomplete(const char *folder, struct incomplete **list, size_t *count,
                             struct nacre_error *error)
{
    int status = NACRE_OK;
    DIR *listing = opendir(folder);
    *list = NULL;
    *count = 0;
    if (!listing) {
        status = nacre_fail_errno(error, errno, "%s: cannot list the sessions", folder);
        goto out;
    }
    for (struct dirent *entry = readdir(listing); entry && status == NACRE_OK;
         entry = readdir(listing)) {
        status = look_at(folder, entry->d_name, list, count, error);
    }
    if (status == NACRE_OK && *count > 0) {
        qsort(*list, *count, sizeof **list, by_age);
    }
out:
    if (listing) {
        (void)closedir(listing); /* was only read */
    }
    if (status != NACRE_OK) {
        incomplete_free(*list, *count);
        *list = NULL;
        *count = 0;
    }
    return status;
}
