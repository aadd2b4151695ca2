/* Area, point, spot and projecting lights. */
#include "render/lights.h"

#include "nacre/error.h"

#include <string.h>

static const double pi = 3.14159265358979323846;

enum { PATTERN_SIZE = 1024 }; /* pixels across a drawn slide */

static bool pattern_is_bright(int pattern, int count, int x, int y)
{
    int column = x * count / PATTERN_SIZE, row = y * count / PATTERN_SIZE;
    int in_column = x * count % PATTERN_SIZE, in_row = y * count % PATTERN_SIZE;
    switch (pattern) {
    case PATTERN_CHECKS:
        return (column + row) % 2 == 0;
    case PATTERN_STRIPES:
        return column % 2 == 0;
    default: /* PATTERN_GRID: bright lines an eighth of a mesh wide */
        return in_column < PATTERN_SIZE / 8 || in_row < PATTERN_SIZE / 8;
    }
}

static int slide_make(const struct scene_texture *texture, struct picture *slide,
                      struct nacre_error *error)
{
    if (texture->image) {
        return picture_read(texture->image, slide, error);
    }
    if (picture_allocate(slide, PATTERN_SIZE, PATTERN_SIZE, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (int y = 0; y < PATTERN_SIZE; y++) {
        for (int x = 0; x < PATTERN_SIZE; x++) {
            const double *colour = pattern_is_bright(texture->pattern, texture->count, x, y)
                                       ? texture->bright
                                       : texture->dark;
            for (int c = 0; c < 3; c++) {
                slide->rgb[((size_t)y * PATTERN_SIZE + (size_t)x) * 3 + (size_t)c] =
                    (float)colour[c];
            }
        }
    }
    return NACRE_OK;
}

/* Irradiance over intensity of a rectangle of unit intensity at a facing point on its axis. */
static double area_factor(double width, double height, double distance)
{
    /* The form factor of a parallel rectangle's quarter, times four, times pi, over the area. */
    double a = width / 2 / distance, b = height / 2 / distance;
    double ra = sqrt(1 + a * a), rb = sqrt(1 + b * b);
    double quarter = (a / ra * atan(b / ra) + b / rb * atan(a / rb)) / (2 * pi);
    return 4 * quarter * pi / (width * height);
}

int light_make(struct light *light, const struct scene_light *settings, struct nacre_error *error)
{
    *light = (struct light){.kind = settings->kind,
                            .position = vec3_from_doubles(settings->position_mm),
                            .width_mm = settings->size_mm[0],
                            .height_mm = settings->size_mm[1]};
    struct vec3 axis = vec3_subtract(vec3_from_doubles(settings->at_mm), light->position);
    light->distance_mm = vec3_length(axis);
    light->forward = vec3_unit(axis);
    struct vec3 right = vec3_cross(light->forward, vec3_from_doubles(settings->up));
    /* A light that looks along its `up` has no other up to be told from. */
    light->right =
        vec3_length(right) > 1e-6 ? vec3_unit(right) : vec3_perpendicular(light->forward);
    light->up = vec3_cross(light->right, light->forward);
    double factor = 1 / (light->distance_mm * light->distance_mm);
    if (light->kind == LIGHT_AREA) {
        factor = area_factor(light->width_mm, light->height_mm, light->distance_mm);
    }
    for (int c = 0; c < 3; c++) {
        light->intensity[c] = settings->irradiance[c] / factor;
    }
    double half = settings->angle_deg / 2 * pi / 180;
    light->cos_edge = cos(half);
    light->cos_full = cos(fmax(half - settings->soft_deg * pi / 180, 0));
    if (light->kind == LIGHT_PROJECTOR) {
        if (slide_make(&settings->texture, &light->slide, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        light->tan_x = tan(half);
        light->tan_y = light->tan_x * light->slide.height / light->slide.width;
    }
    return NACRE_OK;
}

void light_finish(struct light *light)
{
    picture_finish(&light->slide);
    *light = (struct light){0};
}

/* The slide's colour at (s, t) in 0..1 from the lower left corner, bilinear between pixel centres; black outside. */
static void slide_colour(const struct picture *slide, double s, double t, double colour[3])
{
    double x = s * slide->width - 0.5, y = (1 - t) * slide->height - 0.5;
    colour[0] = colour[1] = colour[2] = 0;
    if (!(s >= 0 && s <= 1 && t >= 0 && t <= 1)) {
        return;
    }
    double x0 = floor(x), y0 = floor(y);
    for (int k = 0; k < 4; k++) {
        double xi = x0 + k % 2, yi = y0 + k / 2; /* NOLINT(bugprone-integer-division): a bit of k */
        double weight = (1 - fabs(x - xi)) * (1 - fabs(y - yi));
        size_t column = (size_t)fmin(fmax(xi, 0), slide->width - 1);
        size_t row = (size_t)fmin(fmax(yi, 0), slide->height - 1);
        const float *pixel = slide->rgb + (row * (size_t)slide->width + column) * 3;
        for (int c = 0; c < 3; c++) {
            colour[c] += weight * pixel[c];
        }
    }
}

void light_profile(const struct light *light, struct vec3 direction, double profile[3])
{
    double along = vec3_dot(direction, light->forward), level = 1;
    if (light->kind == LIGHT_AREA) {
        level = fmax(along, 0); /* Lambert's law */
    } else if (light->kind == LIGHT_SPOT) {
        double t = (along - light->cos_edge) / fmax(light->cos_full - light->cos_edge, 1e-12);
        t = fmin(fmax(t, 0), 1);
        level = t * t * (3 - 2 * t);
    } else if (light->kind == LIGHT_PROJECTOR) {
        if (along > 0) {
            double s = vec3_dot(direction, light->right) / along / light->tan_x;
            double t = vec3_dot(direction, light->up) / along / light->tan_y;
            slide_colour(&light->slide, (s + 1) / 2, (t + 1) / 2, profile);
        } else {
            profile[0] = profile[1] = profile[2] = 0;
        }
        return;
    }
    profile[0] = profile[1] = profile[2] = level;
}

static struct vec3 source_point(const struct light *light, double u, double v)
{
    if (light->kind != LIGHT_AREA) {
        return light->position;
    }
    return vec3_along(vec3_along(light->position, (u - 0.5) * light->width_mm, light->right),
                      (v - 0.5) * light->height_mm, light->up);
}

struct light_arrival light_arrive(const struct light *light, struct vec3 point, struct vec3 normal,
                                  const double u[2])
{
    struct light_arrival arrival = {.from = source_point(light, u[0], u[1])};
    struct vec3 way = vec3_subtract(point, arrival.from);
    double square = vec3_dot(way, way);
    struct vec3 direction = vec3_unit(way);
    double cosine = -vec3_dot(direction, normal), profile[3];
    if (cosine > 0 && square > 0) {
        light_profile(light, direction, profile);
        for (int c = 0; c < 3; c++) {
            arrival.irradiance[c] = light->intensity[c] * profile[c] * cosine / square;
        }
    }
    return arrival;
}

struct photon light_emit(const struct light *light, struct vec3 centre, double radius_mm,
                         const double u[4])
{
    struct photon photon = {.origin = source_point(light, u[0], u[1])};
    struct vec3 axis = vec3_subtract(centre, photon.origin);
    double distance = vec3_length(axis), profile[3];
    double sine = distance > radius_mm ? radius_mm / distance : 1;
    double cos_cone = distance > radius_mm ? sqrt(1 - sine * sine) : -1;
    double cosine = 1 - u[2] * (1 - cos_cone), angle = 2 * pi * u[3];
    double aside = sqrt(fmax(1 - cosine * cosine, 0));
    axis = distance > 0 ? vec3_unit(axis) : light->forward;
    struct vec3 side = vec3_perpendicular(axis), other = vec3_cross(axis, side);
    photon.direction = vec3_along(vec3_along(vec3_scale(axis, cosine), aside * cos(angle), side),
                                  aside * sin(angle), other);
    light_profile(light, photon.direction, profile);
    for (int c = 0; c < 3; c++) {
        photon.flux[c] = light->intensity[c] * profile[c] * 2 * pi * (1 - cos_cone);
    }
    return photon;
}
