/* What tells one session's frames from those of another with the same settings: an id in session.yaml and in each frame file. */
#include "rig/session_id.h"

#include <errno.h>
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

enum { DIGITS = sizeof((struct session *)0)->id - 1 };

struct identity {
    char *id;
};

static const struct settings_field identity_fields[] = {
    {.key = "id",
     .kind = SETTINGS_STRING,
     .offset = offsetof(struct identity, id),
     .required = true,
     .sentence = "16 hexadecimal digits that each of the session's frame files names"},
    {0}};

static const struct settings_schema identity_schema = {
    .what = "session file", .size = sizeof(struct identity), .fields = identity_fields};

static char *path_of(const struct session *session)
{
    char *path = NULL;
    return asprintf(&path, "%s/session.yaml", session->path) < 0 ? NULL : path;
}

/* FNV-1a. */
static uint64_t add_bytes(uint64_t hash, const void *bytes, size_t size)
{
    const unsigned char *at = bytes;
    for (size_t i = 0; i < size; i++) {
        hash = (hash ^ at[i]) * 0x100000001b3u;
    }
    return hash;
}

static int add_settings(const struct settings_schema *schema, const void *settings, uint64_t *hash,
                        struct nacre_error *error)
{
    char *text = NULL;
    size_t size = 0;
    int status = settings_text(schema, settings, &text, &size, error);
    if (status == NACRE_OK) {
        *hash = add_bytes(*hash, text, size);
    }
    free(text);
    return status;
}

/* A file that cannot be read is another's to tell of. */
static void add_file(const char *path, uint64_t *hash)
{
    char bytes[4096];
    FILE *file = fopen(path, "rb");
    for (size_t size = 1; file && size > 0;) {
        size = fread(bytes, 1, sizeof bytes, file);
        *hash = add_bytes(*hash, bytes, size);
    }
    if (file) {
        (void)fclose(file); /* was only read */
    }
}

/* Of all that a virtual scan's frames depend on, and not of where that lies. */
static int hash_settings(const struct session *session, uint64_t *hash, struct nacre_error *error)
{
    struct station station = session->station; /* borrows its strings */
    station.simulated.sample = NULL;
    *hash = 0xcbf29ce484222325u;
    int status = add_settings(&station_schema, &station, hash, error);
    if (status == NACRE_OK) {
        status = add_settings(&plan_schema, &session->plan, hash, error);
    }
    if (session->station.simulated.sample) {
        add_file(session->station.simulated.sample, hash);
    }
    return status;
}

int session_id_make(struct session *session, struct nacre_error *error)
{
    uint64_t number = 0;
    int status = NACRE_OK;
    char *path = path_of(session);
    if (!path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    if (station_is_virtual(&session->station)) {
        status = hash_settings(session, &number, error);
    } else if (getrandom(&number, sizeof number, 0) != (ssize_t)sizeof number) {
        status = nacre_fail_errno(error, errno, "%s: cannot draw the session's id", path);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    (void)snprintf(session->id, sizeof session->id, "%016" PRIx64, number);
    status = settings_write(path, &identity_schema, &(struct identity){session->id}, error);
out:
    free(path);
    return status;
}

int session_id_read(struct session *session, struct nacre_error *error)
{
    struct identity identity = {0};
    int status = NACRE_OK;
    char *path = path_of(session);
    session->id[0] = '\0';
    if (!path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    if (access(path, F_OK) != 0) {
        goto out;
    }
    status = settings_read(path, &identity_schema, &identity, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (strlen(identity.id) != DIGITS || strspn(identity.id, "0123456789abcdef") != DIGITS) {
        status = nacre_fail(error,
                            "%s: the id '%.40s' is not %d hexadecimal digits; put back the one "
                            "that the session's frame files have as nacre.session",
                            path, identity.id, DIGITS);
        goto out;
    }
    memcpy(session->id, identity.id, DIGITS + 1);
out:
    settings_finish(&identity_schema, &identity);
    free(path);
    return status;
}
