/* nacre error: how far a material is from the scan it was made of. */
#include "cmd/error_print.h"
#include "cmd/error_scans.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "factor/cross.h"
#include "factor/layout.h"

#include <stdio.h>
#include <string.h>

struct error_settings {
    const char *map;
    bool cross;
};

static const struct option_spec error_options[] = {
    {.name = "map",
     .letter = 'm',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct error_settings, map),
     .writes = true,
     .sentence = "write each surface point's error as an EXR image"},
    {.name = "cross",
     .letter = 'x',
     .kind = OPTION_FLAG,
     .offset = offsetof(struct error_settings, cross),
     .sentence = "estimate the error against the noise-free response too, by factoring half of the "
                 "scan anew"},
    {0}};

/* The same of a material with a kernel per term. A gain is divided out before. */
static void options_of_terms(const struct nacre_material *m, struct factor_options *options)
{
    options->model = FACTOR_MODEL_TERMS;
    options->weight =
        strstr(m->method, "weight kernel") ? FACTOR_WEIGHT_KERNEL : FACTOR_WEIGHT_RESPONSE;
    options->terms = m->terms;
    options->clusters = 0;
    options->iterations = m->iterations > 0 ? m->iterations : options->iterations;
    options->tolerance = 0;
    options->seed = m->seed;
    options->reciprocity = m->h && !m->gain ? TERMS_ONE_WAY : TERMS_RECIPROCAL;
    options->kernels = m->radii == 0 ? FACTOR_KERNELS_FULL : FACTOR_KERNELS_RADIAL;
    options->planes = m->factor_channels > 1 ? FACTOR_PLANES_SEPARATE : FACTOR_PLANES_SHARED;
    options->bits = m->bits;
}

/* The options that a material was made with, as far as it tells: kernels are taken as average ones. */
static int options_of(const struct nacre_material *m, struct factor_options *options,
                      struct nacre_error *error)
{
    *options = factor_options_default();
    if (m->layout == NACRE_KERNEL_PER_TERM && strncmp(m->method, "terms", 5) == 0) {
        options_of_terms(m, options);
        return NACRE_OK;
    }
    if (m->layout != NACRE_KERNEL_SINGLE || m->mixed != 1) {
        return nacre_fail(
            error,
            "--cross factors anew and knows the model of the paper alone: kernels \"single\", "
            "each point in one cluster");
    }
    if (strncmp(m->method, "mu", 2) != 0 && strncmp(m->method, "hals", 4) != 0) {
        return nacre_fail(error, "--cross factors anew and does not know the method \"%s\"",
                          m->method);
    }
    options->method = m->method[0] == 'm' ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS;
    options->weight =
        strstr(m->method, "weight response") ? FACTOR_WEIGHT_RESPONSE : FACTOR_WEIGHT_KERNEL;
    options->terms = m->terms;
    options->clusters = m->clusters;
    options->iterations = m->iterations > 0 ? m->iterations : options->iterations;
    options->tolerance = 0;
    options->epsilon = m->epsilon;
    options->seed = m->seed;
    options->store = m->pixel == NACRE_HALF ? FACTOR_STORE_HALF : FACTOR_STORE_FLOAT;
    return NACRE_OK;
}

static int cross(const struct nacre_scan *scan, const struct nacre_material *material,
                 const char *device, struct progress *progress, struct cross_report *report,
                 struct nacre_error *error)
{
    struct factor_options options;
    struct opencl opencl = {0};
    struct responses responses = {0};
    int status = options_of(material, &options, error);
    if (status == NACRE_OK) {
        status = opencl_open(device, &opencl, error);
    }
    if (status == NACRE_OK) {
        status = responses_load(&responses, scan, material->window, layout_lanes(&opencl),
                                RESPONSES_FLOAT, progress, error);
    }
    if (status == NACRE_OK) {
        status = cross_measure(&responses, material->gain, nacre_scan_info(scan)->pitch_mm,
                               &options, &opencl, progress, report, error);
    }
    responses_finish(&responses);
    opencl_close(&opencl);
    return status;
}

static void print_cross(const struct cross_report *cross)
{
    if (cross->pairs == 0) {
        printf("%-26s unknown: no two entries are reciprocal\n", "  noise-free, no centre");
    } else {
        printf("%-26s %.4f   (noise %.4f, by %zu reciprocal pairs)\n", "  noise-free, no centre",
               cross->error, cross->noise, cross->pairs);
    }
}

/* `cross` may be NULL. */
static int print_result(const struct error_report *report, const struct nacre_material *material,
                        const char *path, const struct cross_report *cross, bool json,
                        struct nacre_error *error)
{
    if (!json) {
        error_print(report, material, path);
        if (cross) {
            print_cross(cross);
        }
        return NACRE_OK;
    }
    json_t *object = error_to_json(report, material, path);
    if (cross && object) {
        json_t *part = cross->pairs ? json_pack("{s:f, s:f, s:I}", "error", cross->error, "noise",
                                                cross->noise, "pairs", (json_int_t)cross->pairs)
                                    : json_null();
        if (json_object_set_new(object, "cross", part) != 0) {
            json_decref(object);
            object = NULL;
        }
    }
    return json_print(object, error);
}

static int error_run(const void *settings, const struct invocation *invocation,
                     struct nacre_error *error)
{
    const struct error_settings *s = settings;
    const char *path = invocation->operands[1];
    struct nacre_scan *scan = NULL;
    struct nacre_material material = {0};
    struct error_report report = {0};
    struct cross_report judged = {0};
    struct error_source source;
    if (error_is_scan(path)) {
        return s->map || s->cross
                   ? nacre_fail(error, "%s: is a scan; --map and --cross go with a material", path)
                   : error_compare_scans(invocation, error);
    }
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
    if (status == NACRE_OK && s->cross) {
        status = cross(scan, &material, invocation->device, &progress, &judged, error);
    }
    progress_end(&progress);
    if (status == NACRE_OK && s->map) {
        status = error_map_write(s->map, &report, material.width, material.height, error);
    }
    if (status == NACRE_OK) {
        status = print_result(&report, &material, path, s->cross ? &judged : NULL, invocation->json,
                              error);
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
            "were not measured, or measured as exactly 0, are counted apart. A second scan in the "
            "material's place is compared the same way: a developed one with exact responses.\n\n"
            "--cross estimates the error against the response without its noise: as light goes the "
            "same way forth and "
            "back, R(x_i, x_o) and R(x_o, x_i) are two measurements of one number. One of each "
            "pair is factored, "
            "with the material's settings, and judged by the other. The scan must be reciprocal; "
            "`nacre factor` "
            "warns where it is not.\n\n"
            "The sizes are those of Table 1 of Peers et al. 2006: the responses at 4 bytes a "
            "number, and every stored number of the material at its stored width.",
    .operand_minimum = 2,
    .operand_maximum = 2,
    .options = error_options,
    .settings_size = sizeof(struct error_settings),
    .run = error_run,
};
