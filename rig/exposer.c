/* Showing, exposing, and matching each frame with its pattern and trigger. */
#include "rig/exposer.h"

#include <inttypes.h>
#include <string.h>

/* A camera that has not delivered this long after an exposure's end has lost the frame. */
static const int64_t DELIVERY_NS = 2000000000;

const char *const retake_names[] = {"show",  "trigger", "lost", "unshown",
                                    "early", "late",    "gap",  NULL};

size_t exposer_retries(const struct exposer *exposer)
{
    size_t sum = 0;
    for (int i = 0; i < RETAKES; i++) {
        sum += exposer->retaken[i];
    }
    return sum;
}

static int64_t sum_times(const struct exposer_times *times)
{
    return times->exposing_ns + times->readout_ns + times->flip_ns + times->trigger_ns +
           times->retakes_ns;
}

void exposer_discard(struct exposer *exposer, const struct exposer *before)
{
    int64_t lost_ns = sum_times(&exposer->times) - sum_times(&before->times);
    int64_t checks_ns = exposer->times.checks_ns;
    exposer->times = before->times;
    exposer->times.checks_ns = checks_ns;
    exposer->times.retakes_ns += lost_ns;
    exposer->exposures = before->exposures;
    exposer->retaken[RETAKE_SHOW]++;
}

static int64_t *account(struct exposer *exposer, int64_t *of)
{
    return exposer->checking ? &exposer->times.checks_ns : of;
}

int exposer_show(struct exposer *exposer, const uint8_t *levels, int64_t *flip_ns,
                 struct nacre_error *error)
{
    struct projector *projector = exposer->devices->projector;
    int status = NACRE_FAILED;
    for (int i = 0; i <= exposer->retries && status == NACRE_FAILED; i++) {
        int64_t began_ns = clock_now_ns(exposer->devices->clock);
        exposer->retaken[RETAKE_SHOW] += i > 0;
        status = projector->ops->show(projector, levels, flip_ns, error);
        int64_t *sum = account(exposer, status == NACRE_OK ? &exposer->times.flip_ns
                                                           : &exposer->times.retakes_ns);
        *sum += clock_now_ns(exposer->devices->clock) - began_ns;
    }
    return status;
}

/* Whether the exposure lies where the trigger asked for it. */
static int match_times(const struct exposer *exposer, const struct exposure *exposure,
                       enum retake *reason, struct nacre_error *error)
{
    bool free_running = exposer->devices->camera->free_running;
    int64_t tolerance_ns = exposer->tolerance_ns;
    int64_t late_ns = exposure->frame_ns - exposure->trigger_ns;
    if (exposure->trigger_ns < exposure->flip_ns) {
        *reason = RETAKE_UNSHOWN;
        return nacre_fail(error, "was triggered %" PRId64 " ns before its pattern was on the glass",
                          exposure->flip_ns - exposure->trigger_ns);
    }
    if (late_ns < (free_running ? 0 : -tolerance_ns) || (!free_running && late_ns > tolerance_ns)) {
        *reason = late_ns < 0 ? RETAKE_EARLY : RETAKE_LATE;
        return nacre_fail(error,
                          "frame %" PRIu32 " began %" PRId64 " ns %s its trigger, where %" PRId64
                          " are allowed",
                          exposure->sequence, late_ns < 0 ? -late_ns : late_ns,
                          late_ns < 0 ? "before" : "after", free_running ? 0 : tolerance_ns);
    }
    return NACRE_OK;
}

/* Whether the frame is the one that the trigger asked for, by time and by count. */
static int match(struct exposer *exposer, const struct exposure *exposure, enum retake *reason,
                 struct nacre_error *error)
{
    bool counted = exposer->sequence_known;
    uint32_t expected = exposer->sequence;
    exposer->sequence_known = true;
    exposer->sequence = exposure->sequence + 1;
    int status = match_times(exposer, exposure, reason, error);
    if (status == NACRE_OK && counted && exposure->sequence != expected) {
        *reason = RETAKE_GAP;
        status = nacre_fail(error, "frame %" PRIu32 " came where %" PRIu32 " was next",
                            exposure->sequence, expected);
    }
    return status;
}

/* Arm, fire, take once. */
static int expose_once(struct exposer *exposer, struct exposure *exposure, enum retake *reason,
                       struct nacre_error *error)
{
    struct camera *camera = exposer->devices->camera;
    struct trigger *trigger = exposer->devices->trigger;
    struct camera_frame frame;
    *reason = RETAKE_TRIGGER;
    int status = camera->ops->arm(camera, exposure->exposure_ns, error);
    if (status == NACRE_OK) {
        status = trigger->ops->fire(trigger, exposure->exposure_ns, &exposure->trigger_ns, error);
    }
    if (status == NACRE_OK) {
        *reason = RETAKE_LOST;
        status = camera->ops->take(camera, exposure->exposure_ns + DELIVERY_NS, &frame, error);
    }
    if (status != NACRE_OK) {
        exposer->sequence_known = false; /* nobody knows how many were lost */
        return status;
    }
    exposure->pulse_ns = trigger->pulse.width_ns;
    exposure->pulse_doubt_ns = trigger->pulse.doubt_ns;
    exposure->frame_ns = frame.frame_ns;
    exposure->sequence = frame.sequence;
    status = match(exposer, exposure, reason, error);
    if (status == NACRE_OK) {
        memcpy(exposure->raw, frame.raw,
               (size_t)camera->width * (size_t)camera->height * sizeof *frame.raw);
    }
    return status;
}

static int64_t between(int64_t low, int64_t value, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

/* A frame that counts: waiting for its beginning, exposing, reading out. */
static void account_frame(struct exposer *exposer, const struct exposure *exposure,
                          int64_t began_ns, int64_t ended_ns)
{
    int64_t first_ns = between(began_ns, exposure->frame_ns, ended_ns);
    int64_t last_ns = between(first_ns, exposure->frame_ns + exposure->exposure_ns, ended_ns);
    *account(exposer, &exposer->times.trigger_ns) += first_ns - began_ns;
    *account(exposer, &exposer->times.exposing_ns) += last_ns - first_ns;
    *account(exposer, &exposer->times.readout_ns) += ended_ns - last_ns;
    exposer->exposures += !exposer->checking;
}

int exposer_expose(struct exposer *exposer, struct exposure *exposure, struct nacre_error *error)
{
    enum retake reason = RETAKE_LOST;
    int status = NACRE_FAILED;
    for (int i = 0; i <= exposer->retries && status == NACRE_FAILED; i++) {
        int64_t began_ns = clock_now_ns(exposer->devices->clock);
        exposer->retaken[reason] += i > 0;
        status = expose_once(exposer, exposure, &reason, error);
        int64_t ended_ns = clock_now_ns(exposer->devices->clock);
        if (status == NACRE_OK) {
            account_frame(exposer, exposure, began_ns, ended_ns);
        } else {
            *account(exposer, &exposer->times.retakes_ns) += ended_ns - began_ns;
        }
        if (exposer->tried) {
            exposer->tried(exposer->context);
        }
    }
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "exposure of %g ms: given up after %d tries",
                                (double)exposure->exposure_ns * 1e-6, exposer->retries + 1);
    }
    return status;
}
