/* Loading a scan's responses. */
#include "factor/responses.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

size_t responses_free_bytes(void)
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

/* Whether the entries are stored as half floats, and whether the memory that is free holds them. */
static int choose_store(const struct nacre_scan *scan, int lanes, enum responses_store store,
                        bool *half, struct nacre_error *error)
{
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    size_t available = responses_free_bytes();
    *half = store == RESPONSES_HALF || (store == RESPONSES_AUTO && info->pixel == NACRE_HALF);
    size_t needed = responses_bytes(info, lanes, *half);
    if (needed <= available) {
        return NACRE_OK;
    }
    bool other = !*half && responses_bytes(info, lanes, true) <= available;
    return nacre_fail(error,
                      "%s: its responses take %.1f GiB of memory and %.1f GiB are free; close "
                      "other programs or %s",
                      nacre_scan_path(scan), (double)needed * 0x1p-30, (double)available * 0x1p-30,
                      other ? "store them as half floats with --responses half"
                            : "scan with a smaller window");
}

int responses_load(struct responses *responses, const struct nacre_scan *scan, int lanes,
                   enum responses_store store, struct progress *progress, struct nacre_error *error)
{
    bool half = false;
    *responses = (struct responses){0};
    int status = choose_store(scan, lanes, store, &half, error);
    if (status == NACRE_OK) {
        status = responses_begin(responses, nacre_scan_info(scan), lanes, half, error);
    }
    if (status == NACRE_OK) {
        status = read_rows(responses, scan, progress, error);
    }
    if (status != NACRE_OK) {
        responses_finish(responses);
        return status;
    }
    responses_scale(responses);
    return NACRE_OK;
}
