/* From camera pixels to surface points: reflected light per point and colour out of a Bayer frame.
 *
 * The light that a surface point sends out is taken as even over the point: that is what R_d, its mean over the point,
 * can say. Pixel k then shows I_k = W_k sum_p s_kp R_p / rho, with W_k what it showed of the white layer of reflectance
 * rho, and s_kp the share of its view that point p takes. `area` weighs this with s_kp and sums over k as if all that
 * the pixel sees were p: R_p = rho (sum_k s_kp I_k) / (sum_k s_kp W_k). Numerator and denominator are summed before
 * they are divided: for a point seen by whole pixels the result is then R_p exactly, however W varies within the
 * point, and pixels count by the light they get, which is how their shot noise wants it. (The mean of the quotients
 * I_k / W_k is exact too but gives a pixel at a dark rim the same say.) But straddling pixels carry a share of the
 * bright point into its dark neighbours. `fit` keeps the mixtures: the same weighted sums with the sum over all points
 * that the pixel sees, sum_k s_kp W_k sum_q s_kq R_q = rho sum_k s_kp I_k, are the normal equations of least squares with
 * weights 1 / W_k, a sparse, symmetric, well-conditioned system as long as a point is wider than a pixel. */
#include "rig/develop/resample.h"

#include "rig/develop/blur.h"
#include "rig/develop/demosaic.h"
#include "rig/develop/fit.h"
#include "rig/develop/footprint.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

const char *const demosaic_names[] = {"auto", "fit", "area", "malvar", NULL};

/* The pixels that tell of one colour. */
struct colour {
    size_t count;
    uint32_t *pixels;
    float *white;             /* [count] */
    float *coverage;          /* [points]: pixels that see the point, when none is saturated */
    struct fit_matrix matrix; /* DEMOSAIC_FIT: of all these pixels */
    double reflectance;
};

struct resampler {
    enum demosaic demosaic;
    enum bayer bayer;
    int width, height, channels;
    int surface_width;
    size_t pixels, points;
    double gains[3]; /* Malvar: what balances the colours before they are mixed */
    struct footprints footprints;
    struct colour colours[3];
};

size_t resampler_size(const struct resampler *resampler)
{
    return (size_t)resampler->channels * resampler->points;
}

static int channel_of(const struct resampler *r, size_t pixel)
{
    return bayer_channel(r->bayer, (int)(pixel % (size_t)r->width),
                         (int)(pixel / (size_t)r->width));
}

/* Full colour of a frame, colours balanced. */
static int full_colour(const struct resampler *r, const float *mosaic, float *planes,
                       struct nacre_error *error)
{
    float *balanced = malloc(r->pixels * sizeof *balanced);
    if (!balanced) {
        return nacre_fail_memory(error, "a balanced frame");
    }
    for (size_t i = 0; i < r->pixels; i++) {
        balanced[i] = mosaic[i] * (float)r->gains[channel_of(r, i)];
    }
    demosaic_malvar(balanced, r->width, r->height, r->bayer, planes);
    free(balanced);
    return NACRE_OK;
}

/* Take the pixels of channel `c` that see the sample and can be divided by their white. */
static int list_pixels(struct resampler *r, const struct flat *flat, const float *white, int c,
                       struct nacre_error *error)
{
    struct colour *colour = &r->colours[c];
    bool mosaic = r->demosaic != DEMOSAIC_MALVAR;
    colour->reflectance = flat->reflectance[c];
    colour->pixels = malloc(r->pixels * sizeof *colour->pixels);
    colour->white = malloc(r->pixels * sizeof *colour->white);
    colour->coverage = calloc(r->points, sizeof *colour->coverage);
    if (!colour->pixels || !colour->white || !colour->coverage) {
        return nacre_fail_memory(error, "the map from pixels to surface points");
    }
    for (size_t i = 0; i < r->pixels; i++) {
        size_t begin = r->footprints.start[i];
        size_t end = r->footprints.start[i + 1];
        if (begin < end && (!mosaic || channel_of(r, i) == c) && flat->lit[i] && white[i] > 0) {
            colour->pixels[colour->count] = (uint32_t)i;
            colour->white[colour->count++] = white[i];
            for (size_t k = begin; k < end; k++) {
                colour->coverage[r->footprints.points[k]] += r->footprints.share[k];
            }
        }
    }
    return r->demosaic == DEMOSAIC_FIT
               ? fit_matrix_init(&colour->matrix, &r->footprints, r->surface_width, colour->pixels,
                                 colour->white, colour->count, r->points, error)
               : NACRE_OK;
}

static int list_all(struct resampler *r, const struct flat *flat, struct nacre_error *error)
{
    static const char *const names[] = {"red", "green", "blue"};
    int status = NACRE_OK;
    const float *white = flat->white;
    float *planes = NULL;
    if (r->demosaic == DEMOSAIC_MALVAR) {
        planes = malloc(3 * r->pixels * sizeof *planes);
        status = planes ? full_colour(r, flat->white, planes, error)
                        : nacre_fail_memory(error, "the white frame's colours");
    }
    for (int c = 0; status == NACRE_OK && c < r->channels; c++) {
        status = list_pixels(r, flat, planes ? planes + (size_t)c * r->pixels : white, c, error);
        size_t blind = 0;
        for (size_t p = 0; status == NACRE_OK && p < r->points; p++) {
            blind += r->colours[c].coverage[p] > 0 ? 0 : 1;
        }
        if (100 * blind > r->points) {
            status = nacre_fail(error,
                                "%zu of %zu surface points are seen by no usable %s pixel; use a "
                                "longer lens, or scan fewer points",
                                blind, r->points, r->channels == 1 ? "camera" : names[c]);
        }
    }
    free(planes);
    return status;
}

int resampler_new(const struct flat *flat, const struct camera_map *map, int surface_width,
                  int surface_height, enum demosaic demosaic, double blur,
                  struct resampler **resampler, struct nacre_error *error)
{
    int status = NACRE_OK;
    struct resampler *r = calloc(1, sizeof *r);
    if (!r) {
        return nacre_fail_memory(error, "the map from pixels to surface points");
    }
    r->demosaic = demosaic == DEMOSAIC_MALVAR && flat->channels == 1 ? DEMOSAIC_AREA : demosaic;
    r->bayer = flat->bayer;
    r->width = flat->width;
    r->height = flat->height;
    r->channels = flat->channels;
    r->surface_width = surface_width;
    r->pixels = (size_t)flat->width * (size_t)flat->height;
    r->points = (size_t)surface_width * (size_t)surface_height;
    for (int c = 0; c < 3; c++) {
        r->gains[c] = flat->levels[c] > 0 ? 1 / flat->levels[c] : 1;
    }
    status = footprints_init(&r->footprints, map, r->width, r->height, surface_width,
                             surface_height, error);
    if (status == NACRE_OK && demosaic == DEMOSAIC_FIT) {
        status = blur_footprints(&r->footprints, r->width, blur, error);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    status = list_all(r, flat, error);
out:
    if (status == NACRE_OK) {
        *resampler = r;
    } else {
        resampler_free(r);
    }
    return status;
}

void resampler_free(struct resampler *resampler)
{
    if (resampler) {
        for (int c = 0; c < 3; c++) {
            free(resampler->colours[c].pixels);
            free(resampler->colours[c].white);
            free(resampler->colours[c].coverage);
            fit_matrix_finish(&resampler->colours[c].matrix);
        }
        footprints_finish(&resampler->footprints);
        free(resampler);
    }
}

/* The sums of one colour of a frame. */
struct sums {
    float *weight;   /* of each listed pixel: its white, 0 where the frame has no value */
    double *light;   /* by point: sum of share times value */
    double *white;   /* by point: sum of share times white */
    double *covered; /* by point: sum of share */
    double *x;       /* by point: light / white */
    size_t missing;  /* listed pixels without a value */
};

static void sums_finish(struct sums *sums)
{
    free(sums->weight);
    free(sums->light);
    *sums = (struct sums){0};
}

static int sums_init(struct sums *sums, const struct resampler *r, struct nacre_error *error)
{
    *sums = (struct sums){.weight = malloc(r->pixels * sizeof *sums->weight),
                          .light = malloc(4 * r->points * sizeof *sums->light)};
    if (!sums->weight || !sums->light) {
        (void)nacre_fail_memory(error, "a frame's surface points");
        return NACRE_FAILED;
    }
    sums->white = sums->light + r->points;
    sums->covered = sums->white + r->points;
    sums->x = sums->covered + r->points;
    return NACRE_OK;
}

static void sum_up(const struct resampler *r, const struct colour *colour, const float *values,
                   struct sums *sums)
{
    const struct footprints *f = &r->footprints;
    memset(sums->light, 0, 3 * r->points * sizeof *sums->light);
    sums->missing = 0;
    for (size_t i = 0; i < colour->count; i++) {
        double value = (double)values[colour->pixels[i]];
        bool measured = !isnan(value);
        sums->weight[i] = measured ? colour->white[i] : 0;
        sums->missing += measured ? 0 : 1;
        size_t end = f->start[colour->pixels[i] + 1];
        for (size_t k = f->start[colour->pixels[i]]; measured && k < end; k++) {
            double share = (double)f->share[k];
            sums->light[f->points[k]] += share * value;
            sums->white[f->points[k]] += share * (double)colour->white[i];
            sums->covered[f->points[k]] += share;
        }
    }
    for (size_t p = 0; p < r->points; p++) {
        sums->x[p] = sums->white[p] > 0 ? sums->light[p] / sums->white[p] : 0;
    }
}

/* From the means by area to the fit. The equations are those of all pixels unless the frame lacks some. */
static int fit(const struct resampler *r, const struct colour *colour, struct sums *sums,
               struct nacre_error *error)
{
    struct fit_matrix own = {0};
    int status = NACRE_OK;
    if (sums->missing > 0) {
        status = fit_matrix_init(&own, &r->footprints, r->surface_width, colour->pixels,
                                 sums->weight, colour->count, r->points, error);
    }
    if (status == NACRE_OK) {
        status = fit_solve(sums->missing > 0 ? &own : &colour->matrix, sums->light, sums->x, error);
    }
    fit_matrix_finish(&own);
    return status;
}

int resampler_apply(const struct resampler *resampler, const float *radiance, float *reflected,
                    struct nacre_error *error)
{
    const struct resampler *r = resampler;
    float *planes = NULL;
    struct sums sums = {0};
    int status = sums_init(&sums, r, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (r->demosaic == DEMOSAIC_MALVAR) {
        planes = malloc(3 * r->pixels * sizeof *planes);
        status = planes ? full_colour(r, radiance, planes, error)
                        : nacre_fail_memory(error, "a frame's colours");
    }
    for (int c = 0; status == NACRE_OK && c < r->channels; c++) {
        const struct colour *colour = &r->colours[c];
        float *out = reflected + (size_t)c * r->points;
        sum_up(r, colour, planes ? planes + (size_t)c * r->pixels : radiance, &sums);
        if (r->demosaic == DEMOSAIC_FIT) {
            status = fit(r, colour, &sums, error);
        }
        for (size_t p = 0; p < r->points; p++) {
            bool enough = sums.covered[p] > 0 && 2 * sums.covered[p] >= (double)colour->coverage[p];
            out[p] = enough ? (float)(colour->reflectance * sums.x[p]) : NAN;
        }
    }
out:
    free(planes);
    sums_finish(&sums);
    return status;
}

/* What the fit leaves of the listed pixels' quotients of light and white, weighted by white as in the fit; of noise it
 * leaves the share that points do not use up. */
static void add_residuals(const struct resampler *r, const struct colour *colour,
                          const float *radiance, const float *variance, const struct sums *sums,
                          struct misfit *misfit)
{
    const struct footprints *f = &r->footprints;
    double left = 1 - fmin((double)r->points / (double)(colour->count + 1), 1);
    for (size_t i = 0; i < colour->count; i++) {
        double weight = (double)sums->weight[i];
        size_t pixel = colour->pixels[i];
        if (weight > 0) {
            double quotient = (double)radiance[pixel] / weight;
            double mixture = 0;
            for (size_t k = f->start[pixel]; k < f->start[pixel + 1]; k++) {
                mixture += (double)f->share[k] * sums->x[f->points[k]];
            }
            misfit->unexplained += weight * (quotient - mixture) * (quotient - mixture) -
                                   left * (double)variance[pixel] / weight;
            misfit->all += weight * quotient * quotient - (double)variance[pixel] / weight;
        }
    }
}

int resampler_add_misfit(const struct resampler *resampler, const float *radiance,
                         const float *variance, struct misfit *misfit, struct nacre_error *error)
{
    const struct resampler *r = resampler;
    struct sums sums = {0};
    int status = sums_init(&sums, r, error);
    for (int c = 0; status == NACRE_OK && c < r->channels; c++) {
        const struct colour *colour = &r->colours[c];
        sum_up(r, colour, radiance, &sums);
        status = fit(r, colour, &sums, error);
        if (status == NACRE_OK) {
            add_residuals(r, colour, radiance, variance, &sums, misfit);
        }
    }
    sums_finish(&sums);
    return status;
}
