/* Samples to factor. */
#include "sample.h"

#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <unity.h>

float *sample_at(const struct sample *s, int x, int y)
{
    size_t size = (size_t)s->channels * (size_t)s->window * (size_t)s->window;
    return s->responses + ((size_t)y * (size_t)s->width + (size_t)x) * size;
}

/* What a point lets through: little on the vein. */
static double openness(int x, int y)
{
    return abs(x - y) % 11 == 5 ? 0.1 : 1;
}

static double fall_off(int x, int y, int channel, double distance)
{
    int material = (x / 5 + y / 5) % 2;
    double length = (material ? 0.6 : 1.7) * (1 - 0.15 * channel);
    double albedo = material ? 0.7 : 0.5;
    return albedo * exp(-distance / length) / (length * length);
}

static void fill_response(struct sample *s, int x, int y, uint64_t seed)
{
    int half = s->window / 2;
    float *entry = sample_at(s, x, y);
    for (int c = 0; c < s->channels; c++) {
        for (int dy = -half; dy <= half; dy++) {
            for (int dx = -half; dx <= half; dx++, entry++) {
                int xo = x + dx, yo = y + dy;
                uint64_t counter = (uint64_t)(entry - s->responses);
                double noise = 1 + 0.02 * (random_uniform(seed, counter) - 0.5);
                double value = fall_off(x, y, c, hypot(dx, dy)) * openness(x, y) * noise;
                int outside = xo < 0 || xo >= s->width || yo < 0 || yo >= s->height;
                *entry = outside ? 0 : (float)(value * openness(xo, yo));
            }
        }
    }
}

struct sample sample_new(int width, int height, int channels, int window, uint64_t seed)
{
    struct sample s = {.width = width, .height = height, .channels = channels, .window = window};
    size_t count =
        (size_t)width * (size_t)height * (size_t)channels * (size_t)window * (size_t)window;
    s.responses = malloc(count * sizeof *s.responses);
    TEST_ASSERT_NOT_NULL(s.responses);
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            fill_response(&s, x, y, seed);
        }
    }
    return s;
}

void sample_finish(struct sample *sample)
{
    free(sample->responses);
    *sample = (struct sample){0};
}

void sample_scale(struct sample *s, float factor)
{
    size_t count = (size_t)s->width * (size_t)s->height * (size_t)s->channels * (size_t)s->window *
                   (size_t)s->window;
    for (size_t i = 0; i < count; i++) {
        s->responses[i] *= factor;
    }
}

static struct responses load(const struct sample *s, int lanes, bool half)
{
    struct nacre_scan_info info = {.width = s->width,
                                   .height = s->height,
                                   .window = s->window,
                                   .channels = s->channels,
                                   .pixel = NACRE_FLOAT,
                                   .pitch_mm = 1};
    struct responses responses;
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_MESSAGE(NACRE_OK, responses_begin(&responses, &info, lanes, half, &error),
                              error.text);
    for (int y = 0; y < s->height; y++) {
        for (int x = 0; x < s->width; x++) {
            responses_put(&responses, x, y, sample_at(s, x, y));
        }
    }
    responses_scale(&responses);
    return responses;
}

struct responses sample_load(const struct sample *s, int lanes)
{
    return load(s, lanes, false);
}

struct responses sample_load_half(const struct sample *s, int lanes)
{
    return load(s, lanes, true);
}

void sample_punch_holes(struct sample *sample)
{
    size_t area = (size_t)sample->window * (size_t)sample->window;
    size_t size = area * (size_t)sample->channels;
    for (int y = 0; y < sample->height; y++) {
        for (int x = 0; x < sample->width; x++) {
            float *response = sample_at(sample, x, y);
            for (size_t i = 0; i < size; i++) {
                bool hole = random_uniform(9, i + size * (size_t)(y * 1000 + x)) < 0.1;
                bool lost = (x == 3 && y == 2) || y == 6 || (x == 8 && y == 4 && i < area);
                response[i] = hole || lost ? (float)NAN : response[i];
            }
        }
    }
}
