/* Writing pattern files beside the measurement: a bounded queue and its threads. */
#include "rig/sequence_writer.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/stat.h>

/* Compressing a pattern takes about as long as simulating one, and a real station leaves the
 * processor idle: two threads keep up with either. The queue evens out single slow writes. */
enum { THREADS = 2, CAPACITY = 4 };

struct sequence_writer {
    const struct session *session;
    struct sequence_writer_listener listener;
    pthread_t threads[THREADS];
    int thread_count;
    pthread_mutex_t mutex; /* guards all below */
    pthread_cond_t changed;
    struct pattern_frames queue[CAPACITY];
    size_t first, length;
    size_t writing; /* taken from the queue and not on disk yet */
    bool ending;
    size_t patterns;
    uint64_t bytes;
    int status; /* of the first write that failed */
    struct nacre_error error;
};

static uint64_t file_bytes(const struct session *session, struct pattern pattern)
{
    struct stat found = {0};
    char *path = session_pattern_path(session, pattern);
    if (path) {
        (void)stat(path, &found); /* the size is only reported */
    }
    free(path);
    return (uint64_t)found.st_size;
}

/* Take the next pattern from the queue; false when there will be none. */
static bool next(struct sequence_writer *writer, struct pattern_frames *frames)
{
    bool got = false;
    (void)pthread_mutex_lock(&writer->mutex);
    while (writer->length == 0 && !writer->ending) {
        (void)pthread_cond_wait(&writer->changed, &writer->mutex);
    }
    if (writer->length > 0) {
        *frames = writer->queue[writer->first];
        writer->first = (writer->first + 1) % CAPACITY;
        writer->length--;
        writer->writing++;
        got = true;
        (void)pthread_cond_broadcast(&writer->changed);
    }
    (void)pthread_mutex_unlock(&writer->mutex);
    return got;
}

static void *write_patterns(void *context)
{
    struct sequence_writer *writer = context;
    struct pattern_frames frames;
    while (next(writer, &frames)) {
        struct nacre_error error;
        int status = session_write(writer->session, &frames, &error);
        uint64_t bytes = status == NACRE_OK ? file_bytes(writer->session, frames.pattern) : 0;
        pattern_frames_finish(&frames);
        (void)pthread_mutex_lock(&writer->mutex);
        writer->writing--;
        if (status == NACRE_OK) {
            writer->patterns++;
            writer->bytes += bytes;
        } else if (writer->status == NACRE_OK) {
            writer->status = status;
            writer->error = error;
        }
        (void)pthread_cond_broadcast(&writer->changed);
        (void)pthread_mutex_unlock(&writer->mutex);
    }
    return NULL;
}

int sequence_writer_new(const struct session *session,
                        const struct sequence_writer_listener *listener,
                        struct sequence_writer **writer, struct nacre_error *error)
{
    int status = NACRE_OK;
    struct sequence_writer *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "the writer of frames");
        goto out;
    }
    made->session = session;
    made->listener = *listener;
    (void)pthread_mutex_init(&made->mutex, NULL); /* default attributes cannot fail on Linux */
    (void)pthread_cond_init(&made->changed, NULL);
    while (made->thread_count < THREADS) {
        int number = pthread_create(&made->threads[made->thread_count], NULL, write_patterns, made);
        if (number != 0) {
            status = nacre_fail_errno(error, number, "cannot start a thread to write frames");
            goto out;
        }
        made->thread_count++;
    }
out:
    if (status != NACRE_OK) {
        sequence_writer_free(made);
        made = NULL;
    }
    *writer = made;
    return status;
}

/* The error is left as it was unless there is one to report. */
static int report(struct sequence_writer *writer, struct nacre_error *error)
{
    if (writer->status != NACRE_OK && error) {
        *error = writer->error;
    }
    return writer->status;
}

/* Wait for a change and tell of it; the mutex is held. */
static void wait_for_disk(struct sequence_writer *writer)
{
    (void)pthread_cond_wait(&writer->changed, &writer->mutex);
    if (writer->listener.moved) {
        writer->listener.moved(writer->listener.context);
    }
}

int sequence_writer_put(struct sequence_writer *writer, struct pattern_frames *frames,
                        struct nacre_error *error)
{
    (void)pthread_mutex_lock(&writer->mutex);
    while (writer->length == CAPACITY && writer->status == NACRE_OK) {
        wait_for_disk(writer);
    }
    int status = report(writer, error);
    if (status == NACRE_OK) {
        writer->queue[(writer->first + writer->length) % CAPACITY] = *frames;
        writer->length++;
        *frames = (struct pattern_frames){0};
        (void)pthread_cond_broadcast(&writer->changed);
    }
    (void)pthread_mutex_unlock(&writer->mutex);
    pattern_frames_finish(frames);
    return status;
}

size_t sequence_writer_pending(struct sequence_writer *writer)
{
    (void)pthread_mutex_lock(&writer->mutex);
    size_t pending = writer->length + writer->writing;
    (void)pthread_mutex_unlock(&writer->mutex);
    return pending;
}

int sequence_writer_finish(struct sequence_writer *writer, size_t *patterns, uint64_t *bytes,
                           struct nacre_error *error)
{
    (void)pthread_mutex_lock(&writer->mutex);
    writer->ending = true;
    (void)pthread_cond_broadcast(&writer->changed);
    while (writer->thread_count > 0 && writer->length + writer->writing > 0) {
        wait_for_disk(writer);
    }
    (void)pthread_mutex_unlock(&writer->mutex);
    while (writer->thread_count > 0) {
        (void)pthread_join(writer->threads[--writer->thread_count], NULL);
    }
    *patterns = writer->patterns;
    *bytes = writer->bytes;
    return report(writer, error);
}

void sequence_writer_free(struct sequence_writer *writer)
{
    size_t patterns;
    uint64_t bytes;
    if (!writer) {
        return;
    }
    (void)sequence_writer_finish(writer, &patterns, &bytes,
                                 NULL); /* an error is in the way already */
    (void)pthread_cond_destroy(&writer->changed);
    (void)pthread_mutex_destroy(&writer->mutex);
    free(writer);
}
