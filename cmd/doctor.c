/* nacre doctor: checks a station's devices and measures their delays. */
#include "base/settings_edit.h"
#include "cmd/board_check.h"
#include "cmd/checks.h"
#include "cmd/json_print.h"
#include "cmd/stand.h"
#include "cmd/verbs.h"
#include "rig/latency.h"
#include "rig/projector_egl.h"
#include "rig/sequence.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

struct doctor_settings {
    const char *station;
    bool store;
    int flips;
};

static const struct option_spec doctor_options[] = {
    {.name = "station",
     .letter = 's',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct doctor_settings, station),
     .sentence = "the station file"},
    {.name = "store",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct doctor_settings, store),
     .sentence = "write the delays that were measured into the station file"},
    {.name = "flips",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 4,
     .maximum = 10000,
     .fallback = "60",
     .offset = offsetof(struct doctor_settings, flips),
     .sentence = "how many patterns are shown to measure delays"},
    {0}};

/* One visit: what was found so far. */
struct visit {
    const char *path;
    struct station station; /* as the file says */
    struct station opened;  /* the same with delays of 0, borrowing its strings */
    struct stand stand;
    struct checks checks;
    bool measured;
    struct latency_report delays;
};

static bool is_egl(const struct visit *visit)
{
    return visit->station.projector.driver == PROJECTOR_DRIVER_EGL;
}

static double known_latency_ms(const struct visit *visit)
{
    return is_egl(visit) ? visit->station.projector.egl.latency_ms
                         : visit->station.simulated.projector.latency_ms;
}

/* Open each by itself, so that all that is wrong is told at once. */
static bool open_real(struct visit *visit)
{
    struct checks *checks = &visit->checks;
    struct devices *devices = &visit->stand.devices;
    struct nacre_error error;
    visit->stand.system = clock_monotonic();
    devices->clock = &visit->stand.system;
    int projector =
        devices_open_projector(&visit->opened, devices->clock, &devices->projector, &error);
    checks_add_status(checks, "projector", projector, &error);
    int camera = devices_open_camera(&visit->opened, devices->clock, &devices->camera, &error);
    checks_add_status(checks, "camera", camera, &error);
    int trigger = devices_open_trigger(&visit->opened, devices->clock, &devices->trigger, &error);
    checks_add_status(checks, "trigger", trigger, &error);
    return projector == NACRE_OK && camera == NACRE_OK && trigger == NACRE_OK;
}

static void check_trigger(struct visit *visit)
{
    struct devices *devices = &visit->stand.devices;
    if (visit->station.trigger.driver == TRIGGER_DRIVER_USB && devices->trigger) {
        board_check(&visit->checks, devices->trigger, devices->clock,
                    visit->station.projector.wheel_hz);
    }
}

static bool open_virtual(struct visit *visit)
{
    struct nacre_error error;
    int status = stand_open(&visit->opened, &visit->stand, &error);
    if (status == NACRE_OK) {
        status = virtual_station_tell_refreshes(visit->stand.simulated, &error);
    }
    checks_add_status(&visit->checks, "devices", status, &error);
    return status == NACRE_OK;
}

/* The time between refreshes against the turn of the wheel that exposures are made of. */
static void check_projector(struct visit *visit)
{
    struct checks *checks = &visit->checks;
    const struct projector *projector = visit->stand.devices.projector;
    if (!is_egl(visit) || !projector) {
        return;
    }
    struct projector_egl_info info = projector_egl_info(projector);
    double turns = (double)info.refresh_ns * 1e-9 * visit->station.projector.wheel_hz;
    checks_add(checks, "display", CHECK_OK, "%s, %s, drawn by %s", info.name, info.mode,
               info.renderer);
    if (info.remarks[0] != '\0') {
        checks_add(checks, "display", CHECK_WARNING, "%s", info.remarks);
    }
    if (!info.counted) {
        checks_add(checks, "display", CHECK_WARNING,
                   "its driver counts no refreshes; each pattern takes one more to appear");
    }
    if (fabs(turns - rint(turns)) > 0.01 || turns < 0.5) {
        checks_add(checks, "wheel", CHECK_WARNING,
                   "a refresh of %.3f ms is %.3f turns of the colour wheel at projector.wheel_hz "
                   "%g; a projector turns its wheel a whole number of times a refresh: correct "
                   "wheel_hz",
                   (double)info.refresh_ns * 1e-6, turns, visit->station.projector.wheel_hz);
    }
}

static void check_disk(struct visit *visit)
{
    struct plan plan;
    struct sequence_needs needs;
    struct nacre_error error;
    const char *path = visit->station.plan;
    if (!path) {
        checks_add(&visit->checks, "disk", CHECK_WARNING,
                   "not checked, as the station file names no plan");
        return;
    }
    int status = session_read_plan(path, &visit->station, &plan, &error);
    if (status == NACRE_OK) {
        status = sequence_estimate(&visit->station, &plan, NULL, &needs, &error);
        plan_finish(&plan);
    }
    if (status == NACRE_OK) {
        status = sequence_check_disk(".", &needs, &error);
    }
    checks_add_status(&visit->checks, "disk", status, &error);
}

/* What was measured against what the file says. */
static void judge_delays(struct visit *visit)
{
    struct checks *checks = &visit->checks;
    const struct latency_report *d = &visit->delays;
    double known_ms = known_latency_ms(visit);
    double turn_ms = 1000 / visit->station.projector.wheel_hz;
    double tolerance_ms = visit->station.camera.tolerance_ms;
    /* What is a fiftieth of a turn late costs 2 % of the shortest exposure's light. */
    bool late = d->light.median_ms - d->light.spread_ms > known_ms + 0.02 * turn_ms;
    bool slow = known_ms > d->light.most_ms + 2 * turn_ms;
    checks_add(checks, "latency",
               late   ? CHECK_WRONG
               : slow ? CHECK_WARNING
                      : CHECK_OK,
               "the light changes %.2f ms after a flip (half within %.2f, %.2f to %.2f); the "
               "station file says %g%s",
               d->light.median_ms, d->light.spread_ms, d->light.least_ms, d->light.most_ms,
               known_ms, late || slow ? "; correct it (--store)" : "");
    if (d->camera.count == 0) {
        checks_add(checks, "stamps", CHECK_OK, "not compared, as no trigger starts the camera");
        return;
    }
    double off_ms = fabs(d->camera.median_ms) + d->camera.spread_ms;
    bool wrong = off_ms > tolerance_ms;
    checks_add(checks, "stamps",
               wrong                       ? CHECK_WRONG
               : off_ms > tolerance_ms / 2 ? CHECK_WARNING
                                           : CHECK_OK,
               "frames begin %.3f ms after their triggers by their stamps (half within %.3f, %.3f "
               "to %.3f), where %g are tolerated%s",
               d->camera.median_ms, d->camera.spread_ms, d->camera.least_ms, d->camera.most_ms,
               tolerance_ms,
               wrong ? "; correct camera.v4l2.stamp_delay_ms (--store) or camera.tolerance_ms"
                     : "");
}

static int measure(struct visit *visit, int flips, bool quiet, struct nacre_error *error)
{
    struct progress progress = progress_begin("measuring delays", quiet);
    struct checks *checks = &visit->checks;
    int status = latency_measure(&visit->stand.devices, flips, &progress, &visit->delays, error);
    progress_end(&progress);
    if (status == NACRE_FAILED) {
        checks_add_status(checks, "light", status, error);
        return NACRE_OK;
    }
    if (status != NACRE_OK) {
        return status;
    }
    visit->measured = true;
    checks_add(checks, "light", visit->delays.saturated > 0.01 ? CHECK_WARNING : CHECK_OK,
               "white is %.0f %% of full scale brighter than black at %g ms, %.1f %% of pixels "
               "saturated",
               100 * visit->delays.contrast, visit->delays.exposure_ms,
               100 * visit->delays.saturated);
    if (visit->delays.lost > 0) {
        checks_add(checks, "frames", CHECK_WARNING, "%zu of %d were lost", visit->delays.lost,
                   flips);
    }
    judge_delays(visit);
    return NACRE_OK;
}

/* The latency that was seen at most, as a pattern must be whole on the glass. */
static int store(struct visit *visit, struct nacre_error *error)
{
    struct settings_edit edits[2];
    size_t count = 0;
    const struct station_camera *camera = &visit->station.camera;
    if (is_egl(visit)) {
        edits[count++] = (struct settings_edit){"projector.egl.latency_ms",
                                                ceil(visit->delays.light.most_ms * 10) / 10};
    }
    if (camera->driver == CAMERA_DRIVER_V4L2 && visit->delays.camera.count > 0) {
        edits[count++] = (struct settings_edit){
            "camera.v4l2.stamp_delay_ms",
            round((camera->v4l2.stamp_delay_ms + visit->delays.camera.median_ms) * 1e3) / 1e3};
    }
    if (count == 0) {
        checks_add(&visit->checks, "store", CHECK_WARNING,
                   "nothing to store: virtual devices have the delays that their file gives them");
        return NACRE_OK;
    }
    int status = settings_edit(visit->path, &station_schema, edits, count, error);
    for (size_t i = 0; i < count && status == NACRE_OK; i++) {
        checks_add(&visit->checks, "store", CHECK_OK, "%s: %s is %g now", visit->path, edits[i].key,
                   edits[i].value);
    }
    return status;
}

static json_t *figure_json(const struct latency_figure *figure)
{
    return figure->count
               ? json_pack("{s:I, s:f, s:f, s:f, s:f}", "count", (json_int_t)figure->count,
                           "median_ms", figure->median_ms, "spread_ms", figure->spread_ms,
                           "least_ms", figure->least_ms, "most_ms", figure->most_ms)
               : json_null();
}

static int print_json(const struct visit *visit, struct nacre_error *error)
{
    json_t *delays = visit->measured
                         ? json_pack("{s:f, s:f, s:o, s:o}", "exposure_ms",
                                     visit->delays.exposure_ms, "contrast", visit->delays.contrast,
                                     "latency", figure_json(&visit->delays.light), "stamps",
                                     figure_json(&visit->delays.camera))
                         : json_null();
    return json_print(
        json_pack("{s:o, s:o}", "checks", checks_as_json(&visit->checks), "delays", delays), error);
}

static int examine(struct visit *visit, const struct doctor_settings *settings, bool quiet,
                   struct nacre_error *error)
{
    int status = station_read(visit->path, &visit->station, error);
    if (status != NACRE_OK) {
        return status;
    }
    visit->opened = visit->station;
    visit->opened.projector.egl.latency_ms = 0;
    bool open = station_is_virtual(&visit->station) ? open_virtual(visit) : open_real(visit);
    check_projector(visit);
    check_trigger(visit);
    checks_of_machine(&visit->checks, visit->station.trigger.driver == TRIGGER_DRIVER_GPIO);
    check_disk(visit);
    if (open) {
        status = measure(visit, settings->flips, quiet, error);
    } else {
        checks_add(&visit->checks, "delays", CHECK_WARNING,
                   "not measured, as not all devices are there");
    }
    if (status == NACRE_OK && settings->store && visit->measured) {
        status = store(visit, error);
    }
    return status;
}

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct doctor_settings *settings = values;
    struct visit visit = {.path = settings->station};
    int status = examine(&visit, settings, invocation->quiet, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (invocation->json) {
        status = print_json(&visit, error);
    } else {
        checks_print(&visit.checks);
    }
    size_t wrong = checks_count(&visit.checks, CHECK_WRONG);
    if (status == NACRE_OK && wrong > 0) {
        status = nacre_fail(error, "%s: %zu of %zu checks found something wrong", settings->station,
                            wrong, visit.checks.count);
    }
out:
    stand_close(&visit.stand);
    station_finish(&visit.station);
    checks_finish(&visit.checks);
    return status;
}

const struct verb verb_doctor = {
    .name = "doctor",
    .operands = "--station FILE",
    .summary = "check a station's devices and measure their delays",
    .text =
        "Opens every device that the station file names and says of each whether it is as it "
        "should be and what to mend; looks at clock, priority and disk; and shows black and white "
        "by turns, to measure how long after a flip the light changes and how far the camera's "
        "stamps are from its triggers. Something bright must lie under the projector: the white "
        "layer, or the sample.\n\n"
        "Fails where anything is wrong. With --store the delays are written into the station "
        "file, the rest of which stays as it is.",
    .operand_maximum = 0,
    .options = doctor_options,
    .settings_size = sizeof(struct doctor_settings),
    .run = run,
};
