/* nacre simulate: the exact responses of a described sample. */
#include "base/clock.h"
#include "base/picture.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "rig/virtual/explain.h"
#include "rig/virtual/sample.h"
#include "rig/virtual/transport.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>

struct simulate_settings {
    const char *output, *picture;
    int window;
    bool explain;
};

static const struct option_spec simulate_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "SCAN",
     .offset = offsetof(struct simulate_settings, output),
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
    {.name = "explain",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct simulate_settings, explain),
     .sentence = "list each effect: simulated or not, why, and its cost"},
    {0}};

static json_t *effects_as_json(const struct effect *effects, size_t count)
{
    json_t *list = json_array();
    for (size_t i = 0; i < count && list; i++) {
        json_t *entry = json_pack("{s:s, s:b, s:i, s:f, s:s}", "effect", effects[i].name,
                                  "simulated", effects[i].simulated, "line", effects[i].line,
                                  "seconds", effects[i].seconds, "reason", effects[i].reason);
        if (json_array_append_new(list, entry)) {
            json_decref(list);
            list = NULL;
        }
    }
    return list;
}

static void print_effects(const char *path, const struct effect *effects, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const struct effect *effect = &effects[i];
        printf("%-9s %-36s", effect->simulated ? "simulated" : "left out", effect->name);
        if (effect->seconds > 0) {
            printf(" %6.1f s  ", effect->seconds);
        } else {
            printf(" %8s  ", "");
        }
        printf("%s", effect->reason);
        if (effect->line) {
            printf(" (%s:%d)", path, effect->line);
        }
        printf("\n");
    }
    printf("Seconds are estimates for one core; effects without any cost nothing beyond the "
           "others'.\n");
}

static int explain(const char *path, const struct sample *sample, const struct transport *transport,
                   int window, bool json, struct nacre_error *error)
{
    struct effect *effects = NULL;
    size_t count = 0;
    int status = explain_effects(sample, transport, window, &effects, &count, error);
    if (!status && json) {
        status = json_print(effects_as_json(effects, count), error);
    } else if (!status) {
        print_effects(path, effects, count);
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

static int print_result(const struct transport *transport, const struct simulate_settings *settings,
                        double seconds, bool json, struct nacre_error *error)
{
    struct transport_facts facts = transport_facts(transport);
    if (json) {
        return json_print(json_pack("{s:s, s:i, s:i, s:i, s:f, s:[i,i,i], s:i, s:f, s:f, s:f}",
                                    "output", settings->output, "width", facts.width, "height",
                                    facts.height, "window", settings->window, "pitch_mm",
                                    facts.pitch_mm, "voxels", facts.voxels[0], facts.voxels[1],
                                    facts.voxels[2], "subdivide", facts.subdivide, "seconds",
                                    seconds, "outside_mean", facts.outside_mean, "outside_max",
                                    facts.outside_max),
                          error);
    }
    printf("%s: %d x %d responses of %d x %d, R G B, pitch %g mm\n", settings->output, facts.width,
           facts.height, settings->window, settings->window, facts.pitch_mm);
    printf("diffusion on %d x %d x %d voxels of %.3g mm, %.1f s\n", facts.voxels[0],
           facts.voxels[1], facts.voxels[2], facts.cell_mm, seconds);
    printf("light beyond the window: mean %.2g %%, max %.2g %%\n", 100 * facts.outside_mean,
           100 * facts.outside_max);
    return NACRE_OK;
}

static int write_scan(struct transport *transport, const struct simulate_settings *settings,
                      const struct invocation *invocation, struct nacre_error *error)
{
    struct clock clock = clock_monotonic();
    int64_t begun = clock_now_ns(&clock);
    struct progress progress = progress_begin("simulating", invocation->quiet);
    int status =
        transport_write_scan(transport, settings->window, settings->output, &progress, error);
    progress_end(&progress);
    if (status) {
        return status;
    }
    double seconds = (double)(clock_now_ns(&clock) - begun) * 1e-9;
    bool json = invocation->json && !settings->explain;
    return print_result(transport, settings, seconds, json, error);
}

static int run(const void *given, const struct invocation *invocation, struct nacre_error *error)
{
    const struct simulate_settings *settings = given;
    const char *path = invocation->operands[0];
    struct transport *transport = NULL;
    struct sample sample = {0};
    int status = NACRE_OK;
    if (!settings->output && !settings->explain && !settings->picture) {
        return nacre_fail(error, "nothing to make; give -o SCAN, --picture IMAGE or --explain");
    }
    if (settings->window % 2 == 0) {
        return nacre_fail(error, "--window %d: must be odd", settings->window);
    }
    if (settings->explain && invocation->json && settings->output) {
        return nacre_fail(error, "--json prints one result; give --explain or -o, not both");
    }
    status = sample_read(path, &sample, error);
    if (!status) {
        status = transport_new(&sample, &transport, error);
    }
    if (!status && settings->explain) {
        status = explain(path, &sample, transport, settings->window, invocation->json, error);
    }
    if (!status && settings->picture) {
        status = write_picture(transport, settings->picture, error);
    }
    if (!status && settings->output) {
        status = write_scan(transport, settings, invocation, error);
    }
    transport_free(transport);
    sample_finish(&sample);
    return status;
}

const struct verb verb_simulate = {
    .name = "simulate",
    .operands = "SAMPLE -o SCAN",
    .summary = "compute the exact responses of a described sample",
    .text = "Reads a sample file (a slab, its materials and what lies in them) and writes the "
            "responses of all of its surface points as a scan, as a perfect station would measure "
            "them. docs/formats.md describes the file, docs/transport.md the computation.\n\n"
            "With --explain alone nothing is computed but the list of effects: which are "
            "simulated, which line of the file calls for each, and what it costs.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = simulate_options,
    .settings_size = sizeof(struct simulate_settings),
    .run = run,
};
