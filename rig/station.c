/* Reading station files. */
#include "rig/station.h"

#include "rig/station_check.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static const char *const camera_drivers[] = {"virtual", "v4l2", NULL};
static const char *const projector_drivers[] = {"virtual", "egl", NULL};
static const char *const trigger_drivers[] = {"virtual", "usb", "gpio", "none", NULL};

static const struct settings_field sample_fields[] = {
    {.key = "width",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct station_sample, width),
     .minimum = 1,
     .maximum = 4096,
     .required = true,
     .sentence = "surface points, which are projector pixels of the sample's region, in x"},
    {.key = "height",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct station_sample, height),
     .minimum = 1,
     .maximum = 4096,
     .required = true,
     .sentence = "surface points in y"},
    {.key = "pitch_mm",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_sample, pitch_mm),
     .minimum = 1e-4,
     .maximum = 1000,
     .sentence = "distance between surface points; without it size_mm tells it"},
    {.key = "size_mm",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_sample, size_mm),
     .minimum = 1e-3,
     .maximum = 1e6,
     .sentence = "measured width of the region on the sample, in x; tells the pitch"},
    {0}};

static const struct settings_schema sample_schema = {
    .what = "sample", .size = sizeof(struct station_sample), .fields = sample_fields};

static const struct settings_field camera_fields[] = {
    {.key = "driver",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct station_camera, driver),
     .required = true,
     .words = camera_drivers,
     .sentence = "what drives the camera"},
    {.key = "width",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct station_camera, width),
     .minimum = 2,
     .maximum = 32768,
     .required = true,
     .sentence = "raw pixels kept of each frame, in x"},
    {.key = "height",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct station_camera, height),
     .minimum = 2,
     .maximum = 32768,
     .required = true,
     .sentence = "raw pixels kept of each frame, in y"},
    {.key = "bits",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct station_camera, bits),
     .minimum = 8,
     .maximum = 16,
     .required = true,
     .sentence = "of a raw value; a saturated pixel holds 2^bits - 1"},
    {.key = "bayer",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct station_camera, bayer),
     .required = true,
     .words = bayer_names,
     .sentence = "order of the colour filters, from the first pixel kept"},
    {.key = "pedestal",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_camera, pedestal),
     .maximum = 60000,
     .sentence = "raw value without light"},
    {.key = "read_noise",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_camera, read_noise),
     .maximum = 10000,
     .sentence = "standard deviation in raw units; without it there is none",
     .line_offset = offsetof(struct station_camera, read_noise_line)},
    {.key = "electrons",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_camera, electrons),
     .maximum = 1e6,
     .sentence = "photo-electrons in one raw unit; without it there is no shot noise",
     .line_offset = offsetof(struct station_camera, electrons_line)},
    {.key = "tolerance_ms",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_camera, tolerance_ms),
     .minimum = 0.001,
     .maximum = 1000,
     .fallback = "2",
     .sentence = "by which a frame may begin before or after its trigger and is still its own"},
    {.key = "v4l2",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station_camera, v4l2),
     .schema = &v4l2_settings_schema,
     .sentence = "what the driver v4l2 needs to know"},
    {0}};

static const struct settings_schema camera_schema = {
    .what = "camera", .size = sizeof(struct station_camera), .fields = camera_fields};

static const struct settings_field projector_fields[] = {
    {.key = "driver",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct station_projector, driver),
     .required = true,
     .words = projector_drivers,
     .sentence = "what drives the projector"},
    {.key = "wheel_hz",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_projector, wheel_hz),
     .minimum = 1,
     .maximum = 10000,
     .required = true,
     .sentence = "turns of the colour wheel a second; exposures are multiples of one turn"},
    {.key = "egl",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station_projector, egl),
     .schema = &egl_settings_schema,
     .sentence = "what the driver egl needs to know"},
    {0}};

static const struct settings_schema projector_schema = {
    .what = "projector", .size = sizeof(struct station_projector), .fields = projector_fields};

static const struct settings_field trigger_fields[] = {
    {.key = "driver",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct station_trigger, driver),
     .required = true,
     .words = trigger_drivers,
     .sentence = "what triggers the camera"},
    {.key = "gpio",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station_trigger, gpio),
     .schema = &gpio_settings_schema,
     .sentence = "what the driver gpio needs to know"},
    {0}};

static const struct settings_schema trigger_schema = {
    .what = "trigger", .size = sizeof(struct station_trigger), .fields = trigger_fields};

static const struct settings_field fields[] = {
    {.key = "sample",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station, sample),
     .required = true,
     .schema = &sample_schema,
     .sentence = "the region of the sample that is measured"},
    {.key = "camera",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station, camera),
     .required = true,
     .schema = &camera_schema,
     .sentence = "the camera"},
    {.key = "projector",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station, projector),
     .required = true,
     .schema = &projector_schema,
     .sentence = "the projector"},
    {.key = "trigger",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station, trigger),
     .required = true,
     .schema = &trigger_schema,
     .sentence = "the trigger"},
    {.key = "white_reflectance",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct station, white_reflectance),
     .count = 3,
     .minimum = 0.01,
     .maximum = 1,
     .fallback = "1",
     .sentence = "R G B, of the white diffuse layer"},
    {.key = "plan",
     .kind = SETTINGS_PATH,
     .offset = offsetof(struct station, plan),
     .sentence = "plan file that is used unless the command names another"},
    {.key = "virtual",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct station, simulated),
     .schema = &virtual_settings_schema,
     .sentence = "what the drivers called virtual simulate"},
    {.key = "without",
     .kind = SETTINGS_STRINGS,
     .offset = offsetof(struct station, without),
     .length_offset = offsetof(struct station, without_count),
     .sentence = "names of effects that are not to be simulated",
     .line_offset = offsetof(struct station, without_line)},
    {0}};

const struct settings_schema station_schema = {
    .what = "station file", .size = sizeof(struct station), .fields = fields};

/* Put the working folder before a relative path; a session's copy of the file lies elsewhere. */
static int make_absolute(char **path, struct nacre_error *error)
{
    char *absolute = NULL;
    char *folder = NULL;
    int status = NACRE_OK;
    if (!*path || **path == '/') {
        goto out;
    }
    folder = getcwd(NULL, 0);
    if (!folder) {
        status = nacre_fail_errno(error, errno, "%s: cannot find the working folder", *path);
        goto out;
    }
    if (asprintf(&absolute, "%s/%s", folder, *path) < 0) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    free(*path);
    *path = absolute;
out:
    free(folder);
    return status;
}

/* The pitch from the region's measured width. */
static int find_pitch(const char *path, struct station_sample *sample, struct nacre_error *error)
{
    double pitch_mm = sample->size_mm / sample->width;
    if (!(sample->size_mm > 0)) {
        return sample->pitch_mm > 0
                   ? NACRE_OK
                   : nacre_fail(error,
                                "%s: sample: lacks pitch_mm; give it, or size_mm, the width of the "
                                "lit region as measured on the sample",
                                path);
    }
    if (sample->pitch_mm > 0 && fabs(sample->pitch_mm - pitch_mm) > 1e-3 * pitch_mm) {
        return nacre_fail(error,
                          "%s: sample: size_mm %g over %d points is a pitch of %g mm, but pitch_mm "
                          "is %g; leave one of them out",
                          path, sample->size_mm, sample->width, pitch_mm, sample->pitch_mm);
    }
    sample->pitch_mm = pitch_mm;
    return NACRE_OK;
}

int station_read(const char *path, struct station *station, struct nacre_error *error)
{
    int status = settings_read(path, &station_schema, station, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = find_pitch(path, &station->sample, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = station_check(path, station, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = make_absolute(&station->plan, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = make_absolute(&station->simulated.sample, error);
out:
    if (status != NACRE_OK) {
        station_finish(station);
    }
    return status;
}

void station_finish(struct station *station)
{
    settings_finish(&station_schema, station);
}

bool station_is_virtual(const struct station *station)
{
    return station->camera.driver == CAMERA_DRIVER_VIRTUAL &&
           station->projector.driver == PROJECTOR_DRIVER_VIRTUAL &&
           station->trigger.driver == TRIGGER_DRIVER_VIRTUAL;
}
