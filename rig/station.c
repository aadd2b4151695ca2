/* Reading station files. */
#include "rig/station.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static const char *const driver_names[] = {"virtual", NULL};

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
     .required = true,
     .sentence = "distance between surface points"},
    {0}};

static const struct settings_schema sample_schema = {
    .what = "sample", .size = sizeof(struct station_sample), .fields = sample_fields};

static const struct settings_field camera_fields[] = {
    {.key = "driver",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct station_camera, driver),
     .required = true,
     .words = driver_names,
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
     .sentence = "standard deviation in raw units; without it there is none"},
    {.key = "electrons",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_camera, electrons),
     .maximum = 1e6,
     .sentence = "photo-electrons in one raw unit; without it there is no shot noise"},
    {0}};

static const struct settings_schema camera_schema = {
    .what = "camera", .size = sizeof(struct station_camera), .fields = camera_fields};

static const struct settings_field projector_fields[] = {
    {.key = "driver",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct station_projector, driver),
     .required = true,
     .words = driver_names,
     .sentence = "what drives the projector"},
    {.key = "wheel_hz",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct station_projector, wheel_hz),
     .minimum = 1,
     .maximum = 10000,
     .required = true,
     .sentence = "turns of the colour wheel a second; exposures are multiples of one turn"},
    {0}};

static const struct settings_schema projector_schema = {
    .what = "projector", .size = sizeof(struct station_projector), .fields = projector_fields};

static const struct settings_field trigger_fields[] = {
    {.key = "driver",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct station_trigger, driver),
     .required = true,
     .words = driver_names,
     .sentence = "what triggers the camera"},
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

/* What no single key can be refused for. */
static int check(const char *path, const struct station *station, struct nacre_error *error)
{
    int full_scale = (1 << station->camera.bits) - 1;
    if (station->camera.pedestal >= full_scale) {
        return nacre_fail(error, "%s: camera.pedestal: %g leaves no range below saturation at %d",
                          path, station->camera.pedestal, full_scale);
    }
    return NACRE_OK;
}

int station_read(const char *path, struct station *station, struct nacre_error *error)
{
    int status = settings_read(path, &station_schema, station, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check(path, station, error);
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
