/* Loading a scan into the working layout. */
#include "factor/responses.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

/* Two megabytes: huge pages spare the streaming kernels most address translations. */
enum { ALIGNMENT = 1 << 21 };

static void set_sizes(struct responses *r, const struct nacre_scan_info *info, int lanes)
{
    size_t run = (size_t)info->window * (size_t)lanes;
    r->width = info->width;
    r->height = info->height;
    r->channels = info->channels;
    r->window = info->window;
    r->lanes = lanes;
    r->blocks = (info->width + lanes - 1) / lanes;
    r->row = (size_t)r->blocks * run;
    /* A vector read at x - dx starts at most half a window and a block before the row or behind it. */
    r->lead = (size_t)(info->window / 2 / lanes + 2) * run;
    r->zeros = r->lead + (size_t)r->height * (size_t)r->window * r->row + r->lead;
    r->size = r->zeros + r->row + r->lead;
}

size_t responses_bytes(const struct nacre_scan_info *info, int lanes)
{
    struct responses r = {0};
    double floats = (double)info->height * info->window * info->window * (info->width + lanes);
    if (floats > 0x1p55 || info->window > 1 << 15) {
        return SIZE_MAX;
    }
    set_sizes(&r, info, lanes);
    return (size_t)r.channels *
           (r.size * sizeof(float) + r.size / (size_t)lanes * sizeof(uint16_t));
}

static void *allocate_zeroed(size_t bytes)
{
    size_t rounded = (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    void *memory = bytes < ALIGNMENT ? aligned_alloc(4096, (bytes + 4095) / 4096 * 4096)
                                     : aligned_alloc(ALIGNMENT, rounded);
    if (memory && bytes >= ALIGNMENT) {
        (void)madvise(memory, rounded, MADV_HUGEPAGE); /* a hint */
    }
    if (memory) {
        memset(memory, 0, bytes);
    }
    return memory;
}

int responses_begin(struct responses *responses, const struct nacre_scan_info *info, int lanes,
                    struct nacre_error *error)
{
    int status = NACRE_FAILED;
    *responses = (struct responses){0};
    if (responses_bytes(info, lanes) == SIZE_MAX) {
        return nacre_fail_memory(error, "the responses");
    }
    set_sizes(responses, info, lanes);
    responses->measured = calloc((size_t)info->width * (size_t)info->height, 1);
    if (!responses->measured) {
        status = nacre_fail_memory(error, "the responses");
        goto out;
    }
    for (int c = 0; c < info->channels; c++) {
        responses->values[c] = allocate_zeroed(responses->size * sizeof(float));
        responses->mask[c] = allocate_zeroed(responses->size / (size_t)lanes * sizeof(uint16_t));
        if (!responses->values[c] || !responses->mask[c]) {
            status = nacre_fail_memory(error, "the responses");
            goto out;
        }
    }
    status = NACRE_OK;
out:
    if (status != NACRE_OK) {
        responses_finish(responses);
    }
    return status;
}

size_t responses_index(const struct responses *r, int x, int y, int u, int v)
{
    size_t block = (size_t)(x / r->lanes), lane = (size_t)(x % r->lanes);
    size_t row = (size_t)y * (size_t)r->window + (size_t)v;
    return r->lead + row * r->row + (block * (size_t)r->window + (size_t)u) * (size_t)r->lanes +
           lane;
}

int responses_is_measured(const struct responses *r, int channel, size_t index)
{
    size_t lanes = (size_t)r->lanes;
    return (r->mask[channel][index / lanes] >> (index % lanes)) & 1;
}

/* The part of the window of a point that lies inside the sample, along one axis: entries [*first, *end). */
static void inside(int position, int size, int window, int *first, int *end)
{
    int start = position - window / 2;
    *first = start < 0 ? -start : 0;
    *end = start + window > size ? size - start : window;
}

void responses_put(struct responses *r, int x, int y, const float *response)
{
    int u0 = 0, u1 = 0, v0 = 0, v1 = 0;
    size_t area = (size_t)r->window * (size_t)r->window;
    inside(x, r->width, r->window, &u0, &u1);
    inside(y, r->height, r->window, &v0, &v1);
    for (int c = 0; c < r->channels; c++) {
        const float *window = response + (size_t)c * area;
        for (int v = v0; v < v1; v++) {
            for (int u = u0; u < u1; u++) {
                float value = window[(size_t)v * (size_t)r->window + (size_t)u];
                size_t index = responses_index(r, x, y, u, v);
                if (isfinite(value)) {
                    r->values[c][index] = value;
                    r->mask[c][index / (size_t)r->lanes] |=
                        (uint16_t)(1u << (index % (size_t)r->lanes));
                    r->measured[(size_t)y * (size_t)r->width + (size_t)x] = 1;
                }
            }
        }
    }
}

/* Count measured points and unmeasured entries, and find whether any value is negative. */
static void take_stock(struct responses *r)
{
    size_t points = (size_t)r->width * (size_t)r->height;
    double expected = 0;
    r->measured_count = 0;
    r->mask_needed = 0;
    r->negative = 0;
    for (size_t i = 0; i < points; i++) {
        r->measured_count += r->measured[i];
    }
    for (int y = 0; y < r->height; y++) {
        for (int x = 0; x < r->width; x++) {
            int u0 = 0, u1 = 0, v0 = 0, v1 = 0;
            inside(x, r->width, r->window, &u0, &u1);
            inside(y, r->height, r->window, &v0, &v1);
            expected += (double)(u1 - u0) * (v1 - v0);
        }
    }
    for (int c = 0; c < r->channels; c++) {
        size_t vectors = r->size / (size_t)r->lanes, measured = 0;
        int negative = 0;
#pragma omp parallel for reduction(+ : measured)
        for (size_t i = 0; i < vectors; i++) {
            measured += (size_t)__builtin_popcount(r->mask[c][i]);
        }
#pragma omp parallel for reduction(| : negative)
        for (size_t i = 0; i < r->size; i++) {
            negative |= r->values[c][i] < 0;
        }
        r->mask_needed |= (double)measured != expected;
        r->negative |= negative;
    }
}

void responses_scale(struct responses *r)
{
    take_stock(r);
    for (int c = 0; c < r->channels; c++) {
        float largest = 0;
        int exponent = 0;
#pragma omp parallel for reduction(max : largest)
        for (size_t i = 0; i < r->size; i++) {
            float magnitude = fabsf(r->values[c][i]);
            largest = magnitude > largest ? magnitude : largest;
        }
        (void)frexpf(largest, &exponent);
        r->exponent[c] = exponent;
        if (exponent == 0) {
            continue;
        }
        /* In two exact steps, as one power of two may be too large for a float. */
        float half = ldexpf(1, -exponent / 2), rest = ldexpf(1, -exponent - -exponent / 2);
#pragma omp parallel for
        for (size_t i = 0; i < r->size; i++) {
            r->values[c][i] = r->values[c][i] * half * rest;
        }
    }
}

/* Bytes that the kernel says programs may still take; SIZE_MAX where it does not say. */
static size_t available_bytes(void)
{
    size_t kibibytes = SIZE_MAX / 1024;
    char line[128];
    FILE *file = fopen("/proc/meminfo", "re");
    if (!file) {
        return SIZE_MAX;
    }
    while (fgets(line, sizeof line, file)) {
        if (strncmp(line, "MemAvailable:", 13) == 0) {
            kibibytes = strtoull(line + 13, NULL, 10);
        }
    }
    (void)fclose(file);
    return kibibytes * 1024;
}

static int read_rows(struct responses *r, const struct nacre_scan *scan, struct progress *progress,
                     struct nacre_error *error)
{
    size_t floats = nacre_scan_response_size(nacre_scan_info(scan));
    int failed_at = r->height, done = 0, status = NACRE_OK;
    struct nacre_error first = {0};
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < r->height; y++) {
        struct nacre_error mine = {0};
        int skip = 0;
#pragma omp critical(factor_read)
        {
            if (status == NACRE_OK) {
                status = progress_step(progress, done++, r->height, "reading responses", &mine);
                first = status == NACRE_OK ? first : mine;
            }
            skip = status != NACRE_OK;
        }
        float *response = skip ? NULL : malloc(floats * sizeof *response);
        int result = response || skip ? NACRE_OK : nacre_fail_memory(&mine, "a response");
        for (int x = 0; x < r->width && result == NACRE_OK && !skip; x++) {
            result = nacre_scan_read(scan, x, y, response, &mine);
            if (result == NACRE_OK) {
                responses_put(r, x, y, response);
            }
        }
        free(response);
#pragma omp critical(factor_read)
        if (result != NACRE_OK && y < failed_at) {
            failed_at = y;
            status = result;
            first = mine;
        }
    }
    if (status != NACRE_OK && error) {
        *error = first;
    }
    return status;
}

int responses_load(struct responses *responses, const struct nacre_scan *scan, int lanes,
                   struct progress *progress, struct nacre_error *error)
{
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    size_t needed = responses_bytes(info, lanes), available = available_bytes();
    int status = NACRE_FAILED;
    *responses = (struct responses){0};
    if (needed > available) {
        return nacre_fail(error,
                          "%s: its responses take %.1f GiB of memory and %.1f GiB are free; close "
                          "other programs or scan with a smaller window",
                          nacre_scan_path(scan), (double)needed * 0x1p-30,
                          (double)available * 0x1p-30);
    }
    if (responses_begin(responses, info, lanes, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    status = read_rows(responses, scan, progress, error);
    if (status != NACRE_OK) {
        responses_finish(responses);
        return status;
    }
    responses_scale(responses);
    return NACRE_OK;
}

void responses_get(const struct responses *r, int channel, int x, int y, float *window)
{
    for (int v = 0; v < r->window; v++) {
        for (int u = 0; u < r->window; u++) {
            size_t index = responses_index(r, x, y, u, v);
            *window++ = responses_is_measured(r, channel, index) ? r->values[channel][index] : NAN;
        }
    }
}

void responses_finish(struct responses *responses)
{
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        free(responses->values[c]);
        free(responses->mask[c]);
    }
    free(responses->measured);
    *responses = (struct responses){0};
}
