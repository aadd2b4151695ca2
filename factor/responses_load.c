/* Loading a scan's responses. */
#include "factor/responses.h"

#include "factor/window.h"

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

static struct window_cut cut_to(const struct responses *r, int from)
{
    return (struct window_cut){.width = r->width,
                               .height = r->height,
                               .channels = r->channels,
                               .from = from,
                               .to = r->window};
}

/* Put a response of a window of `from`, of which the middle is kept. */
static void put_middle(struct responses *r, int x, int y, int from, float *response)
{
    if (r->beyond) {
        const struct window_cut cut = cut_to(r, from);
        r->beyond[(size_t)y * (size_t)r->width + (size_t)x] =
            window_cut(&cut, x, y, response, response);
    }
    responses_put(r, x, y, response);
}

/* Room for responses of a smaller window than `info` has, where `window` is one. */
static int begin(struct responses *r, const struct nacre_scan_info *info, int window, int lanes,
                 bool half, struct nacre_error *error)
{
    struct nacre_scan_info smaller = *info;
    smaller.window = window;
    int status = responses_begin(r, &smaller, lanes, half, error);
    if (status == NACRE_OK && window < info->window) {
        r->beyond = calloc((size_t)r->width * (size_t)r->height, sizeof *r->beyond);
        status = r->beyond ? NACRE_OK : nacre_fail_memory(error, "the responses");
    }
    return status;
}

static int read_rows(struct responses *r, const struct nacre_scan *scan, struct progress *progress,
                     struct nacre_error *error)
{
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    size_t floats = nacre_scan_response_size(info);
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
                put_middle(r, x, y, info->window, response);
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
static int choose_store(const struct nacre_scan *scan, const struct nacre_scan_info *info,
                        int lanes, enum responses_store store, bool *half,
                        struct nacre_error *error)
{
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
                            : "take a smaller window with --window");
}

int responses_load(struct responses *responses, const struct nacre_scan *scan, int window,
                   int lanes, enum responses_store store, struct progress *progress,
                   struct nacre_error *error)
{
    struct nacre_scan_info info = *nacre_scan_info(scan);
    bool half = false;
    *responses = (struct responses){0};
    if (window < 0 || window > info.window || (window > 0 && window % 2 == 0)) {
        return nacre_fail(error,
                          "%s: a window of %d cannot be taken out of one of %d; ask for an odd "
                          "one that is no larger",
                          nacre_scan_path(scan), window, info.window);
    }
    info.window = window > 0 ? window : info.window;
    int status = choose_store(scan, &info, lanes, store, &half, error);
    if (status == NACRE_OK) {
        status = begin(responses, nacre_scan_info(scan), info.window, lanes, half, error);
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

int responses_shrink(struct responses *responses, const struct responses *from, int window,
                     struct nacre_error *error)
{
    const struct nacre_scan_info info = {.width = from->width,
                                         .height = from->height,
                                         .channels = from->channels,
                                         .window = from->window};
    size_t floats = nacre_scan_response_size(&info), points = (size_t)info.width * info.height;
    bool short_of_room = false;
    *responses = (struct responses){0};
    int status = begin(responses, &info, window, from->lanes, from->half, error);
#pragma omp parallel for schedule(dynamic) reduction(|| : short_of_room)
    for (int y = 0; y < (status == NACRE_OK ? info.height : 0); y++) {
        float *response = malloc(floats * sizeof *response);
        short_of_room = short_of_room || !response;
        for (int x = 0; response && x < info.width; x++) {
            responses_read(from, x, y, response);
            put_middle(responses, x, y, info.window, response);
        }
        free(response);
    }
    if (status == NACRE_OK && short_of_room) {
        status = nacre_fail_memory(error, "a response");
    }
    for (size_t i = 0; status == NACRE_OK && from->beyond && i < points; i++) {
        responses->beyond[i] += from->beyond[i];
    }
    if (status != NACRE_OK) {
        responses_finish(responses);
        return status;
    }
    responses_scale(responses);
    return NACRE_OK;
}
