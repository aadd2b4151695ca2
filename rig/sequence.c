/* The sequencer: every pattern on the glass, every exposure matched to its trigger, every frame on
 * disk. */
#include "rig/sequence.h"

#include "rig/calibration_reuse.h"
#include "rig/sequence_layer.h"
#include "rig/sequence_writer.h"
#include "rig/time_limit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One run: what the steps share. */
struct run {
    const struct devices *devices;
    const struct session *session;
    const struct sequence_operator *person;
    struct sequence_result *result;
    struct sequence_writer *writer;
    struct exposer exposer;
    uint8_t *levels; /* [projector height][projector width] */
    struct sequence_layer layer;
    struct time_limit limit;
    int64_t began_ns; /* on the station's clock; later by what passed on it between runs */
};

/* Add what has passed on the station's clock since `began_ns`. */
static void account(struct run *run, int64_t began_ns, int64_t *sum)
{
    *sum += clock_now_ns(run->devices->clock) - began_ns;
}

static int check_devices(const struct devices *devices, const struct session *session,
                         struct nacre_error *error)
{
    const struct camera *camera = devices->camera;
    const struct projector *projector = devices->projector;
    const struct station_camera *wanted = &session->station.camera;
    const struct station_sample *sample = &session->station.sample;
    if (camera->width != wanted->width || camera->height != wanted->height ||
        camera->bits != wanted->bits || (int)camera->bayer != wanted->bayer) {
        return nacre_fail(
            error,
            "camera %s: delivers %d x %d pixels, %d bits, %s, where the station file says "
            "%d x %d, %d bits, %s",
            camera->ops->name, camera->width, camera->height, camera->bits,
            bayer_names[camera->bayer], wanted->width, wanted->height, wanted->bits,
            bayer_names[wanted->bayer]);
    }
    if (projector->width != sample->width || projector->height != sample->height) {
        return nacre_fail(
            error,
            "projector %s: shows %d x %d pixels where the station's sample has %d x %d "
            "surface points",
            projector->ops->name, projector->width, projector->height, sample->width,
            sample->height);
    }
    return NACRE_OK;
}

/* Frames with room for every exposure of the pattern. */
static int make_frames(const struct run *run, struct pattern pattern, struct pattern_frames *frames,
                       struct nacre_error *error)
{
    const struct session *session = run->session;
    const struct camera *camera = run->devices->camera;
    *frames = (struct pattern_frames){.pattern = pattern,
                                      .width = camera->width,
                                      .height = camera->height,
                                      .bits = camera->bits,
                                      .bayer = camera->bayer,
                                      .seed = session->plan.seed};
    size_t count = plan_pattern_exposures(&session->plan, pattern);
    frames->exposures = calloc(count, sizeof *frames->exposures);
    if (!frames->exposures) {
        return nacre_fail_memory(error, "raw frames");
    }
    frames->count = count;
    for (size_t i = 0; i < frames->count; i++) {
        frames->exposures[i].exposure_ns = session_exposure_ns(session, i);
        frames->exposures[i].raw =
            malloc((size_t)camera->width * (size_t)camera->height * sizeof(uint16_t));
        if (!frames->exposures[i].raw) {
            return nacre_fail_memory(error, "raw frames");
        }
    }
    return NACRE_OK;
}

/* Show run->levels and take every exposure of them; again from the beginning where the pattern did not stay on the glass. */
static int show_and_expose(struct run *run, struct pattern_frames *frames,
                           struct nacre_error *error)
{
    struct projector *projector = run->devices->projector;
    for (int tries = run->exposer.retries;; tries--) {
        const struct exposer before = run->exposer;
        int64_t flip_ns = 0;
        int status = exposer_show(&run->exposer, run->levels, &flip_ns, error);
        for (size_t i = 0; i < frames->count && status == NACRE_OK; i++) {
            frames->exposures[i].flip_ns = flip_ns;
            status = exposer_expose(&run->exposer, &frames->exposures[i], error);
        }
        if (status != NACRE_OK || !projector->ops->confirm) {
            return status;
        }
        status = projector->ops->confirm(projector, error);
        if (status != NACRE_FAILED || tries == 0) {
            return status;
        }
        exposer_discard(&run->exposer, &before);
    }
}

/* Show one pattern, expose it and hand its frames to the writer. */
static int measure(struct run *run, struct pattern pattern, struct nacre_error *error)
{
    const struct projector *projector = run->devices->projector;
    struct pattern_frames frames = {0};
    int status = make_frames(run, pattern, &frames, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = sequence_layer_set(&run->layer, pattern_kind_wants_white_layer(pattern.kind), error);
    if (status != NACRE_OK) {
        goto out;
    }
    plan_draw(&run->session->plan, pattern, projector->width, projector->height, run->levels);
    status = show_and_expose(run, &frames, error);
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "pattern %s %d", pattern_kind_names[pattern.kind],
                                pattern.number);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    if (run->layer.checked) {
        layer_check_remember(&run->layer.check, &frames);
    }
    int64_t handed_ns = clock_now_ns(run->devices->clock);
    status = sequence_writer_put(run->writer, &frames, error);
    account(run, handed_ns, &run->result->times.disk_ns);
out:
    pattern_frames_finish(&frames);
    return status;
}

/* Let the person know, and pause or stop where they want it. */
static int begin_pattern(struct run *run, const struct sequence_moment *moment,
                         struct nacre_error *error)
{
    const struct sequence_operator *person = run->person;
    int64_t began_ns = clock_now_ns(run->devices->clock);
    int status =
        person->pattern_begins ? person->pattern_begins(person->context, moment, error) : NACRE_OK;
    account(run, began_ns, &run->result->times.person_ns);
    return status;
}

/* Go on where an earlier run was when it had measured this pattern. */
static int go_on_after(struct run *run, struct pattern before, struct nacre_error *error)
{
    const struct sequence_operator *person = run->person;
    struct pattern_frames frames = {0};
    int64_t stood_ns = clock_now_ns(run->devices->clock);
    int status = session_read(run->session, before, &frames, error);
    if (status == NACRE_OK) {
        status = person->goes_on(person->context, &frames, error);
        run->exposer.sequence_known = false; /* frames are counted from there, too */
    }
    pattern_frames_finish(&frames);
    account(run, stood_ns, &run->began_ns);
    return status;
}

/* Stop before a write fails: the disk must have room for the next pattern and for those that are still to be written. */
static int check_room(struct run *run, const struct sequence_needs *needs, size_t left,
                      struct nacre_error *error)
{
    uint64_t bytes = needs->bytes / needs->patterns;
    size_t pending = sequence_writer_pending(run->writer);
    return sequence_check_room(run->session->path, bytes * (1 + pending), bytes * (left + pending),
                               error);
}

static int64_t exposure_ns_of(const struct session *session, struct pattern pattern)
{
    int64_t sum = 0;
    for (size_t e = 0; e < plan_pattern_exposures(&session->plan, pattern); e++) {
        sum += session_exposure_ns(session, e);
    }
    return sum;
}

/* Refuse a limit that leaves no time for what comes before the grids, and for one of these. */
static int check_limit(const struct run *run, const struct pattern *patterns, size_t count,
                       struct nacre_error *error)
{
    const struct session *session = run->session;
    int64_t needed_ns = 0;
    bool grid = false;
    for (size_t i = 0; i < count && !grid; i++) {
        if (!session_has(session, patterns[i])) {
            grid = patterns[i].kind == PATTERN_GRID;
            needed_ns += exposure_ns_of(session, patterns[i]);
        }
    }
    return time_limit_allows(&run->limit, 0, needed_ns)
               ? NACRE_OK
               : nacre_fail(error,
                            "%s: the calibration and one grid take %.2g h of exposing, and %.2g h "
                            "are allowed; allow more",
                            session->path, (double)needed_ns / 3.6e12,
                            (double)run->limit.within_ns / 3.6e12);
}

/* Grids come last, so what there is no time for is all that is left. */
static bool has_time(const struct run *run, struct pattern pattern)
{
    int64_t passed_ns = clock_now_ns(run->devices->clock) - run->began_ns;
    return pattern.kind != PATTERN_GRID ||
           time_limit_allows(&run->limit, passed_ns, exposure_ns_of(run->session, pattern));
}

static int measure_timed(struct run *run, struct pattern pattern, struct nacre_error *error)
{
    int64_t began_ns = clock_now_ns(run->devices->clock);
    int status = measure(run, pattern, error);
    time_limit_learn(&run->limit, clock_now_ns(run->devices->clock) - began_ns,
                     exposure_ns_of(run->session, pattern));
    return status;
}

static int measure_missing(struct run *run, const struct pattern *patterns, size_t count,
                           const struct sequence_needs *needs, struct progress *progress,
                           struct nacre_error *error)
{
    size_t done = 0;
    size_t missing = needs->patterns;
    bool found = false; /* the pattern before */
    for (size_t i = 0; i < count; i++) {
        char detail[96];
        if (session_has(run->session, patterns[i])) {
            run->result->skipped++;
            found = true;
            continue;
        }
        if (!has_time(run, patterns[i])) {
            run->result->left = missing - done;
            break;
        }
        size_t retries = exposer_retries(&run->exposer);
        (void)snprintf(detail, sizeof detail, "%s %d, %zu retries",
                       pattern_kind_names[patterns[i].kind], patterns[i].number, retries);
        int status = progress_step(progress, (double)done, (double)missing, detail, error);
        if (status == NACRE_OK && run->person->goes_on && found) {
            status = go_on_after(run, patterns[i - 1], error);
        }
        found = false;
        if (status == NACRE_OK) {
            struct sequence_moment moment = {patterns[i], done, missing, retries};
            status = begin_pattern(run, &moment, error);
        }
        if (status == NACRE_OK) {
            status = check_room(run, needs, missing - done, error);
        }
        if (status == NACRE_OK) {
            status = measure_timed(run, patterns[i], error);
        }
        if (status != NACRE_OK) {
            return status;
        }
        done++;
    }
    return NACRE_OK;
}

/* What is needed to show patterns and to look at the white layer. */
static int begin(struct run *run, const struct sequence_options *options, struct nacre_error *error)
{
    const struct projector *projector = run->devices->projector;
    struct layer_check *check = &run->layer.check;
    run->levels = malloc((size_t)projector->width * (size_t)projector->height);
    if (!run->levels) {
        return nacre_fail_memory(error, "a pattern");
    }
    run->layer.checked = options->check_layer;
    if (!options->check_layer && !options->calibration) {
        return NACRE_OK;
    }
    int status = layer_check_begin(check, &run->exposer, run->session, run->levels, error);
    return status == NACRE_OK ? layer_check_recall(check, run->session, error) : status;
}

/* Use another session's calibration if nothing has moved. A session that has dots has a calibration. */
static int use_calibration(struct run *run, const struct session *old, struct nacre_error *error)
{
    const struct pattern first = {PATTERN_DOTS, 0};
    struct sequence_result *result = run->result;
    if (session_has(run->session, first)) {
        return NACRE_OK;
    }
    int status = calibration_fits(old, run->session, error);
    if (status == NACRE_OK) {
        status = layer_check_recall(&run->layer.check, old, error);
    }
    if (status == NACRE_OK) {
        status = sequence_layer_verify(&run->layer, old->path, &result->moved_px, error);
    }
    return status == NACRE_OK ? calibration_take_over(old, run->session, &result->taken_over, error)
                              : status;
}

/* All that comes before the first pattern. */
static int prepare(struct run *run, const struct sequence_options *options,
                   struct sequence_needs *needs, struct nacre_error *error)
{
    const struct session *session = run->session;
    int status = check_devices(run->devices, session, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = begin(run, options, error);
    if (status == NACRE_OK && options->calibration) {
        status = use_calibration(run, options->calibration, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    status = sequence_estimate(&session->station, &session->plan, session, needs, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = sequence_check_disk(session->path, needs, error);
    const struct sequence_writer_listener listener = {run->person->exposure_ends,
                                                      run->person->context};
    return status == NACRE_OK ? sequence_writer_new(session, &listener, &run->writer, error)
                              : status;
}

/* What the run leaves to be told. */
static void sum_up(const struct run *run)
{
    struct sequence_result *result = run->result;
    const struct exposer_times *stages = &run->exposer.times;
    result->exposures = run->exposer.exposures;
    result->retries = exposer_retries(&run->exposer);
    memcpy(result->retaken, run->exposer.retaken, sizeof result->retaken);
    result->insisted = run->layer.insisted;
    result->times.stages = *stages;
    result->times.person_ns += run->layer.person_ns;
    result->station_ns = clock_now_ns(run->devices->clock) - run->began_ns;
    result->times.rest_ns = result->station_ns - result->times.person_ns - result->times.disk_ns -
                            stages->exposing_ns - stages->readout_ns - stages->flip_ns -
                            stages->trigger_ns - stages->retakes_ns - stages->checks_ns;
}

double sequence_overhead_turns(const struct sequence_result *result, const struct station *station)
{
    const struct exposer_times *stages = &result->times.stages;
    double seconds = (double)(stages->flip_ns + stages->trigger_ns) * 1e-9;
    return result->exposures ? seconds * station->projector.wheel_hz / (double)result->exposures
                             : 0;
}

int sequence_run(const struct devices *devices, const struct session *session,
                 const struct sequence_operator *person, const struct sequence_options *options,
                 struct progress *progress, struct sequence_result *result,
                 struct nacre_error *error)
{
    struct run run = {
        .devices = devices,
        .session = session,
        .person = person,
        .result = result,
        .limit = {.within_ns = options->within_ns},
        .layer = {.person = person, .clock = devices->clock},
        .exposer = {.devices = devices,
                    .retries = options->retries,
                    .tolerance_ns = options->tolerance_ns
                                        ? options->tolerance_ns
                                        : llround(session->station.camera.tolerance_ms * 1e6),
                    .tried = person->exposure_ends,
                    .context = person->context}};
    struct sequence_needs needs;
    struct pattern *patterns = NULL;
    size_t count = 0;
    run.began_ns = clock_now_ns(devices->clock);
    *result = (struct sequence_result){0};
    int status = prepare(&run, options, &needs, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = plan_order(&session->plan, &patterns, &count, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check_limit(&run, patterns, count, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = measure_missing(&run, patterns, count, &needs, progress, error);
    int64_t ended_ns = clock_now_ns(devices->clock);
    int written = sequence_writer_finish(run.writer, &result->patterns, &result->bytes,
                                         status == NACRE_OK ? error : NULL);
    account(&run, ended_ns, &result->times.disk_ns);
    status = status == NACRE_OK ? written : status;
out:
    sum_up(&run);
    sequence_writer_free(run.writer);
    sequence_layer_finish(&run.layer);
    free(run.levels);
    free(patterns);
    return status;
}
