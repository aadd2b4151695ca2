/* nacre plan: grid spacing and window of a scan from a pilot measurement. */
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "rig/develop/adapt.h"
#include "rig/develop/pilot.h"
#include "rig/sequence.h"

#include <jansson.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

struct plan_settings {
    const char *output;
    double leak;
    int window;
    double noise, tails, overlap;
    int block;
    double within_seconds;
};

static const struct option_spec plan_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct plan_settings, output),
     .writes = true,
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
    {.name = "window",
     .kind = OPTION_INT,
     .argument = "K",
     .minimum = 0,
     .maximum = 511,
     .fallback = "0",
     .offset = offsetof(struct plan_settings, window),
     .sentence = "window, odd, at most the pilot's; 0: chosen by --leak"},
    {.name = "noise",
     .kind = OPTION_REAL,
     .argument = "SHARE",
     .minimum = 0,
     .maximum = 1,
     .fallback = "0",
     .offset = offsetof(struct plan_settings, noise),
     .sentence = "adapt the plan: deviation that noise may give a response, over all its entries; "
                 "0: the pilot's exposures and black frames, one spacing, as wide as the window"},
    {.name = "tails",
     .kind = OPTION_REAL,
     .argument = "SHARE",
     .minimum = 1e-6,
     .maximum = 10,
     .fallback = "5 %",
     .offset = offsetof(struct plan_settings, tails),
     .sentence = "of an adapted plan: the same without the entry of the lit point itself"},
    {.name = "overlap",
     .kind = OPTION_REAL,
     .argument = "SHARE",
     .minimum = 1e-6,
     .maximum = 0.5,
     .fallback = "5 %",
     .offset = offsetof(struct plan_settings, overlap),
     .sentence = "of an adapted plan: share of a response's energy that may fall among its grid's "
                 "neighbours, from which developing parts it again"},
    {.name = "block",
     .kind = OPTION_INT,
     .argument = "POINTS",
     .minimum = 0,
     .maximum = 65535,
     .fallback = "16",
     .offset = offsetof(struct plan_settings, block),
     .sentence = "of an adapted plan: side of the regions that are told apart; 0: all alike"},
    {.name = "within",
     .kind = OPTION_SECONDS,
     .argument = "TIME",
     .minimum = 0,
     .maximum = 1e9,
     .fallback = "0",
     .offset = offsetof(struct plan_settings, within_seconds),
     .sentence =
         "of an adapted plan: time of exposing, as 90min or 3h; --noise, --tails and --overlap "
         "are widened until it is kept; 0: as long as it takes"},
    {0}};

/* What was chosen, and what it costs. */
struct choice {
    const struct pilot *pilot;
    const struct plan *plan;
    struct pilot_leak leak;
    struct sequence_needs needs;
    double
        whole_seconds; /* of exposing by the pilot's exposures and a spacing as wide as the window */
    bool adapted;
    struct adapt_result adapted_to;
};

static json_t *adapted_json(const struct choice *choice)
{
    const struct adapt_result *to = &choice->adapted_to;
    return choice->adapted
               ? json_pack("{s:i, s:i, s:i, s:I, s:f, s:f, s:f, s:f, s:I, s:f, s:f}", "narrowest",
                           to->narrowest, "widest", to->widest, "black_frames",
                           choice->plan->black_frames, "exposures",
                           (json_int_t)choice->plan->exposure_count, "noise_mean", to->noise.mean,
                           "noise_worst", to->noise.worst, "tails_mean", to->tails.mean,
                           "tails_worst", to->tails.worst, "noisy", (json_int_t)to->noisy,
                           "widened", to->widened, "without_seconds", choice->whole_seconds)
               : json_null();
}

static int print_json(const char *output, const struct choice *choice, struct nacre_error *error)
{
    return json_print(json_pack("{s:s, s:i, s:i, s:i, s:I, s:f, s:f, s:f, s:I, s:o}", "output",
                                output, "grid_spacing", choice->plan->grid_spacing, "window",
                                choice->plan->window, "grids",
                                plan_shown_count(choice->plan, PATTERN_GRID), "pilot_responses",
                                (json_int_t)choice->pilot->responses, "leak_mean",
                                choice->leak.mean, "leak_worst", choice->leak.worst,
                                "station_seconds", choice->needs.seconds, "bytes_at_most",
                                (json_int_t)choice->needs.bytes, "adapted", adapted_json(choice)),
                      error);
}

static void print_needs(const struct choice *choice)
{
    (void)printf("%-13s %.3g h of exposing, at most %.1f MiB\n", "scan",
                 choice->needs.seconds / 3600, (double)choice->needs.bytes / 1048576);
}

static void print_adapted(const struct choice *choice)
{
    const struct adapt_result *to = &choice->adapted_to;
    const struct plan *plan = choice->plan;
    (void)printf("%-13s spacing %d to %d in %zu regions; exposures of", "adapted", to->narrowest,
                 to->widest, plan->region_count);
    for (size_t e = 0; e < plan->exposure_count; e++) {
        (void)printf(" %g", plan->exposure_turns[e]);
    }
    (void)printf(" turns; %d black frames\n", plan->black_frames);
    (void)printf("%-13s %.2g %%, %.2g %% at worst; off the centre %.2g %%, %.2g %% at worst\n",
                 "noise", 100 * to->noise.mean, 100 * to->noise.worst, 100 * to->tails.mean,
                 100 * to->tails.worst);
    if (to->noisy) {
        (void)printf("%-13s %zu responses of the pilot have more noise than allowed with every "
                     "exposure\n",
                     "", to->noisy);
    }
    if (to->widened > 1) {
        (void)printf(
            "%-13s --noise, --tails and --overlap are widened %.2g times to keep the time\n", "",
            to->widened);
    }
    print_needs(choice);
    (void)printf("%-13s %.3g h with the pilot's exposures and a spacing of %d\n", "",
                 choice->whole_seconds / 3600, plan->window);
}

static void print_text(const char *output, const struct choice *choice)
{
    (void)printf("%-13s %s: grid_spacing %d, window %d, %d grids\n", "plan", output,
                 choice->plan->grid_spacing, choice->plan->window,
                 plan_shown_count(choice->plan, PATTERN_GRID));
    (void)printf("%-13s %.2g %% of the energy, %.2g %% at worst, by %zu responses of the pilot\n",
                 "leaks", 100 * choice->leak.mean, 100 * choice->leak.worst,
                 choice->pilot->responses);
    if (choice->adapted) {
        print_adapted(choice);
        return;
    }
    for (int half = choice->plan->window / 2 - 4; half <= choice->plan->window / 2 + 4; half += 2) {
        if (half > 0 && half < choice->pilot->rings) {
            struct pilot_leak leak = pilot_leak(choice->pilot, half);
            int side = 2 * half + 1;
            (void)printf("%-13s spacing %d, %d grids: %.2g %%, %.2g %% at worst\n", "", side,
                         side * side, 100 * leak.mean, 100 * leak.worst);
        }
    }
    print_needs(choice);
}

/* The pilot's plan with another grid. */
static int set_grid(struct session *session, int half, struct choice *choice,
                    struct nacre_error *error)
{
    struct plan *plan = &session->plan;
    const struct station_sample *sample = &session->station.sample;
    plan->window = 2 * half + 1;
    plan->grid_spacing = plan->window;
    plan->grid_patterns = 0;
    int status = plan_lay(plan, session->path, sample->width, sample->height,
                          choice->pilot->channels, error);
    if (status == NACRE_OK) {
        status = sequence_estimate(&session->station, plan, NULL, &choice->needs, error);
        choice->whole_seconds = choice->needs.seconds;
    }
    return status;
}

static int choose_window(const struct plan_settings *given, const struct pilot *pilot, int *half,
                         struct nacre_error *error)
{
    if (given->window == 0) {
        return pilot_choose(pilot, given->leak, half, error);
    }
    if (given->window % 2 == 0) {
        return nacre_fail(error, "--window %d: is even; use %d or %d", given->window,
                          given->window - 1, given->window + 1);
    }
    *half = given->window / 2;
    return *half < pilot->rings
               ? NACRE_OK
               : nacre_fail(error, "--window %d: the pilot's own is %d; scan a wider pilot",
                            given->window, 2 * pilot->rings - 1);
}

static int choose(const struct plan_settings *given, struct session *session, struct choice *choice,
                  struct nacre_error *error)
{
    const struct adapt_wish wish = {given->overlap, given->noise, given->tails, given->block,
                                    given->within_seconds};
    int half = 0;
    int status = choose_window(given, choice->pilot, &half, error);
    if (status == NACRE_OK) {
        choice->leak = pilot_leak(choice->pilot, half);
        status = set_grid(session, half, choice, error);
    }
    if (status == NACRE_OK && given->noise > 0) {
        choice->adapted = true;
        status = adapt_plan(choice->pilot, &session->station, &wish, &session->plan,
                            &choice->adapted_to, error);
    }
    return status == NACRE_FAILED ? nacre_fail_within(error, "%s", session->path) : status;
}

static int run(const void *settings, const struct invocation *invocation, struct nacre_error *error)
{
    const struct plan_settings *given = settings;
    const char *path = invocation->operands[0];
    struct session session = {0};
    struct pilot pilot = {0};
    struct choice choice = {.pilot = &pilot, .plan = &session.plan};
    char *scratch = NULL;
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
    status = choose(given, &session, &choice, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = settings_write(given->output, &plan_schema, &session.plan, error);
    if (status != NACRE_OK) {
        goto out;
    }
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
        "With --noise the plan is adapted to the sample. Each block of it gets the smallest "
        "spacing "
        "at which its responses leave no more than --overlap among neighbours, which developing "
        "parts among them by the profile of the pilot; the exposures whose noise is no more than "
        "--noise and --tails, long ones only in grids whose points need them; and black frames "
        "until their mean adds no more than a quarter of --tails. Exposures are the pilot's first, "
        "which white needs, and up to three of a ladder of whole turns up to its longest: those "
        "that take the least time.\n\n"
        "Beyond the distance at which the pilot's light is lost in noise the fall is taken to go "
        "on as it was before.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = plan_options,
    .settings_size = sizeof(struct plan_settings),
    .run = run,
};
