/* The work file of a development: responses developed so far, beside the output, so that what was stopped can go on. */
#ifndef RIG_DEVELOP_WORK_H
#define RIG_DEVELOP_WORK_H

#include "nacre/error.h"
#include "nacre/scan.h"
#include "rig/plan.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* What is kept of a grid beside its responses. */
struct work_note {
    int64_t frame_size, frame_ns; /* of its frame file: bytes, and when it was last changed */
    uint64_t saturated, pixels;
    double pulse_turns, pulse_error; /* of the pulse that the wheel made the most wrong */
};

struct work;

/* Make the work file of `output`, or go on with the one that a killed program left. `key` stands for all that the
 * responses depend on but the grids' own frames: a file of another key is refused. Fails where another program works on
 * it. The plan is laid over the sample and outlives the work. */
int work_open(const char *output, const struct nacre_scan_info *info, const struct plan *plan,
              uint64_t key, bool resume, struct work **work, struct nacre_error *error);

/* Whether a grid's responses are there, whole, and made of a frame file like this. */
bool work_has(const struct work *work, int grid, int64_t frame_size, int64_t frame_ns);

/* Lit points of a grid, row by row, and where the responses of all of them begin: x, y of number `index`. */
size_t work_count(const struct work *work, int grid);
void work_place(const struct work *work, int grid, size_t index, int *x, int *y);

/* All responses of a grid: [lit points][channels][K][K]. A grid written by this program or taken from an earlier one by
 * work_read counts from then on. */
int work_write(struct work *work, int grid, const struct work_note *note, const float *responses,
               struct nacre_error *error);
int work_read(struct work *work, int grid, struct work_note *note, float *responses,
              struct nacre_error *error);

/* The response of a surface point; *counts is false, and nothing is read, where its grid does not count. */
int work_read_point(const struct work *work, int x, int y, float *response, bool *counts,
                    struct nacre_error *error);

/* Close; the file stays only where `keep` and something is in it, which is told. NULL is allowed. */
bool work_close(struct work *work, bool keep);

/* A number for bytes that goes on from `key`: the same bytes, the same number. */
uint64_t work_key(uint64_t key, const void *bytes, size_t size);

#endif
