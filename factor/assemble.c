/* Making a material of factors. */
#include "factor/assemble.h"

#include "factor/fill.h"
#include "factor/update.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Whether something was measured that enters at (x, y), or leaves there. */
static bool is_known(const struct responses *r, int channel, bool outgoing, int x, int y)
{
    int half = r->window / 2;
    for (int v = 0; v < r->window; v++) {
        for (int u = 0; u < r->window; u++) {
            int from_x = outgoing ? x - u + half : x, from_y = outgoing ? y - v + half : y;
            if (from_x >= 0 && from_x < r->width && from_y >= 0 && from_y < r->height &&
                responses_is_measured(r, channel, responses_index(r, from_x, from_y, u, v))) {
                return true;
            }
        }
    }
    return false;
}

void assemble_known(const struct responses *r, int channel, bool outgoing, uint8_t *known)
{
#pragma omp parallel for
    for (int y = 0; y < r->height; y++) {
        for (int x = 0; x < r->width; x++) {
            known[(size_t)y * (size_t)r->width + (size_t)x] = is_known(r, channel, outgoing, x, y);
        }
    }
}

/* The largest half float is just below 2^16; one binade is left to rounding. */
enum { HALF_EXPONENT = 15 };

static float largest_of(const float *values, size_t count)
{
    float largest = 0;
    for (size_t i = 0; i < count; i++) {
        largest = fmaxf(largest, values[i]);
    }
    return largest;
}

/* Give F and H of a term maxima of the same size by an exact power of two, so that both fit half floats. Values at the
 * methods' floor become 0. */
static void balance(float *f, float *h, size_t count)
{
    float largest_f = largest_of(f, count), largest_h = largest_of(h, count);
    int of_f = 0, of_h = 0;
    (void)frexpf(largest_f, &of_f);
    (void)frexpf(largest_h, &of_h);
    int shift = (of_h - of_f) / 2;
    for (size_t i = 0; i < count; i++) {
        f[i] = f[i] <= UPDATE_FLOOR ? 0 : ldexpf(f[i], shift);
        h[i] = h[i] <= UPDATE_FLOOR ? 0 : ldexpf(h[i], -shift);
    }
}

/* Where kernels are far below the responses they stand for, factors may pass what half floats hold: a power of two is then
 * the kernels' to carry, whose exponent is returned. */
static int relieve(float *values, size_t count)
{
    int exponent = 0;
    (void)frexpf(largest_of(values, count), &exponent);
    int excess = exponent - HALF_EXPONENT;
    for (size_t i = 0; i < count && excess > 0; i++) {
        values[i] = ldexpf(values[i], -excess);
    }
    return excess > 0 ? excess : 0;
}

/* One channel's factors into the material's planes. work: 2 x [terms][height][width] floats; known: [height][width].
 * Kernels are to be multiplied by 2^*exponent. */
static int assemble_factors(const struct problem *p, const struct factors *factors, int channel,
                            struct nacre_material *m, float *work, uint8_t *known, int *exponent,
                            struct nacre_error *error)
{
    const struct responses *r = p->responses;
    size_t plane = (size_t)r->width * (size_t)r->height, count = plane * (size_t)p->terms;
    float *f = work, *h = work + count;
    int status = NACRE_OK;
    memcpy(f, factors->f[channel], count * sizeof *f);
    memcpy(h, factors->h[channel], count * sizeof *h);
    for (size_t t = 0; t < (size_t)p->terms && status == NACRE_OK; t++) {
        balance(f + t * plane, h + t * plane, plane);
    }
    *exponent = relieve(f, count) + relieve(h, count);
    if (status == NACRE_OK && r->mask_needed) {
        assemble_known(r, channel, false, known);
        status = fill_planes(r->width, r->height, known, p->ids, f, (size_t)p->terms, plane, error);
    }
    if (status == NACRE_OK && r->mask_needed) {
        assemble_known(r, channel, true, known);
        status = fill_planes(r->width, r->height, known, p->ids, h, (size_t)p->terms, plane, error);
    }
    for (size_t t = 0; t < (size_t)p->terms && status == NACRE_OK; t++) {
        size_t to = (t * (size_t)m->channels + (size_t)channel) * plane;
        memcpy(m->f + to, f + t * plane, plane * sizeof *f);
        memcpy(m->h + to, h + t * plane, plane * sizeof *h);
    }
    return status;
}

void assemble_albedo(const struct responses *r, int channel, float *albedo)
{
#pragma omp parallel for
    for (int y = 0; y < r->height; y++) {
        for (int x = 0; x < r->width; x++) {
            albedo[y * r->width + x] =
                (float)ldexp(responses_sum(r, channel, x, y), r->exponent[channel]);
        }
    }
}

int assemble_material(const struct problem *p, const struct factors *factors,
                      struct nacre_material *m, struct nacre_error *error)
{
    const struct responses *r = p->responses;
    size_t plane = (size_t)r->width * (size_t)r->height;
    size_t area = (size_t)r->window * (size_t)r->window;
    float *work = malloc(2 * plane * (size_t)p->terms * sizeof *work);
    uint8_t *known = malloc(plane);
    int exponents[RESPONSES_CHANNELS] = {0};
    int status = NACRE_OK;
    if (!work || !known) {
        status = nacre_fail_memory(error, "the factors");
        goto out;
    }
    for (int c = 0; c < r->channels && status == NACRE_OK; c++) {
        status = assemble_factors(p, factors, c, m, work, known, &exponents[c], error);
        assemble_albedo(r, c, m->albedo + (size_t)c * plane);
    }
    /* The kernels carry the responses' scale, as they are always stored as floats. */
    for (size_t i = 0; i < (size_t)p->clusters * (size_t)r->channels; i++) {
        size_t c = i % (size_t)r->channels;
        for (size_t j = 0; j < area; j++) {
            m->kernels[i * area + j] =
                ldexpf(p->kernels[i * area + j], r->exponent[c] + exponents[c]);
        }
    }
    for (size_t i = 0; i < plane; i++) {
        m->ids[i] = p->ids[i];
        m->weights[i] = 1;
    }
out:
    free(work);
    free(known);
    return status;
}
