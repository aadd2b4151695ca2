/* Responses in the working layout: placing, scaling and reading them. */
#include "factor/responses.h"

#define IMATH_HALF_NO_LOOKUP_TABLE
#include <Imath/half.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>

/* Half floats are scaled so that a channel's largest is at most 2^15, a binade below what overflows. */
enum { HALF_EXPONENT = 15 };

/* A point as it was put: the exponents of its largest magnitudes, which its half floats are scaled by until all
 * channels' are known. */
struct responses_point {
    int16_t exponent[RESPONSES_CHANNELS]; /* DARK where there is nothing but 0 */
    bool put, missing, negative;
};

#define DARK INT16_MIN

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

static size_t values_bytes(const struct responses *r)
{
    return r->size * (r->half ? sizeof(uint16_t) : sizeof(float));
}

/* Of zeroed responses 0. */
static size_t mask_bytes(const struct responses *r)
{
    return r->lanes > 0 ? r->size / (size_t)r->lanes * sizeof(uint16_t) : 0;
}

size_t responses_bytes(const struct nacre_scan_info *info, int lanes, bool half)
{
    struct responses r = {.half = half};
    double count = (double)info->height * info->window * info->window * (info->width + lanes);
    if (count > 0x1p55 || info->window > 1 << 15) {
        return SIZE_MAX;
    }
    set_sizes(&r, info, lanes);
    return (size_t)info->channels * (values_bytes(&r) + mask_bytes(&r));
}

/* Zeros that take no memory before they are touched, which the threads that load do. Huge pages spare the streaming
 * kernels most address translations. NULL where there is no room. */
static void *map_zeros(size_t bytes)
{
    void *memory = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) {
        return NULL;
    }
    (void)madvise(memory, bytes, MADV_HUGEPAGE); /* a hint */
    return memory;
}

static void unmap(void *memory, size_t bytes)
{
    if (memory) {
        (void)munmap(memory, bytes);
    }
}

int responses_begin(struct responses *responses, const struct nacre_scan_info *info, int lanes,
                    bool half, struct nacre_error *error)
{
    struct responses *r = responses;
    int status = NACRE_FAILED;
    *r = (struct responses){.half = half};
    if (responses_bytes(info, lanes, half) == SIZE_MAX) {
        return nacre_fail_memory(error, "the responses");
    }
    set_sizes(r, info, lanes);
    size_t points = (size_t)info->width * (size_t)info->height;
    r->measured = calloc(points, 1);
    r->points = calloc(points, sizeof *r->points);
    bool room = r->measured && r->points;
    for (int c = 0; c < info->channels; c++) {
        void *values = map_zeros(values_bytes(r));
        r->values[c] = half ? NULL : values;
        r->halves[c] = half ? values : NULL;
        r->mask[c] = map_zeros(mask_bytes(r));
        room = room && values && r->mask[c];
    }
    if (!room) {
        status = nacre_fail_memory(error, "the responses");
        goto out;
    }
    status = NACRE_OK;
out:
    if (status != NACRE_OK) {
        responses_finish(r);
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
    return !r->mask_needed || ((r->mask[channel][index / lanes] >> (index % lanes)) & 1);
}

/* The part of the window of a point that lies inside the sample, along one axis: entries [*first, *end). */
static void inside(int position, int size, int window, int *first, int *end)
{
    int start = position - window / 2;
    *first = start < 0 ? -start : 0;
    *end = start + window > size ? size - start : window;
}

/* Two exact steps of a power of two, which may be too large or too small for one float. */
struct scale {
    float first, rest;
};

static struct scale scale_by(int exponent)
{
    return (struct scale){ldexpf(1, exponent / 2), ldexpf(1, exponent - exponent / 2)};
}

/* What is to be known of a point before it is stored. */
static void take_stock(const struct responses *r, int x, int y, const float *response,
                       struct responses_point *point)
{
    int u0 = 0, u1 = 0, v0 = 0, v1 = 0, missing = 0, negative = 0;
    size_t window = (size_t)r->window;
    inside(x, r->width, r->window, &u0, &u1);
    inside(y, r->height, r->window, &v0, &v1);
    for (int c = 0; c < r->channels; c++) {
        float largest = 0;
        int exponent = 0;
        for (int v = v0; v < v1; v++) {
            const float *row = response + ((size_t)c * window + (size_t)v) * window;
#pragma omp simd reduction(max : largest) reduction(+ : missing, negative)
            for (int u = u0; u < u1; u++) {
                float magnitude = fabsf(row[u]);
                int known = magnitude < INFINITY;
                largest = known && magnitude > largest ? magnitude : largest;
                missing += !known;
                negative += known && row[u] < 0;
            }
        }
        (void)frexpf(largest, &exponent);
        point->exponent[c] = (int16_t)(largest > 0 ? exponent : DARK);
    }
    point->put = true;
    point->missing = missing > 0;
    point->negative = negative > 0;
}

static void set_measured(struct responses *r, int channel, size_t index)
{
    size_t lanes = (size_t)r->lanes;
    r->mask[channel][index / lanes] |= (uint16_t)(1U << (index % lanes));
}

void responses_put(struct responses *r, int x, int y, const float *response)
{
    size_t at = (size_t)y * (size_t)r->width + (size_t)x, lanes = (size_t)r->lanes;
    struct responses_point *point = &r->points[at];
    int u0 = 0, u1 = 0, v0 = 0, v1 = 0, known = 0;
    inside(x, r->width, r->window, &u0, &u1);
    inside(y, r->height, r->window, &v0, &v1);
    take_stock(r, x, y, response, point);
    for (int row = 0; row < r->channels * r->window; row++, response += r->window) {
        int c = row / r->window, v = row % r->window;
        size_t index = responses_index(r, x, y, u0, v);
        struct scale scale = scale_by(HALF_EXPONENT - point->exponent[c]);
        for (int u = u0; v >= v0 && v < v1 && u < u1; u++, index += lanes) {
            if (!isfinite(response[u])) {
                continue;
            }
            known = 1;
            if (r->half && point->exponent[c] != DARK) {
                r->halves[c][index] = imath_float_to_half(response[u] * scale.first * scale.rest);
            } else if (!r->half) {
                r->values[c][index] = response[u];
            }
            if (point->missing) {
                set_measured(r, c, index);
            }
        }
    }
    r->measured[at] = (uint8_t)known;
}

/* Where something was not measured, mark all of the points of which everything was; else there is no mask. */
static void complete_masks(struct responses *r)
{
    for (int c = 0; c < r->channels && !r->mask_needed; c++) {
        unmap(r->mask[c], mask_bytes(r));
        r->mask[c] = NULL;
    }
#pragma omp parallel for
    for (int y = 0; y < (r->mask_needed ? r->height : 0); y++) {
        for (int x = 0; x < r->width; x++) {
            const struct responses_point *point = &r->points[y * r->width + x];
            int u0 = 0, u1 = 0, v0 = 0, v1 = 0;
            inside(x, r->width, r->window, &u0, &u1);
            inside(y, r->height, r->window, &v0, &v1);
            for (int v = v0; point->put && !point->missing && v < v1; v++) {
                for (int u = u0; u < u1; u++) {
                    for (int c = 0; c < r->channels; c++) {
                        set_measured(r, c, responses_index(r, x, y, u, v));
                    }
                }
            }
        }
    }
}

/* Give the half floats of a block's points, each scaled by its own exponent, that of the channel. */
static void rescale_block(struct responses *r, int channel, int block, int y, int exponent)
{
    size_t lanes = (size_t)r->lanes, run = (size_t)r->window * lanes;
    struct scale scales[RESPONSES_LANES];
    bool all_same = true;
    for (int lane = 0; lane < r->lanes; lane++) {
        int x = block * r->lanes + lane;
        int own = x < r->width ? r->points[y * r->width + x].exponent[channel] : DARK;
        scales[lane] = scale_by(own == DARK ? 0 : own - exponent);
        all_same = all_same && (own == DARK || own == exponent);
    }
    for (int v = 0; v < r->window && !all_same; v++) {
        uint16_t *halves = r->halves[channel] + responses_index(r, block * r->lanes, y, 0, v);
        for (size_t i = 0; i < run; i++) {
            struct scale scale = scales[i % lanes];
            halves[i] = halves[i] == 0 ? 0
                                       : imath_float_to_half(imath_half_to_float(halves[i]) *
                                                             scale.first * scale.rest);
        }
    }
}

/* The exponent of a channel's largest magnitude; 0 where all are 0. */
static int largest_exponent(const struct responses *r, int channel)
{
    int largest = DARK;
    for (size_t i = 0; i < (size_t)r->width * (size_t)r->height; i++) {
        int own = r->points[i].put ? r->points[i].exponent[channel] : DARK;
        largest = own > largest ? own : largest;
    }
    return largest == DARK ? 0 : largest;
}

static void scale_channel(struct responses *r, int channel)
{
    int exponent = largest_exponent(r, channel);
    r->exponent[channel] = exponent;
    if (r->half) {
        r->exponent[channel] -= HALF_EXPONENT;
#pragma omp parallel for
        for (int y = 0; y < r->height; y++) {
            for (int b = 0; b < r->blocks; b++) {
                rescale_block(r, channel, b, y, exponent);
            }
        }
        return;
    }
    struct scale scale = scale_by(-exponent);
    size_t size = exponent == 0 ? 0 : r->size;
#pragma omp parallel for simd
    for (size_t i = 0; i < size; i++) {
        r->values[channel][i] = r->values[channel][i] * scale.first * scale.rest;
    }
}

void responses_scale(struct responses *r)
{
    for (size_t i = 0; i < (size_t)r->width * (size_t)r->height; i++) {
        const struct responses_point *point = &r->points[i];
        r->measured_count += r->measured[i];
        r->mask_needed |= !point->put || point->missing;
        r->negative |= point->negative;
    }
    complete_masks(r);
    for (int c = 0; c < r->channels; c++) {
        scale_channel(r, c);
    }
    free(r->points);
    r->points = NULL;
}

static float value_at(const struct responses *r, int channel, size_t index)
{
    return r->half ? imath_half_to_float(r->halves[channel][index]) : r->values[channel][index];
}

float responses_value(const struct responses *r, int channel, int x, int y, int u, int v)
{
    size_t index = responses_index(r, x, y, u, v);
    return responses_is_measured(r, channel, index) ? value_at(r, channel, index) : (float)NAN;
}

void responses_get_row(const struct responses *r, int channel, int x, int y, int v, float *row)
{
    int u0 = 0, u1 = 0, v0 = 0, v1 = 0;
    inside(x, r->width, r->window, &u0, &u1);
    inside(y, r->height, r->window, &v0, &v1);
    u1 = v >= v0 && v < v1 ? u1 : u0;
    size_t index = responses_index(r, x, y, u0, v);
    for (int u = 0; u < r->window; u++) {
        row[u] = NAN;
    }
    for (int u = u0; u < u1; u++) {
        row[u] = value_at(r, channel, index + (size_t)(u - u0) * (size_t)r->lanes);
    }
    for (int u = u0; r->mask_needed && u < u1; u++, index += (size_t)r->lanes) {
        row[u] = responses_is_measured(r, channel, index) ? row[u] : (float)NAN;
    }
}

double responses_sum(const struct responses *r, int channel, int x, int y)
{
    int u0 = 0, u1 = 0, v0 = 0, v1 = 0;
    double sum = 0;
    bool any = false;
    inside(x, r->width, r->window, &u0, &u1);
    inside(y, r->height, r->window, &v0, &v1);
    for (int v = v0; v < v1; v++) {
        size_t index = responses_index(r, x, y, u0, v);
        for (int u = u0; u < u1; u++, index += (size_t)r->lanes) {
            if (responses_is_measured(r, channel, index)) {
                sum += (double)value_at(r, channel, index);
                any = true;
            }
        }
    }
    return any ? sum : (double)NAN;
}

void responses_get(const struct responses *r, int channel, int x, int y, float *window)
{
    for (int v = 0; v < r->window; v++, window += r->window) {
        responses_get_row(r, channel, x, y, v, window);
    }
}

void responses_read(const struct responses *r, int x, int y, float *response)
{
    size_t area = (size_t)r->window * (size_t)r->window;
    for (int c = 0; c < r->channels; c++, response += area) {
        struct scale scale = scale_by(r->exponent[c]);
        responses_get(r, c, x, y, response);
        for (size_t i = 0; i < area; i++) {
            response[i] = response[i] * scale.first * scale.rest;
        }
    }
}

void responses_finish(struct responses *responses)
{
    struct responses *r = responses;
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        unmap(r->values[c], values_bytes(r));
        unmap(r->halves[c], values_bytes(r));
        unmap(r->mask[c], mask_bytes(r));
    }
    free(r->measured);
    free(r->points);
    free(r->beyond);
    *r = (struct responses){0};
}
