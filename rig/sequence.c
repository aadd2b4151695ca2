/* The sequencer: every pattern on the glass, every exposure matched to its trigger, every frame on
 * disk. */
#include "rig/sequence.h"

#include "rig/sequence_writer.h"

#include <errno.h>
#include <inttypes.h>
#include <libgen.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

/* A camera that has not delivered this long after an exposure's end has lost the frame. */
static const int64_t DELIVERY_NS = 2000000000;

/* More than the header of one part takes in a pattern's file. */
enum { PART_HEADER_BYTES = 4096 };

/* One run: what the steps share. */
struct run {
    const struct devices *devices;
    const struct session *session;
    const struct sequence_operator *person;
    const struct sequence_options *options;
    struct sequence_result *result;
    struct sequence_writer *writer;
    uint8_t *levels; /* [projector height][projector width] */
    bool layer_known, layer_on;
    bool sequence_known; /* frames arrive one by one: `sequence` is the next one's number */
    uint32_t sequence;
};

int sequence_estimate(const struct station *station, const struct plan *plan,
                      const struct session *session, struct sequence_needs *needs,
                      struct nacre_error *error)
{
    struct pattern *patterns = NULL;
    size_t count = 0;
    double turns = 0;
    int status = plan_order(plan, &patterns, &count, error);
    *needs = (struct sequence_needs){0};
    for (size_t i = 0; i < count; i++) {
        needs->patterns += !session || !session_has(session, patterns[i]);
    }
    for (size_t i = 0; i < plan->exposure_count; i++) {
        turns += plan->exposure_turns[i];
    }
    uint64_t frame_bytes = (uint64_t)station->camera.width * (uint64_t)station->camera.height * 4;
    needs->exposures = needs->patterns * plan->exposure_count;
    needs->seconds = (double)needs->patterns * turns / station->projector.wheel_hz;
    needs->bytes = needs->exposures * (frame_bytes + PART_HEADER_BYTES);
    free(patterns);
    return status;
}

int sequence_check_disk(const char *path, const struct sequence_needs *needs,
                        struct nacre_error *error)
{
    struct statvfs disk;
    char *copy = strdup(path);
    if (!copy) {
        return nacre_fail_memory(error, "a path");
    }
    int result = statvfs(path, &disk);
    if (result != 0 && errno == ENOENT) {
        result = statvfs(dirname(copy), &disk);
    }
    int number = errno;
    free(copy);
    if (result != 0) {
        return nacre_fail_errno(error, number, "%s: cannot ask for the disk's free space", path);
    }
    uint64_t free_bytes = (uint64_t)disk.f_bavail * disk.f_frsize;
    if (free_bytes < needs->bytes) {
        return nacre_fail(
            error,
            "%s: the disk has %.1f MiB free and the scan may need %.1f MiB; free some "
            "space or put the session on another disk",
            path, (double)free_bytes / 1048576, (double)needs->bytes / 1048576);
    }
    return NACRE_OK;
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

/* Whether the frame is the one that the trigger asked for, by time and by count. */
static int match(struct run *run, const struct exposure *exposure, struct nacre_error *error)
{
    bool counted = run->sequence_known;
    uint32_t expected = run->sequence;
    int64_t late_ns = exposure->frame_ns - exposure->trigger_ns;
    run->sequence_known = true;
    run->sequence = exposure->sequence + 1;
    if (exposure->trigger_ns < exposure->flip_ns) {
        return nacre_fail(error, "was triggered %" PRId64 " ns before its pattern was on the glass",
                          exposure->flip_ns - exposure->trigger_ns);
    }
    bool too_late = !run->devices->camera->free_running && late_ns > run->options->tolerance_ns;
    if (late_ns < 0 || too_late) {
        return nacre_fail(error,
                          "frame %" PRIu32 " began %" PRId64
                          " ns after its trigger, outside 0 to %" PRId64 " ns",
                          exposure->sequence, late_ns, run->options->tolerance_ns);
    }
    if (counted && exposure->sequence != expected) {
        return nacre_fail(error, "frame %" PRIu32 " came where %" PRIu32 " was next",
                          exposure->sequence, expected);
    }
    return NACRE_OK;
}

/* Arm, fire, take once. */
static int expose_once(struct run *run, struct exposure *exposure, struct nacre_error *error)
{
    struct camera *camera = run->devices->camera;
    struct trigger *trigger = run->devices->trigger;
    struct camera_frame frame;
    int status = camera->ops->arm(camera, exposure->exposure_ns, error);
    if (status == NACRE_OK) {
        status = trigger->ops->fire(trigger, exposure->exposure_ns, &exposure->trigger_ns, error);
    }
    if (status == NACRE_OK) {
        status = camera->ops->take(camera, exposure->exposure_ns + DELIVERY_NS, &frame, error);
    }
    if (status != NACRE_OK) {
        run->sequence_known = false; /* nobody knows how many were lost */
        return status;
    }
    exposure->pulse_ns = trigger->pulse.width_ns;
    exposure->pulse_doubt_ns = trigger->pulse.doubt_ns;
    exposure->frame_ns = frame.frame_ns;
    exposure->sequence = frame.sequence;
    status = match(run, exposure, error);
    if (status == NACRE_OK) {
        memcpy(exposure->raw, frame.raw,
               (size_t)camera->width * (size_t)camera->height * sizeof *frame.raw);
    }
    return status;
}

/* Expose until a frame is beyond doubt. */
static int expose(struct run *run, struct exposure *exposure, struct nacre_error *error)
{
    const struct sequence_operator *person = run->person;
    int status = NACRE_FAILED;
    for (int i = 0; i <= run->options->retries && status == NACRE_FAILED; i++) {
        run->result->retries += i > 0;
        status = expose_once(run, exposure, error);
        if (person->exposure_ends) {
            person->exposure_ends(person->context);
        }
    }
    if (status == NACRE_OK) {
        run->result->exposures++;
    } else if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "exposure of %g ms: given up after %d tries",
                                (double)exposure->exposure_ns * 1e-6, run->options->retries + 1);
    }
    return status;
}

static int lay_white_layer(struct run *run, enum pattern_kind kind, struct nacre_error *error)
{
    bool on = pattern_kind_wants_white_layer(kind);
    int status = NACRE_OK;
    if (!run->layer_known || run->layer_on != on) {
        status = run->person->white_layer(run->person->context, on, error);
        status = status == SEQUENCE_INSISTED ? NACRE_OK : status;
        run->layer_known = status == NACRE_OK;
        run->layer_on = on;
    }
    return status;
}

/* Frames with room for every exposure of the plan. */
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
    frames->exposures = calloc(session->plan.exposure_count, sizeof *frames->exposures);
    if (!frames->exposures) {
        return nacre_fail_memory(error, "raw frames");
    }
    frames->count = session->plan.exposure_count;
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

/* Show one pattern, expose it and hand its frames to the writer. */
static int measure(struct run *run, struct pattern pattern, struct nacre_error *error)
{
    struct projector *projector = run->devices->projector;
    struct pattern_frames frames = {0};
    int64_t flip_ns = 0;
    int status = make_frames(run, pattern, &frames, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = lay_white_layer(run, pattern.kind, error);
    if (status != NACRE_OK) {
        goto out;
    }
    plan_draw(&run->session->plan, pattern, projector->width, projector->height, run->levels);
    status = projector->ops->show(projector, run->levels, &flip_ns, error);
    for (size_t i = 0; i < frames.count && status == NACRE_OK; i++) {
        frames.exposures[i].flip_ns = flip_ns;
        status = expose(run, &frames.exposures[i], error);
    }
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "pattern %s %d", pattern_kind_names[pattern.kind],
                                pattern.number);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    status = sequence_writer_put(run->writer, &frames, error);
out:
    pattern_frames_finish(&frames);
    return status;
}

/* Let the person know, and pause or stop where they want it. */
static int begin_pattern(struct run *run, const struct sequence_moment *moment,
                         struct nacre_error *error)
{
    const struct sequence_operator *person = run->person;
    return person->pattern_begins ? person->pattern_begins(person->context, moment, error)
                                  : NACRE_OK;
}

static int measure_missing(struct run *run, const struct pattern *patterns, size_t count,
                           size_t missing, struct progress *progress, struct nacre_error *error)
{
    size_t done = 0;
    for (size_t i = 0; i < count; i++) {
        char detail[96];
        if (session_has(run->session, patterns[i])) {
            run->result->skipped++;
            continue;
        }
        (void)snprintf(detail, sizeof detail, "%s %d, %zu retries",
                       pattern_kind_names[patterns[i].kind], patterns[i].number,
                       run->result->retries);
        int status = progress_step(progress, (double)done, (double)missing, detail, error);
        if (status == NACRE_OK) {
            struct sequence_moment moment = {patterns[i], done, missing, run->result->retries};
            status = begin_pattern(run, &moment, error);
        }
        if (status == NACRE_OK) {
            status = measure(run, patterns[i], error);
        }
        if (status != NACRE_OK) {
            return status;
        }
        done++;
    }
    return NACRE_OK;
}

/* What the devices and the disk must be before the first pattern. */
static int prepare(struct run *run, struct sequence_needs *needs, struct nacre_error *error)
{
    const struct projector *projector = run->devices->projector;
    int status = check_devices(run->devices, run->session, error);
    if (status != NACRE_OK) {
        return status;
    }
    status =
        sequence_estimate(&run->session->station, &run->session->plan, run->session, needs, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = sequence_check_disk(run->session->path, needs, error);
    if (status != NACRE_OK) {
        return status;
    }
    run->levels = malloc((size_t)projector->width * (size_t)projector->height);
    if (!run->levels) {
        return nacre_fail_memory(error, "a pattern");
    }
    return sequence_writer_new(run->session, &run->writer, error);
}

int sequence_run(const struct devices *devices, const struct session *session,
                 const struct sequence_operator *person, const struct sequence_options *options,
                 struct progress *progress, struct sequence_result *result,
                 struct nacre_error *error)
{
    struct run run = {.devices = devices,
                      .session = session,
                      .person = person,
                      .options = options,
                      .result = result};
    struct sequence_needs needs;
    struct pattern *patterns = NULL;
    size_t count = 0;
    int64_t began_ns = clock_now_ns(devices->clock);
    *result = (struct sequence_result){0};
    int status = prepare(&run, &needs, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = plan_order(&session->plan, &patterns, &count, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = measure_missing(&run, patterns, count, needs.patterns, progress, error);
    int written = sequence_writer_finish(run.writer, &result->patterns, &result->bytes,
                                         status == NACRE_OK ? error : NULL);
    status = status == NACRE_OK ? written : status;
out:
    result->station_ns = clock_now_ns(devices->clock) - began_ns;
    sequence_writer_free(run.writer);
    free(run.levels);
    free(patterns);
    return status;
}
