/* Printing what a scan needs and what it took. */
#include "cmd/scan_print.h"

#include "cmd/json_print.h"

#include <jansson.h>
#include <stdio.h>
#include <string.h>

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

int scan_print_plan(const struct session *session, const struct sequence_needs *needs, bool json,
                    struct nacre_error *error)
{
    if (json) {
        return json_print(plan_as_json(session, needs), error);
    }
    print_plan(session, needs);
    return NACRE_OK;
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
        json_pack("{s:I, s:I, s:I, s:I, s:f, s:I, s:I, s:o, s:I, s:f, s:o, s:f, s:I}", "patterns",
                  (json_int_t)result->patterns, "left", (json_int_t)result->left, "measured_before",
                  (json_int_t)result->skipped, "taken_over", (json_int_t)result->taken_over,
                  "moved_px", result->moved_px, "frames", (json_int_t)result->exposures, "retries",
                  (json_int_t)result->retries, "retaken", retaken, "insisted",
                  (json_int_t)result->insisted, "station_seconds",
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
    if (result->left) {
        printf("%-13s %zu grids for which there was no time; --resume measures them\n", "left",
               result->left);
    }
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

int scan_print_result(const struct sequence_result *result, const struct station *station,
                      bool json, struct nacre_error *error)
{
    if (json) {
        return print_json(result, station, error);
    }
    print_text(result, station);
    return NACRE_OK;
}
