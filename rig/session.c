/* Session folders: making, resuming and opening them. */
#include "rig/session.h"

#include "rig/session_id.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

/* "SESSION/NAME"; heap. */
static char *file_path(const struct session *session, const char *name)
{
    char *path = NULL;
    return asprintf(&path, "%s/%s", session->path, name) < 0 ? NULL : path;
}

char *session_pattern_path(const struct session *session, struct pattern pattern)
{
    char name[64];
    if (pattern.kind == PATTERN_GRID) {
        (void)snprintf(name, sizeof name, "frames/%06d.exr", pattern.number);
    } else {
        (void)snprintf(name, sizeof name, "calibration/%s-%03d.exr",
                       pattern_kind_names[pattern.kind], pattern.number);
    }
    return file_path(session, name);
}

bool session_has(const struct session *session, struct pattern pattern)
{
    char *path = session_pattern_path(session, pattern);
    bool has = path && access(path, F_OK) == 0;
    free(path);
    return has;
}

static int make_folder(const struct session *session, const char *name, bool may_exist,
                       struct nacre_error *error)
{
    char *path = file_path(session, name);
    int status = NACRE_OK;
    if (!path) {
        return nacre_fail_memory(error, "a path");
    }
    if (mkdir(path, 0777) != 0 && !(may_exist && errno == EEXIST)) {
        status = nacre_fail_errno(error, errno, "%s: cannot make the folder", path);
    }
    free(path);
    return status;
}

/* Temporary files of whole_file.h that a killed program left. */
static bool is_unfinished(const char *name)
{
    return name[0] == '.' && strstr(name, ".part-") != NULL;
}

static int remove_unfinished(const struct session *session, const char *name,
                             struct nacre_error *error)
{
    char *path = file_path(session, name);
    DIR *folder = NULL;
    int status = NACRE_OK;
    if (!path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    folder = opendir(path);
    if (!folder) {
        status = nacre_fail_errno(error, errno, "%s: cannot list the folder", path);
        goto out;
    }
    for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
        if (is_unfinished(entry->d_name) && unlinkat(dirfd(folder), entry->d_name, 0) != 0) {
            status = nacre_fail_errno(error, errno, "%s/%s: cannot remove the unfinished file",
                                      path, entry->d_name);
            goto out;
        }
    }
out:
    if (folder) {
        (void)closedir(folder); /* was only read */
    }
    free(path);
    return status;
}

static int lock(struct session *session, struct nacre_error *error)
{
    session->folder = open(session->path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (session->folder < 0) {
        return nacre_fail_errno(error, errno, "%s: cannot open the session", session->path);
    }
    session->locked = true;
    if (flock(session->folder, LOCK_EX | LOCK_NB) != 0) {
        return errno == EWOULDBLOCK
                   ? nacre_fail(
                         error,
                         "%s: another program is measuring this session; wait for it or stop it",
                         session->path)
                   : nacre_fail_errno(error, errno, "%s: cannot lock the session", session->path);
    }
    return NACRE_OK;
}

int session_read_plan(const char *path, const struct station *station, struct plan *plan,
                      struct nacre_error *error)
{
    int status = plan_read(path, plan, error);
    if (status == NACRE_OK) {
        status = plan_lay(plan, path, station->sample.width, station->sample.height,
                          station->camera.bayer == BAYER_MONO ? 1 : 3, error);
    }
    if (status != NACRE_OK) {
        plan_finish(plan);
    }
    return status;
}

int session_read_settings(const char *station_path, const char *plan_path, struct session *session,
                          struct nacre_error *error)
{
    int status = station_read(station_path, &session->station, error);
    if (status != NACRE_OK) {
        return status;
    }
    if (!plan_path && !session->station.plan) {
        return nacre_fail(error, "%s: names no plan; add the key plan or name a plan file (--plan)",
                          station_path);
    }
    status = session_read_plan(plan_path ? plan_path : session->station.plan, &session->station,
                               &session->plan, error);
    free(session->station.plan); /* the session has its own */
    session->station.plan = NULL;
    return status;
}

/* Read the settings in the session's folder. */
static int read_own_settings(struct session *session, struct nacre_error *error)
{
    char *station_path = file_path(session, "station.yaml");
    char *plan_path = file_path(session, "plan.yaml");
    int status;
    if (!station_path || !plan_path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    status = station_read(station_path, &session->station, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = session_read_plan(plan_path, &session->station, &session->plan, error);
    if (status == NACRE_OK) {
        status = session_id_read(session, error);
    }
out:
    free(station_path);
    free(plan_path);
    return status;
}

static bool has_file(const struct session *session, const char *name)
{
    char *path = file_path(session, name);
    bool has = path && access(path, F_OK) == 0;
    free(path);
    return has;
}

static int write_settings(const struct session *session, const char *name,
                          const struct settings_schema *schema, const void *settings,
                          struct nacre_error *error)
{
    char *path = file_path(session, name);
    int status =
        path ? settings_write(path, schema, settings, error) : nacre_fail_memory(error, "a path");
    free(path);
    return status;
}

/* What make_session writes last: a session that lacks it was never measured. */
static const char last_written[] = "plan.yaml";

static int fill_folder(struct session *session, struct nacre_error *error)
{
    static const char *const folders[] = {"calibration", "frames"};
    int status;
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        status = make_folder(session, folders[i], true, error);
        if (status != NACRE_OK) {
            return status;
        }
    }
    status = write_settings(session, "station.yaml", &station_schema, &session->station, error);
    if (status == NACRE_OK) {
        status = session_id_make(session, error);
    }
    return status == NACRE_OK
               ? write_settings(session, last_written, &plan_schema, &session->plan, error)
               : status;
}

/* The id is taken over. */
static int compare_settings(struct session *session, struct nacre_error *error)
{
    char where[256];
    struct session own = {.path = session->path};
    const char *file = "station.yaml";
    int status = read_own_settings(&own, error);
    if (status != NACRE_OK) {
        goto out;
    }
    bool same =
        settings_same(&station_schema, &own.station, &session->station, where, sizeof where);
    if (same) {
        file = "plan.yaml";
        same = settings_same(&plan_schema, &own.plan, &session->plan, where, sizeof where);
    }
    if (!same) {
        status =
            nacre_fail(error,
                       "%s: cannot be resumed: %s of %s/%s is not what it was begun with; use the "
                       "same settings or begin a new session",
                       session->path, where, session->path, file);
    }
    memcpy(session->id, own.id, sizeof session->id);
out:
    own.path = NULL;
    session_finish(&own);
    return status;
}

/* Continue what is there; a session killed while it was made is made to the end. */
static int resume_session(struct session *session, bool given, struct nacre_error *error)
{
    static const char *const folders[] = {".", "calibration", "frames"};
    int status = lock(session, error);
    if (status != NACRE_OK) {
        return status;
    }
    if (!given) {
        status = read_own_settings(session, error);
    } else if (has_file(session, last_written)) {
        status = compare_settings(session, error);
    } else {
        status = fill_folder(session, error);
    }
    for (size_t i = 0; i < sizeof folders / sizeof *folders && status == NACRE_OK; i++) {
        status = remove_unfinished(session, folders[i], error);
    }
    return status;
}

static int make_session(struct session *session, struct nacre_error *error)
{
    int status;
    if (mkdir(session->path, 0777) != 0) {
        return errno == EEXIST
                   ? nacre_fail(error,
                                "%s: exists already; resume it (--resume) or choose another name",
                                session->path)
                   : nacre_fail_errno(error, errno, "%s: cannot make the session", session->path);
    }
    status = lock(session, error);
    return status == NACRE_OK ? fill_folder(session, error) : status;
}

int session_create(const char *path, const char *station_path, const char *plan_path, bool resume,
                   struct session *session, struct nacre_error *error)
{
    int status = NACRE_OK;
    *session = (struct session){.path = strdup(path)};
    if (!session->path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    if (!station_path && !resume) {
        status = nacre_fail(error, "%s: a new session needs a station file (--station)", path);
        goto out;
    }
    if (station_path) {
        status = session_read_settings(station_path, plan_path, session, error);
        if (status != NACRE_OK) {
            goto out;
        }
    }
    status = resume ? resume_session(session, station_path != NULL, error)
                    : make_session(session, error);
out:
    if (status != NACRE_OK) {
        session_finish(session);
    }
    return status;
}

int session_open(const char *path, struct session *session, struct nacre_error *error)
{
    struct stat found;
    int status = NACRE_OK;
    *session = (struct session){.path = strdup(path)};
    if (!session->path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    if (stat(path, &found) != 0) {
        status = nacre_fail_errno(error, errno, "%s: cannot open the session", path);
        goto out;
    }
    if (!S_ISDIR(found.st_mode)) {
        status = nacre_fail(error, "%s: is no session: a session is a folder that nacre scan made",
                            path);
        goto out;
    }
    status = read_own_settings(session, error);
out:
    if (status != NACRE_OK) {
        session_finish(session);
    }
    return status;
}

void session_finish(struct session *session)
{
    if (!session) {
        return;
    }
    if (session->locked && session->folder >= 0) {
        (void)close(session->folder); /* gives the lock back */
    }
    station_finish(&session->station);
    plan_finish(&session->plan);
    free(session->path);
    *session = (struct session){0};
}
