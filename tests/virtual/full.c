/* A small station with every effect. */
#include "full.h"

#include "tests/nacre/scratch.h"
#include "unity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char full_station[] =
    "sample: {width: 16, height: 12, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 80, height: 60, bits: 12, bayer: RGGB, pedestal: 64,\n"
    "         read_noise: 4, electrons: 1}\n"
    "projector: {driver: virtual, wheel_hz: 30}\n"
    "trigger: {driver: virtual}\n"
    "virtual:\n"
    "  sample: sample.yaml\n"
    "  seed: 3\n"
    "  tilt_deg: [2, -1.5]\n"
    "  projector:\n"
    "    contrast: 500\n"
    "    vignetting: 0.2\n"
    "    latency_ms: 16\n"
    "    defocus_points: 1\n"
    "    shift_points: [0.25, -0.15]\n"
    "    wheel:\n"
    "      segments:\n"
    "        - {color: [1, 0, 0], angle_deg: 120}\n"
    "        - {color: [0, 1, 0], angle_deg: 120}\n"
    "        - {color: [0, 0, 1], angle_deg: 120}\n"
    "    lamp: {drift_hours: 0.5, flicker_hz: 100, drift: 0.02, flicker: 0.01}\n"
    "  camera:\n"
    "    elevation_deg: 20\n"
    "    pixels_per_point: 4.6\n"
    "    distance_mm: 200\n"
    "    vignetting: 0.15\n"
    "    readout_ms: 15\n"
    "    distortion: [-0.02, 0.002]\n"
    "    defocus_px: 2\n"
    "    dark_per_s: 200\n"
    "    nonuniformity: 0.02\n"
    "    hot_pixels: 0.005\n"
    "    hot_per_s: 20000\n"
    "    dead_pixels: 0.005\n";

const char full_sample[] =
    "width: 16\nheight: 12\npitch_mm: 0.5\nthickness_mm: 4\nmargin_points: 4\nbase: pale\n"
    "materials:\n"
    "  - {name: pale, scattering_per_mm: [2.6, 2.5, 2.4], absorption_per_mm: [0.2, 0.3, 0.5],\n"
    "     index: 1.3}\n"
    "surface: {roughness: 0.25}\n"
    "dust: {per_cm2: 20, size_mm: 0.3, seed: 2}\n";

/* Half of what each is expected to change, by the file's numbers. Of 48 mm^2, 10 specks of 0.07 mm^2 cover 1.5 %. The dark
 * half of the points gets 1/500 of the lit ones' light. A field's mean of r^2, 1 in its corners, is 1/3. A normal variate
 * is 0.8 of its deviation on average; the lamp's flicker is a mean of 5 values, its drift one, which with a chance of
 * 0.9 is above 1/8 of the deviation. A quarter of a point crosses one of two edges of each square, less as light spreads
 * in the sample. Half of the wheel's turn passes red, then half of green: [4/3, 1, 2/3]. The frame's mean is some 300. */
const struct full_piece full_pieces[] = {
    {EFFECT_WHEEL,
     "    wheel:\n"
     "      segments:\n"
     "        - {color: [1, 0, 0], angle_deg: 120}\n"
     "        - {color: [0, 1, 0], angle_deg: 120}\n"
     "        - {color: [0, 0, 1], angle_deg: 120}\n",
     false, 0.08},
    {EFFECT_BLACK_LEVEL, "    contrast: 500\n", false, 0.001},
    {EFFECT_PROJECTOR_VIGNETTING, "    vignetting: 0.2\n", false, 0.03},
    {EFFECT_LAMP_DRIFT, ", drift: 0.02", false, 0.0025},
    {EFFECT_LAMP_FLICKER, ", flicker: 0.01", false, 0.0005},
    {EFFECT_MISALIGNMENT, "    shift_points: [0.25, -0.15]\n", false, 0.01},
    {EFFECT_PROJECTOR_DEFOCUS, "    defocus_points: 1\n", false, 0.01},
    {EFFECT_LOCAL, "surface: {roughness: 0.25}\n", true, 0.03},
    {EFFECT_DUST, "dust: {per_cm2: 20, size_mm: 0.3, seed: 2}\n", true, 0.01},
    {EFFECT_TILT, "  tilt_deg: [2, -1.5]\n", false, 0.002},
    {EFFECT_DISTORTION, "    distortion: [-0.02, 0.002]\n", false, 0.005},
    {EFFECT_CAMERA_DEFOCUS, "    defocus_px: 2\n", false, 0.005},
    {EFFECT_CAMERA_VIGNETTING, "    vignetting: 0.15\n", false, 0.025},
    {EFFECT_NONUNIFORMITY, "    nonuniformity: 0.02\n", false, 0.008},
    {EFFECT_DEAD_PIXELS, "    dead_pixels: 0.005\n", false, 0.0025},
    {EFFECT_DARK_CURRENT, "    dark_per_s: 200\n", false, 0.015},
    {EFFECT_HOT_PIXELS, "    hot_pixels: 0.005\n", false, 0.008},
    {EFFECT_SHOT_NOISE, ", electrons: 1", false, 0.02},
    {EFFECT_READ_NOISE, "\n         read_noise: 4,", false, 0.0006},
};
const int full_piece_count = sizeof full_pieces / sizeof *full_pieces;

char *full_take_out(const char *text, const char *piece)
{
    char *left = NULL;
    const char *place = strstr(text, piece);
    TEST_ASSERT_NOT_NULL_MESSAGE(place, piece);
    TEST_ASSERT_TRUE(asprintf(&left, "%.*s%s", (int)(place - text), text, place + strlen(piece)) >=
                     0);
    return left;
}

struct virtual_station *full_make(const char *station_text, const char *sample_text)
{
    struct nacre_error error;
    struct station settings;
    struct virtual_station *station = NULL;
    (void)scratch_text("sample.yaml", sample_text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, station_read(scratch_text("station.yaml", station_text), &settings, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, virtual_station_new(&settings, &station, &error),
                                  error.text);
    station_finish(&settings); /* the station keeps what it needs */
    return station;
}

void full_frame(struct virtual_station *station, uint16_t *raw)
{
    struct projector *projector = virtual_station_projector(station);
    struct camera *camera = virtual_station_camera(station);
    struct trigger *trigger = virtual_station_trigger(station);
    struct nacre_error error;
    struct camera_frame frame;
    uint8_t levels[FULL_COLUMNS * FULL_ROWS];
    int64_t time_ns;
    for (int i = 0; i < FULL_COLUMNS * FULL_ROWS; i++) {
        int square = i % FULL_COLUMNS / 2 + i / FULL_COLUMNS / 2;
        levels[i] = square % 2 ? 255 : 0;
    }
    virtual_station_begin_pattern(station, (struct pattern){PATTERN_GRID, 0});
    TEST_ASSERT_EQUAL_INT(NACRE_OK, projector->ops->show(projector, levels, &time_ns, &error));
    /* The wheel's first segment begins with a turn; with the latency or without, so does the exposure. */
    clock_sleep_until_ns(virtual_station_clock(station), 1000000000);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, camera->ops->arm(camera, 50000000, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, trigger->ops->fire(trigger, 50000000, &time_ns, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, camera->ops->take(camera, 1000000000, &frame, &error),
                                  error.text);
    memcpy(raw, frame.raw, FULL_PIXELS * sizeof *raw);
}
