/* Checkpoint files: the bytes of a run's state, whole or not at all, with what the run is of and a check sum. */
#ifndef FACTOR_CHECKPOINT_H
#define FACTOR_CHECKPOINT_H

#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>

/* Bytes that are put behind one another and got back in the same order. Zeroed: empty. */
struct blob {
    unsigned char *bytes;
    size_t size, capacity;
    size_t at;   /* where the next get begins */
    bool failed; /* no memory for a put, or a get beyond the end: what follows does nothing */
};

void blob_put(struct blob *blob, const void *bytes, size_t size);
void blob_get(struct blob *blob, void *bytes, size_t size);

/* The next `size` bytes as they lie, or NULL. */
const void *blob_take(struct blob *blob, size_t size);

/* Room for `size` more bytes, to be filled by the caller, or NULL. */
void *blob_reserve(struct blob *blob, size_t size);

/* Bytes that are left to get. */
size_t blob_left(const struct blob *blob);

void blob_finish(struct blob *blob);

/* Write the whole file. `identity`: lines "NAME: VALUE" that say what run this is the state of. */
int checkpoint_write(const char *path, const char *identity, const struct blob *state,
                     struct nacre_error *error);

/* Read it; where there is no such file *state stays empty. Refused, with the remedy: a file that is no checkpoint, is
 * damaged or cut short, or is of another run, naming the first line of the identity that differs. */
int checkpoint_read(const char *path, const char *identity, struct blob *state,
                    struct nacre_error *error);

/* 64 bits that depend on all of `bytes`, to be carried on from `sum`, which begins as 0. */
unsigned long long checkpoint_sum(unsigned long long sum, const void *bytes, size_t size);

#endif
