/* Area, point, spot and projecting lights, and the environment. */
#include "render/lights.h"

#include "nacre/error.h"
#include "render/light_picture.h"

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
        return light_picture_read(texture->image, slide, error);
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

/* The slide's colour at (s, t) in 0..1 from the lower left corner, bilinear between pixel centres; black outside. */
static void slide_colour(const struct picture *slide, double s, double t, double colour[3])
{
    double x = s * slide->width - 0.5, y = (1 - t) * slide->height - 0.5;
    colour[0] = colour[1] = colour[2] = 0;
    if (!(s >= 0 && s <= 1 && t >= 0 && t <= 1)) {
        return;
    }
    if (!slide->rgb) {
        colour[0] = colour[1] = colour[2] = 1;
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

/* Share of its intensity that a spot has in a direction whose cosine to `forward` is `along`. */
static double spot_level(const struct light *light, double along)
{
    double t = (along - light->cos_edge) / fmax(light->cos_full - light->cos_edge, 1e-12);
    t = fmin(fmax(t, 0), 1);
    return t * t * (3 - 2 * t);
}

static void projected_colour(const struct light *light, struct vec3 direction, double colour[3])
{
    double along = vec3_dot(direction, light->forward);
    colour[0] = colour[1] = colour[2] = 0;
    if (along > 0) {
        double s = vec3_dot(direction, light->right) / along / light->tan_x;
        double t = vec3_dot(direction, light->up) / along / light->tan_y;
        slide_colour(&light->slide, (s + 1) / 2, (t + 1) / 2, colour);
    }
}

static struct vec3 area_point(const struct light *light, double u, double v)
{
    return vec3_along(vec3_along(light->position, (u - 0.5) * light->width_mm, light->right),
                      (v - 0.5) * light->height_mm, light->up);
}

/* Irradiance over intensity along the way (unit `direction`) from a point; 0 from behind. */
static double fall_off(struct vec3 from, struct vec3 point, struct vec3 normal,
                       struct vec3 *direction)
{
    struct vec3 way = vec3_subtract(point, from);
    double square = vec3_dot(way, way);
    *direction = vec3_unit(way);
    double cosine = -vec3_dot(*direction, normal);
    return cosine > 0 && square > 0 ? cosine / square : 0;
}

static struct light_arrival arrival_of(const struct light *light, struct vec3 from, double factor)
{
    return (struct light_arrival){
        from,
        {light->intensity[0] * factor, light->intensity[1] * factor, light->intensity[2] * factor}};
}

static struct light_arrival arrive_from_area(const struct light *light, struct vec3 point,
                                             struct vec3 normal, const double u[2])
{
    struct vec3 from = area_point(light, u[0], u[1]), direction;
    double factor = fall_off(from, point, normal, &direction);
    /* Lambert's law. */
    return arrival_of(light, from, factor * fmax(vec3_dot(direction, light->forward), 0));
}

static struct light_arrival arrive_from_point(const struct light *light, struct vec3 point,
                                              struct vec3 normal, const double u[2])
{
    struct vec3 direction;
    (void)u;
    return arrival_of(light, light->position, fall_off(light->position, point, normal, &direction));
}

static struct light_arrival arrive_from_spot(const struct light *light, struct vec3 point,
                                             struct vec3 normal, const double u[2])
{
    struct vec3 direction;
    (void)u;
    double factor = fall_off(light->position, point, normal, &direction);
    return arrival_of(light, light->position,
                      factor * spot_level(light, vec3_dot(direction, light->forward)));
}

static struct light_arrival arrive_from_projector(const struct light *light, struct vec3 point,
                                                  struct vec3 normal, const double u[2])
{
    struct vec3 direction;
    double colour[3];
    (void)u;
    double factor = fall_off(light->position, point, normal, &direction);
    struct light_arrival arrival = arrival_of(light, light->position, factor);
    if (factor > 0) {
        projected_colour(light, direction, colour);
        for (int c = 0; c < 3; c++) {
            arrival.irradiance[c] *= colour[c];
        }
    }
    return arrival;
}

/* Half of the directions are drawn by the surface's cosine and half by the picture, and each is weighed by the density
 * of both: neither a small sun nor an even sky makes them scatter. */
static struct light_arrival arrive_from_environment(const struct light *light, struct vec3 point,
                                                    struct vec3 normal, const double u[2])
{
    const struct environment *environment = &light->environment;
    double by_cosine = environment->picture.rgb ? 0.5 : 1;
    double rest[2] = {u[0] / by_cosine, u[1]}, value[3];
    struct vec3 direction;
    if (u[0] < by_cosine) {
        direction = vec3_by_cosine(normal, rest);
    } else {
        rest[0] = (u[0] - by_cosine) / (1 - by_cosine);
        direction = environment_draw(environment, rest);
    }
    double cosine = vec3_dot(direction, normal);
    double away = vec3_length(vec3_subtract(point, environment->centre));
    struct light_arrival arrival = {
        .from = vec3_along(point, 1.01 * (away + environment->radius_mm), direction)};
    if (!(cosine > 0)) {
        return arrival;
    }
    /* Over pi, as values are pi times radiance. */
    double density = by_cosine * cosine;
    if (by_cosine < 1) {
        density += (1 - by_cosine) * pi * environment_density(environment, direction);
    }
    environment_value(environment, direction, value);
    for (int c = 0; c < 3; c++) {
        arrival.irradiance[c] = value[c] * (cosine / density);
    }
    return arrival;
}

/* Turn the light towards its aim. Returns the distance. */
static double aim(struct light *light, const struct scene_light *settings)
{
    struct vec3 axis = vec3_subtract(vec3_from_doubles(settings->at_mm), light->position);
    light->forward = vec3_unit(axis);
    struct vec3 right = vec3_cross(light->forward, vec3_from_doubles(settings->up));
    /* A light that looks along its `up` has no other up to be told from. */
    light->right =
        vec3_length(right) > 1e-6 ? vec3_unit(right) : vec3_perpendicular(light->forward);
    light->up = vec3_cross(light->right, light->forward);
    return vec3_length(axis);
}

int light_make(struct light *light, const struct scene_light *settings, struct nacre_error *error)
{
    *light = (struct light){.kind = settings->kind,
                            .soft = settings->kind == LIGHT_AREA,
                            .position = vec3_from_doubles(settings->position_mm),
                            .width_mm = settings->size_mm[0],
                            .height_mm = settings->size_mm[1]};
    light->distance_mm = aim(light, settings);
    double factor = 1 / (light->distance_mm * light->distance_mm);
    double half = settings->angle_deg / 2 * pi / 180;
    switch (light->kind) {
    case LIGHT_AREA:
        light->arrive = arrive_from_area;
        factor = area_factor(light->width_mm, light->height_mm, light->distance_mm);
        break;
    case LIGHT_SPOT:
        light->arrive = arrive_from_spot;
        light->cos_edge = cos(half);
        light->cos_full = cos(fmax(half - settings->soft_deg * pi / 180, 0));
        break;
    case LIGHT_PROJECTOR:
        light->arrive = arrive_from_projector;
        light->lookup = LOOKUP_SLIDE;
        if (slide_make(&settings->texture, &light->slide, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        light->tan_x = tan(half);
        light->tan_y = light->tan_x * light->slide.height / light->slide.width;
        break;
    default:
        light->arrive = arrive_from_point;
        break;
    }
    for (int c = 0; c < 3; c++) {
        light->intensity[c] = settings->irradiance[c] / factor;
    }
    return NACRE_OK;
}

int light_make_environment(struct light *light, const struct scene_environment *settings,
                           struct nacre_error *error)
{
    *light = (struct light){.kind = LIGHT_ENVIRONMENT,
                            .lookup = LOOKUP_SKY,
                            .soft = true,
                            .arrive = arrive_from_environment};
    return environment_make(&light->environment, settings, error);
}

void light_surround(struct light *light, struct vec3 centre, double radius_mm)
{
    light->environment.centre = centre;
    light->environment.radius_mm = radius_mm;
}

void light_finish(struct light *light)
{
    picture_finish(&light->slide);
    environment_finish(&light->environment);
    *light = (struct light){0};
}

static void emitted_profile(const struct light *light, struct vec3 direction, double profile[3])
{
    double along = vec3_dot(direction, light->forward), level = 1;
    if (light->kind == LIGHT_PROJECTOR) {
        projected_colour(light, direction, profile);
        return;
    }
    if (light->kind == LIGHT_AREA) {
        level = fmax(along, 0);
    } else if (light->kind == LIGHT_SPOT) {
        level = spot_level(light, along);
    }
    profile[0] = profile[1] = profile[2] = level;
}

/* A photon of the environment: through a disc that hides the sphere, from beyond the scene. */
static struct photon emit_environment(const struct light *light, struct vec3 centre,
                                      double radius_mm, const double u[4])
{
    const struct environment *environment = &light->environment;
    struct vec3 from = environment_draw(environment, u);
    double density = environment_density(environment, from), value[3];
    struct vec3 side = vec3_perpendicular(from), other = vec3_cross(from, side);
    double r = radius_mm * sqrt(u[2]), angle = 2 * pi * u[3];
    double away = vec3_length(vec3_subtract(centre, environment->centre));
    struct vec3 middle =
        vec3_along(centre, 1.01 * (away + environment->radius_mm + radius_mm), from);
    struct photon photon = {
        .origin = vec3_along(vec3_along(middle, r * cos(angle), side), r * sin(angle), other),
        .direction = vec3_scale(from, -1)};
    environment_value(environment, from, value);
    for (int c = 0; c < 3; c++) {
        photon.flux[c] = value[c] * radius_mm * radius_mm / density;
    }
    return photon;
}

struct photon light_emit(const struct light *light, struct vec3 centre, double radius_mm,
                         const double u[4])
{
    if (light->kind == LIGHT_ENVIRONMENT) {
        return emit_environment(light, centre, radius_mm, u);
    }
    struct photon photon = {.origin = light->kind == LIGHT_AREA ? area_point(light, u[0], u[1])
                                                                : light->position};
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
    emitted_profile(light, photon.direction, profile);
    for (int c = 0; c < 3; c++) {
        photon.flux[c] = light->intensity[c] * profile[c] * 2 * pi * (1 - cos_cone);
    }
    return photon;
}
