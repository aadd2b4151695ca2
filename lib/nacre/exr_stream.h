/* An OpenEXR context on a file of ours: every byte goes through positioned reads and writes here,
 * so that causes are kept instead of printed. Private to libnacre. */
#ifndef NACRE_EXR_STREAM_H
#define NACRE_EXR_STREAM_H

#include "nacre/error.h"

#include <openexr.h>
#include <stdbool.h>
#include <stdint.h>

/* Zero-initialise; must not move while it is open. A reading stream belongs to one thread at a
 * time. */
struct exr_stream {
    exr_context_t context;
    char path[256]; /* for messages; a long one is cut */
    int descriptor;
    bool open, borrowed;
    int64_t size;      /* of the file, when reading */
    int number;        /* errno of the last transfer that failed */
    char message[256]; /* OpenEXR's last words, when reading */
};

/* Open for reading and parse the headers. What is no file, no OpenEXR or cut off in the header is
 * refused. */
int exr_stream_open(struct exr_stream *stream, const char *path, struct nacre_error *error);

/* A second reading context on the open file of `other`, which must outlive it. */
int exr_stream_share(struct exr_stream *stream, const struct exr_stream *other,
                     struct nacre_error *error);

/* Begin writing into the existing file `temporary`; `path` is its name to be. */
int exr_stream_create(struct exr_stream *stream, const char *temporary, const char *path,
                      struct nacre_error *error);

/* NACRE_FAILED with the text "PATH: WHAT: CAUSE", with the cause of `result`. */
int exr_stream_fail(const struct exr_stream *stream, exr_result_t result, struct nacre_error *error,
                    const char *format, ...) __attribute__((format(printf, 4, 5)));

/* Write what is outstanding (the chunk table) and close. */
int exr_stream_close(struct exr_stream *stream, struct nacre_error *error);

/* Close without regard to failures. NULL and zeroed are allowed. */
void exr_stream_finish(struct exr_stream *stream);

/* To be called on an encoded chunk before it is written. One that compresses to exactly its own size must be stored as it
 * is, for that is what readers take it for; OpenEXR 3.1 leaves the compressed bytes (its issue 2306). */
void exr_stream_settle(exr_encode_pipeline_t *encode);

/* The most pixel data, in bytes, that a file of `size` bytes can hold with this compression; sizes
 * in a header beyond it are not worth allocating. */
uint64_t exr_stream_plausible(int64_t size, exr_compression_t compression);

/* Whether an open file of one tiled part holds each of its `tiles` tiles to the last byte. */
bool exr_stream_complete(const struct exr_stream *stream, uint64_t tiles);

#endif
