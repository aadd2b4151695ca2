/* Making a material of planes with a kernel each. */
#include "factor/terms_material.h"

#include "factor/assemble.h"
#include "factor/fill.h"
#include "factor/terms_round.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Planes have a maximum of 2^-PLANE_EXPONENT, so that half floats hold squares of small levels, and kernels the rest. */
enum { PLANE_EXPONENT = 4 };

/* Of the centre at least, whatever planes have: one number there is what many entries of a plane are. The albedo is for
 * viewers alone, which 62 steps from dark to bright do for. */
enum { CENTRE_BITS = 8, ALBEDO_BITS = 6 };

/* Logarithmic levels reach this far below the largest value; what is darker becomes the least of them. */
#define DARKEST 1e-6

/* The least value that half floats hold with all their digits. */
#define HALF_LEAST 0x1p-14F

int terms_material_allocate(int seed, int bits, double pitch_mm, const struct problem *p,
                            struct nacre_material *m, struct nacre_error *error)
{
    const struct terms_data *d = p->data;
    const struct responses *r = d->responses;
    *m = (struct nacre_material){.width = r->width,
                                 .height = r->height,
                                 .channels = r->channels,
                                 .factor_channels = terms_data_sets(d),
                                 .window = r->window,
                                 .terms = p->terms,
                                 .layout = NACRE_KERNEL_PER_TERM,
                                 .pixel = NACRE_HALF,
                                 .bits = bits,
                                 .radii = d->grid.radius ? d->grid.count : 0,
                                 .pitch_mm = pitch_mm,
                                 .seed = seed};
    return nacre_material_allocate(m, d->copy_count == 2 || d->gain, true, error);
}

static size_t points_of(const struct nacre_material *m)
{
    return (size_t)m->width * (size_t)m->height;
}

/* Planes[terms][points] in place as the file has them, over its largest value each: rounded, or not. scales[terms] become what
 * that is in the factors' unit. */
static int quantise_planes(const struct problem *p, const struct factors *f, int set, int side,
                           int bits, float *planes, double *scales, struct nacre_error *error)
{
    size_t points = (size_t)f->width * (size_t)f->height, terms = (size_t)f->terms;
    double top = ldexp(1, bits) - 1;
    int status =
        bits > 0 ? terms_round(p->data, f, set, side, bits, planes, scales, error) : NACRE_OK;
    for (size_t t = 0; t < terms && status == NACRE_OK; t++) {
        float *plane = planes + t * points;
        double largest = 0;
        for (size_t i = 0; i < points; i++) {
            largest = fmax(largest, (double)plane[i]);
        }
        for (size_t i = 0; i < points; i++) {
            double share = bits > 0      ? (double)plane[i] / top * (double)plane[i] / top
                           : largest > 0 ? (double)plane[i] / largest
                                         : 0;
            plane[i] = (float)ldexp(share, -PLANE_EXPONENT);
        }
        scales[t] = ldexp(bits > 0 ? scales[t] : largest, PLANE_EXPONENT);
    }
    return status;
}

int terms_material_round(const struct problem *p, int bits, struct factors *f,
                         struct nacre_error *error)
{
    size_t points = (size_t)f->width * (size_t)f->height, count = (size_t)f->terms * points;
    struct factors exact;
    double *scales = calloc((size_t)f->terms, sizeof *scales);
    if (!scales) {
        return nacre_fail_memory(error, "rounding");
    }
    int status = factors_allocate(&exact, p, error);
    if (status == NACRE_OK) {
        factors_copy(&exact, f);
    }
    for (int i = 0; i < 2 * terms_data_sets(p->data) && status == NACRE_OK; i++) {
        float *planes = i % 2 ? f->h[i / 2] : f->f[i / 2];
        status = planes ? quantise_planes(p, &exact, i / 2, i % 2, bits, planes, scales, error)
                        : NACRE_OK;
        for (size_t j = 0; planes && j < count && status == NACRE_OK; j++) {
            planes[j] = (float)(scales[j / points] * (double)planes[j]);
        }
    }
    free(scales);
    factors_finish(&exact);
    return status;
}

/* Values of all channels above 0, which are as the file has them, to evenly spaced logarithms; 0 and NaN stay. */
static void quantise_logarithms(float *plane, size_t count, int bits)
{
    double least = INFINITY, largest = 0;
    double levels = ldexp(1, bits) - 2;
    for (size_t i = 0; i < count; i++) {
        largest = fmax(largest, (double)plane[i]); /* passes over NaN */
    }
    for (size_t i = 0; i < count; i++) {
        if (plane[i] > 0 && (double)plane[i] >= largest * DARKEST) {
            least = fmin(least, (double)plane[i]);
        }
    }
    double range = largest > least ? log(largest / least) : 1;
    for (size_t i = 0; i < count; i++) {
        if (plane[i] > 0) {
            double level = rint(log(fmax((double)plane[i], least) / least) / range * levels);
            plane[i] = (float)(least * exp(level / levels * range));
        }
    }
}

/* Points of which something was measured in any of `count` channels from the first on, as x_i or x_o. */
static void find_known(const struct responses *r, int first, int count, uint8_t *known,
                       uint8_t *work)
{
    size_t points = (size_t)r->width * (size_t)r->height;
    memset(known, 0, points);
    for (int c = first; c < first + count; c++) {
        for (int outgoing = 0; outgoing < 2; outgoing++) {
            assemble_known(r, c, outgoing, work);
            for (size_t i = 0; i < points; i++) {
                known[i] |= work[i];
            }
        }
    }
}

/* One side's planes of one set, filled and quantised; scales[terms] are multiplied by what kernels are to be. */
static int fill_planes_of(const struct problem *p, const struct factors *factors, int set, int side,
                          const uint8_t *known, struct nacre_material *m, double *scales,
                          struct nacre_error *error)
{
    const struct responses *r = p->data->responses;
    size_t points = points_of(m), terms = (size_t)p->terms, sets = (size_t)m->factor_channels;
    float *planes = malloc(terms * points * sizeof *planes), *to = side == 1 ? m->h : m->f;
    double *own = calloc(terms, sizeof *own);
    int status = NACRE_OK;
    if (!planes || !own) {
        status = nacre_fail_memory(error, "the planes");
        goto out;
    }
    memcpy(planes, side == 1 ? factors->h[set] : factors->f[set], terms * points * sizeof *planes);
    if (r->mask_needed) {
        status = fill_planes(r->width, r->height, known, p->ids, planes, terms, points, error);
    }
    if (status == NACRE_OK) {
        status = quantise_planes(p, factors, set, side, m->bits, planes, own, error);
    }
    for (size_t t = 0; t < terms && status == NACRE_OK; t++) {
        scales[t] *= own[t];
        memcpy(to + (t * sets + (size_t)set) * points, planes + t * points, points * sizeof *to);
    }
out:
    free(planes);
    free(own);
    return status;
}

/* Kernels in the responses' own unit; the centre is not theirs. */
static void place_kernels(const struct problem *p, const struct factors *factors, int channel,
                          const double *scales, struct nacre_material *m)
{
    const struct terms_data *d = p->data;
    int exponent = d->responses->exponent[channel] + d->copies[0].exponent[channel];
    size_t count = (size_t)d->grid.count, terms = (size_t)p->terms;
    float *to = m->radii > 0 ? m->profiles : m->kernels;
    for (size_t t = 0; t < terms; t++) {
        const float *numbers = factors->kernels[channel] + t * count;
        float *own = to + (t * (size_t)m->channels + (size_t)channel) * count;
        for (size_t i = 0; i < count; i++) {
            own[i] = (float)ldexp((double)numbers[i] * scales[t], exponent);
        }
        own[m->radii > 0 ? 0 : count / 2] = 0;
    }
}

/* The measured centre entries, in the responses' own unit. */
static int place_centre(const struct problem *p, int channel, struct nacre_material *m,
                        uint8_t *work, struct nacre_error *error)
{
    const struct responses *r = p->data->responses;
    int half = r->window / 2;
    float *centre = m->centre + (size_t)channel * points_of(m);
    for (int i = 0; i < r->width * r->height; i++) {
        float value = responses_value(r, channel, i % r->width, i / r->width, half, half);
        work[i] = !isnan(value);
        centre[i] = value > 0 ? ldexpf(value, r->exponent[channel]) : 0;
    }
    int status = r->mask_needed ? fill_planes(r->width, r->height, work, p->ids, centre, 1,
                                              points_of(m), error)
                                : NACRE_OK;
    return status;
}

/* Half floats do where none of the centre's values is too small for them. */
static enum nacre_pixel choose_pixel(const struct nacre_material *m)
{
    for (size_t i = 0; i < (size_t)m->channels * points_of(m); i++) {
        bool fits = m->centre[i] == 0 || (m->centre[i] >= HALF_LEAST && m->centre[i] < 60000);
        if (!fits) {
            return NACRE_FLOAT;
        }
    }
    return NACRE_HALF;
}

static int apply_gain(const struct terms_data *d, struct nacre_material *m,
                      struct nacre_error *error)
{
    size_t points = points_of(m);
    size_t count = points * (size_t)m->terms * (size_t)m->factor_channels;
    nacre_material_round(m); /* while f is what the file holds */
    m->gain = malloc(points * sizeof *m->gain);
    if (!m->gain) {
        return nacre_fail_memory(error, "the gain");
    }
    memcpy(m->gain, d->gain, points * sizeof *m->gain);
    nacre_material_round(m);
    for (size_t i = 0; i < count; i++) {
        m->h[i] = m->f[i] / m->gain[i % points];
        m->f[i] *= m->gain[i % points];
    }
    return NACRE_OK;
}

static int fill_set(const struct problem *p, const struct factors *factors, int set,
                    struct nacre_material *m, uint8_t *known, uint8_t *work, double *scales,
                    struct nacre_error *error)
{
    const struct terms_data *d = p->data;
    int sets = terms_data_sets(d), channels = sets > 1 ? 1 : m->channels;
    int status = NACRE_OK;
    for (int t = 0; t < p->terms; t++) {
        scales[t] = 1;
    }
    find_known(d->responses, set, channels, known, work);
    status = fill_planes_of(p, factors, set, 0, known, m, scales, error);
    if (status == NACRE_OK && d->copy_count == 2) {
        status = fill_planes_of(p, factors, set, 1, known, m, scales, error);
    } else {
        for (int t = 0; t < p->terms; t++) {
            scales[t] *= scales[t];
        }
    }
    for (int c = set; c < set + channels && status == NACRE_OK; c++) {
        place_kernels(p, factors, c, scales, m);
        assemble_albedo(d->responses, c, m->albedo + (size_t)c * points_of(m));
        status = place_centre(p, c, m, work, error);
    }
    return status;
}

int terms_material_fill(const struct problem *p, const struct factors *factors,
                        struct nacre_material *m, struct nacre_error *error)
{
    const struct terms_data *d = p->data;
    uint8_t *known = malloc(points_of(m)), *work = malloc(points_of(m));
    double *scales = malloc((size_t)p->terms * sizeof *scales);
    int status = NACRE_OK;
    if (!known || !work || !scales) {
        status = nacre_fail_memory(error, "the planes");
        goto out;
    }
    for (int set = 0; set < terms_data_sets(d) && status == NACRE_OK; set++) {
        status = fill_set(p, factors, set, m, known, work, scales, error);
    }
    if (status == NACRE_OK) {
        size_t count = (size_t)m->channels * points_of(m);
        m->pixel = choose_pixel(m);
        nacre_material_round(m);
        if (m->bits > 0) {
            quantise_logarithms(m->albedo, count, ALBEDO_BITS);
            quantise_logarithms(m->centre, count, m->bits < CENTRE_BITS ? CENTRE_BITS : m->bits);
        }
        if (d->grid.radius) {
            memcpy(m->radius, d->grid.radius, (size_t)d->grid.count * sizeof *m->radius);
            nacre_material_spread(m);
        }
        if (d->gain) {
            status = apply_gain(d, m, error);
        } else {
            nacre_material_round(m);
        }
    }
out:
    free(known);
    free(work);
    free(scales);
    return status;
}
