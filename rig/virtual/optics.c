/* Pinhole camera and lens: the footprint of each pixel on the surface, and how sensitive the pixel is. */
#include "rig/virtual/optics.h"

#include "rig/virtual/lens.h"
#include "rig/virtual/pixels.h"

#include <math.h>
#include <stdlib.h>

static double radians(double degrees)
{
    return degrees * (3.14159265358979323846 / 180);
}

/* How the stage falls, in mm for each mm in x and in y. */
static void find_slopes(const struct station *station, const struct effects *effects,
                        double slopes[2])
{
    bool tilted = effects_has(effects, EFFECT_TILT);
    slopes[0] = tilted ? tan(radians(station->simulated.tilt_deg[1])) : 0;
    slopes[1] = tilted ? tan(radians(station->simulated.tilt_deg[0])) : 0;
}

/* Where the stage's middle is among the points; the projector may be out of its place. */
static void find_middle(const struct station *station, const struct effects *effects,
                        double middle[2])
{
    const double *shift = station->simulated.projector.shift_points;
    bool moved = effects_has(effects, EFFECT_MISALIGNMENT);
    middle[0] = 0.5 * station->sample.width - (moved ? shift[0] : 0);
    middle[1] = 0.5 * station->sample.height - (moved ? shift[1] : 0);
}

void optics_homography(const struct station *station, const struct effects *effects, double h[3][3])
{
    const struct virtual_camera_settings *camera = &station->simulated.camera;
    double slopes[2];
    double middle[2];
    double pitch = station->sample.pitch_mm;
    double sine = sin(radians(camera->elevation_deg));
    double cosine = cos(radians(camera->elevation_deg));
    double roll_sine = sin(radians(camera->roll_deg));
    double roll_cosine = cos(radians(camera->roll_deg));
    double focal = camera->pixels_per_point * camera->distance_mm / pitch; /* raw pixels */
    find_middle(station, effects, middle);
    /* Surface point to mm from the stage's middle, y down. */
    double x_mm[3] = {pitch, 0, -pitch * middle[0]};
    double y_mm[3] = {0, pitch, -pitch * middle[1]};
    find_slopes(station, effects, slopes);
    for (int k = 0; k < 3; k++) {
        /* The camera stands above the projector (towards negative y): what is lower is farther. */
        double fall = slopes[0] * x_mm[k] + slopes[1] * y_mm[k];
        double depth = (k == 2 ? camera->distance_mm : 0) + sine * y_mm[k] + cosine * fall;
        double right = focal * x_mm[k];
        double down = focal * cosine * y_mm[k] - focal * sine * fall;
        h[0][k] = roll_cosine * right + roll_sine * down + depth * station->camera.width / 2;
        h[1][k] = -roll_sine * right + roll_cosine * down + depth * station->camera.height / 2;
        h[2][k] = depth;
    }
}

static void scale_to_one(double vector[3])
{
    double length = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    for (int k = 0; k < 3; k++) {
        vector[k] /= length;
    }
}

void optics_directions(const struct station *station, const struct effects *effects, double x,
                       double y, double to_light[3], double to_camera[3])
{
    const struct virtual_camera_settings *camera = &station->simulated.camera;
    double pitch = station->sample.pitch_mm;
    double angle = radians(camera->elevation_deg);
    double slopes[2];
    double middle[2];
    find_middle(station, effects, middle);
    double x_mm = pitch * (x - middle[0]);
    double y_mm = pitch * (y - middle[1]);
    find_slopes(station, effects, slopes);
    double away[3] = {-x_mm, -camera->distance_mm * sin(angle) - y_mm,
                      camera->distance_mm * cos(angle) + slopes[0] * x_mm + slopes[1] * y_mm};
    double normal[3] = {slopes[0], slopes[1], 1};
    double along[3] = {1, 0, -slopes[0]};
    scale_to_one(away);
    scale_to_one(normal);
    scale_to_one(along);
    double across[3] = {normal[1] * along[2] - normal[2] * along[1],
                        normal[2] * along[0] - normal[0] * along[2],
                        normal[0] * along[1] - normal[1] * along[0]};
    const double *const axes[3] = {along, across, normal};
    for (int k = 0; k < 3; k++) {
        to_light[k] = axes[k][2];
        to_camera[k] = axes[k][0] * away[0] + axes[k][1] * away[1] + axes[k][2] * away[2];
    }
}

static void invert(double a[3][3], double inverse[3][3])
{
    double determinant = 0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            int r = (j + 1) % 3, s = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[i][j] = a[r][c] * a[s][d] - a[r][d] * a[s][c];
        }
    }
    for (int i = 0; i < 3; i++) {
        determinant += a[0][i] * inverse[i][0];
    }
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            inverse[i][j] /= determinant;
        }
    }
}

/* What is left of the light at a place of a width x height field that loses `loss` in its corners. */
double optics_falloff(double loss, double x, double y, int width, int height)
{
    double dx = x - 0.5 * width;
    double dy = y - 0.5 * height;
    return 1 - loss * 4 * (dx * dx + dy * dy) / ((double)width * width + (double)height * height);
}

/* One pixel's row of the matrix: which points lie under it, and under how many of its places. */
struct footprint {
    size_t count;
    uint32_t points[LENS_DEFOCUSED];
    int places[LENS_DEFOCUSED];
};

/* What all pixels' footprints are found by. */
struct view {
    const struct station *station;
    double inverse[3][3]; /* from pixels without distortion to surface points */
    struct lens_places places;
};

static void add_place(struct footprint *footprint, uint32_t point)
{
    for (size_t i = footprint->count; i > 0; i--) {
        if (footprint->points[i - 1] == point) {
            footprint->places[i - 1]++;
            return;
        }
    }
    footprint->points[footprint->count] = point;
    footprint->places[footprint->count] = 1;
    footprint->count++;
}

/* `distorted` is a constant where it is used. */
static inline __attribute__((always_inline)) void
find_footprint(const struct view *view, int px, int py, bool distorted, struct footprint *footprint)
{
    const struct station *station = view->station;
    const struct station_sample *sample = &station->sample;
    const double(*inverse)[3] = view->inverse;
    footprint->count = 0;
    for (int i = 0; i < view->places.count; i++) {
        double u = px + view->places.u[i];
        double v = py + view->places.v[i];
        if (distorted) {
            lens_straighten(station->simulated.camera.distortion, station->camera.width,
                            station->camera.height, &u, &v);
        }
        double w = inverse[2][0] * u + inverse[2][1] * v + inverse[2][2];
        double x = (inverse[0][0] * u + inverse[0][1] * v + inverse[0][2]) / w;
        double y = (inverse[1][0] * u + inverse[1][1] * v + inverse[1][2]) / w;
        if (x >= 0 && y >= 0 && x < sample->width && y < sample->height) {
            add_place(footprint, (uint32_t)y * (uint32_t)sample->width + (uint32_t)x);
        }
    }
}

static void find_through_pinhole(const struct view *view, int px, int py,
                                 struct footprint *footprint)
{
    find_footprint(view, px, py, false, footprint);
}

static void find_through_lens(const struct view *view, int px, int py, struct footprint *footprint)
{
    find_footprint(view, px, py, true, footprint);
}

static int reserve(struct optics *optics, size_t wanted, size_t *capacity)
{
    if (wanted > *capacity) {
        size_t larger = wanted * 2;
        uint32_t *points = realloc(optics->points, larger * sizeof *points);
        optics->points = points ? points : optics->points;
        float *weights = realloc(optics->weights, larger * sizeof *weights);
        optics->weights = weights ? weights : optics->weights;
        if (!points || !weights) {
            return NACRE_FAILED;
        }
        *capacity = larger;
    }
    return NACRE_OK;
}

/* Raw units a second that each pixel gathers of white: gains[pixel]. */
static void find_gains(const struct station *station, struct effects *effects, double *gains)
{
    const struct virtual_camera_settings *lens = &station->simulated.camera;
    const struct station_camera *camera = &station->camera;
    size_t count = (size_t)camera->width * (size_t)camera->height;
    double full_scale = ((1 << camera->bits) - 1) - camera->pedestal;
    for (size_t i = 0; i < count; i++) {
        int px = (int)(i % (size_t)camera->width);
        int py = (int)(i / (size_t)camera->width);
        int channel = bayer_channel((enum bayer)camera->bayer, px, py);
        gains[i] = full_scale / lens->full_scale_s * lens->response[channel];
    }
    if (effects_has(effects, EFFECT_CAMERA_VIGNETTING)) {
        effects->work[EFFECT_CAMERA_VIGNETTING] += count;
        for (size_t i = 0; i < count; i++) {
            size_t column = i % (size_t)camera->width;
            size_t row = i / (size_t)camera->width;
            gains[i] *= optics_falloff(lens->vignetting, (double)column + 0.5, (double)row + 0.5,
                                       camera->width, camera->height);
        }
    }
    if (effects_has(effects, EFFECT_TILT)) {
        double slopes[2];
        effects->work[EFFECT_TILT] += count;
        find_slopes(station, effects, slopes);
        double facing = 1 / sqrt(1 + slopes[0] * slopes[0] + slopes[1] * slopes[1]);
        for (size_t i = 0; i < count; i++) {
            gains[i] *= facing;
        }
    }
    if (effects_has(effects, EFFECT_NONUNIFORMITY)) {
        effects->work[EFFECT_NONUNIFORMITY] += count;
        for (size_t i = 0; i < count; i++) {
            gains[i] *= pixels_sensitivity(&station->simulated, i);
        }
    }
    if (effects_has(effects, EFFECT_DEAD_PIXELS)) {
        for (size_t i = 0; i < count; i++) {
            bool dead = pixels_is_dead(&station->simulated, i);
            effects->work[EFFECT_DEAD_PIXELS] += dead;
            gains[i] = dead ? 0 : gains[i];
        }
    }
}

/* How pixels find their points, as the lens wants it. */
static void prepare_view(const struct station *station, struct effects *effects, struct view *view)
{
    double h[3][3];
    view->station = station;
    effects->work[EFFECT_MISALIGNMENT] += effects_has(effects, EFFECT_MISALIGNMENT);
    optics_homography(station, effects, h);
    invert(h, view->inverse);
    if (effects_has(effects, EFFECT_CAMERA_DEFOCUS)) {
        lens_places_defocused(station->simulated.camera.defocus_px, &view->places);
    } else {
        lens_places_sharp(&view->places);
    }
}

static int fill_matrix(const struct view *view, struct effects *effects, const double *gains,
                       struct optics *optics, struct nacre_error *error)
{
    void (*const find)(const struct view *, int, int, struct footprint *) =
        effects_has(effects, EFFECT_DISTORTION) ? find_through_lens : find_through_pinhole;
    const struct station_camera *camera = &view->station->camera;
    const struct station_sample *sample = &view->station->sample;
    uint32_t plane = (uint32_t)sample->width * (uint32_t)sample->height;
    struct footprint footprint;
    size_t used = 0;
    size_t capacity = 0;
    for (size_t i = 0; i < optics->pixel_count; i++) {
        int px = (int)(i % (size_t)camera->width);
        int py = (int)(i / (size_t)camera->width);
        int channel = bayer_channel((enum bayer)camera->bayer, px, py);
        find(view, px, py, &footprint);
        if (reserve(optics, used + footprint.count, &capacity) != NACRE_OK) {
            return nacre_fail_memory(error, "the virtual camera");
        }
        for (size_t k = 0; k < footprint.count; k++) {
            optics->points[used] = (uint32_t)channel * plane + footprint.points[k];
            optics->weights[used++] = (float)(gains[i] * footprint.places[k] / view->places.count);
        }
        optics->starts[i + 1] = used;
    }
    effects->work[EFFECT_DISTORTION] +=
        effects_has(effects, EFFECT_DISTORTION) ? optics->pixel_count : 0;
    effects->work[EFFECT_CAMERA_DEFOCUS] +=
        effects_has(effects, EFFECT_CAMERA_DEFOCUS) ? optics->pixel_count : 0;
    return NACRE_OK;
}

int optics_init(const struct station *station, struct effects *effects, struct optics *optics,
                struct nacre_error *error)
{
    const struct station_camera *camera = &station->camera;
    struct view view;
    int status = NACRE_OK;
    *optics = (struct optics){.pixel_count = (size_t)camera->width * (size_t)camera->height};
    double *gains = calloc(optics->pixel_count, sizeof *gains);
    optics->starts = calloc(optics->pixel_count + 1, sizeof *optics->starts);
    if (!gains || !optics->starts) {
        status = nacre_fail_memory(error, "the virtual camera");
        goto out;
    }
    find_gains(station, effects, gains);
    prepare_view(station, effects, &view);
    status = fill_matrix(&view, effects, gains, optics, error);
out:
    free(gains);
    if (status != NACRE_OK) {
        optics_finish(optics);
    }
    return status;
}

void optics_finish(struct optics *optics)
{
    free(optics->starts);
    free(optics->points);
    free(optics->weights);
    *optics = (struct optics){0};
}

void optics_apply(const struct optics *optics, const float *radiosity, float *signal)
{
    for (size_t i = 0; i < optics->pixel_count; i++) {
        float sum = 0;
        for (size_t k = optics->starts[i]; k < optics->starts[i + 1]; k++) {
            sum += optics->weights[k] * radiosity[optics->points[k]];
        }
        signal[i] = sum;
    }
}
