/* nacre plan: grid spacing and window of a scan from a pilot measurement. */
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "rig/develop/pilot.h"
#include "rig/sequence.h"

#include <jansson.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

struct plan_settings {
    const char *output;
    double leak;
};

static const struct option_spec plan_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct plan_settings, output),
     .sentence = "the plan to be written"},
    {.name = "leak",
     .kind = OPTION_REAL,
     .argument = "SHARE",
     .minimum = 1e-6,
     .maximum = 0.5,
     .fallback = "1 %",
     .offset = offsetof(struct plan_settings, leak),
     .sentence = "share of a response's energy that may fall outside its window, and into the "
                 "windows of its neighbours"},
    {0}};

/* What was chosen, and what it costs. */
struct choice {
    const struct pilot *pilot;
    const struct plan *plan;
    struct pilot_leak leak;
    struct sequence_needs needs;
};

static int print_json(const char *output, const struct choice *choice, struct nacre_error *error)
{
    return json_print(
        json_pack("{s:s, s:i, s:i, s:i, s:I, s:f, s:f, s:f, s:I}", "output", output, "grid_spacing",
                  choice->plan->grid_spacing, "window", choice->plan->window, "grids",
                  plan_shown_count(choice->plan, PATTERN_GRID), "pilot_responses",
                  (json_int_t)choice->pilot->responses, "leak_mean", choice->leak.mean,
                  "leak_worst", choice->leak.worst, "station_seconds", choice->needs.seconds,
                  "bytes_at_most", (json_int_t)choice->needs.bytes),
        error);
}

static void print_text(const char *output, const struct choice *choice)
{
    (void)printf("%-13s %s: grid_spacing %d, window %d, %d grids\n", "plan", output,
                 choice->plan->grid_spacing, choice->plan->window,
                 plan_shown_count(choice->plan, PATTERN_GRID));
    (void)printf("%-13s %.2g %% of the energy, %.2g %% at worst, by %zu responses of the pilot\n",
                 "leaks", 100 * choice->leak.mean, 100 * choice->leak.worst,
                 choice->pilot->responses);
    for (int half = choice->plan->window / 2 - 4; half <= choice->plan->window / 2 + 4; half += 2) {
        if (half > 0 && half < choice->pilot->rings) {
            struct pilot_leak leak = pilot_leak(choice->pilot, half);
            int side = 2 * half + 1;
            (void)printf("%-13s spacing %d, %d grids: %.2g %%, %.2g %% at worst\n", "", side,
                         side * side, 100 * leak.mean, 100 * leak.worst);
        }
    }
    (void)printf("%-13s %.2f h of exposing, at most %.1f MiB\n", "scan",
                 choice->needs.seconds / 3600, (double)choice->needs.bytes / 1048576);
}

/* The pilot's plan with another grid. */
static int write_plan(const char *output, struct plan *plan, int half, struct nacre_error *error)
{
    plan->window = 2 * half + 1;
    plan->grid_spacing = plan->window;
    plan->grid_patterns = 0;
    return settings_write(output, &plan_schema, plan, error);
}

static int run(const void *settings, const struct invocation *invocation, struct nacre_error *error)
{
    const struct plan_settings *given = settings;
    const char *path = invocation->operands[0];
    struct session session = {0};
    struct pilot pilot = {0};
    char *scratch = NULL;
    int half = 0;
    struct progress progress = progress_begin("developing the pilot", invocation->quiet);
    int status = session_open(path, &session, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (asprintf(&scratch, "%s.pilot", given->output) < 0) {
        scratch = NULL;
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    status = pilot_read(path, scratch, &progress, &pilot, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = pilot_choose(&pilot, given->leak, &half, error);
    if (status != NACRE_OK) {
        status = nacre_fail_within(error, "%s", path);
        goto out;
    }
    status = write_plan(given->output, &session.plan, half, error);
    if (status != NACRE_OK) {
        goto out;
    }
    struct choice choice = {&pilot, &session.plan, pilot_leak(&pilot, half), {0}};
    status = sequence_estimate(&session.station, &session.plan, NULL, &choice.needs, error);
    if (status != NACRE_OK) {
        goto out;
    }
    progress_end(&progress);
    if (invocation->json) {
        status = print_json(given->output, &choice, error);
    } else {
        print_text(given->output, &choice);
    }
out:
    progress_end(&progress);
    pilot_finish(&pilot);
    session_finish(&session);
    free(scratch);
    return status;
}

const struct verb verb_plan = {
    .name = "plan",
    .operands = "PILOT -o PLAN",
    .summary = "choose grid spacing and window by a pilot scan",
    .text =
        "Develops a pilot: a session with few grids (grid_patterns in its plan) whose lit points "
        "are so far apart, and whose window is so wide, that all of a response is seen. From how "
        "the light falls with distance it chooses the smallest spacing, and a window as wide, at "
        "which no more than --leak of any response's energy in any colour falls outside the "
        "window. What falls outside falls into the windows of neighbours lit at the same time, so "
        "the same share of their energy is foreign. The plan that is written is the pilot's with "
        "these two numbers and all grids.\n\n"
        "Beyond the distance at which the pilot's light is lost in noise the fall is taken to go "
        "on as it was before.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = plan_options,
    .settings_size = sizeof(struct plan_settings),
    .run = run,
};
