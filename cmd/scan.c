/* nacre scan: a whole acquisition in this process. */
#include "cmd/scan_explain.h"
#include "cmd/scan_print.h"
#include "cmd/stand.h"
#include "cmd/verbs.h"
#include "rig/calibration_reuse.h"
#include "rig/person.h"
#include "rig/sequence.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

struct scan_settings {
    const char *station, *plan, *calibration;
    bool resume, dry_run, explain;
    int retries;
    double within;
};

static const struct option_spec scan_options[] = {
    {.name = "station",
     .letter = 's',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct scan_settings, station),
     .sentence = "the station file; may be left out when resuming"},
    {.name = "plan",
     .letter = 'p',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct scan_settings, plan),
     .sentence = "the plan file, instead of the one that the station file names"},
    {.name = "calibration",
     .letter = 'c',
     .kind = OPTION_STRING,
     .argument = "OLD",
     .offset = offsetof(struct scan_settings, calibration),
     .sentence =
         "take white and dots frames over from the session OLD, if a check frame shows that "
         "nothing has moved since"},
    {.name = "resume",
     .letter = 'r',
     .kind = OPTION_FLAG,
     .offset = offsetof(struct scan_settings, resume),
     .sentence = "go on with a session that was interrupted: measure what it lacks"},
    {.name = "dry-run",
     .letter = 'n',
     .kind = OPTION_FLAG,
     .offset = offsetof(struct scan_settings, dry_run),
     .sentence = "only say what would be measured, how long it takes and what disk it needs"},
    {.name = "explain",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct scan_settings, explain),
     .sentence = "measure nothing; list each effect of a virtual station: simulated or not, what "
                 "calls for it, and its cost"},
    {.name = "retries",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = 1000,
     .fallback = "3",
     .offset = offsetof(struct scan_settings, retries),
     .sentence = "how often a lost or doubtful frame is taken again"},
    {.name = "within",
     .letter = 'w',
     .kind = OPTION_SECONDS,
     .argument = "TIME",
     .minimum = 0,
     .maximum = 1e8,
     .fallback = "0",
     .offset = offsetof(struct scan_settings, within),
     .sentence =
         "begin no grid that would not be done in this time (90min, 3h); the grids left are "
         "a random choice, and --resume measures them; 0: no limit"},
    {0}};

/* The settings a scan would use, without making anything. */
static int read_settings(const char *path, const struct scan_settings *settings,
                         struct session *session, struct nacre_error *error)
{
    struct stat found;
    *session = (struct session){0};
    if (!settings->resume && stat(path, &found) == 0) {
        return nacre_fail(error, "%s: exists already; resume it (--resume) or choose another name",
                          path);
    }
    if (settings->resume && !settings->station) {
        return session_open(path, session, error);
    }
    session->path = strdup(path);
    if (!session->path) {
        return nacre_fail_memory(error, "a path");
    }
    return session_read_settings(settings->station, settings->plan, session, error);
}

/* The effects of the station file, or of the session's own. */
static int explain(const struct session *session, const struct scan_settings *settings, bool json,
                   struct nacre_error *error)
{
    char *own = NULL;
    if (asprintf(&own, "%s/station.yaml", session->path) < 0) {
        return nacre_fail_memory(error, "a path");
    }
    int status = scan_explain(session, settings->station ? settings->station : own, json, error);
    free(own);
    return status;
}

/* What would be done, without doing it. */
static int open_calibration(const char *path, const struct session *wanted,
                            struct session *calibration, struct nacre_error *error)
{
    int status = session_open(path, calibration, error);
    return status == NACRE_OK ? calibration_fits(calibration, wanted, error) : status;
}

/* White and dots are not measured where another session's are taken over. */
static void spare_calibration(const struct session *session, struct sequence_needs *needs)
{
    const struct plan *plan = &session->plan;
    size_t spared = (size_t)plan_pattern_count(plan, PATTERN_WHITE) +
                    (size_t)plan_pattern_count(plan, PATTERN_DOTS);
    needs->patterns -= spared;
    needs->exposures -= spared * plan->exposure_count;
    for (size_t e = 0; e < plan->exposure_count; e++) {
        needs->seconds -=
            (double)spared * plan->exposure_turns[e] / session->station.projector.wheel_hz;
    }
}

static int dry_run(const char *path, const struct scan_settings *settings, bool json,
                   struct nacre_error *error)
{
    struct session session = {0};
    struct session calibration = {0};
    struct sequence_needs needs;
    int status = read_settings(path, settings, &session, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = sequence_estimate(&session.station, &session.plan, settings->resume ? &session : NULL,
                               &needs, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (settings->calibration) {
        status = open_calibration(settings->calibration, &session, &calibration, error);
        spare_calibration(&session, &needs);
    }
    if (status == NACRE_OK && (json ? !settings->explain : settings->dry_run)) {
        status = scan_print_plan(&session, &needs, json, error);
    }
    if (status == NACRE_OK && settings->explain) {
        status = explain(&session, settings, json, error);
    }
out:
    session_finish(&calibration);
    session_finish(&session);
    return status;
}

static int lay_white_layer(void *context, bool on, struct nacre_error *error)
{
    (void)error; /* the virtual station always obeys */
    virtual_station_set_white_layer(context, on);
    return NACRE_OK;
}

static int begin_pattern(void *context, const struct sequence_moment *moment,
                         struct nacre_error *error)
{
    (void)error; /* the virtual station is always ready */
    virtual_station_begin_pattern(context, moment->pattern);
    return NACRE_OK;
}

static int go_on(void *context, const struct pattern_frames *before, struct nacre_error *error)
{
    (void)error; /* the virtual station is always ready */
    virtual_station_go_on(context, before);
    return NACRE_OK;
}

/* Who lays the white layer on and takes it off: the virtual station itself, or the person at a real one. */
static struct sequence_operator operator_of(struct stand *stand, struct person *person)
{
    if (stand->simulated) {
        return (struct sequence_operator){.context = stand->simulated,
                                          .white_layer = lay_white_layer,
                                          .pattern_begins = begin_pattern,
                                          .goes_on = go_on};
    }
    return (struct sequence_operator){.context = person,
                                      .white_layer = person_white_layer,
                                      .layer_doubted = person_layer_doubted};
}

static int measure(const char *path, const struct scan_settings *settings, struct stand *stand,
                   const struct session *calibration, struct person *person, bool json,
                   struct nacre_error *error)
{
    struct session session = {0};
    struct sequence_result result;
    const struct sequence_options options = {.retries = settings->retries,
                                             .within_ns = llround(settings->within * 1e9),
                                             .check_layer = !stand->simulated,
                                             .calibration = calibration->path ? calibration : NULL};
    const struct sequence_operator who = operator_of(stand, person);
    int status =
        session_create(path, settings->station, settings->plan, settings->resume, &session, error);
    if (status == NACRE_OK) {
        status = sequence_run(&stand->devices, &session, &who, &options, person->progress, &result,
                              error);
    }
    progress_end(person->progress);
    if (status == NACRE_OK) {
        status = scan_print_result(&result, &session.station, json, error);
    }
    session_finish(&session);
    return status;
}

/* Ask for the disk and open the devices first: where one fails, no session is begun. */
static int prepare(const char *path, const struct scan_settings *settings, struct stand *stand,
                   struct session *calibration, struct nacre_error *error)
{
    struct session wanted = {0};
    struct sequence_needs needs;
    int status = read_settings(path, settings, &wanted, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = sequence_estimate(&wanted.station, &wanted.plan, settings->resume ? &wanted : NULL,
                               &needs, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = sequence_check_disk(path, &needs, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (settings->calibration) {
        status = open_calibration(settings->calibration, &wanted, calibration, error);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    status = stand_open(&wanted.station, stand, error);
out:
    session_finish(&wanted);
    return status;
}

static int scan(const char *path, const struct scan_settings *settings,
                const struct invocation *invocation, struct nacre_error *error)
{
    struct stand stand = {0};
    struct session calibration = {0};
    struct progress progress = progress_begin("scanning", invocation->quiet);
    struct person person;
    int status = person_begin(&person, &progress, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = prepare(path, settings, &stand, &calibration, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = measure(path, settings, &stand, &calibration, &person, invocation->json, error);
out:
    session_finish(&calibration);
    stand_close(&stand);
    person_end(&person);
    return status;
}

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct scan_settings *settings = values;
    const char *path = invocation->operands[0];
    if (settings->plan && !settings->station) {
        (void)nacre_fail(error,
                         "--plan: needs --station too; a session keeps the plan it began with");
        return OPTIONS_WRONG_USAGE;
    }
    if (settings->calibration && settings->resume) {
        (void)nacre_fail(error, "--calibration: is for new sessions; a resumed one has its own");
        return OPTIONS_WRONG_USAGE;
    }
    if (!settings->station && !settings->resume) {
        (void)nacre_fail(error, "%s: a new session needs a station file (--station)", path);
        return OPTIONS_WRONG_USAGE;
    }
    return settings->dry_run || settings->explain ? dry_run(path, settings, invocation->json, error)
                                                  : scan(path, settings, invocation, error);
}

const struct verb verb_scan = {
    .name = "scan",
    .operands = "SESSION --station FILE",
    .summary = "measure a sample: show every pattern of the plan and write the raw frames",
    .text =
        "Shows the calibration patterns and then the grids in random order, takes every exposure "
        "of "
        "each, and writes one file a pattern into the folder SESSION. A pattern's file is whole or "
        "absent, so a scan that was interrupted is resumed with --resume and equals one that was "
        "not.\n\nThe station file describes camera, projector, trigger and the sample's region; "
        "the "
        "driver called virtual simulates them. Then come `nacre develop` and `nacre factor`.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = scan_options,
    .settings_size = sizeof(struct scan_settings),
    .run = run,
};
