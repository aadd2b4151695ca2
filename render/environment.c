/* Equirectangular pictures as light. */
#include "render/environment.h"

#include "render/light_picture.h"

#include <stdlib.h>

static const double pi = 3.14159265358979323846;

/* Direction at (s, t) in 0..1 of the picture, from its upper left corner. */
static struct vec3 direction_at(const struct environment *environment, double s, double t)
{
    double azimuth = (s - 0.5) * 2 * pi - environment->rotation; /* from y to x */
    double sine = sin(t * pi);
    return (struct vec3){sine * sin(azimuth), sine * cos(azimuth), cos(t * pi)};
}

static void place_of(const struct environment *environment, struct vec3 direction, double *s,
                     double *t)
{
    double turns = (atan2(direction.x, direction.y) + environment->rotation) / (2 * pi) + 0.5;
    *s = turns - floor(turns);
    *t = acos(fmin(fmax(direction.z, -1), 1)) / pi;
}

/* Cosine of the polar angle at which a row begins. */
static double row_cosine(const struct picture *picture, int row)
{
    return cos(pi * row / picture->height);
}

static const float *pixel_at(const struct picture *picture, int x, int y)
{
    int column = (x + picture->width) % picture->width;
    int row = y < 0 ? 0 : y < picture->height ? y : picture->height - 1;
    return picture->rgb + ((size_t)row * (size_t)picture->width + (size_t)column) * 3;
}

/* The mean over a pixel of what is bilinear between pixel centres, and over colours. */
static double pixel_mean(const struct picture *picture, int x, int y)
{
    static const double weights[3] = {1.0 / 8, 6.0 / 8, 1.0 / 8};
    double sum = 0;
    for (int k = 0; k < 9; k++) {
        const float *pixel = pixel_at(picture, x + k % 3 - 1, y + k / 3 - 1);
        double grey = ((double)pixel[0] + pixel[1] + pixel[2]) / 3;
        sum += weights[k % 3] * weights[k / 3] * grey;
    }
    return sum;
}

static int sum_up(struct environment *environment, struct nacre_error *error)
{
    const struct picture *picture = &environment->picture;
    size_t width = (size_t)picture->width, height = (size_t)picture->height;
    environment->row_sums = calloc(height + 1, sizeof *environment->row_sums);
    environment->column_sums = calloc(height * (width + 1), sizeof *environment->column_sums);
    if (!environment->row_sums || !environment->column_sums) {
        return nacre_fail_memory(error, "the environment");
    }
    for (int y = 0; y < picture->height; y++) {
        double *sums = environment->column_sums + (size_t)y * (width + 1);
        double angle = (row_cosine(picture, y) - row_cosine(picture, y + 1)) * 2 * pi /
                       picture->width; /* solid angle of a pixel */
        for (int x = 0; x < picture->width; x++) {
            sums[x + 1] = sums[x] + pixel_mean(picture, x, y) * angle;
        }
        environment->row_sums[y + 1] = environment->row_sums[y] + sums[width];
    }
    return NACRE_OK;
}

static int read_picture(struct environment *environment, const struct scene_environment *settings,
                        struct nacre_error *error)
{
    struct picture *picture = &environment->picture;
    if (light_picture_read(settings->image, picture, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    size_t count = (size_t)picture->width * (size_t)picture->height * 3;
    for (size_t i = 0; i < count; i++) {
        picture->rgb[i] *= (float)settings->color[i % 3];
    }
    return sum_up(environment, error);
}

int environment_make(struct environment *environment, const struct scene_environment *settings,
                     struct nacre_error *error)
{
    *environment = (struct environment){.rotation = settings->rotation_deg * pi / 180};
    for (int c = 0; c < 3; c++) {
        environment->color[c] = settings->color[c];
    }
    if (!settings->image) {
        return NACRE_OK;
    }
    int status = read_picture(environment, settings, error);
    if (status != NACRE_OK) {
        environment_finish(environment);
    }
    return status;
}

void environment_finish(struct environment *environment)
{
    picture_finish(&environment->picture);
    free(environment->row_sums);
    free(environment->column_sums);
    *environment = (struct environment){0};
}

void environment_value(const struct environment *environment, struct vec3 direction,
                       double value[3])
{
    const struct picture *picture = &environment->picture;
    double s, t;
    if (!picture->rgb) {
        for (int c = 0; c < 3; c++) {
            value[c] = environment->color[c];
        }
        return;
    }
    place_of(environment, direction, &s, &t);
    double x = s * picture->width - 0.5, y = t * picture->height - 0.5;
    double x0 = floor(x), y0 = floor(y);
    value[0] = value[1] = value[2] = 0;
    for (int k = 0; k < 4; k++) {
        int column = (int)x0 + k % 2, row = (int)y0 + k / 2;
        double weight = (1 - fabs(x - column)) * (1 - fabs(y - row));
        const float *pixel = pixel_at(picture, column, row);
        for (int c = 0; c < 3; c++) {
            value[c] += weight * pixel[c];
        }
    }
}

/* The place among ascending sums where `target` falls; *rest is how far into its step, in 0..1. */
static int find(const double *sums, int count, double target, double *rest)
{
    int low = 0, high = count;
    while (high - low > 1) {
        int middle = low + (high - low) / 2;
        if (sums[middle] <= target) {
            low = middle;
        } else {
            high = middle;
        }
    }
    double step = sums[low + 1] - sums[low];
    *rest = step > 0 ? fmin(fmax((target - sums[low]) / step, 0), 1) : 0.5;
    return low;
}

struct vec3 environment_draw(const struct environment *environment, const double u[2])
{
    const struct picture *picture = &environment->picture;
    double down, across;
    if (!picture->rgb || !(environment->row_sums[picture->height] > 0)) {
        double z = 1 - 2 * u[0], sine = sqrt(fmax(1 - z * z, 0)), angle = 2 * pi * u[1];
        return (struct vec3){sine * cos(angle), sine * sin(angle), z};
    }
    int row = find(environment->row_sums, picture->height,
                   u[0] * environment->row_sums[picture->height], &down);
    const double *sums = environment->column_sums + (size_t)row * ((size_t)picture->width + 1);
    int column = find(sums, picture->width, u[1] * sums[picture->width], &across);
    /* Evenly by solid angle within the pixel. */
    double top = row_cosine(picture, row), bottom = row_cosine(picture, row + 1);
    double t = acos(top + (bottom - top) * down) / pi;
    return direction_at(environment, (column + across) / picture->width, t);
}

double environment_density(const struct environment *environment, struct vec3 direction)
{
    const struct picture *picture = &environment->picture;
    double s, t;
    if (!picture->rgb || !(environment->row_sums[picture->height] > 0)) {
        return 1 / (4 * pi);
    }
    place_of(environment, direction, &s, &t);
    int column = (int)fmin(s * picture->width, picture->width - 1);
    int row = (int)fmin(t * picture->height, picture->height - 1);
    const double *sums = environment->column_sums + (size_t)row * ((size_t)picture->width + 1);
    double angle =
        (row_cosine(picture, row) - row_cosine(picture, row + 1)) * 2 * pi / picture->width;
    return (sums[column + 1] - sums[column]) / angle / environment->row_sums[picture->height];
}
