/* nacre develop: a session's frames to responses. */
#include "rig/develop/develop.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"

#include <jansson.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>

struct develop_settings {
    const char *output;
    int demosaic, black, store, flat;
    double confidence;
    bool resume;
    const char *pixels, *known_pixels, *target;
    double target_spacing_mm;
};

static const char *const store_words[] = {"float", "half", NULL};

static const struct option_spec develop_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct develop_settings, output),
     .writes = true,
     .sentence = "the scan to be written"},
    {.name = "demosaic",
     .kind = OPTION_CHOICE,
     .words = demosaic_names,
     .fallback = "auto",
     .offset = offsetof(struct develop_settings, demosaic),
     .sentence =
         "how pixels become surface points: fit (least squares over the mixtures that pixels see), "
         "area (the mean of a colour's pixels), malvar (that mean after demosaicing by Malvar, He "
         "and Cutler), or auto: fit where the frames agree with it, else malvar"},
    {.name = "black",
     .kind = OPTION_CHOICE,
     .words = black_mode_names,
     .fallback = "subtract",
     .offset = offsetof(struct develop_settings, black),
     .sentence = "subtract the mean of the black frames and keep what falls below zero, or clip to "
                 "zero what "
                 "is not above the black frames with the given confidence"},
    {.name = "confidence",
     .kind = OPTION_REAL,
     .argument = "SHARE",
     .minimum = 0.5,
     .maximum = 0.999999,
     .fallback = "99 %",
     .offset = offsetof(struct develop_settings, confidence),
     .sentence = "one-sided confidence of --black=clip"},
    {.name = "flat",
     .kind = OPTION_CHOICE,
     .words = flat_mode_names,
     .fallback = "separate",
     .offset = offsetof(struct develop_settings, flat),
     .sentence = "divide by the camera's vignetting where light leaves and by the projector's "
                 "fall-off where it enters, told apart by the sample's reciprocity; or divide by "
                 "white alone, as the paper does"},
    {.name = "store",
     .kind = OPTION_CHOICE,
     .words = store_words,
     .fallback = "float",
     .offset = offsetof(struct develop_settings, store),
     .sentence = "numbers in the scan; half flushes what is below 6e-8"},
    {.name = "pixels",
     .kind = OPTION_STRING,
     .argument = "FILE.exr",
     .offset = offsetof(struct develop_settings, pixels),
     .sentence = "write a map of the camera's pixels: good, dead, hot, not linear or noisy"},
    {.name = "known-pixels",
     .kind = OPTION_STRING,
     .argument = "FILE.exr",
     .offset = offsetof(struct develop_settings, known_pixels),
     .sentence =
         "leave out the pixels that such a map names, beside those that this session shows"},
    {.name = "target",
     .kind = OPTION_STRING,
     .argument = "SESSION",
     .offset = offsetof(struct develop_settings, target),
     .sentence = "take the distance between surface points from a session of this station, of a "
                 "plan with grid_spacing 1, that shows a target of dots in place of the sample"},
    {.name = "target-spacing",
     .kind = OPTION_REAL,
     .argument = "MM",
     .minimum = 1e-3,
     .maximum = 1e4,
     .fallback = "5",
     .offset = offsetof(struct develop_settings, target_spacing_mm),
     .sentence = "distance between the target's dots, which lie in a square lattice, in mm"},
    {.name = "resume",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct develop_settings, resume),
     .sentence = "go on with what a development into this SCAN that was stopped or killed left in "
                 "SCAN.work; the scan is the same as undisturbed"},
    {0}};

static json_t *real(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

static json_t *flat_json(const struct develop_report *report)
{
    return json_pack("{s:I, s:o, s:o}", "pairs", (json_int_t)report->falloff_pairs, "falloff",
                     real(report->falloff), "falloff_doubt", real(report->falloff_doubt));
}

static json_t *pitch_json(const struct develop_report *report)
{
    const struct target_report *target = &report->target;
    json_t *pitch = json_pack("{s:o}", "mm", real(report->pitch_mm));
    if (pitch && target->dots) {
        json_t *measured = json_pack(
            "{s:I, s:o, s:o, s:o, s:o, s:o}", "dots", (json_int_t)target->dots, "across_mm",
            real(target->across), "down_mm", real(target->down), "uneven", real(target->uneven),
            "doubt", real(target->doubt), "rms_points", real(target->rms_points));
        (void)json_object_set_new(pitch, "target", measured);
    }
    return pitch;
}

static json_t *warnings_json(const struct warnings *warnings)
{
    json_t *list = json_array();
    for (int i = 0; i < warnings->count; i++) {
        (void)json_array_append_new(list, json_string(warnings->texts[i]));
    }
    return list;
}

static json_t *seconds_json(const struct develop_report *report)
{
    return json_pack("{s:o, s:o, s:o, s:o, s:o, s:o}", "white", real(report->white_seconds),
                     "black", real(report->black_seconds), "dots", real(report->dots_seconds),
                     "map", real(report->map_seconds), "grids", real(report->grid_seconds), "total",
                     real(report->total_seconds));
}

static json_t *geometry_json(const struct develop_report *report)
{
    const struct align_report *align = &report->align;
    json_t *map = json_array();
    for (int tile = 0; tile < ALIGN_TILES * ALIGN_TILES; tile++) {
        (void)json_array_append_new(map,
                                    real(align->map_px[tile / ALIGN_TILES][tile % ALIGN_TILES]));
    }
    return json_pack("{s:s, s:o, s:o, s:I, s:I, s:I, s:o, s:o, s:o, s:o, s:s, s:o}", "demosaic",
                     demosaic_names[report->demosaic], "misfit", real(report->misfit), "blur_px",
                     real(report->blur_px), "dots", (json_int_t)align->dots, "matched",
                     (json_int_t)align->matched, "rejected", (json_int_t)align->rejected, "rms_px",
                     real(align->rms_px), "worst_px", real(align->worst_px), "pixels_per_point",
                     real(report->pixels_per_point), "rms_px_by_ninths", map, "lens",
                     lens_model_names[align->lens], "lens_px", real(align->lens_px));
}

static json_t *pixels_json(const struct develop_report *report)
{
    const struct linearity_report *linearity = &report->linearity;
    return json_pack("{s:I, s:I, s:I, s:I, s:o, s:o}", "dead", (json_int_t)linearity->dead, "hot",
                     (json_int_t)linearity->hot, "nonlinear", (json_int_t)linearity->nonlinear,
                     "noisy", (json_int_t)linearity->noisy, "linearity_deviation",
                     real(linearity->deviation), "saturated_share", real(report->saturated_share));
}

static int print_json(const char *output, const struct develop_report *report,
                      struct nacre_error *error)
{
    json_t *root = json_pack(
        "{s:s, s:[i,i], s:i, s:i, s:i, s:i, s:i, s:i, s:i, s:i, s:I, s:I, s:o, s:o, s:o, "
        "s:o, s:o, s:o, "
        "s:o, "
        "s:o, s:o, s:o, s:o, s:o}",
        "output", output, "size", report->width, report->height, "window", report->window,
        "channels", report->channels, "patterns", report->patterns, "missing_patterns",
        report->missing_patterns, "taken_over", report->taken_over, "white_frames",
        report->white_frames, "black_frames", report->black_frames, "dots_frames",
        report->dots_frames, "responses", (json_int_t)report->responses, "missing_entries",
        (json_int_t)report->missing_entries, "black_level_per_s", real(report->black_level),
        "frame_noise_per_s", real(report->frame_noise), "noise", real(report->noise), "centre",
        real(report->centre), "rim_share", real(report->rim_share), "overlap",
        real(report->overlap), "geometry", geometry_json(report), "pixels", pixels_json(report),
        "flat", flat_json(report), "pitch", pitch_json(report), "seconds", seconds_json(report),
        "warnings", warnings_json(&report->warnings));
    return json_print(root, error);
}

static void print_lens(const struct align_report *align)
{
    double worst = 0;
    for (int tile = 0; tile < ALIGN_TILES * ALIGN_TILES; tile++) {
        worst = fmax(worst, align->map_px[tile / ALIGN_TILES][tile % ALIGN_TILES]);
    }
    (void)printf("%-12s at most %.3f px RMS in a ninth of the region; ", "", worst);
    if (align->lens == LENS_IDEAL) {
        (void)printf("no distortion of the lens is called for\n");
    } else {
        (void)printf("radial distortion of the lens%s, up to %.2f px\n",
                     align->lens == LENS_SHIFTED ? " about a centre of its own" : "",
                     align->lens_px);
    }
}

static void print_pitch(const struct develop_report *report)
{
    const struct target_report *target = &report->target;
    if (target->dots) {
        (void)printf("%-12s %.5g mm (doubt %.2g %%) by %zu dots of the target; %.5g across, %.5g "
                     "down, %.2g %% uneven\n",
                     "pitch", target->pitch_mm, 100 * target->doubt, target->dots, target->across,
                     target->down, 100 * target->uneven);
    }
}

static void print_falloff(const struct develop_report *report)
{
    if (report->falloff_pairs > 0) {
        (void)printf("\n%-12s projector's light varies by %.2g %% over the region (doubt %.2g %%), "
                     "by %zu pairs",
                     "flat", 100 * report->falloff, 100 * report->falloff_doubt,
                     report->falloff_pairs);
    }
}

static void print_text(const char *output, const struct develop_report *report)
{
    const struct align_report *align = &report->align;
    const struct linearity_report *pixels = &report->linearity;
    (void)printf("%-12s %s: %d x %d points, window %d, %d channel%s\n", "scan", output,
                 report->width, report->height, report->window, report->channels,
                 report->channels == 1 ? "" : "s");
    (void)printf("%-12s %d grids (%d missing), %d white, %d dots, %d black", "patterns",
                 report->patterns, report->missing_patterns, report->white_frames,
                 report->dots_frames, report->black_frames);
    if (report->taken_over) {
        (void)printf("; %d grids were done before", report->taken_over);
    }
    (void)printf("\n");
    (void)printf("%-12s %zu measured, %zu entries missing, %.2g %% of pixels saturated\n",
                 "responses", report->responses, report->missing_entries,
                 100 * report->saturated_share);
    (void)printf(
        "%-12s %zu of %zu dots, %zu rejected; %.3f px RMS, %.3f px at worst; %.2f px a point\n",
        "geometry", align->matched, align->dots, align->rejected, align->rms_px, align->worst_px,
        report->pixels_per_point);
    print_lens(align);
    print_pitch(report);
    (void)printf("%-12s %s", "demosaic", demosaic_names[report->demosaic]);
    if (isfinite(report->misfit)) {
        (void)printf(" (frames and fit disagree by %.2g %%)", 100 * report->misfit);
    }
    if (report->blur_px > 0) {
        (void)printf("\n%-12s the camera is out of focus by %.2f px (deviation), which the fit "
                     "takes into account",
                     "", report->blur_px);
    }
    (void)printf("\n%-12s %zu dead, %zu hot, %zu not linear, %zu noisy", "pixels", pixels->dead,
                 pixels->hot, pixels->nonlinear, pixels->noisy);
    if (isfinite(pixels->deviation)) {
        (void)printf("; exposures within %.2g %% of proportion", 100 * pixels->deviation);
    }
    print_falloff(report);
    (void)printf("\n%-12s %.4g raw a second, noise of a frame %.3g\n", "black level",
                 report->black_level, report->frame_noise);
    (void)printf("%-12s %.2g of R_d an entry; centre entries are %.3g\n", "noise", report->noise,
                 report->centre);
    (void)printf("%-12s %.2g %% of the energy outside the window (%.2g %% on its rim)\n", "overlap",
                 100 * report->overlap, 100 * report->rim_share);
    (void)printf("%-12s %.1f s: white %.1f, black %.1f, dots %.1f, map %.1f, grids %.1f\n", "time",
                 report->total_seconds, report->white_seconds, report->black_seconds,
                 report->dots_seconds, report->map_seconds, report->grid_seconds);
}

static int run(const void *settings, const struct invocation *invocation, struct nacre_error *error)
{
    const struct develop_settings *given = settings;
    struct develop_options options = {.black = (enum black_mode)given->black,
                                      .confidence = given->confidence,
                                      .demosaic = (enum demosaic)given->demosaic,
                                      .store = given->store ? NACRE_HALF : NACRE_FLOAT,
                                      .flat = (enum flat_mode)given->flat,
                                      .resume = given->resume,
                                      .pixels = given->pixels,
                                      .known_pixels = given->known_pixels,
                                      .target = given->target,
                                      .target_spacing_mm = given->target_spacing_mm};
    struct progress progress = progress_begin("developing", invocation->quiet);
    struct develop_report report;
    int status = develop_session(invocation->operands[0], &options, given->output, &progress,
                                 &report, error);
    progress_end(&progress);
    if (status != NACRE_OK) {
        return status;
    }
    for (int i = 0; i < report.warnings.count; i++) {
        (void)fprintf(stderr, "nacre develop: warning: %s\n", report.warnings.texts[i]);
    }
    if (invocation->json) {
        return print_json(given->output, &report, error);
    }
    print_text(given->output, &report);
    return NACRE_OK;
}

const struct verb verb_develop = {
    .name = "develop",
    .operands = "SESSION -o SCAN",
    .summary = "make responses of a session's frames",
    .text =
        "Merges the raw exposures of every pattern, takes the black level off, divides by the "
        "white frames, "
        "maps camera pixels to surface points by the dots patterns, and cuts out the response "
        "of each lit point. "
        "Patterns that were not measured leave responses of NaN, which are counted.\n\n"
        "--demosaic=fit is exact where light is even over each surface point and the camera sharp, "
        "as with the virtual station; where light changes within points or is blurred, malvar is "
        "nearer. auto asks four grids, and of the dots whether the camera is out of focus, which "
        "it then takes into account.\n\n"
        "The calibration frames in the session's folder are all used; without any of one kind "
        "developing fails.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = develop_options,
    .settings_size = sizeof(struct develop_settings),
    .run = run,
};
