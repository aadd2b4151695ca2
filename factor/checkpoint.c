/* Checkpoint files. */
#include "factor/checkpoint.h"

#include "nacre/whole_file.h"

#include <errno.h>
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAGIC "nacre checkpoint 1\n"

/* What precedes identity and state. */
struct head {
    char magic[24];
    uint64_t identity_size, state_size, sum; /* sum: of identity and state */
};

void *blob_reserve(struct blob *blob, size_t size)
{
    if (blob->failed || size > SIZE_MAX / 2 - blob->size) {
        blob->failed = true;
        return NULL;
    }
    if (blob->size + size > blob->capacity) {
        size_t capacity = blob->size + size + blob->capacity / 2 + 4096;
        unsigned char *grown = realloc(blob->bytes, capacity);
        if (!grown) {
            blob->failed = true;
            return NULL;
        }
        blob->bytes = grown;
        blob->capacity = capacity;
    }
    blob->size += size;
    return blob->bytes + blob->size - size;
}

void blob_put(struct blob *blob, const void *bytes, size_t size)
{
    void *to = size ? blob_reserve(blob, size) : NULL;
    if (to) {
        memcpy(to, bytes, size);
    }
}

const void *blob_take(struct blob *blob, size_t size)
{
    if (blob->failed || size > blob->size - blob->at) {
        blob->failed = true;
        return NULL;
    }
    blob->at += size;
    return blob->bytes + blob->at - size;
}

void blob_get(struct blob *blob, void *bytes, size_t size)
{
    const void *from = size ? blob_take(blob, size) : NULL;
    if (from) {
        memcpy(bytes, from, size);
    }
}

size_t blob_left(const struct blob *blob)
{
    return blob->failed ? 0 : blob->size - blob->at;
}

void blob_finish(struct blob *blob)
{
    free(blob->bytes);
    *blob = (struct blob){0};
}

unsigned long long checkpoint_sum(unsigned long long sum, const void *bytes, size_t size)
{
    const unsigned char *from = bytes;
    uint64_t mixed = sum ^ (size * 0x9e3779b97f4a7c15u);
    for (size_t i = 0; i < size; i += 8) {
        uint64_t word = 0;
        memcpy(&word, from + i, size - i < 8 ? size - i : 8);
        mixed = (mixed ^ word) * 0xbf58476d1ce4e5b9u;
        mixed ^= mixed >> 29;
    }
    return mixed;
}

static uint64_t sum_of(const char *identity, size_t identity_size, const void *state, size_t size)
{
    return checkpoint_sum(checkpoint_sum(0, identity, identity_size), state, size);
}

int checkpoint_write(const char *path, const char *identity, const struct blob *state,
                     struct nacre_error *error)
{
    struct whole_file file = {0};
    struct head head = {.magic = MAGIC,
                        .identity_size = strlen(identity),
                        .state_size = state->size,
                        .sum = sum_of(identity, strlen(identity), state->bytes, state->size)};
    int status = state->failed ? nacre_fail_memory(error, "the checkpoint")
                               : whole_file_create(&file, path, error);
    FILE *to = status == NACRE_OK ? fopen(file.temporary, "wbe") : NULL;
    if (status == NACRE_OK && !to) {
        status = nacre_fail_errno(error, errno, "cannot write %s", path);
    }
    if (to) {
        bool written = fwrite(&head, sizeof head, 1, to) == 1 &&
                       fwrite(identity, 1, head.identity_size, to) == head.identity_size &&
                       fwrite(state->bytes, 1, state->size, to) == state->size;
        int number = errno;
        if (fclose(to) != 0 || !written) {
            status = nacre_fail_errno(error, written ? errno : number, "cannot write %s", path);
        }
    }
    if (status == NACRE_OK) {
        status = whole_file_commit(&file, error);
    }
    whole_file_discard(&file);
    return status;
}

static int fail_damaged(const char *path, const char *what, struct nacre_error *error)
{
    return nacre_fail(error,
                      "checkpoint %s: %s; remove it to begin anew, or name another file with "
                      "--checkpoint",
                      path, what);
}

/* Name the first line that differs. */
static int compare(const char *path, const char *theirs, size_t size, const char *ours,
                   struct nacre_error *error)
{
    const char *end = theirs + size;
    while (theirs < end || *ours) {
        size_t length = theirs < end ? strcspn(theirs, "\n") : 0, our_length = strcspn(ours, "\n");
        if (length != our_length || memcmp(theirs, ours, length) != 0) {
            return nacre_fail(error,
                              "checkpoint %s belongs to another run: there \"%.*s\", here "
                              "\"%.*s\"; give the same scan and options, remove it to begin anew, "
                              "or name another file with --checkpoint",
                              path, (int)length, theirs, (int)our_length, ours);
        }
        theirs += length + (theirs < end);
        ours += our_length + (*ours ? 1 : 0);
    }
    return NACRE_OK;
}

/* Read the rest of the file into identity and *state; sizes are those of the file already. */
static int read_rest(const char *path, FILE *from, const struct head *head, const char *identity,
                     struct blob *state, struct nacre_error *error)
{
    int status = NACRE_FAILED;
    char *theirs = malloc(head->identity_size + 1);
    void *bytes = blob_reserve(state, head->state_size);
    if (!theirs || !bytes) {
        status = nacre_fail_memory(error, "the checkpoint");
        goto out;
    }
    if (fread(theirs, 1, head->identity_size, from) != head->identity_size ||
        fread(bytes, 1, head->state_size, from) != head->state_size) {
        status = ferror(from) ? nacre_fail_errno(error, errno, "cannot read %s", path)
                              : fail_damaged(path, "it is cut short", error);
        goto out;
    }
    theirs[head->identity_size] = '\0';
    if (sum_of(theirs, head->identity_size, state->bytes, state->size) != head->sum) {
        status = fail_damaged(path, "it is damaged (wrong check sum)", error);
        goto out;
    }
    status = compare(path, theirs, head->identity_size, identity, error);
out:
    free(theirs);
    return status;
}

int checkpoint_read(const char *path, const char *identity, struct blob *state,
                    struct nacre_error *error)
{
    struct head head;
    int status = NACRE_FAILED;
    FILE *from = fopen(path, "rbe");
    if (!from) {
        return errno == ENOENT ? NACRE_OK : nacre_fail_errno(error, errno, "cannot read %s", path);
    }
    long size = fseek(from, 0, SEEK_END) == 0 ? ftell(from) : -1;
    rewind(from);
    if (fread(&head, sizeof head, 1, from) != 1 ||
        memcmp(head.magic, MAGIC, sizeof MAGIC - 1) != 0) {
        status = fail_damaged(path, "it is no checkpoint of this version of nacre", error);
        goto out;
    }
    uint64_t rest = (uint64_t)size - sizeof head;
    if (size < (long)sizeof head || head.identity_size > rest ||
        head.state_size != rest - head.identity_size || head.state_size == 0) {
        status = fail_damaged(path, "it is damaged (cut short, or longer than it says)", error);
        goto out;
    }
    status = read_rest(path, from, &head, identity, state, error);
out:
    (void)fclose(from); /* only read */
    if (status != NACRE_OK) {
        blob_finish(state);
    }
    return status;
}
