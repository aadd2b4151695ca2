/* Checking a material's sizes and values. */
#include "material_check.h"

#include "channel.h"
#include "half_float.h"

#include <math.h>

/* Limits under which no product of sizes can overflow 64 bits. */
enum { SIDE_LIMIT = 1 << 20, COUNT_LIMIT = 1 << 12 };

static bool within(int value, int limit)
{
    return value >= 1 && value <= limit;
}

int material_check_sizes(const struct nacre_material *material, struct nacre_error *error)
{
    if (!within(material->width, SIDE_LIMIT) || !within(material->height, SIDE_LIMIT)) {
        return nacre_fail(error, "a material of %d x %d surface points cannot be", material->width,
                          material->height);
    }
    if (material->channels != 1 && material->channels != 3) {
        return nacre_fail(error, "a material of %d channels cannot be; it has 1 or 3",
                          material->channels);
    }
    if (!within(material->window, COUNT_LIMIT) || material->window % 2 == 0) {
        return nacre_fail(error,
                          "a material with a window of %d cannot be; it is odd and at most %d",
                          material->window, COUNT_LIMIT - 1);
    }
    if (!within(material->terms, COUNT_LIMIT)) {
        return nacre_fail(error, "a material of %d terms cannot be; it has 1 to %d",
                          material->terms, COUNT_LIMIT);
    }
    if (material->factor_channels != material->channels && material->factor_channels != 1) {
        return nacre_fail(error, "a material with %d of %d channels in its factors cannot be",
                          material->factor_channels, material->channels);
    }
    if (material->pixel != NACRE_HALF && material->pixel != NACRE_FLOAT) {
        return nacre_fail(error, "a material of integers cannot be; store HALF or FLOAT");
    }
    if (material->bits < 0 || material->bits > 32) {
        return nacre_fail(error, "a material of %d bits cannot be", material->bits);
    }
    if (material->layout == NACRE_KERNEL_PER_TERM) {
        if (material->clusters != 0 || material->mixed != 0) {
            return nacre_fail(error, "a material with a kernel per term has no clusters");
        }
    } else if (!within(material->clusters, COUNT_LIMIT) ||
               !within(material->mixed, material->clusters)) {
        return nacre_fail(error, "a material of %d clusters, %d mixed at a point, cannot be",
                          material->clusters, material->mixed);
    }
    return NACRE_OK;
}

/* The first of `count` values that is negative, not finite or, stored as HALF, would not be; or
 * `count`. */
static size_t first_wrong(const float *values, size_t count, enum nacre_pixel pixel)
{
    for (size_t i = 0; i < count; i++) {
        if (!(values[i] >= 0) || !isfinite(values[i]) ||
            (pixel == NACRE_HALF && !isfinite(half_nearest(values[i])))) {
            return i;
        }
    }
    return count;
}

/* One part's planes: values[planes][height][width], named by their first plane's number and
 * channel. */
static int check_planes(const char *part, const char *item, const float *values, size_t planes,
                        int width, int height, int channels, enum nacre_pixel pixel,
                        struct nacre_error *error)
{
    size_t size = (size_t)width * (size_t)height;
    size_t wrong = first_wrong(values, planes * size, pixel);
    if (wrong == planes * size) {
        return NACRE_OK;
    }
    size_t plane = wrong / size;
    size_t pixel_index = wrong % size;
    return nacre_fail(error,
                      "part %s: %s %zu, channel %s: the value at (%zu, %zu) is %g; it must be "
                      "finite, not negative%s",
                      part, item, plane / (size_t)channels,
                      channel_name(channels, (int)(plane % (size_t)channels)),
                      pixel_index % (size_t)width, pixel_index / (size_t)width,
                      (double)values[wrong],
                      pixel == NACRE_HALF ? ", and at most 65504 to be stored as HALF" : "");
}

/* Ids and weights of the point with index i. */
static int check_point(const struct nacre_material *material, size_t i, struct nacre_error *error)
{
    size_t size = (size_t)material->width * (size_t)material->height;
    size_t x = i % (size_t)material->width;
    size_t y = i / (size_t)material->width;
    double sum = 0;
    for (int m = 0; m < material->mixed; m++) {
        uint32_t id = material->ids[(size_t)m * size + i];
        float weight = material->weights[(size_t)m * size + i];
        if (id >= (uint32_t)material->clusters) {
            return nacre_fail(error,
                              "part cluster: channel id%d: the id at (%zu, %zu) is %u, and there "
                              "are %d clusters",
                              m, x, y, id, material->clusters);
        }
        if (!(weight >= 0) || !isfinite(weight)) {
            return nacre_fail(error, "part cluster: channel w%d: the weight at (%zu, %zu) is %g", m,
                              x, y, (double)weight);
        }
        for (int other = 0; other < m; other++) {
            if (material->ids[(size_t)other * size + i] == id) {
                return nacre_fail(error,
                                  "part cluster: channels id%d and id%d name the same cluster at "
                                  "(%zu, %zu)",
                                  other, m, x, y);
            }
        }
        sum += (double)weight;
    }
    /* Weights are floats: each is off by 6e-8 at most, and normalising them adds as much. */
    if (fabs(sum - 1) > 1e-4) {
        return nacre_fail(error, "part cluster: the weights at (%zu, %zu) sum to %g, not 1", x, y,
                          sum);
    }
    return NACRE_OK;
}

int material_check_values(const struct nacre_material *material, struct nacre_error *error)
{
    int width = material->width;
    int height = material->height;
    int factors = material->factor_channels;
    size_t planes = (size_t)material->terms * (size_t)factors;
    int count = nacre_material_kernel_count(material);
    int status = check_planes("F", "term", material->f, planes, width, height, factors,
                              material->pixel, error);
    if (status == NACRE_OK && material->h) {
        status = check_planes("H", "term", material->h, planes, width, height, factors,
                              material->pixel, error);
    }
    if (status == NACRE_OK) {
        status = check_planes("kernel", "kernel", material->kernels,
                              (size_t)count * (size_t)material->channels, material->window,
                              material->window, material->channels, NACRE_FLOAT, error);
    }
    if (status == NACRE_OK && material->centre) {
        status = check_planes("centre", "plane", material->centre, (size_t)material->channels,
                              width, height, material->channels, material->pixel, error);
    }
    size_t points = (size_t)width * (size_t)height;
    for (size_t i = 0; material->mixed > 0 && i < points && status == NACRE_OK; i++) {
        status = check_point(material, i, error);
    }
    return status;
}
