/* nacre simulate: the exact responses of a described sample. */
#include "base/clock.h"
#include "base/picture.h"
#include "cmd/effects_print.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "rig/virtual/explain.h"
#include "rig/virtual/sample.h"
#include "rig/virtual/solver.h"
#include "rig/virtual/transport.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>

struct simulate_settings {
    const char *output, *picture;
    int window, seed;
    double tolerance;
    bool explain;
};

static const struct option_spec simulate_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "SCAN",
     .offset = offsetof(struct simulate_settings, output),
     .writes = true,
     .sentence = "the scan file to write"},
    {.name = "window",
     .letter = 'w',
     .kind = OPTION_INT,
     .argument = "K",
     .minimum = 1,
     .maximum = 1023,
     .fallback = "25",
     .offset = offsetof(struct simulate_settings, window),
     .sentence = "surface points along a side of each response, odd"},
    {.name = "picture",
     .kind = OPTION_STRING,
     .argument = "IMAGE",
     .offset = offsetof(struct simulate_settings, picture),
     .sentence = "also write the sample as it looks in even light, as .exr or .png"},
    {.name = "tolerance",
     .kind = OPTION_REAL,
     .argument = "E",
     .minimum = 1e-4,
     .maximum = 1,
     .offset = offsetof(struct simulate_settings, tolerance),
     .sentence = "relative error of a response that is accepted; decides which solver is taken"},
    {.name = "seed",
     .kind = OPTION_INT,
     .argument = "N",
     .minimum = 0,
     .maximum = 2147483647,
     .fallback = "1",
     .offset = offsetof(struct simulate_settings, seed),
     .sentence = "of the paths where Monte Carlo is taken"},
    {.name = "explain",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct simulate_settings, explain),
     .sentence = "list each effect: simulated or not, why, and its cost"},
    {0}};

static int explain(const char *path, const struct sample *sample, const struct transport *transport,
                   const struct solver_choice *choice, bool json, struct nacre_error *error)
{
    struct effects_subject subject = {
        NULL, path, "s", 1,
        "Seconds are estimates for one core; effects without any cost "
        "nothing beyond the others'."};
    struct effect *effects = NULL;
    size_t count = 0;
    int status = explain_effects(sample, transport, choice, &effects, &count, error);
    if (!status) {
        status = effects_print(&subject, effects, count, json, error);
    }
    free(effects);
    return status;
}

/* The sample under an irradiance of 1 everywhere. */
static int write_picture(struct transport *transport, const char *path, struct nacre_error *error)
{
    struct transport_facts facts = transport_facts(transport);
    size_t points = (size_t)facts.width * (size_t)facts.height;
    struct picture picture = {0};
    float *light = calloc(points, 2 * 3 * sizeof *light);
    int status = NACRE_OK;
    if (!light) {
        status = nacre_fail_memory(error, "the picture");
        goto out;
    }
    for (size_t i = 0; i < 3 * points; i++) {
        light[i] = 1;
    }
    const float *seen = light + 3 * points;
    status = transport_apply(transport, light, light + 3 * points, error);
    if (!status) {
        status = picture_allocate(&picture, facts.width, facts.height, error);
    }
    if (status) {
        goto out;
    }
    for (size_t i = 0; i < 3 * points; i++) {
        picture.rgb[i] = seen[i % 3 * points + i / 3];
    }
    status = picture_write(path, &picture, NULL, error);
out:
    picture_finish(&picture);
    free(light);
    return status;
}

/* What a scan was made by, and how it went. */
struct outcome {
    const struct solver_choice *choice;
    double seconds;
    double deviation; /* Monte Carlo's relative standard error */
};

static int print_json(const struct transport_facts *facts, const struct simulate_settings *settings,
                      const struct outcome *outcome, struct nacre_error *error)
{
    json_t *result = json_pack("{s:s, s:s, s:i, s:i, s:i, s:f, s:f}", "output", settings->output,
                               "solver", solver_name(outcome->choice->solver), "width",
                               facts->width, "height", facts->height, "window", settings->window,
                               "pitch_mm", facts->pitch_mm, "seconds", outcome->seconds);
    json_t *more = json_object();
    if (outcome->choice->solver == SOLVER_DIFFUSION) {
        json_decref(more);
        more = json_pack("{s:[i,i,i], s:i, s:f, s:f}", "voxels", facts->voxels[0], facts->voxels[1],
                         facts->voxels[2], "subdivide", facts->subdivide, "outside_mean",
                         facts->outside_mean, "outside_max", facts->outside_max);
    } else if (outcome->choice->solver == SOLVER_MONTECARLO) {
        json_decref(more);
        more = json_pack("{s:I, s:f}", "paths", (json_int_t)outcome->choice->paths,
                         "standard_error", outcome->deviation);
    }
    if (result && json_object_update(result, more)) {
        json_decref(result);
        result = NULL;
    }
    json_decref(more);
    return json_print(result, error);
}

static int print_result(const struct transport *transport, const struct simulate_settings *settings,
                        const struct outcome *outcome, bool json, struct nacre_error *error)
{
    struct transport_facts facts = transport_facts(transport);
    if (json) {
        return print_json(&facts, settings, outcome, error);
    }
    printf("%s: %d x %d responses of %d x %d, R G B, pitch %g mm\n", settings->output, facts.width,
           facts.height, settings->window, settings->window, facts.pitch_mm);
    if (outcome->choice->solver == SOLVER_DIFFUSION) {
        printf("diffusion on %d x %d x %d voxels of %.3g mm, %.1f s\n", facts.voxels[0],
               facts.voxels[1], facts.voxels[2], facts.cell_mm, outcome->seconds);
        printf("light beyond the window: mean %.2g %%, max %.2g %%\n", 100 * facts.outside_mean,
               100 * facts.outside_max);
    } else if (outcome->choice->solver == SOLVER_MONTECARLO) {
        printf("Monte Carlo, %llu paths a point and channel, %.1f s\n",
               (unsigned long long)outcome->choice->paths, outcome->seconds);
        printf("standard error of a response: %.2g %%\n", 100 * outcome->deviation);
    } else {
        printf("closed form of a homogeneous slab, %.1f s\n", outcome->seconds);
    }
    return NACRE_OK;
}

static int write_scan(const struct sample *sample, struct transport *transport,
                      const struct solver_choice *choice, const struct simulate_settings *settings,
                      const struct invocation *invocation, struct nacre_error *error)
{
    struct clock clock = clock_monotonic();
    int64_t begun = clock_now_ns(&clock);
    struct progress progress = progress_begin("simulating", invocation->quiet);
    struct outcome outcome = {.choice = choice};
    int status = NACRE_OK;
    switch (choice->solver) {
    case SOLVER_CLOSED:
        status = solver_write_closed(sample, settings->window, settings->output, &progress, error);
        break;
    case SOLVER_MONTECARLO:
        status = solver_write_montecarlo(sample, choice, settings->window, (uint32_t)settings->seed,
                                         settings->output, &progress, &outcome.deviation, error);
        break;
    case SOLVER_DIFFUSION:
    case SOLVERS:
        status =
            transport_write_scan(transport, settings->window, settings->output, &progress, error);
        break;
    }
    progress_end(&progress);
    if (status) {
        return status;
    }
    outcome.seconds = (double)(clock_now_ns(&clock) - begun) * 1e-9;
    bool json = invocation->json && !settings->explain;
    return print_result(transport, settings, &outcome, json, error);
}

/* Lay out the sample and choose a solver, which may want finer voxels. */
static int prepare(struct sample *sample, const struct simulate_settings *settings,
                   struct transport **transport, struct solver_choice *choice,
                   struct nacre_error *error)
{
    int status = transport_new(sample, transport, error);
    if (status) {
        return status;
    }
    int subdivide = transport_facts(*transport).subdivide;
    status = solver_choose(sample, settings->window, settings->tolerance,
                           explain_diffusion_seconds(*transport, settings->window), subdivide,
                           choice, error);
    if (!status && choice->solver == SOLVER_DIFFUSION && choice->subdivide != subdivide) {
        sample->voxels.subdivide = choice->subdivide;
        transport_free(*transport);
        *transport = NULL;
        status = transport_new(sample, transport, error);
    }
    return status;
}

static int run(const void *given, const struct invocation *invocation, struct nacre_error *error)
{
    const struct simulate_settings *settings = given;
    const char *path = invocation->operands[0];
    struct transport *transport = NULL;
    struct sample sample = {0};
    struct solver_choice choice = {0};
    int status = NACRE_OK;
    if (!settings->output && !settings->explain && !settings->picture) {
        (void)nacre_fail(error, "nothing to make; give -o SCAN, --picture IMAGE or --explain");
        return OPTIONS_WRONG_USAGE;
    }
    if (settings->window % 2 == 0) {
        return nacre_fail(error, "--window %d: must be odd", settings->window);
    }
    if (settings->explain && invocation->json && settings->output) {
        (void)nacre_fail(error, "--json prints one result; give --explain or -o, not both");
        return OPTIONS_WRONG_USAGE;
    }
    status = sample_read(path, &sample, error);
    if (!status) {
        status = prepare(&sample, settings, &transport, &choice, error);
    }
    if (!status && settings->explain) {
        status = explain(path, &sample, transport, &choice, invocation->json, error);
    }
    if (!status && settings->picture) {
        status = write_picture(transport, settings->picture, error);
    }
    if (!status && settings->output) {
        status = write_scan(&sample, transport, &choice, settings, invocation, error);
    }
    transport_free(transport);
    sample_finish(&sample);
    return status;
}

const struct verb verb_simulate = {
    .name = "simulate",
    .operands = "SAMPLE -o SCAN",
    .summary = "compute the exact responses of a described sample",
    .text =
        "Reads a sample file (a slab, its materials and what lies in them) and writes the "
        "responses of all of its surface points as a scan, as a perfect station would measure "
        "them. docs/formats.md describes the file, docs/transport.md the computation.\n\n"
        "The cheapest solver that holds the tolerance is taken: a closed form where the slab is "
        "homogeneous, diffusion on voxels, or Monte Carlo in OpenCL, which follows single paths "
        "of light. Without --tolerance any of them will do.\n\n"
        "With --explain alone nothing is computed but the list of effects: which are "
        "simulated, which line of the file calls for each, and what it costs.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = simulate_options,
    .settings_size = sizeof(struct simulate_settings),
    .run = run,
};
