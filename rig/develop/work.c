/* The work file of a development: responses developed so far, beside the output, so that what was stopped can go on.
 *
 * A header, a record for each grid, then each grid's responses at a place of their own. A record is written after its
 * responses and holds their checksum, so that what a killed program or a power cut left half done is not believed. */
#include "rig/develop/work.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

static const char magic[16] = "nacre develop 1";

struct header {
    char magic[16];
    uint64_t key;
};

struct record {
    uint64_t written; /* 1 */
    uint64_t checksum;
    struct work_note note;
};

struct work {
    char *path;
    int file;                      /* -1: none */
    const struct plan_grids *laid; /* borrowed */
    int grids;
    size_t response_bytes;
    struct record *records; /* [grids] */
    bool *whole;            /* [grids]: the record and its responses are there */
    bool *counts;           /* [grids]: written or taken over by this program */
};

uint64_t work_key(uint64_t key, const void *bytes, size_t size)
{
    /* FNV-1a, eight bytes at a time where there are as many. */
    const unsigned char *at = bytes;
    key = key ? key : 0xcbf29ce484222325u;
    while (size) {
        uint64_t word = 0;
        size_t step = size < sizeof word ? size : sizeof word;
        memcpy(&word, at, step);
        key = (key ^ word) * 0x100000001b3u;
        key ^= key >> 32; /* the product's upper half knows all bytes, its lower one few */
        at += step;
        size -= step;
    }
    return key;
}

size_t work_count(const struct work *work, int grid)
{
    return work->laid->starts[grid + 1] - work->laid->starts[grid];
}

void work_place(const struct work *work, int grid, size_t index, int *x, int *y)
{
    int point = (int)work->laid->points[work->laid->starts[grid] + index];
    *x = point % work->laid->width;
    *y = point / work->laid->width;
}

static off_t record_place(int grid)
{
    return (off_t)(sizeof(struct header) + (size_t)grid * sizeof(struct record));
}

static off_t responses_place(const struct work *work, int grid, size_t index)
{
    return record_place(work->grids) +
           (off_t)((work->laid->starts[grid] + index) * work->response_bytes);
}

/* All of it, or a failure. */
static int put(const struct work *work, const void *bytes, size_t size, off_t place,
               struct nacre_error *error)
{
    const char *at = bytes;
    while (size) {
        ssize_t done = pwrite(work->file, at, size, place);
        if (done < 0 && errno != EINTR) {
            return nacre_fail_errno(error, errno, "%s: cannot write the work file", work->path);
        }
        done = done < 0 ? 0 : done;
        at += done;
        place += done;
        size -= (size_t)done;
    }
    return NACRE_OK;
}

static int get(const struct work *work, void *bytes, size_t size, off_t place,
               struct nacre_error *error)
{
    char *at = bytes;
    while (size) {
        ssize_t done = pread(work->file, at, size, place);
        if (done == 0) {
            return nacre_fail(error, "%s: ends too early; develop without --resume", work->path);
        }
        if (done < 0 && errno != EINTR) {
            return nacre_fail_errno(error, errno, "%s: cannot read the work file", work->path);
        }
        done = done < 0 ? 0 : done;
        at += done;
        place += done;
        size -= (size_t)done;
    }
    return NACRE_OK;
}

static size_t bytes_of(const struct work *work, int grid)
{
    return work_count(work, grid) * work->response_bytes;
}

/* Which grids an earlier program left whole. What cannot be read was not written. */
static int find_whole(struct work *work, struct nacre_error *error)
{
    size_t most = 0;
    int status = NACRE_OK;
    for (int g = 0; g < work->grids; g++) {
        most = bytes_of(work, g) > most ? bytes_of(work, g) : most;
    }
    char *bytes = malloc(most ? most : 1);
    if (!bytes) {
        return nacre_fail_memory(error, "a grid's responses");
    }
    for (int g = 0; g < work->grids; g++) {
        struct record *record = &work->records[g];
        size_t size = bytes_of(work, g);
        struct nacre_error ignored;
        work->whole[g] =
            get(work, record, sizeof *record, record_place(g), &ignored) == NACRE_OK &&
            record->written == 1 &&
            get(work, bytes, size, responses_place(work, g, 0), &ignored) == NACRE_OK &&
            work_key(work_key(0, &record->note, sizeof record->note), bytes, size) ==
                record->checksum;
    }
    free(bytes);
    return status;
}

/* Take over what is there, or begin anew. */
static int begin(struct work *work, uint64_t key, bool resume, struct nacre_error *error)
{
    struct header header = {.key = key};
    struct header found = {.key = 0};
    struct nacre_error ignored;
    memcpy(header.magic, magic, sizeof magic);
    if (resume && get(work, &found, sizeof found, 0, &ignored) == NACRE_OK) {
        if (memcmp(found.magic, magic, sizeof magic) != 0 || found.key != key) {
            return nacre_fail(error,
                              "%s: was begun with other options, calibration frames or another "
                              "nacre; develop without --resume",
                              work->path);
        }
        return find_whole(work, error);
    }
    if (ftruncate(work->file, 0) != 0) {
        return nacre_fail_errno(error, errno, "%s: cannot empty the work file", work->path);
    }
    return put(work, &header, sizeof header, 0, error);
}

static char *path_of(const char *output)
{
    char *path = NULL;
    return asprintf(&path, "%s.work", output) < 0 ? NULL : path;
}

static int allocate(const struct nacre_scan_info *info, const struct plan *plan, struct work *work,
                    struct nacre_error *error)
{
    work->laid = plan->grids;
    work->grids = plan_pattern_count(plan, PATTERN_GRID);
    work->response_bytes = nacre_scan_response_size(info) * sizeof(float);
    work->records = calloc((size_t)work->grids, sizeof *work->records);
    work->whole = calloc((size_t)work->grids, sizeof *work->whole);
    work->counts = calloc((size_t)work->grids, sizeof *work->counts);
    if (!work->records || !work->whole || !work->counts) {
        return nacre_fail_memory(error, "the list of grids");
    }
    return NACRE_OK;
}

/* Whether the open file is still the one of that name: a program that was at its end may have removed it. */
static bool is_named(const struct work *work)
{
    struct stat ours;
    struct stat named;
    return fstat(work->file, &ours) == 0 && stat(work->path, &named) == 0 &&
           ours.st_dev == named.st_dev && ours.st_ino == named.st_ino;
}

static int open_locked(struct work *work, struct nacre_error *error)
{
    work->file = open(work->path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (work->file < 0) {
        return nacre_fail_errno(error, errno, "%s: cannot make the work file", work->path);
    }
    bool locked = flock(work->file, LOCK_EX | LOCK_NB) == 0;
    if (!locked || !is_named(work)) {
        int number = locked ? EWOULDBLOCK : errno;
        (void)close(work->file); /* it is another's */
        work->file = -1;
        return number == EWOULDBLOCK
                   ? nacre_fail(error,
                                "%s: another program is developing into this file; wait for it or "
                                "choose another name",
                                work->path)
                   : nacre_fail_errno(error, number, "%s: cannot lock the work file", work->path);
    }
    return NACRE_OK;
}

static void destroy(struct work *work, bool keep)
{
    if (work->file >= 0) {
        if (!keep) {
            (void)unlink(work->path); /* nothing is lost if it stays */
        }
        (void)close(work->file); /* gives the lock back */
    }
    free(work->path);
    free(work->records);
    free(work->whole);
    free(work->counts);
    free(work);
}

int work_open(const char *output, const struct nacre_scan_info *info, const struct plan *plan,
              uint64_t key, bool resume, struct work **work, struct nacre_error *error)
{
    int status = NACRE_OK;
    bool keep = false;
    struct work *made = calloc(1, sizeof *made);
    *work = NULL;
    if (!made) {
        return nacre_fail_memory(error, "the work file");
    }
    made->file = -1;
    made->path = path_of(output);
    if (!made->path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    status = allocate(info, plan, made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = open_locked(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = begin(made, key, resume, error);
    keep = resume; /* what an earlier program left is not lost */
out:
    if (status != NACRE_OK) {
        destroy(made, keep);
        made = NULL;
    }
    *work = made;
    return status;
}

bool work_has(const struct work *work, int grid, int64_t frame_size, int64_t frame_ns)
{
    const struct work_note *note = &work->records[grid].note;
    return work->whole[grid] && note->frame_size == frame_size && note->frame_ns == frame_ns;
}

int work_write(struct work *work, int grid, const struct work_note *note, const float *responses,
               struct nacre_error *error)
{
    struct record *record = &work->records[grid];
    size_t size = bytes_of(work, grid);
    *record = (struct record){1, work_key(work_key(0, note, sizeof *note), responses, size), *note};
    work->whole[grid] = false;
    int status = put(work, responses, size, responses_place(work, grid, 0), error);
    if (status == NACRE_OK) {
        status = put(work, record, sizeof *record, record_place(grid), error);
    }
    work->whole[grid] = work->counts[grid] = status == NACRE_OK;
    return status;
}

int work_read(struct work *work, int grid, struct work_note *note, float *responses,
              struct nacre_error *error)
{
    *note = work->records[grid].note;
    work->counts[grid] = true;
    return get(work, responses, bytes_of(work, grid), responses_place(work, grid, 0), error);
}

int work_read_point(const struct work *work, int x, int y, float *response, bool *counts,
                    struct nacre_error *error)
{
    size_t point = (size_t)y * (size_t)work->laid->width + (size_t)x;
    int grid = (int)work->laid->grid_of[point];
    size_t index = work->laid->places[point] - work->laid->starts[grid];
    *counts = work->counts[grid];
    return *counts ? get(work, response, work->response_bytes, responses_place(work, grid, index),
                         error)
                   : NACRE_OK;
}

bool work_close(struct work *work, bool keep)
{
    if (!work) {
        return false;
    }
    bool any = false;
    for (int g = 0; g < work->grids; g++) {
        any = any || work->whole[g];
    }
    destroy(work, keep && any);
    return keep && any;
}
