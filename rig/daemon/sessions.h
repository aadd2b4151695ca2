/* The folder that holds the daemon's sessions: which names they may have, and which of them lack patterns. */
#ifndef RIG_DAEMON_SESSIONS_H
#define RIG_DAEMON_SESSIONS_H

#include "nacre/error.h"

#include <stddef.h>

/* Names are of A-Z a-z 0-9 . _ - and do not begin with a dot: they lead nowhere but into the folder. */
int sessions_check_name(const char *name, struct nacre_error *error);

/* FOLDER/NAME; heap, NULL when memory runs out. */
char *sessions_path(const char *folder, const char *name);

enum session_found {
    SESSION_ABSENT,
    SESSION_UNFINISHED, /* a folder whose making was interrupted: nothing was measured */
    SESSION_THERE,
};

enum session_found sessions_find(const char *path);

/* A session that lacks patterns. */
struct incomplete {
    char *name;
    size_t done, patterns;
    long long changed_ns; /* when something was last measured */
};

/* The incomplete sessions of a folder, the one that was measured last first; heap, also with none. What is no session,
 * or cannot be read, is passed over. incomplete_free frees. */
int sessions_list_incomplete(const char *folder, struct incomplete **list, size_t *count,
                             struct nacre_error *error);
void incomplete_free(struct incomplete *list, size_t count);

#endif
