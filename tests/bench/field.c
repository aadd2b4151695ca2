/* Maps of two materials, and what goes from one point to another through them. */
#include "field.h"

#include "timing.h"

#include "factor/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Noise: a relative part, and that of counting quanta of so much response. Together about 0.6 % of a response, and the
 * tails have exact zeros, both as in path-traced samples. */
#define NOISE   0.003F
#define QUANTUM 4e-6F

enum { STREAM_KINDS = 1, STREAM_NOISE };

/* A medium: attenuation (1/points) and diffuse transmission of each channel, transport mean free path (points). */
struct medium {
    float attenuation[3], transmission[3], path;
};

static float mix(float a, float b, float share)
{
    return a + share * (b - a);
}

/* 0 below `low`, 1 above `high`, smooth between. */
static float ramp(float low, float high, float value)
{
    float t = fminf(1, fmaxf(0, (value - low) / (high - low)));
    return t * t * (3 - 2 * t);
}

static float lattice(uint64_t seed, int x, int y)
{
    uint64_t counter = ((uint64_t)(uint32_t)y << 32) | (uint32_t)x;
    return (float)(2 * random_uniform(seed, counter) - 1);
}

/* Noise of a lattice, in (-1, 1), that changes over about a unit. */
static float noise(uint64_t seed, float x, float y)
{
    int column = (int)floorf(x), row = (int)floorf(y);
    float u = ramp(0, 1, x - (float)column), v = ramp(0, 1, y - (float)row);
    return mix(mix(lattice(seed, column, row), lattice(seed, column + 1, row), u),
               mix(lattice(seed, column, row + 1), lattice(seed, column + 1, row + 1), u), v);
}

/* Four octaves of it, the coarsest over `size` points. */
static float clouds(uint64_t seed, float x, float y, float size)
{
    float sum = 0;
    for (int octave = 0; octave < 4; octave++) {
        sum += ldexpf(noise(random_bits(seed, (uint64_t)octave), x / size, y / size), -octave);
        size /= 2;
    }
    return sum;
}

/* 1 on fine lines about `width` points wide, 0 off them. */
static float vein(uint64_t seed, float x, float y, float size, float width)
{
    float slope = 1.5F / size; /* of the noise where it passes through 0, about */
    return 1 -
           ramp(0.5F * width * slope, (0.5F * width + 1) * slope, fabsf(clouds(seed, x, y, size)));
}

static struct medium blend(const struct medium *a, const struct medium *b, float share)
{
    struct medium m = {.path = mix(a->path, b->path, share)};
    for (int c = 0; c < 3; c++) {
        m.attenuation[c] = mix(a->attenuation[c], b->attenuation[c], share);
        m.transmission[c] = mix(a->transmission[c], b->transmission[c], share);
    }
    return m;
}

/* More or less scattering, and more or less absorbed at the surface. */
static void vary(struct medium *m, float scattering, float absorption)
{
    m->path /= scattering;
    for (int c = 0; c < 3; c++) {
        m->attenuation[c] *= scattering;
        m->transmission[c] *= absorption;
    }
}

/* Two waxes poured into one another: their border is sharp in some places and soft in others. */
static struct medium candle(uint64_t seed, float x, float y)
{
    static const struct medium clear = {{0.13F, 0.17F, 0.26F}, {0.95F, 0.85F, 0.62F}, 0.9F},
                               milky = {{0.34F, 0.28F, 0.42F}, {0.70F, 0.80F, 0.78F}, 0.5F},
                               pigment = {{0.6F, 0.9F, 1.1F}, {0.30F, 0.15F, 0.12F}, 0.4F};
    float soft = 0.02F + 0.5F * ramp(-0.1F, 0.6F, clouds(seed + 1, x, y, 48));
    struct medium m = blend(&clear, &milky, ramp(-soft, soft, clouds(seed + 2, x, y, 24)));
    vary(&m, 1 + 0.3F * clouds(seed + 3, x, y, 14), 1 + 0.12F * clouds(seed + 4, x, y, 6));
    return blend(&m, &pigment, 0.8F * vein(seed + 5, x, y, 40, 1.5F));
}

/* Stones side by side, with dark joints. */
static struct medium marble(uint64_t seed, float x, float y, float side)
{
    static const struct medium stones[] = {
        {{0.22F, 0.24F, 0.30F}, {0.93F, 0.90F, 0.84F}, 0.55F},  /* white */
        {{0.55F, 0.38F, 0.52F}, {0.55F, 0.75F, 0.60F}, 0.42F},  /* green */
        {{0.32F, 0.50F, 0.60F}, {0.85F, 0.62F, 0.55F}, 0.45F},  /* rose */
        {{0.80F, 0.85F, 0.90F}, {0.35F, 0.33F, 0.32F}, 0.36F}}; /* black */
    static const struct medium joint = {{1.1F, 1.2F, 1.3F}, {0.4F, 0.35F, 0.3F}, 0.36F};
    int column = (int)(x / side), row = (int)(y / side);
    uint64_t kind = random_bits(seed, STREAM_KINDS) + (uint64_t)(column + 3 * row + row / 2);
    uint64_t own = random_bits(seed, (uint64_t)(column * 64 + row) + 100);
    float edge = fmaxf(fabsf(x / side - (float)column - 0.5F), fabsf(y / side - (float)row - 0.5F));
    struct medium m = stones[kind % 4], light = m;
    vary(&light, 0.55F, 1.05F);
    m = blend(&m, &light, ramp(-0.4F, 0.7F, clouds(own, x, y, 20)));
    vary(&m, 1 + 0.2F * clouds(own + 1, x, y, 10), 1 + 0.08F * clouds(own + 2, x, y, 8));
    m = blend(&m, &stones[(kind + 3) % 4], 0.7F * vein(own + 3, x, y, 36, 1));
    return blend(&m, &joint, ramp(0.5F - 1.5F / side, 0.5F - 0.3F / side, edge));
}

static void map_media(struct field *f, enum field_kind kind)
{
    int width = f->info.width, height = f->info.height;
    float side = (float)(width > height ? width : height) / 4;
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            size_t i = (size_t)y * (size_t)width + (size_t)x;
            struct medium m = kind == FIELD_CANDLE ? candle(f->seed, (float)x, (float)y)
                                                   : marble(f->seed, (float)x, (float)y, side);
            for (int c = 0; c < 3; c++) {
                f->media[i][c] = m.attenuation[c];
                f->transmission[i][c] = m.transmission[c];
            }
            f->media[i][3] = m.path;
        }
    }
}

/* The points that light passes on its way: both ends, and between them one about every second point. The way back is
 * the same, so responses are reciprocal. */
static int trace(const struct field *f, int dx, int dy, int *steps)
{
    float distance = hypotf((float)dx, (float)dy);
    int parts = dx || dy ? (int)ceilf(distance / 2) + 1 : 0;
    for (int i = 0; i <= parts; i++) {
        float share = parts ? (float)i / (float)parts : 0;
        steps[i] = (int)lrintf(share * (float)dy) * f->info.width + (int)lrintf(share * (float)dx);
    }
    return parts + 1;
}

static void trace_all(struct field *f)
{
    int window = f->info.window, half = window / 2, count = 0;
    size_t area = (size_t)window * (size_t)window;
    f->path_starts = allocate((area + 1) * sizeof *f->path_starts);
    f->path_steps = allocate(area * (size_t)(window + 3) * sizeof *f->path_steps);
    for (int i = 0; i < window * window; i++) {
        f->path_starts[i] = count;
        count += trace(f, i % window - half, i / window - half, f->path_steps + count);
    }
    f->path_starts[area] = count;
}

struct field field_new(enum field_kind kind, int width, int height, int window, int channels,
                       uint64_t seed)
{
    size_t points = (size_t)width * (size_t)height;
    struct field f = {.info = {.width = width,
                               .height = height,
                               .window = window,
                               .channels = channels,
                               .pixel = NACRE_FLOAT,
                               .pitch_mm = 0.5},
                      .seed = random_bits(seed, (uint64_t)kind)};
    (void)snprintf(f.info.source, sizeof f.info.source, "bench_field %s",
                   kind == FIELD_CANDLE ? "candle" : "marble");
    f.media = allocate(points * sizeof *f.media);
    f.transmission = allocate(points * sizeof *f.transmission);
    map_media(&f, kind);
    trace_all(&f);
    return f;
}

void field_finish(struct field *field)
{
    free(field->media);
    free(field->transmission);
    free(field->path_starts);
    free(field->path_steps);
    *field = (struct field){0};
}

/* Means along the path of entry i of point p's window. */
static void average(const struct field *f, size_t p, int i, float mean[4])
{
    int start = f->path_starts[i], end = f->path_starts[i + 1];
    float sum[4] = {0};
    for (int step = start; step < end; step++) {
        const float *media = f->media[p + (size_t)(ptrdiff_t)f->path_steps[step]];
        for (int c = 0; c < 4; c++) {
            sum[c] += media[c];
        }
    }
    for (int c = 0; c < 4; c++) {
        mean[c] = sum[c] / (float)(end - start);
    }
}

/* The dipole's fall-off; what is nearer than a point's own extent is as far as that. */
static float fall_off(float attenuation, float path, float squared_distance)
{
    float distance = sqrtf(squared_distance + path * path + 0.08F);
    return path * (1 + attenuation * distance) * expf(-attenuation * distance) /
           (6.2832F * distance * distance * distance);
}

/* A count whose mean and variance are `mean`: of Poisson's distribution where few are expected, else uniform. */
static float count_quanta(float mean, float uniform)
{
    float count = 0, chance = expf(-mean), sum = chance;
    if (mean > 12) {
        return mean + sqrtf(12 * mean) * (uniform - 0.5F);
    }
    while (uniform > sum && count < 40) {
        count++;
        chance *= mean / count;
        sum += chance;
    }
    return count;
}

static float add_noise(float value, uint64_t seed, uint64_t counter)
{
    uint64_t bits = random_bits(seed, counter);
    float first = (float)(uint32_t)bits * 0x1p-32F, second = (float)(bits >> 32) * 0x1p-32F;
    value = QUANTUM * count_quanta(value / QUANTUM, first);
    return value * (1 + NOISE * 3.4641016F * (second - 0.5F));
}

void field_response(const struct field *f, int x, int y, float *response)
{
    const struct nacre_scan_info *s = &f->info;
    int half = s->window / 2, area = s->window * s->window;
    size_t p = (size_t)y * (size_t)s->width + (size_t)x;
    uint64_t seed = random_bits(f->seed, STREAM_NOISE);
    for (int i = 0; i < area; i++) {
        int dx = i % s->window - half, dy = i / s->window - half, xo = x + dx, yo = y + dy;
        bool inside = xo >= 0 && xo < s->width && yo >= 0 && yo < s->height;
        float mean[4] = {0};
        size_t o = (size_t)yo * (size_t)s->width + (size_t)xo;
        if (inside) {
            average(f, p, i, mean);
        }
        for (int c = 0; c < s->channels; c++) {
            int colour = s->channels == 1 ? 1 : c;
            size_t entry = (size_t)c * (size_t)area + (size_t)i;
            float value = 0;
            if (inside) {
                float through = sqrtf(f->transmission[p][colour] * f->transmission[o][colour]);
                value = through * fall_off(mean[colour], mean[3], (float)(dx * dx + dy * dy));
                value = add_noise(value, seed, p * nacre_scan_response_size(s) + entry);
            }
            response[entry] = value;
        }
    }
}

struct responses field_load(const struct field *f, int lanes, bool half)
{
    struct nacre_error error = {0};
    struct responses responses;
    if (responses_begin(&responses, &f->info, lanes, half, &error) != NACRE_OK) {
        fail(error.text);
    }
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < f->info.height; y++) {
        float *response = allocate(nacre_scan_response_size(&f->info) * sizeof *response);
        for (int x = 0; x < f->info.width; x++) {
            field_response(f, x, y, response);
            responses_put(&responses, x, y, response);
        }
        free(response);
    }
    responses_scale(&responses);
    return responses;
}

/* Rows are made by all threads and written in order. */
void field_write(const struct field *field, const char *path)
{
    const struct nacre_scan_info *info = &field->info;
    size_t size = nacre_scan_response_size(info);
    float *row = allocate((size_t)info->width * size * sizeof *row);
    struct nacre_scan_writer *writer = NULL;
    struct nacre_error error = {0};
    if (nacre_scan_create(path, info, &writer, &error) != NACRE_OK) {
        fail(error.text);
    }
    for (int y = 0; y < info->height; y++) {
#pragma omp parallel for schedule(dynamic, 8)
        for (int x = 0; x < info->width; x++) {
            field_response(field, x, y, row + (size_t)x * size);
        }
        for (int x = 0; x < info->width; x++) {
            if (nacre_scan_write(writer, x, y, row + (size_t)x * size, &error) != NACRE_OK) {
                nacre_scan_discard(writer);
                fail(error.text);
            }
        }
    }
    if (nacre_scan_commit(writer, &error) != NACRE_OK) {
        fail(error.text);
    }
    free(row);
}
