/* A scan that was divided by white made one of even light: the projector's fall-off moved to where light enters. */
#include "rig/develop/even.h"

#include <math.h>
#include <stdlib.h>

static bool measured(const float *response, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        if (!isnan(response[i])) {
            return true;
        }
    }
    return false;
}

int even_scan(const char *uneven, const struct falloff *falloff, const struct nacre_scan_info *info,
              const char *output, struct nacre_error *error)
{
    struct nacre_scan *scan = NULL;
    struct nacre_scan_writer *writer = NULL;
    size_t size = nacre_scan_response_size(info);
    float *response = malloc(size * sizeof *response);
    int status = NACRE_OK;
    if (!response) {
        status = nacre_fail_memory(error, "a response");
        goto out;
    }
    status = nacre_scan_open(uneven, &scan, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = nacre_scan_create(output, info, &writer, error);
    for (int y = 0; status == NACRE_OK && y < info->height; y++) {
        for (int x = 0; status == NACRE_OK && x < info->width; x++) {
            status = nacre_scan_read(scan, x, y, response, error);
            if (status == NACRE_OK && measured(response, size)) {
                falloff_apply(falloff, info, x, y, response);
                status = nacre_scan_write(writer, x, y, response, error);
            }
        }
    }
    if (status == NACRE_OK) {
        status = nacre_scan_commit(writer, error);
        writer = NULL;
    }
out:
    nacre_scan_discard(writer);
    nacre_scan_close(scan);
    free(response);
    return status;
}
