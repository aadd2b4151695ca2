/* What tells one session's frames from those of another with the same settings: an id in session.yaml and in each frame file. */
#ifndef RIG_SESSION_ID_H
#define RIG_SESSION_ID_H

#include "nacre/error.h"
#include "rig/session.h"

/* Give a session an id, in session->id and in its folder: drawn at random, but on a station that is all virtual it follows
 * from the settings and the sample's file, as everything else does there. */
int session_id_make(struct session *session, struct nacre_error *error);

/* Read session->id from the folder: "" where it has none. */
int session_id_read(struct session *session, struct nacre_error *error);

#endif
