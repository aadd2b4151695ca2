/* Whether each pixel answers in proportion to light: a linear regression over the exposures of the white frames, and
 * whether it counts without light: the same over those of the black frames. */
#include "rig/develop/linearity.h"

#include "rig/develop/flat.h"

#include <math.h>
#include <stdlib.h>

enum { WEIGHT, TIMES, TIMES2, VALUES, VALUES_TIMES, VALUES2, SUMS };
enum { EXPOSURES = 16, REACH = 4 };

/* A pixel below this share of the lower quartile of its neighbours is dead: its shot noise is twice theirs, so that what it
 * tells is worth a quarter of a pixel, and a calibration of it four times as wrong. Sensitivities scatter by some per cent,
 * and vignetting over 4 pixels by less. */
static const double dead_share = 0.25;
/* Whether the neighbours get light at all: their share of the colour's upper level. */
static const double lit_share = 0.1;
/* Variances over what is foretold. Eight frames know a variance to 1 / sqrt(3.5), 53 %: chance passes 5 times it once in 10^5
 * pixels, and never 25. Such a pixel among the 16 or so of a point makes that more than 1.5 times as noisy. */
static const double noisy_ratio = 25;

/* Standard errors that make something certain: 1 in 3.5 million pixels passes 5 by chance, less than one a frame. */
static const double certain = 5;

int linearity_init(struct linearity *linearity, size_t pixels, struct nacre_error *error)
{
    *linearity = (struct linearity){.pixels = pixels,
                                    .sums = calloc(pixels, SUMS * sizeof *linearity->sums),
                                    .count = calloc(pixels, sizeof *linearity->count)};
    if (!linearity->sums || !linearity->count) {
        linearity_finish(linearity);
        return nacre_fail_memory(error, "the linear regression");
    }
    return NACRE_OK;
}

void linearity_finish(struct linearity *linearity)
{
    if (linearity) {
        free(linearity->sums);
        free(linearity->count);
        *linearity = (struct linearity){0};
    }
}

static size_t exposure_index(struct linearity *linearity, double seconds)
{
    size_t e = 0;
    while (e < linearity->exposure_count && linearity->seconds[e] != seconds) {
        e++;
    }
    if (e == linearity->exposure_count && e < EXPOSURES) {
        linearity->seconds[e] = seconds;
        linearity->exposure_count++;
    }
    return e;
}

void linearity_add(struct linearity *linearity, const struct pattern_frames *frames,
                   const struct noise_model *noise, const float *radiance)
{
    double floor_variance = noise->read_noise * noise->read_noise + 1.0 / 12;
    double shot = noise->electrons > 0 ? 1 / noise->electrons : 0;
    for (size_t e = 0; e < frames->count; e++) {
        const uint16_t *raw = frames->exposures[e].raw;
        double t = (double)frames->exposures[e].exposure_ns * 1e-9;
        double range = (double)((1 << frames->bits) - 2) - noise->pedestal;
        size_t index = exposure_index(linearity, t);
        double residual = 0;
        double expected = 0;
        double scatter = 0;
        for (size_t i = 0; i < linearity->pixels; i++) {
            double light = (double)radiance[i] * t;
            double variance = floor_variance + fmax(light, 0) * shot;
            if (isnan(radiance[i]) || light + 5 * sqrt(variance) > range) {
                continue;
            }
            double value = raw[i] - noise->pedestal;
            double weight = 1 / variance;
            double *sums = linearity->sums + SUMS * i;
            sums[WEIGHT] += weight;
            sums[TIMES] += weight * t;
            sums[TIMES2] += weight * t * t;
            sums[VALUES] += weight * value;
            sums[VALUES_TIMES] += weight * value * t;
            sums[VALUES2] += weight * value * value;
            linearity->count[i]++;
            residual += value - light;
            expected += light;
            scatter += variance;
        }
        if (index < EXPOSURES) {
            linearity->residual[index] += residual;
            linearity->expected[index] += expected;
            linearity->variance[index] += scatter;
        }
    }
}

void linearity_line(const struct linearity *linearity, size_t pixel, double *slope, double *offset,
                    double *chi_squared, int *freedom)
{
    const double *sums = linearity->sums + SUMS * pixel;
    double spread = sums[TIMES2] - sums[TIMES] * sums[TIMES] / sums[WEIGHT];
    *slope = *offset = *chi_squared = NAN;
    *freedom = 0;
    if (linearity->count[pixel] >= 2 && spread > 1e-9 * sums[TIMES2]) {
        double shared = sums[VALUES_TIMES] - sums[TIMES] * sums[VALUES] / sums[WEIGHT];
        double square = sums[VALUES2] - sums[VALUES] * sums[VALUES] / sums[WEIGHT];
        *slope = shared / spread;
        *offset = (sums[VALUES] - *slope * sums[TIMES]) / sums[WEIGHT];
        *chi_squared = fmax(square - *slope * shared, 0);
        *freedom = (int)linearity->count[pixel] - 2;
    }
}

/* What chi squared of `freedom` degrees passes once in a million times (Wilson and Hilferty). */
static double chi_squared_limit(int freedom)
{
    double k = freedom;
    double root = 1 - 2 / (9 * k) + 4.753 * sqrt(2 / (9 * k));
    return k * root * root * root;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median of chi squared per degree of freedom over all pixels, at least 1; 1 where none has any. */
static int common_spread(const struct linearity *linearity, double *median,
                         struct nacre_error *error)
{
    size_t used = 0;
    double *spreads = malloc(linearity->pixels * sizeof *spreads);
    if (!spreads) {
        return nacre_fail_memory(error, "the linear regression");
    }
    for (size_t i = 0; i < linearity->pixels; i++) {
        double slope;
        double offset;
        double chi;
        int freedom;
        linearity_line(linearity, i, &slope, &offset, &chi, &freedom);
        if (freedom > 0) {
            spreads[used++] = chi / freedom;
        }
    }
    qsort(spreads, used, sizeof *spreads, compare_doubles);
    *median = used ? fmax(spreads[used / 2], 1) : 1;
    free(spreads);
    return NACRE_OK;
}

/* The value that a share of the measured pixels of the same colour around `pixel`, itself left out, stay below; 0 where
 * there is none. Beyond the frame lies `beyond`; NAN: nothing. */
static double neighbour_level(const float *values, const struct pixel_map *map, size_t pixel,
                              double share, float beyond)
{
    int width = map->width;
    int height = map->height;
    int x = (int)(pixel % (size_t)width);
    int y = (int)(pixel / (size_t)width);
    enum bayer bayer = map->bayer;
    double around[(2 * REACH + 1) * (2 * REACH + 1)];
    size_t count = 0;
    for (int ny = y - REACH; ny <= y + REACH; ny++) {
        for (int nx = x - REACH; nx <= x + REACH; nx++) {
            if ((nx == x && ny == y) ||
                bayer_channel(bayer, nx, ny) != bayer_channel(bayer, x, y)) {
                continue;
            }
            bool inside = nx >= 0 && nx < width && ny >= 0 && ny < height;
            float value = inside ? values[(size_t)ny * (size_t)width + (size_t)nx] : beyond;
            if (!isnan(value)) {
                around[count++] = value;
            }
        }
    }
    qsort(around, count, sizeof *around, compare_doubles);
    return count ? around[(size_t)((double)count * share)] : 0;
}

static double largest_deviation(const struct linearity *linearity)
{
    double deviation = NAN;
    size_t used = 0;
    for (size_t e = 0; e < linearity->exposure_count; e++) {
        if (linearity->expected[e] > 100 * sqrt(linearity->variance[e]) &&
            linearity->expected[e] > 0) {
            double relative = fabs(linearity->residual[e]) / linearity->expected[e];
            deviation = isnan(deviation) ? relative : fmax(deviation, relative);
            used++;
        }
    }
    return used > 1 ? deviation : NAN;
}

/* What the regression over black frames says of each pixel. */
struct darkness {
    float *slope, *offset; /* NaN where not known */
    float *slope_error, *offset_error;
};

/* How much larger the variance of a mean over all frames is than if their errors were independent: rounding is the same
 * in every frame, unless other noise is there to shake it. */
static double common_error(const struct linearity *black, const struct noise_model *noise,
                           size_t pixel)
{
    double frames =
        (double)black->count[pixel] / (double)(black->exposure_count ? black->exposure_count : 1);
    double rounding = 1.0 / 12 / (noise->read_noise * noise->read_noise + 1.0 / 12);
    return 1 + fmax(frames - 1, 0) * rounding;
}

static int darkness_init(struct darkness *darkness, const struct linearity *black,
                         const struct noise_model *noise, struct nacre_error *error)
{
    size_t pixels = black->pixels;
    float *planes = malloc((pixels ? pixels : 1) * 4 * sizeof *planes);
    if (!planes) {
        (void)nacre_fail_memory(error, "the pixels' darkness");
        return NACRE_FAILED;
    }
    *darkness =
        (struct darkness){planes, planes + pixels, planes + 2 * pixels, planes + 3 * pixels};
    for (size_t i = 0; i < pixels; i++) {
        const double *sums = black->sums + SUMS * i;
        double slope;
        double offset;
        double chi;
        int freedom;
        linearity_line(black, i, &slope, &offset, &chi, &freedom);
        double spread = sums[TIMES2] - sums[TIMES] * sums[TIMES] / sums[WEIGHT];
        darkness->slope[i] = (float)slope;
        darkness->offset[i] = (float)offset;
        /* Weights are inverse variances. */
        double common = common_error(black, noise, i);
        darkness->slope_error[i] = (float)sqrt(common / spread);
        darkness->offset_error[i] = (float)sqrt(common * sums[TIMES2] / (sums[WEIGHT] * spread));
    }
    return NACRE_OK;
}

/* Dark counts a second that are as noisy in the longest exposure as all else is in the dark; without known shot noise, as
 * large as `certain` deviations of that. */
static double hot_limit(const struct linearity_evidence *evidence)
{
    const struct noise_model *noise = evidence->noise;
    double floor_variance = noise->read_noise * noise->read_noise + 1.0 / 12;
    double counts =
        noise->electrons > 0 ? floor_variance * noise->electrons : certain * sqrt(floor_variance);
    return counts / evidence->longest_seconds;
}

/* The light that a dark projector pixel still gives, for white's: what 95 % of the lit pixels stay below; 0 where nothing
 * is known. */
static int find_leak(const struct darkness *darkness, const float *white, size_t pixels,
                     const struct pixel_map *map, const double levels[3], double *leak,
                     struct nacre_error *error)
{
    size_t count = 0;
    double *ratios = malloc((pixels ? pixels : 1) * sizeof *ratios);
    if (!ratios) {
        return nacre_fail_memory(error, "the pixels' darkness");
    }
    for (size_t i = 0; i < pixels; i++) {
        int channel =
            bayer_channel(map->bayer, (int)(i % (size_t)map->width), (int)(i / (size_t)map->width));
        if ((double)white[i] > lit_share * levels[channel] && !isnan(darkness->slope[i])) {
            ratios[count++] =
                (double)darkness->slope[i] /
                fmax((double)white[i] - (double)darkness->slope[i], (double)white[i] / 10);
        }
    }
    qsort(ratios, count, sizeof *ratios, compare_doubles);
    *leak = count ? fmax(ratios[count * 95 / 100], 0) : 0;
    free(ratios);
    return NACRE_OK;
}

/* Counts in the dark as much beyond the light that is there as that and all other noise amount to: `limit` stands for the
 * latter. The light is what three quarters of its neighbours stay below, or what its white foretells: the former fails at
 * the corners of the lit area, the latter beside it. */
static bool is_hot(const struct darkness *darkness, const struct pixel_map *map, size_t pixel,
                   double foretold, double limit)
{
    double slope = (double)darkness->slope[pixel];
    if (!(slope > limit)) {
        return false;
    }
    double light = fmax(neighbour_level(darkness->slope, map, pixel, 0.75, NAN), 0);
    light = foretold > light ? foretold : light; /* white may be NaN */
    double excess = slope - light;
    return excess > limit + light && excess > certain * (double)darkness->slope_error[pixel];
}

static bool is_displaced(const struct darkness *darkness, const struct pixel_map *map, size_t pixel,
                         double deviation)
{
    double limit = deviation + certain * (double)darkness->offset_error[pixel];
    double usual = fabs((double)darkness->offset[pixel]) > limit / 2
                       ? neighbour_level(darkness->offset, map, pixel, 0.5, NAN)
                       : 0;
    return fabs((double)darkness->offset[pixel] - usual) > limit;
}

/* Off its line by more than chance. */
static bool is_bent(const struct linearity *white, double common, struct pixel_map *map,
                    size_t pixel)
{
    double slope;
    double offset;
    double chi;
    int freedom;
    linearity_line(white, pixel, &slope, &offset, &chi, &freedom);
    map->slope[pixel] = (float)slope;
    map->offset[pixel] = (float)offset;
    return freedom > 0 && chi > common * chi_squared_limit(freedom);
}

/* Answers far less than its neighbours, where these see the lit area: their lower quartile is dark as soon as its border
 * is near, where a pixel may be dark by right. That border may as well run along the frame's: what lies beyond counts as
 * dark, so that nothing is said of the outermost two pixels. */
static bool is_dead(const float *white, const struct pixel_map *map, size_t pixel,
                    const double levels[3])
{
    int channel = bayer_channel(map->bayer, (int)(pixel % (size_t)map->width),
                                (int)(pixel / (size_t)map->width));
    double usual = neighbour_level(white, map, pixel, 0.25, 0);
    return usual > lit_share * levels[channel] && !((double)white[pixel] >= dead_share * usual);
}

int linearity_judge(const struct linearity_evidence *evidence, struct pixel_map *map,
                    struct linearity_report *report, struct nacre_error *error)
{
    const struct linearity *white = evidence->white;
    const struct noise_model *noise = evidence->noise;
    struct darkness darkness = {0};
    double deviation = sqrt(noise->read_noise * noise->read_noise + 1.0 / 12);
    double common = 1;
    double leak = 0;
    double levels[3];
    int status = common_spread(white, &common, error);
    if (status == NACRE_OK) {
        status =
            flat_levels(evidence->mean_white, map->width, map->height, map->bayer, levels, error);
    }
    if (status == NACRE_OK) {
        status = darkness_init(&darkness, evidence->black, noise, error);
    }
    if (status == NACRE_OK) {
        status = find_leak(&darkness, evidence->mean_white, evidence->black->pixels, map, levels,
                           &leak, error);
    }
    for (size_t i = 0; status == NACRE_OK && i < white->pixels; i++) {
        bool known = i < evidence->black->pixels && !isnan(darkness.slope[i]);
        /* What a pixel counts in the dark it counts in white frames too. */
        double foretold =
            known ? leak * ((double)evidence->mean_white[i] - (double)darkness.slope[i]) : 0;
        bool bent = is_bent(white, common, map, i);
        map->dark[i] = known ? darkness.slope[i] : NAN;
        map->classes[i] =
            is_dead(evidence->mean_white, map, i, levels)                       ? PIXEL_DEAD
            : known && is_hot(&darkness, map, i, foretold, hot_limit(evidence)) ? PIXEL_HOT
            : bent || (known && is_displaced(&darkness, map, i, deviation))     ? PIXEL_NONLINEAR
            : evidence->black_variance && evidence->black_variance[i] >
                                              (float)noisy_ratio * evidence->foretold_variance[i]
                ? PIXEL_NOISY
                : PIXEL_GOOD;
    }
    *report = (struct linearity_report){.dead = pixel_map_count(map, PIXEL_DEAD),
                                        .hot = pixel_map_count(map, PIXEL_HOT),
                                        .nonlinear = pixel_map_count(map, PIXEL_NONLINEAR),
                                        .noisy = pixel_map_count(map, PIXEL_NOISY),
                                        .deviation = largest_deviation(white)};
    free(darkness.slope);
    return status;
}
