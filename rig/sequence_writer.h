/* Threads that write a scan's pattern files while the next patterns are being measured. */
#ifndef RIG_SEQUENCE_WRITER_H
#define RIG_SEQUENCE_WRITER_H

#include "nacre/error.h"
#include "rig/session.h"

#include <stddef.h>
#include <stdint.h>

struct sequence_writer;

/* Who is told in sequence_writer_put and sequence_writer_finish, while they wait, that the disk moves on. `moved` may be
 * NULL. */
struct sequence_writer_listener {
    void (*moved)(void *context);
    void *context;
};

/* Start the threads. `session` must outlive the writer. */
int sequence_writer_new(const struct session *session,
                        const struct sequence_writer_listener *listener,
                        struct sequence_writer **writer, struct nacre_error *error);

/* Hand a pattern over to be written; its contents are the writer's and *frames is empty afterwards,
 * whatever happens. Waits while the queue is full. Fails once any write has failed. */
int sequence_writer_put(struct sequence_writer *writer, struct pattern_frames *frames,
                        struct nacre_error *error);

/* Patterns that were handed over and are not on disk yet. */
size_t sequence_writer_pending(struct sequence_writer *writer);

/* Write what is queued and end the threads. Fails if any write failed; what was written is counted
 * either way. */
int sequence_writer_finish(struct sequence_writer *writer, size_t *patterns, uint64_t *bytes,
                           struct nacre_error *error);

/* Free a writer that was finished; one that was not is finished first. NULL is allowed. */
void sequence_writer_free(struct sequence_writer *writer);

#endif
