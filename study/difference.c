/* How far one scan is from another of the same sample: a developed one from exact responses. */
#include "study/difference.h"

#include <math.h>
#include <stdlib.h>

static void add_point(const float *exact, const float *other, size_t size,
                      struct scan_difference *difference)
{
    double off = 0;
    double all = 0;
    double sum = 0;
    double exact_sum = 0;
    for (size_t i = 0; i < size; i++) {
        double e = (double)exact[i];
        double o = (double)other[i];
        if (!isnan(e) && !isnan(o)) {
            off += (o - e) * (o - e);
            all += e * e;
            sum += o;
            exact_sum += e;
        }
    }
    if (!(all > 0)) {
        difference->left_out++;
        return;
    }
    double relative = sqrt(off / all);
    difference->points++;
    difference->least = fmin(difference->least, relative);
    difference->greatest = fmax(difference->greatest, relative);
    difference->mean += relative;
    difference->bias += sum / exact_sum - 1;
}

static int check(const struct nacre_scan *exact, const struct nacre_scan *other,
                 struct nacre_error *error)
{
    const struct nacre_scan_info *a = nacre_scan_info(exact);
    const struct nacre_scan_info *b = nacre_scan_info(other);
    if (a->width != b->width || a->height != b->height || a->window != b->window ||
        a->channels != b->channels) {
        return nacre_fail(error,
                          "%s: has %d x %d points, window %d and %d channels where %s has %d x %d, "
                          "%d and %d; compare scans of one sample and window",
                          nacre_scan_path(other), b->width, b->height, b->window, b->channels,
                          nacre_scan_path(exact), a->width, a->height, a->window, a->channels);
    }
    return NACRE_OK;
}

int scan_difference(const struct nacre_scan *exact, const struct nacre_scan *other,
                    struct scan_difference *difference, struct nacre_error *error)
{
    const struct nacre_scan_info *info = nacre_scan_info(exact);
    size_t size = nacre_scan_response_size(info);
    float *responses = malloc(2 * size * sizeof *responses);
    *difference = (struct scan_difference){.least = INFINITY};
    int status = NACRE_OK;
    if (!responses) {
        status = nacre_fail_memory(error, "two responses");
        goto out;
    }
    status = check(exact, other, error);
    for (int i = 0; status == NACRE_OK && i < info->width * info->height; i++) {
        int x = i % info->width;
        int y = i / info->width;
        status = nacre_scan_read(exact, x, y, responses, error);
        if (status == NACRE_OK) {
            status = nacre_scan_read(other, x, y, responses + size, error);
        }
        if (status == NACRE_OK) {
            add_point(responses, responses + size, size, difference);
        }
    }
    if (status == NACRE_OK && difference->points == 0) {
        status = nacre_fail(error, "%s and %s: have no measured point in common",
                            nacre_scan_path(exact), nacre_scan_path(other));
    }
    difference->mean /= (double)difference->points;
    difference->bias /= (double)difference->points;
out:
    free(responses);
    return status;
}
