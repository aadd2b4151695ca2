/* Small stations for tests. */
#include "stage.h"

#include "tests/files.h"
#include "unity.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char stage_station[] = "sample: {width: 6, height: 5, pitch_mm: 0.5}\n"
                             "camera:\n"
                             "  driver: virtual\n"
                             "  width: 24\n"
                             "  height: 20\n"
                             "  bits: 10\n"
                             "  bayer: GRBG\n"
                             "  pedestal: 32\n"
                             "  read_noise: 1.5\n"
                             "  electrons: 8\n"
                             "projector: {driver: virtual, wheel_hz: 30}\n"
                             "trigger: {driver: virtual}\n"
                             "white_reflectance: 0.9\n"
                             "plan: plan.yaml\n"
                             "virtual:\n"
                             "  seed: 5\n"
                             "  projector: {contrast: 500, latency_ms: 16}\n"
                             "  camera: {elevation_deg: 20, full_scale_s: 0.05, readout_ms: 10}\n";

const char stage_plan[] = "seed: 3\n"
                          "black_frames: 2\n"
                          "white_frames: 1\n"
                          "dot_spacing: 4\n"
                          "dot_shift: 2\n"
                          "dot_size: 1\n"
                          "grid_spacing: 3\n"
                          "window: 3\n"
                          "exposure_turns: [1, 3]\n";

void stage_write(const struct stage *stage, const char *name, const char *text)
{
    char *path = path_join(stage->folder, name);
    text_write(path, text);
    free(path);
}

void stage_make(struct stage *stage, const char *station, const char *plan)
{
    stage->folder = folder_make();
    stage->station = path_join(stage->folder, "station.yaml");
    stage->plan = path_join(stage->folder, "plan.yaml");
    stage->session = path_join(stage->folder, "session");
    stage_write(stage, "station.yaml", station ? station : stage_station);
    stage_write(stage, "plan.yaml", plan ? plan : stage_plan);
}

void stage_begin(struct stage *stage, const char *station, struct session *session)
{
    struct nacre_error error = {""};
    stage_make(stage, station, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(stage->session, stage->station, NULL, false, session, &error),
        error.text);
}

void stage_remove(struct stage *stage)
{
    folder_remove(stage->folder);
    free(stage->station);
    free(stage->plan);
    free(stage->session);
    *stage = (struct stage){0};
}

char *text_replace(const char *text, const char *from, const char *to)
{
    char *replaced = NULL;
    const char *place = strstr(text, from);
    TEST_ASSERT_NOT_NULL_MESSAGE(place, from);
    TEST_ASSERT_TRUE(
        asprintf(&replaced, "%.*s%s%s", (int)(place - text), text, to, place + strlen(from)) >= 0);
    return replaced;
}

static int faulty_arm(struct camera *camera, int64_t exposure_ns, struct nacre_error *error)
{
    struct camera *inner = ((struct faulty_camera *)camera)->inner;
    return inner->ops->arm(inner, exposure_ns, error);
}

static int faulty_take(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                       struct nacre_error *error)
{
    struct faulty_camera *own = (struct faulty_camera *)camera;
    bool now = own->takes++ == own->when;
    if (now && own->fault == FAULT_BROKEN) {
        return nacre_fail(error, "camera faulty: cannot dequeue buffer 3: Input/output error");
    }
    if (own->fault == FAULT_UNPLUGGED && own->when >= 0 && own->takes > own->when) {
        return nacre_fail(error, "camera faulty: No such device");
    }
    int status = own->inner->ops->take(own->inner, timeout_ns, frame, error);
    if (status != NACRE_OK) {
        return status;
    }
    if (now && own->fault == FAULT_LOST) {
        return nacre_fail(error, "camera faulty: buffer 1 is damaged");
    }
    own->skipped += now && own->fault == FAULT_DROPPED;
    frame->sequence += own->skipped;
    frame->frame_ns += now && own->fault == FAULT_LATE ? 40000000 : 0;
    frame->frame_ns -= now && own->fault == FAULT_EARLY ? 40000000 : 0;
    frame->frame_ns -= now && own->fault == FAULT_JITTER ? 1900000 : 0;
    return NACRE_OK;
}

static void faulty_close(struct camera *camera)
{
    struct camera *inner = ((struct faulty_camera *)camera)->inner;
    inner->ops->close(inner);
}

struct faulty_camera faulty_camera(struct camera *inner, enum fault fault, int when)
{
    static const struct camera_ops ops = {"faulty", faulty_arm, faulty_take, faulty_close};
    struct faulty_camera camera = {.base = *inner, .inner = inner, .fault = fault, .when = when};
    camera.base.ops = &ops;
    return camera;
}

static int shifted_arm(struct camera *camera, int64_t exposure_ns, struct nacre_error *error)
{
    struct camera *inner = ((struct shifted_camera *)camera)->inner;
    return inner->ops->arm(inner, exposure_ns, error);
}

static int shifted_take(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                        struct nacre_error *error)
{
    struct shifted_camera *own = (struct shifted_camera *)camera;
    int status = own->inner->ops->take(own->inner, timeout_ns, frame, error);
    frame->frame_ns += own->shift_ns;
    if (own->lose && ++own->taken % own->lose == 0) {
        return nacre_fail(error, "camera faulty: lost");
    }
    return status;
}

struct shifted_camera shifted_camera(struct camera *inner)
{
    static const struct camera_ops ops = {
        .name = "faulty", .arm = shifted_arm, .take = shifted_take};
    struct shifted_camera camera = {.base = *inner, .inner = inner};
    camera.base.ops = &ops;
    return camera;
}

static int lay_white_layer(void *context, bool on, struct nacre_error *error)
{
    struct operator_log *log = context;
    struct clock *clock = virtual_station_clock(log->station);
    (void)error;
    clock_sleep_until_ns(clock, clock_now_ns(clock) + log->white_layer_takes_ns);
    if (on) {
        log->layer_on++;
    } else {
        log->layer_off++;
    }
    virtual_station_set_white_layer(log->station, on);
    return NACRE_OK;
}

static int begin_pattern(void *context, const struct sequence_moment *moment,
                         struct nacre_error *error)
{
    (void)error;
    struct operator_log *log = context;
    if (++log->begun == log->raise_at) {
        (void)raise(SIGINT);
    }
    if (log->begun == log->call_at && log->call) {
        log->call();
    }
    virtual_station_begin_pattern(log->station, moment->pattern);
    return NACRE_OK;
}

struct sequence_operator stage_operator(struct operator_log *log, struct virtual_station *station)
{
    log->station = station;
    return (struct sequence_operator){
        .context = log, .white_layer = lay_white_layer, .pattern_begins = begin_pattern};
}

int stage_scan(const struct session *session, enum fault fault, int when, int retries,
               struct operator_log *log, struct sequence_result *result, struct nacre_error *error)
{
    struct virtual_station *station = NULL;
    const struct sequence_options options = {.retries = retries};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, virtual_station_new(&session->station, &station, error),
                                  error->text);
    struct faulty_camera camera = faulty_camera(virtual_station_camera(station), fault, when);
    struct devices devices = {.camera = &camera.base,
                              .projector = virtual_station_projector(station),
                              .trigger = virtual_station_trigger(station),
                              .clock = virtual_station_clock(station)};
    const struct sequence_operator person = stage_operator(log, station);
    int status = sequence_run(&devices, session, &person, &options, NULL, result, error);
    virtual_station_free(station);
    return status;
}
