/* Pinhole camera, vignetting and the projector's fall-off. */
#include "rig/virtual/optics.h"

#include <math.h>
#include <stdlib.h>

/* A pixel's footprint is the surface under SAMPLES x SAMPLES places in it. */
enum { SAMPLES = 8 };

static double radians(double degrees)
{
    return degrees * (3.14159265358979323846 / 180);
}

void optics_homography(const struct station *station, double h[3][3])
{
    const struct virtual_camera_settings *camera = &station->simulated.camera;
    double pitch = station->sample.pitch_mm;
    double sine = sin(radians(camera->elevation_deg));
    double cosine = cos(radians(camera->elevation_deg));
    double roll_sine = sin(radians(camera->roll_deg));
    double roll_cosine = cos(radians(camera->roll_deg));
    double focal = camera->pixels_per_point * camera->distance_mm / pitch; /* raw pixels */
    /* Surface point to mm from the sample's centre, y down. */
    double x_mm[3] = {pitch, 0, -pitch * station->sample.width / 2};
    double y_mm[3] = {0, pitch, -pitch * station->sample.height / 2};
    for (int k = 0; k < 3; k++) {
        /* The camera stands above the projector (towards negative y): what is lower is farther. */
        double depth = (k == 2 ? camera->distance_mm : 0) + sine * y_mm[k];
        double right = focal * x_mm[k];
        double down = focal * cosine * y_mm[k];
        h[0][k] = roll_cosine * right + roll_sine * down + depth * station->camera.width / 2;
        h[1][k] = -roll_sine * right + roll_cosine * down + depth * station->camera.height / 2;
        h[2][k] = depth;
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
static double falloff(double loss, double x, double y, int width, int height)
{
    double dx = x - 0.5 * width;
    double dy = y - 0.5 * height;
    return 1 - loss * 4 * (dx * dx + dy * dy) / ((double)width * width + (double)height * height);
}

/* One pixel's row of the matrix: which points lie under it, and under how many of its places. */
struct footprint {
    size_t count;
    uint32_t points[SAMPLES * SAMPLES];
    int places[SAMPLES * SAMPLES];
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

static void find_footprint(const struct station_sample *sample, double inverse[3][3], int px,
                           int py, struct footprint *footprint)
{
    footprint->count = 0;
    for (int i = 0; i < SAMPLES * SAMPLES; i++) {
        double u = px + ((i % SAMPLES) + 0.5) / SAMPLES;
        double v =
            py + ((i / SAMPLES) + 0.5) / SAMPLES; // NOLINT(bugprone-integer-division): the row
        double w = inverse[2][0] * u + inverse[2][1] * v + inverse[2][2];
        double x = (inverse[0][0] * u + inverse[0][1] * v + inverse[0][2]) / w;
        double y = (inverse[1][0] * u + inverse[1][1] * v + inverse[1][2]) / w;
        if (x >= 0 && y >= 0 && x < sample->width && y < sample->height) {
            add_place(footprint, (uint32_t)y * (uint32_t)sample->width + (uint32_t)x);
        }
    }
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

int optics_init(const struct station *station, struct optics *optics, struct nacre_error *error)
{
    const struct virtual_camera_settings *lens = &station->simulated.camera;
    const struct station_camera *camera = &station->camera;
    uint32_t plane = (uint32_t)station->sample.width * (uint32_t)station->sample.height;
    double full_scale = ((1 << camera->bits) - 1) - camera->pedestal;
    double h[3][3], inverse[3][3];
    struct footprint footprint;
    size_t used = 0;
    size_t capacity = 0;
    int status = NACRE_OK;
    *optics = (struct optics){.pixel_count = (size_t)camera->width * (size_t)camera->height};
    optics->starts = calloc(optics->pixel_count + 1, sizeof *optics->starts);
    if (!optics->starts || reserve(optics, 2 * optics->pixel_count, &capacity) != NACRE_OK) {
        status = nacre_fail_memory(error, "the virtual camera");
        goto out;
    }
    optics_homography(station, h);
    invert(h, inverse);
    for (size_t i = 0; i < optics->pixel_count; i++) {
        int px = (int)(i % (size_t)camera->width);
        int py = (int)(i / (size_t)camera->width);
        int channel = bayer_channel((enum bayer)camera->bayer, px, py);
        double gain = full_scale / lens->full_scale_s * lens->response[channel] *
                      falloff(lens->vignetting, px + 0.5, py + 0.5, camera->width, camera->height);
        find_footprint(&station->sample, inverse, px, py, &footprint);
        if (reserve(optics, used + footprint.count, &capacity) != NACRE_OK) {
            status = nacre_fail_memory(error, "the virtual camera");
            goto out;
        }
        for (size_t k = 0; k < footprint.count; k++) {
            optics->points[used] = (uint32_t)channel * plane + footprint.points[k];
            optics->weights[used++] = (float)(gain * footprint.places[k] / (SAMPLES * SAMPLES));
        }
        optics->starts[i + 1] = used;
    }
out:
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

void optics_project(const struct station *station, const uint8_t *levels, float *irradiance)
{
    const struct virtual_projector_settings *projector = &station->simulated.projector;
    int width = station->sample.width;
    int height = station->sample.height;
    size_t plane = (size_t)width * (size_t)height;
    double black = projector->contrast > 1 ? 1 / projector->contrast : 0;
    for (size_t i = 0; i < plane; i++) {
        size_t column = i % (size_t)width;
        size_t row = i / (size_t)width;
        double light =
            falloff(projector->vignetting, (double)column + 0.5, (double)row + 0.5, width, height) *
            (black + (1 - black) * levels[i] / 255);
        irradiance[i] = irradiance[plane + i] = irradiance[2 * plane + i] = (float)light;
    }
}
