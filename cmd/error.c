/* nacre error: how far a material is from the scan it was made of. */
#include "cmd/error_print.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"

struct error_settings {
    const char *map;
};

static const struct option_spec error_options[] = {
    {.name = "map",
     .letter = 'm',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct error_settings, map),
     .sentence = "write each surface point's error as an EXR image"},
    {0}};

static int print_result(const struct error_report *report, const struct nacre_material *material,
                        const char *path, bool json, struct nacre_error *error)
{
    if (json) {
        return json_print(error_to_json(report, material, path), error);
    }
    error_print(report, material, path);
    return NACRE_OK;
}

static int error_run(const void *settings, const struct invocation *invocation,
                     struct nacre_error *error)
{
    const struct error_settings *s = settings;
    const char *path = invocation->operands[1];
    struct nacre_scan *scan = NULL;
    struct nacre_material material = {0};
    struct error_report report = {0};
    struct error_source source;
    struct progress progress = progress_begin("comparing", invocation->quiet);
    int status = nacre_scan_open(invocation->operands[0], &scan, error);
    if (status == NACRE_OK) {
        status = nacre_material_read(path, &material, error);
    }
    if (status == NACRE_OK) {
        status = error_check_sizes(scan, &material, error);
    }
    if (status == NACRE_OK) {
        source = error_source_scan(scan);
        status = error_measure(&source, &material, &progress, &report, error);
    }
    progress_end(&progress);
    if (status == NACRE_OK && s->map) {
        status = error_map_write(s->map, &report, material.width, material.height, error);
    }
    if (status == NACRE_OK) {
        status = print_result(&report, &material, path, invocation->json, error);
    }
    error_report_finish(&report);
    nacre_material_finish(&material);
    nacre_scan_close(scan);
    return status;
}

const struct verb verb_error = {
    .name = "error",
    .operands = "SCAN MATERIAL",
    .summary = "measure how far a material is from the scan it was made of",
    .text = "For each surface point the relative error is ||measured - factored|| / ||measured|| "
            "over the measured entries of its window inside the sample, all channels. Printed are "
            "the least, the mean and the greatest, with and without the entry where light leaves "
            "at the point that it enters, which can hold most of a response's energy. Points that "
            "were not measured, or measured as exactly 0, are counted apart.\n\n"
            "The sizes are those of Table 1 of Peers et al. 2006: the responses at 4 bytes a "
            "number, and every stored number of the material at its stored width.",
    .operand_minimum = 2,
    .operand_maximum = 2,
    .options = error_options,
    .settings_size = sizeof(struct error_settings),
    .run = error_run,
};
