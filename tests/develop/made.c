/* A made station: exact pictures of a made material through a pinhole, a mosaic and a noisy sensor. */
#include "made.h"

#include "tests/files.h"
#include "unity.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Places across a pixel at which its view is sampled. */
enum { PLACES = 8 };

const char made_plan_text[] = "seed: 5\nblack_frames: 16\nwhite_frames: 4\ndot_spacing: 8\n"
                              "dot_shift: 3\ndot_size: 2\ngrid_spacing: 9\nwindow: 9\n"
                              "exposure_turns: [1, 4, 16, 64]\n";

double made_uniform(struct made_random *random)
{
    uint64_t z = random->state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return ((double)((z ^ z >> 31) >> 11) + 0.5) * 0x1p-53;
}

double made_normal(struct made_random *random)
{
    double radius = sqrt(-2 * log(made_uniform(random)));
    return radius * cos(6.283185307179586 * made_uniform(random));
}

double made_poisson(struct made_random *random, double mean)
{
    if (mean > 60) {
        return mean + sqrt(mean) * made_normal(random);
    }
    double count = -1;
    double product = 1;
    double limit = exp(-mean);
    do {
        product *= made_uniform(random);
        count++;
    } while (product > limit);
    return count;
}

struct made_station made_station_usual(void)
{
    /* About 4.4 pixels a point, turned by 2 degrees, the far side 6 % smaller. */
    return (struct made_station){.width = 40,
                                 .height = 36,
                                 .camera_width = 190,
                                 .camera_height = 170,
                                 .bits = 10,
                                 .bayer = BAYER_RGGB,
                                 .pedestal = 16,
                                 .read_noise = 1.2,
                                 .electrons = 15,
                                 .map = {4.45, 0.16, 6.3, -0.14, 4.38, 10.2, 0.0006, 0.0011, 1},
                                 .gain = {450000, 600000, 400000},
                                 .vignetting = 0.2,
                                 .black = 0.0005,
                                 .reach = 0.9,
                                 .white = {0.95, 0.9, 0.85},
                                 .dead_x = -1};
}

double made_transfer(const struct made_station *station, int channel, int xi, int yi, int xo,
                     int yo)
{
    static const double albedo[3] = {0.42, 0.35, 0.28};
    double reach = station->reach * (1 + 0.15 * (1 - channel));
    double dense = (xi + 2 * yi) % 13 < 5 ? 0.6 : 1;
    double dense_out = (xo + 2 * yo) % 13 < 5 ? 0.7 : 1;
    double dx = xo - xi;
    double dy = 1.2 * (yo - yi);
    double distance = sqrt(dx * dx + dy * dy);
    double across = 1 + 0.2 * tanh(0.3 * dx);
    return albedo[channel] * dense * dense_out * across * exp(-distance / reach);
}

void made_light(const struct made_station *station, const uint8_t *levels, bool white_layer,
                float *radiosity)
{
    int width = station->width;
    int height = station->height;
    int points = width * height;
    int reach = (int)ceil(10 * station->reach); /* 5e-5 of the middle is left */
    for (int i = 0; i < 3 * points; i++) {
        int channel = i / points;
        double irradiance = levels[i % points] ? 1 : station->black;
        radiosity[i] = white_layer ? (float)(station->white[channel] * irradiance) : 0;
    }
    for (int i = 0; !white_layer && i < 3 * points; i++) {
        int channel = i / points;
        int xi = i % points % width;
        int yi = i % points / width;
        double irradiance = levels[i % points] ? 1 : station->black;
        for (int yo = yi - reach; irradiance > 0 && yo <= yi + reach; yo++) {
            for (int xo = xi - reach; xo <= xi + reach; xo++) {
                if (xo >= 0 && yo >= 0 && xo < width && yo < height) {
                    radiosity[channel * points + yo * width + xo] +=
                        (float)(irradiance * made_transfer(station, channel, xi, yi, xo, yo));
                }
            }
        }
    }
}

/* From where the lens shows something to where an ideal one would: by repetition, as the lens is nearly ideal. */
static void undistort(const struct made_station *station, double *u, double *v)
{
    if (station->lens == 0) {
        return;
    }
    double middle_x = station->camera_width / 2.0 + station->lens_x;
    double middle_y = station->camera_height / 2.0 + station->lens_y;
    double across = station->camera_width;
    double down = station->camera_height;
    double bend = station->lens * 4 / (across * across + down * down);
    double x = *u - middle_x;
    double y = *v - middle_y;
    for (int round = 0; round < 12; round++) {
        double shrink = 1 / (1 + bend * (x * x + y * y));
        x = (*u - middle_x) * shrink;
        y = (*v - middle_y) * shrink;
    }
    *u = x + middle_x;
    *v = y + middle_y;
}

/* What a pixel sees: the mean radiosity of its colour over its view, 0 beside the sample. */
static double view(const struct made_station *station, const float *radiosity, int px, int py)
{
    const double *m = station->map;
    double determinant_x[3] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8],
                               m[1] * m[5] - m[2] * m[4]};
    double determinant_y[3] = {m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6],
                               m[2] * m[3] - m[0] * m[5]};
    double determinant_w[3] = {m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7],
                               m[0] * m[4] - m[1] * m[3]};
    int channel = bayer_channel(station->bayer, px, py);
    const float *plane = radiosity + (ptrdiff_t)channel * station->width * station->height;
    double sum = 0;
    for (int k = 0; k < PLACES * PLACES; k++) {
        double across = 1 + station->blur_px;
        double u = px + 0.5 + ((k % PLACES + 0.5) / PLACES - 0.5) * across;
        int row = k / PLACES;
        double v = py + 0.5 + ((row + 0.5) / PLACES - 0.5) * across;
        undistort(station, &u, &v);
        double scale = 1 / (determinant_w[0] * u + determinant_w[1] * v + determinant_w[2]);
        double x = (determinant_x[0] * u + determinant_x[1] * v + determinant_x[2]) * scale;
        double y = (determinant_y[0] * u + determinant_y[1] * v + determinant_y[2]) * scale;
        if (x >= 0 && y >= 0 && x < station->width && y < station->height) {
            sum += (double)plane[(int)y * station->width + (int)x];
        }
    }
    return sum / (PLACES * PLACES);
}

void made_signal(const struct made_station *station, const float *radiosity, double *signal)
{
    double half_x = station->camera_width / 2.0;
    double half_y = station->camera_height / 2.0;
    for (int y = 0; y < station->camera_height; y++) {
        for (int x = 0; x < station->camera_width; x++) {
            double dx = (x + 0.5 - half_x) / half_x;
            double dy = (y + 0.5 - half_y) / half_y;
            bool dead = x == station->dead_x && y == station->dead_y;
            *signal++ = dead ? 0
                             : view(station, radiosity, x, y) *
                                   station->gain[bayer_channel(station->bayer, x, y)] *
                                   (1 - station->vignetting * (dx * dx + dy * dy) / 2);
        }
    }
}

void made_expose(const struct made_station *station, const double *signal, double seconds,
                 struct made_random *random, uint16_t *raw)
{
    double top = (1 << station->bits) - 1;
    for (int i = 0; i < station->camera_width * station->camera_height; i++) {
        double value = signal[i] * seconds;
        if (station->electrons > 0) {
            value = made_poisson(random, value * station->electrons) / station->electrons;
        }
        if (station->read_noise > 0) {
            value += station->read_noise * made_normal(random);
        }
        raw[i] = (uint16_t)fmin(fmax(floor(value + station->pedestal + 0.5), 0), top);
    }
}

static void write_text(const char *folder, const char *name, const char *text)
{
    char *path = path_join(folder, name);
    text_write(path, text);
    free(path);
}

void made_write_settings(const struct made_station *station, const char *folder,
                         const char *plan_text)
{
    char text[1024];
    (void)snprintf(
        text, sizeof text,
        "sample: {width: %d, height: %d, pitch_mm: 0.5}\n"
        "camera: {driver: virtual, width: %d, height: %d, bits: %d, bayer: %s, pedestal: %g, "
        "read_noise: %g, electrons: %g}\n"
        "projector: {driver: virtual, wheel_hz: 10000}\ntrigger: {driver: virtual}\n"
        "white_reflectance: [%g, %g, %g]\n",
        station->width, station->height, station->camera_width, station->camera_height,
        station->bits, bayer_names[station->bayer], station->pedestal, station->read_noise,
        station->electrons, station->white[0], station->white[1], station->white[2]);
    write_text(folder, "station.yaml", text);
    write_text(folder, "plan.yaml", plan_text);
}

/* raw[camera_height][camera_width] of every exposure of a pattern. */
static void expose_pattern(const struct made_station *station, const struct plan *plan,
                           struct pattern_frames *frames)
{
    size_t points = (size_t)station->width * (size_t)station->height;
    struct pattern pattern = frames->pattern;
    struct made_random random = {(uint64_t)pattern.kind * 1000003u +
                                 (uint64_t)pattern.number * 7919u};
    uint8_t *levels = malloc(points);
    float *radiosity = malloc(3 * points * sizeof *radiosity);
    double *signal = malloc((size_t)frames->width * (size_t)frames->height * sizeof *signal);
    bool layer = pattern.kind == PATTERN_WHITE || pattern.kind == PATTERN_DOTS;
    struct made_station seen = *station;
    seen.blur_px += layer ? station->layer_soft_px : station->soft_px;
    plan_draw(plan, pattern, station->width, station->height, levels);
    made_light(station, levels, layer, radiosity);
    made_signal(&seen, radiosity, signal);
    for (size_t e = 0; e < frames->count; e++) {
        made_expose(station, signal, (double)frames->exposures[e].exposure_ns * 1e-9, &random,
                    frames->exposures[e].raw);
    }
    free(levels);
    free(radiosity);
    free(signal);
}

static void measure(const struct made_station *station, const struct session *session,
                    struct pattern pattern, int fill)
{
    size_t pixels = (size_t)station->camera_width * (size_t)station->camera_height;
    struct nacre_error error = {""};
    struct exposure exposures[16] = {0};
    struct pattern_frames frames = {pattern,
                                    station->camera_width,
                                    station->camera_height,
                                    station->bits,
                                    station->bayer,
                                    session->plan.seed,
                                    session->plan.exposure_count,
                                    exposures,
                                    NULL};
    for (size_t e = 0; e < frames.count; e++) {
        exposures[e].exposure_ns = session_exposure_ns(session, e);
        exposures[e].raw = malloc(pixels * sizeof *exposures[e].raw);
        for (size_t i = 0; i < pixels; i++) {
            exposures[e].raw[i] = (uint16_t)fill;
        }
    }
    if (fill < 0) {
        expose_pattern(station, &session->plan, &frames);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_write(session, &frames, &error), error.text);
    for (size_t e = 0; e < frames.count; e++) {
        free(exposures[e].raw);
    }
}

void made_measure(const struct made_station *station, const char *path, struct pattern pattern,
                  int fill)
{
    struct session session;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, session_open(path, &session, &error), error.text);
    measure(station, &session, pattern, fill);
    session_finish(&session);
}

char *made_session(const struct made_station *station, const char *folder, const char *plan_text)
{
    char *station_path = path_join(folder, "station.yaml");
    char *plan_path = path_join(folder, "plan.yaml");
    char *path = path_join(folder, "session");
    struct session session;
    struct nacre_error error = {""};
    made_write_settings(station, folder, plan_text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(path, station_path, plan_path, false, &session, &error),
        error.text);
    for (int kind = 0; kind < PATTERN_KINDS; kind++) {
        for (int n = 0; n < plan_pattern_count(&session.plan, (enum pattern_kind)kind); n++) {
            measure(station, &session, (struct pattern){(enum pattern_kind)kind, n}, -1);
        }
    }
    session_finish(&session);
    free(station_path);
    free(plan_path);
    return path;
}
