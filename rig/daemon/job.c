/* The running scan: a thread that runs the sequencer, and what others ask of it, under one mutex. */
#include "rig/daemon/job.h"

#include "rig/sequence.h"
#include "rig/session.h"

#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <unistd.h>

/* Of one exposure, after the first try. */
enum { RETRIES = 3 };

/* A camera is given so long beyond the exposure for its frame, and again to be opened anew; a trigger waits for three
 * turns of the wheel, or so long. Opening a display anew compiles shaders. */
static const int64_t DEVICES_NS = 6000000000, OPENING_NS = 30000000000;

struct job {
    struct job_opener opener;
    int event;
    pthread_t thread;
    bool joinable;
    /* The order; the thread's own while it runs. */
    char *path, *station;
    int plan;               /* memory that holds the plan's text as a file; < 0: none */
    bool unfinished;        /* of the order */
    struct session session; /* what is measured: open if it is resumed, else only its settings */
    size_t skipped;         /* patterns that the session had before */
    /* Under the mutex. */
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    struct job_status status;
    bool confirmed, insisted;
    char doubt[512];           /* what a check frame showed, for the next question */
    int64_t life_ns;           /* last sign of life */
    int64_t limit_ns;          /* longest time between two */
    int64_t begun_ns, held_ns; /* first pattern; time spent in pauses and waits since */
    double estimate;           /* seconds of one pattern, before any was measured */
};

static int64_t now_ns(void)
{
    struct clock clock = clock_monotonic();
    return clock_now_ns(&clock);
}

bool job_is_active(enum job_state state)
{
    return state == JOB_PREPARING || state == JOB_RUNNING || state == JOB_WAITING ||
           state == JOB_PAUSED;
}

static bool is_held(enum job_state state)
{
    return state == JOB_WAITING || state == JOB_PAUSED;
}

/* Let everybody look at the status; the mutex is held. */
static void tell(struct job *job)
{
    uint64_t one = 1;
    (void)!write(job->event, &one,
                 sizeof one); /* full only if nobody reads, who then finds it all */
    (void)pthread_cond_broadcast(&job->changed);
}

static void set_state(struct job *job, enum job_state state)
{
    job->status.state = state;
    tell(job);
}

int job_new(const struct job_opener *opener, struct job **job, struct nacre_error *error)
{
    int status = NACRE_OK;
    struct job *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "a job");
        goto out;
    }
    made->opener = *opener;
    made->plan = -1;
    made->event = -1;
    (void)pthread_mutex_init(&made->mutex, NULL); /* default attributes cannot fail on Linux */
    (void)pthread_cond_init(&made->changed, NULL);
    made->event = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (made->event < 0) {
        status = nacre_fail_errno(error, errno, "cannot make an eventfd");
    }
out:
    if (status != NACRE_OK) {
        job_free(made);
        made = NULL;
    }
    *job = made;
    return status;
}

/* Wait for the last job's thread and forget its order. */
static void finish_last(struct job *job)
{
    if (job->joinable) {
        (void)pthread_join(job->thread, NULL);
        job->joinable = false;
    }
    if (job->plan >= 0) {
        (void)close(job->plan); /* memory */
        job->plan = -1;
    }
    session_finish(&job->session);
    free(job->path);
    free(job->station);
    job->path = NULL;
    job->station = NULL;
}

void job_free(struct job *job)
{
    if (!job) {
        return;
    }
    (void)job_cancel(job, NULL); /* there may be nothing to stop */
    finish_last(job);
    if (job->event >= 0) {
        (void)close(job->event);
    }
    (void)pthread_cond_destroy(&job->changed);
    (void)pthread_mutex_destroy(&job->mutex);
    free(job);
}

int job_event_fd(const struct job *job)
{
    return job->event;
}

void job_clear_event(struct job *job)
{
    uint64_t count;
    (void)!read(job->event, &count, sizeof count); /* empty if nothing has changed */
}

void job_read(struct job *job, struct job_status *status)
{
    (void)pthread_mutex_lock(&job->mutex);
    *status = job->status;
    (void)pthread_mutex_unlock(&job->mutex);
}

/* Stay in `state` until `until` is set, or the job is to stop. The mutex is held. */
static int hold(struct job *job, enum job_state state, const bool *until, bool value,
                struct nacre_error *error)
{
    int64_t began_ns = now_ns();
    if (*until != value && !job->status.stopping) {
        set_state(job, state);
    }
    while (*until != value && !job->status.stopping) {
        (void)pthread_cond_wait(&job->changed, &job->mutex);
    }
    job->life_ns = now_ns();
    job->held_ns += job->life_ns - began_ns;
    if (job->status.stopping) {
        (void)nacre_fail(error, "stopped on request");
        return NACRE_CANCELLED;
    }
    job->status.message[0] = '\0';
    set_state(job, JOB_RUNNING);
    return NACRE_OK;
}

/* What the person is asked; the mutex is held. */
static void word_question(struct job *job, bool on)
{
    const char *doubt = job->doubt;
    (void)snprintf(job->status.message, sizeof job->status.message, "%s%s%s, then confirm%s", doubt,
                   *doubt ? "; " : "",
                   on ? "lay the white diffuse layer on the sample"
                      : "take the white diffuse layer off the sample",
                   *doubt ? "; if you are sure that it is right, insist (nacre confirm --insist)"
                          : "");
    job->doubt[0] = '\0';
}

/* Ask the person and wait for the answer; then for a pause to end that was asked for meanwhile. */
static int lay_white_layer(void *context, bool on, struct nacre_error *error)
{
    struct job *job = context;
    (void)pthread_mutex_lock(&job->mutex);
    word_question(job, on);
    job->confirmed = false;
    job->insisted = false;
    int status = hold(job, JOB_WAITING, &job->confirmed, true, error);
    if (status == NACRE_OK) {
        status = hold(job, JOB_PAUSED, &job->status.pausing, false, error);
    }
    if (status == NACRE_OK && job->insisted) {
        status = SEQUENCE_INSISTED;
    }
    (void)pthread_mutex_unlock(&job->mutex);
    if (status >= NACRE_OK && job->opener.white_layer) {
        job->opener.white_layer(job->opener.context, on);
    }
    return status;
}

static void doubt_layer(void *context, const char *why)
{
    struct job *job = context;
    (void)pthread_mutex_lock(&job->mutex);
    (void)snprintf(job->doubt, sizeof job->doubt, "%s", why);
    (void)pthread_mutex_unlock(&job->mutex);
}

/* What the patterns so far took, without pauses; before the first, what they ought to take. */
static double seconds_left(const struct job *job, const struct sequence_moment *moment)
{
    double each = job->estimate;
    if (moment->measured > 0) {
        each = (double)(now_ns() - job->begun_ns - job->held_ns) * 1e-9 / (double)moment->measured;
    }
    return each * (double)(moment->wanted - moment->measured);
}

static int begin_pattern(void *context, const struct sequence_moment *moment,
                         struct nacre_error *error)
{
    struct job *job = context;
    struct job_status *known = &job->status;
    (void)pthread_mutex_lock(&job->mutex);
    if (moment->measured == 0) {
        job->begun_ns = now_ns();
        job->held_ns = 0;
    }
    known->pattern = moment->pattern;
    known->done = job->skipped + moment->measured;
    known->retries = moment->retries;
    known->seconds_left = seconds_left(job, moment);
    int status = hold(job, JOB_PAUSED, &known->pausing, false, error);
    (void)pthread_mutex_unlock(&job->mutex);
    return status;
}

static void show_life(void *context)
{
    struct job *job = context;
    (void)pthread_mutex_lock(&job->mutex);
    job->life_ns = now_ns();
    (void)pthread_mutex_unlock(&job->mutex);
}

/* Open the devices, and only then make the session if there is none: where one fails, none is begun. */
static int open_devices(struct job *job, struct devices *devices, struct nacre_error *error)
{
    char plan[32];
    int status = job->opener.open(job->opener.context, &job->session.station, devices, error);
    if (status != NACRE_OK || !job->station) {
        return status;
    }
    session_finish(&job->session);
    (void)snprintf(plan, sizeof plan, "/proc/self/fd/%d", job->plan);
    status = session_create(job->path, job->station, job->plan >= 0 ? plan : NULL, job->unfinished,
                            &job->session, error);
    if (status != NACRE_OK) {
        job->opener.close(job->opener.context, devices);
    }
    return status;
}

static int measure(struct job *job, struct sequence_result *result, struct nacre_error *error)
{
    const struct sequence_options options = {.retries = RETRIES,
                                             .check_layer = job->opener.check_layer};
    const struct sequence_operator person = {.context = job,
                                             .white_layer = lay_white_layer,
                                             .pattern_begins = begin_pattern,
                                             .exposure_ends = show_life,
                                             .layer_doubted = doubt_layer};
    struct devices devices = {0};
    if (job->skipped == job->status.patterns) {
        return NACRE_OK; /* a session that lacks nothing needs no devices */
    }
    int status = open_devices(job, &devices, error);
    if (status != NACRE_OK) {
        return status;
    }
    show_life(job);
    status = sequence_run(&devices, &job->session, &person, &options, NULL, result, error);
    job->opener.close(job->opener.context, &devices);
    return status;
}

static void *work(void *context)
{
    struct job *job = context;
    struct nacre_error error = {""};
    struct sequence_result result = {0};
    int status = measure(job, &result, &error);
    session_finish(&job->session); /* gives back its lock */
    (void)pthread_mutex_lock(&job->mutex);
    job->status.done = job->skipped + result.patterns;
    job->status.retries = result.retries;
    job->status.seconds_left = 0;
    job->status.pausing = false;
    job->status.stopping = false;
    (void)snprintf(job->status.message, sizeof job->status.message, "%s", error.text);
    set_state(job, status == NACRE_OK          ? JOB_DONE
                   : status == NACRE_CANCELLED ? JOB_CANCELLED
                                               : JOB_FAILED);
    (void)pthread_mutex_unlock(&job->mutex);
    return NULL;
}

/* A file in memory with the plan's text, as sessions are made from files. */
static int keep_plan(struct job *job, const char *text, struct nacre_error *error)
{
    size_t size = strlen(text);
    job->plan = memfd_create("plan", MFD_CLOEXEC);
    if (job->plan < 0 || write(job->plan, text, size) != (ssize_t)size) {
        return nacre_fail_errno(error, errno, "cannot keep the plan in memory");
    }
    return NACRE_OK;
}

/* Read what the order names; a session that is resumed is locked from here on. */
static int read_order(struct job *job, const struct job_order *order, struct nacre_error *error)
{
    char plan[32];
    int status = NACRE_OK;
    if (!order->station) {
        return session_create(order->path, NULL, NULL, true, &job->session, error);
    }
    if (order->plan) {
        status = keep_plan(job, order->plan, error);
    }
    if (status == NACRE_OK) {
        (void)snprintf(plan, sizeof plan, "/proc/self/fd/%d", job->plan);
        status =
            session_read_settings(order->station, order->plan ? plan : NULL, &job->session, error);
    }
    return status;
}

/* Copy the order, and find out what there is to do. */
static int take_order(struct job *job, const struct job_order *order, struct sequence_needs *needs,
                      struct nacre_error *error)
{
    struct session *session = &job->session;
    struct sequence_needs all;
    job->path = strdup(order->path);
    job->station = order->station ? strdup(order->station) : NULL;
    job->unfinished = order->unfinished;
    if (!job->path || (order->station && !job->station)) {
        return nacre_fail_memory(error, "an order");
    }
    int status = read_order(job, order, error);
    if (status == NACRE_OK) {
        status = sequence_estimate(&session->station, &session->plan, NULL, &all, error);
    }
    if (status == NACRE_OK) {
        status = sequence_estimate(&session->station, &session->plan,
                                   order->station ? NULL : session, needs, error);
    }
    if (status == NACRE_OK) {
        status = sequence_check_disk(order->path, needs, error);
    }
    if (status == NACRE_OK) {
        job->skipped = all.patterns - needs->patterns;
        job->estimate = all.patterns ? all.seconds / (double)all.patterns : 0;
    }
    return status;
}

/* The longest time in which a job that moves on may give no sign of it. */
static int64_t longest_silence_ns(const struct session *session)
{
    double turns = session->plan.exposure_turns[session->plan.exposure_count - 1];
    return (int64_t)((turns + 3) / session->station.projector.wheel_hz * 1e9) + DEVICES_NS;
}

int job_start(struct job *job, const struct job_order *order, struct nacre_error *error)
{
    struct job_status now;
    struct sequence_needs needs = {0};
    const char *name = strrchr(order->path, '/');
    job_read(job, &now);
    if (job_is_active(now.state)) {
        return nacre_fail(error, "%s is being measured; wait for it or stop it (nacre cancel)",
                          now.name);
    }
    finish_last(job);
    int status = take_order(job, order, &needs, error);
    if (status != NACRE_OK) {
        finish_last(job);
        return status;
    }
    (void)pthread_mutex_lock(&job->mutex);
    job->status = (struct job_status){.number = now.number + 1,
                                      .patterns = job->skipped + needs.patterns,
                                      .done = job->skipped,
                                      .seconds_left = needs.seconds};
    (void)snprintf(job->status.name, sizeof job->status.name, "%s", name ? name + 1 : order->path);
    job->life_ns = now_ns();
    job->limit_ns = longest_silence_ns(&job->session);
    job->doubt[0] = '\0';
    int number = pthread_create(&job->thread, NULL, work, job);
    job->joinable = number == 0;
    if (number != 0) {
        (void)snprintf(job->status.message, sizeof job->status.message, "cannot start a thread");
    }
    set_state(job, number == 0 ? JOB_PREPARING : JOB_FAILED);
    (void)pthread_mutex_unlock(&job->mutex);
    return number == 0 ? NACRE_OK : nacre_fail_errno(error, number, "cannot start a thread");
}

/* What may be asked of an active job only. */
enum request { REQUEST_PAUSE, REQUEST_RESUME, REQUEST_CONFIRM, REQUEST_INSIST, REQUEST_CANCEL };

static int obey(struct job *job, enum request request, struct nacre_error *error)
{
    struct job_status *known = &job->status;
    switch (request) {
    case REQUEST_PAUSE:
        known->pausing = true;
        break;
    case REQUEST_RESUME:
        if (!known->pausing) {
            return nacre_fail(error, "%s is not paused", known->name);
        }
        known->pausing = false;
        break;
    case REQUEST_CONFIRM:
    case REQUEST_INSIST:
        if (known->state != JOB_WAITING) {
            return nacre_fail(error, "%s waits for nobody; there is nothing to confirm",
                              known->name);
        }
        job->confirmed = true;
        job->insisted = request == REQUEST_INSIST;
        break;
    case REQUEST_CANCEL:
        known->stopping = true;
        job->life_ns = now_ns(); /* whoever was waited for is waited for no longer */
        break;
    }
    tell(job);
    return NACRE_OK;
}

static int ask(struct job *job, enum request request, struct nacre_error *error)
{
    (void)pthread_mutex_lock(&job->mutex);
    int status = job_is_active(job->status.state)
                     ? obey(job, request, error)
                     : nacre_fail(error, "no scan is running; begin one with nacre start");
    (void)pthread_mutex_unlock(&job->mutex);
    return status;
}

int job_pause(struct job *job, struct nacre_error *error)
{
    return ask(job, REQUEST_PAUSE, error);
}

int job_resume(struct job *job, struct nacre_error *error)
{
    return ask(job, REQUEST_RESUME, error);
}

int job_confirm(struct job *job, struct nacre_error *error)
{
    return ask(job, REQUEST_CONFIRM, error);
}

int job_insist(struct job *job, struct nacre_error *error)
{
    return ask(job, REQUEST_INSIST, error);
}

int job_cancel(struct job *job, struct nacre_error *error)
{
    return ask(job, REQUEST_CANCEL, error);
}

bool job_is_alive(struct job *job, int64_t slack_ns)
{
    (void)pthread_mutex_lock(&job->mutex);
    enum job_state state = job->status.state;
    bool held = is_held(state) && !job->status.stopping;
    int64_t limit_ns = job->limit_ns + (state == JOB_PREPARING ? OPENING_NS : 0);
    bool alive = !job_is_active(state) || held || now_ns() - job->life_ns <= limit_ns + slack_ns;
    (void)pthread_mutex_unlock(&job->mutex);
    return alive;
}
