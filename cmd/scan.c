/* nacre scan: a whole acquisition in this process. */
#include "cmd/json_print.h"
#include "cmd/scan_explain.h"
#include "cmd/stand.h"
#include "cmd/verbs.h"
#include "rig/calibration_reuse.h"
#include "rig/person.h"
#include "rig/sequence.h"

#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

struct scan_settings {
    const char *station, *plan, *calibration;
    bool resume, dry_run, explain;
    int retries;
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
    {0}};

static void print_duration(const char *label, double seconds)
{
    if (seconds < 60) {
        printf("%-13s %.1f s\n", label, seconds);
    } else {
        int minutes = (int)(seconds / 60);
        printf("%-13s %d h %02d min %02d s\n", label, minutes / 60, minutes % 60,
               (int)(seconds - 60.0 * minutes));
    }
}

static void print_plan(const struct session *session, const struct sequence_needs *needs)
{
    const struct plan *plan = &session->plan;
    printf("%-13s %d white, %d dots, %d black, %d grids\n", "plan",
           plan_pattern_count(plan, PATTERN_WHITE), plan_pattern_count(plan, PATTERN_DOTS),
           plan_pattern_count(plan, PATTERN_BLACK), plan_shown_count(plan, PATTERN_GRID));
    printf("%-13s", "exposures");
    for (size_t i = 0; i < plan->exposure_count; i++) {
        printf(" %g ms", (double)session_exposure_ns(session, i) * 1e-6);
    }
    printf("\n%-13s %zu patterns, %zu frames\n", "to measure", needs->patterns, needs->exposures);
    print_duration("station time", needs->seconds);
    printf("%-13s at most %.1f MiB\n", "disk", (double)needs->bytes / 1048576);
}

static json_t *plan_as_json(const struct session *session, const struct sequence_needs *needs)
{
    json_t *exposures = json_array();
    for (size_t i = 0; i < session->plan.exposure_count; i++) {
        (void)json_array_append_new(exposures, json_integer(session_exposure_ns(session, i)));
    }
    return json_pack("{s:i, s:i, s:i, s:i, s:o, s:I, s:I, s:f, s:I}", "white",
                     plan_pattern_count(&session->plan, PATTERN_WHITE), "dots",
                     plan_pattern_count(&session->plan, PATTERN_DOTS), "black",
                     plan_pattern_count(&session->plan, PATTERN_BLACK), "grids",
                     plan_shown_count(&session->plan, PATTERN_GRID), "exposures_ns", exposures,
                     "patterns_to_measure", (json_int_t)needs->patterns, "frames_to_take",
                     (json_int_t)needs->exposures, "station_seconds", needs->seconds,
                     "bytes_at_most", (json_int_t)needs->bytes);
}

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
static int dry_run(const char *path, const struct scan_settings *settings, bool json,
                   struct nacre_error *error)
{
    struct session session = {0};
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
    if (json && !settings->explain) {
        status = json_print(plan_as_json(&session, &needs), error);
    } else if (settings->dry_run && !json) {
        print_plan(&session, &needs);
    }
    if (settings->explain) {
        status = explain(&session, settings, json, error);
    }
out:
    session_finish(&session);
    return status;
}

/* Where the time of a scan went, in the order in which it is told. */
struct share {
    const char *key, *label;
    int64_t time_ns;
};

enum { SHARES = 9 };

static void list_shares(const struct sequence_times *times, struct share shares[SHARES])
{
    const struct exposer_times *stages = &times->stages;
    const struct share all[SHARES] = {{"exposing", "exposing", stages->exposing_ns},
                                      {"reading_out", "reading out", stages->readout_ns},
                                      {"flips", "waiting for the flip", stages->flip_ns},
                                      {"triggers", "waiting for the trigger", stages->trigger_ns},
                                      {"retakes", "retakes", stages->retakes_ns},
                                      {"checks", "check frames", stages->checks_ns},
                                      {"person", "waiting for the person", times->person_ns},
                                      {"disk", "waiting for the disk", times->disk_ns},
                                      {"rest", "rest", times->rest_ns}};
    memcpy(shares, all, sizeof all);
}

static int print_json(const struct sequence_result *result, const struct station *station,
                      struct nacre_error *error)
{
    struct share shares[SHARES];
    json_t *seconds = json_object();
    json_t *retaken = json_object();
    list_shares(&result->times, shares);
    for (int i = 0; i < SHARES; i++) {
        (void)json_object_set_new(seconds, shares[i].key,
                                  json_real((double)shares[i].time_ns * 1e-9));
    }
    for (int i = 0; i < RETAKES; i++) {
        (void)json_object_set_new(retaken, retake_names[i],
                                  json_integer((json_int_t)result->retaken[i]));
    }
    return json_print(
        json_pack("{s:I, s:I, s:I, s:f, s:I, s:I, s:o, s:I, s:f, s:o, s:f, s:I}", "patterns",
                  (json_int_t)result->patterns, "measured_before", (json_int_t)result->skipped,
                  "taken_over", (json_int_t)result->taken_over, "moved_px", result->moved_px,
                  "frames", (json_int_t)result->exposures, "retries", (json_int_t)result->retries,
                  "retaken", retaken, "insisted", (json_int_t)result->insisted, "station_seconds",
                  (double)result->station_ns * 1e-9, "seconds", seconds, "overhead_turns",
                  sequence_overhead_turns(result, station), "bytes", (json_int_t)result->bytes),
        error);
}

static void print_text(const struct sequence_result *result, const struct station *station)
{
    struct share shares[SHARES];
    const char *between = " (";
    printf("%-13s %zu measured, %zu measured before\n", "patterns", result->patterns,
           result->skipped);
    if (result->taken_over) {
        printf("%-13s %zu patterns taken over; dots moved by %.2f pixels at most\n", "calibration",
               result->taken_over, result->moved_px);
    }
    printf("%-13s %zu, %zu retries", "frames", result->exposures, result->retries);
    for (int i = 0; i < RETAKES; i++) {
        if (result->retaken[i]) {
            printf("%s%s %zu", between, retake_names[i], result->retaken[i]);
            between = ", ";
        }
    }
    printf("%s\n", result->retries ? ")" : "");
    if (result->insisted) {
        printf("%-13s %zu changes of it were insisted on and not seen\n", "white layer",
               result->insisted);
    }
    print_duration("station time", (double)result->station_ns * 1e-9);
    list_shares(&result->times, shares);
    for (int i = 0; i < SHARES; i++) {
        if (shares[i].time_ns > 0) {
            printf("  %-24s %10.1f s  %5.1f %%\n", shares[i].label,
                   (double)shares[i].time_ns * 1e-9,
                   100. * (double)shares[i].time_ns / (double)result->station_ns);
        }
    }
    printf("%-13s %.2f turns of the colour wheel an exposure, beyond exposing and reading out\n",
           "overhead", sequence_overhead_turns(result, station));
    printf("%-13s %.1f MiB\n", "written", (double)result->bytes / 1048576);
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

/* Who lays the white layer on and takes it off: the virtual station itself, or the person at a real one. */
static struct sequence_operator operator_of(struct stand *stand, struct person *person)
{
    if (stand->simulated) {
        return (struct sequence_operator){.context = stand->simulated,
                                          .white_layer = lay_white_layer,
                                          .pattern_begins = begin_pattern};
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
    if (status == NACRE_OK && json) {
        status = print_json(&result, &session.station, error);
    } else if (status == NACRE_OK) {
        print_text(&result, &session.station);
    }
    session_finish(&session);
    return status;
}

static int open_calibration(const char *path, const struct session *wanted,
                            struct session *calibration, struct nacre_error *error)
{
    int status = session_open(path, calibration, error);
    return status == NACRE_OK ? calibration_fits(calibration, wanted, error) : status;
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
