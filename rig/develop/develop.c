/* A session's frames made into a scan: calibration, then every grid pattern merged, cleaned, resampled and cut up. */
#include "rig/develop/develop.h"

#include "base/clock.h"
#include "nacre/scan.h"
#include "rig/develop/calibrate.h"
#include "rig/develop/even.h"
#include "rig/develop/extract.h"
#include "rig/develop/wheel.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

const char *const flat_mode_names[] = {"separate", "paper", NULL};

enum {
    NOISE_FRAMES = 4,  /* black frames developed like grids to see their noise */
    MISFIT_FRAMES = 4, /* grids that decide how pixels become points */
};

/* The largest misfit at which the fit is used. The virtual station's sharp camera stays below 0.03. Light that is blurred
 * by a tenth of a point exceeds it, and Malvar is nearer (tests/develop/test_resample.c). A lens out of focus by a
 * pixel exceeds it too, though the fit would still be nearer: the misfit cannot tell the two. */
static const double misfit_limit = 0.1;

/* Light that varies more over the region is no projector's: the sample is not alike in both directions. */
static const double falloff_limit = 1.5;

/* A fall-off known no better than this (of log E) is not worth taking out. */
static const double doubt_limit = 0.05;

/* A colour that the wheel makes more wrong than that is worth a warning. */
static const double colour_limit = 1e-3;

/* A pedestal below so many deviations of the read noise cuts off its lower end. */
static const double pedestal_deviations = 2;

/* Everything that the visitors of black and grid frames need. */
struct development {
    const struct session *session;
    const struct calibration *calibration;
    struct resampler *resampler;
    struct nacre_scan_info info;
    struct nacre_scan_writer *writer;
    float *response;
    struct extract_sums sums;
    bool separate;              /* write to be evened out, and gather what tells the fall-off */
    struct falloff_pairs pairs; /* where `separate` */
    double pulse_turns; /* of the exposure whose pulse was the farthest from what was asked */
    double pulse_error; /* its colour error; 0: none was measured */
    double squares;     /* of the entries of developed black frames */
    size_t entries;
    size_t saturated, pixels;
    struct misfit misfit;
};

static double now_seconds(void)
{
    struct clock clock = clock_monotonic();
    return (double)clock_now_ns(&clock) * 1e-9;
}

static int work_frame(void *state, const struct merged *merged, float *result,
                      struct nacre_error *error)
{
    const struct development *development = state;
    black_level_subtract(&development->calibration->black, merged->radiance);
    return resampler_apply(development->resampler, merged->radiance, result, error);
}

static int take_black(void *state, const struct merged *merged, const float *result,
                      struct nacre_error *error)
{
    struct development *development = state;
    size_t size = resampler_size(development->resampler);
    (void)merged;
    (void)error;
    for (size_t i = 0; i < size; i++) {
        if (!isnan(result[i])) {
            development->squares += (double)result[i] * (double)result[i];
            development->entries++;
        }
    }
    return NACRE_OK;
}

/* Remember the pulse that the wheel makes the most wrong, if it is surely no whole number of turns. */
static void note_pulses(struct development *development, const struct pattern_frames *frames)
{
    double wheel_hz = development->session->station.projector.wheel_hz;
    for (size_t e = 0; e < frames->count; e++) {
        const struct exposure *exposure = &frames->exposures[e];
        int64_t off = llabs(exposure->pulse_ns - exposure->exposure_ns);
        if (exposure->pulse_ns > 0 && off > exposure->pulse_doubt_ns) {
            double turns = (double)exposure->pulse_ns * 1e-9 * wheel_hz;
            double wrong = wheel_colour_error(turns);
            if (wrong > development->pulse_error) {
                development->pulse_error = wrong;
                development->pulse_turns = turns;
            }
        }
    }
}

static int take_grid(void *state, const struct merged *merged, const float *result,
                     struct nacre_error *error)
{
    struct development *development = state;
    const struct nacre_scan_info *info = &development->info;
    const struct plan *plan = &development->session->plan;
    int left;
    int top;
    plan_pattern_offset(plan, merged->pattern, &left, &top);
    development->saturated += merged->saturated;
    development->pixels += (size_t)merged->frames->width * (size_t)merged->frames->height;
    note_pulses(development, merged->frames);
    for (int y = top; y < info->height; y += plan->grid_spacing) {
        for (int x = left; x < info->width; x += plan->grid_spacing) {
            extract_window(info, result, x, y, development->response, &development->sums);
            if (development->separate) {
                falloff_pairs_add(&development->pairs, info, x, y, development->response);
            }
            int status = nacre_scan_write(development->writer, x, y, development->response, error);
            if (status != NACRE_OK) {
                return status;
            }
        }
    }
    return NACRE_OK;
}

static int work_misfit(void *state, const struct merged *merged, float *result,
                       struct nacre_error *error)
{
    const struct development *development = state;
    struct misfit misfit = {0, 0};
    black_level_subtract(&development->calibration->black, merged->radiance);
    int status = resampler_add_misfit(development->resampler, merged->radiance, merged->variance,
                                      &misfit, error);
    result[0] = (float)misfit.unexplained;
    result[1] = (float)misfit.all;
    return status;
}

static int take_misfit(void *state, const struct merged *merged, const float *result,
                       struct nacre_error *error)
{
    struct development *development = state;
    (void)merged;
    (void)error;
    development->misfit.unexplained += (double)result[0];
    development->misfit.all += (double)result[1];
    return NACRE_OK;
}

static int check_grids(const struct session *session, struct nacre_error *error)
{
    const struct plan *plan = &session->plan;
    for (int n = 0; n < plan_pattern_count(plan, PATTERN_GRID); n++) {
        if (session_has(session, (struct pattern){PATTERN_GRID, n})) {
            return NACRE_OK;
        }
    }
    return nacre_fail(error, "%s: has no grid pattern in frames/; resume the scan to measure them",
                      session->path);
}

/* Effects that the station's file forbade, which its frames lack. Cut to the room there is. */
static void record_forbidden(const struct station *station, struct nacre_scan_info *info)
{
    for (size_t i = 0; i < station->without_count; i++) {
        size_t used = strlen(info->source);
        (void)snprintf(info->source + used, sizeof info->source - used, "%s%s",
                       i == 0 ? "; without " : ", ", station->without[i]);
    }
}

static void describe(const struct session *session, const struct develop_options *options,
                     enum demosaic demosaic, int channels, struct nacre_scan_info *info)
{
    *info = (struct nacre_scan_info){.width = session->station.sample.width,
                                     .height = session->station.sample.height,
                                     .window = session->plan.window,
                                     .channels = channels,
                                     .pixel = options->store,
                                     .compress = options->store == NACRE_HALF,
                                     .pitch_mm = session->station.sample.pitch_mm};
    (void)snprintf(info->source, sizeof info->source,
                   "nacre develop --demosaic=%s --black=%s --flat=%s", demosaic_names[demosaic],
                   black_mode_names[options->black], flat_mode_names[options->flat]);
    record_forbidden(&session->station, info);
}

static int make_resampler(struct development *development, enum demosaic demosaic,
                          struct nacre_error *error)
{
    const struct calibration *calibration = development->calibration;
    const struct station_sample *sample = &development->session->station.sample;
    resampler_free(development->resampler);
    development->resampler = NULL;
    return resampler_new(&calibration->flat, &calibration->map, sample->width, sample->height,
                         demosaic, &development->resampler, error);
}

/* Ask some grids whether they agree with the fit, and make the resampler that this speaks for. */
static int choose_resampler(struct development *development, enum demosaic wanted,
                            struct visit_progress *progress, struct develop_report *report,
                            struct nacre_error *error)
{
    int visited;
    int missing;
    struct visitor visitor = {
        .state = development, .result_size = 2, .work = work_misfit, .take = take_misfit};
    enum demosaic mean =
        development->calibration->flat.channels == 1 ? DEMOSAIC_AREA : DEMOSAIC_MALVAR;
    report->demosaic = wanted;
    report->misfit = NAN;
    if (wanted != DEMOSAIC_AUTO) {
        return make_resampler(development, wanted, error);
    }
    int status = make_resampler(development, DEMOSAIC_FIT, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = visit_patterns(development->session, PATTERN_GRID, MISFIT_FRAMES,
                            &development->calibration->noise, &visitor, progress, &visited,
                            &missing, error);
    if (status != NACRE_OK) {
        return status;
    }
    struct misfit misfit = development->misfit;
    report->misfit = misfit.all > 0 ? sqrt(fmax(misfit.unexplained, 0) / misfit.all) : NAN;
    report->demosaic = report->misfit > misfit_limit ? mean : DEMOSAIC_FIT;
    return report->demosaic == DEMOSAIC_FIT ? NACRE_OK : make_resampler(development, mean, error);
}

/* What one entry of R_d scatters by: black frames developed as if they were grids. They had their part in the mean
 * that was taken off them, which hides 1/n of their variance. */
static int measure_noise(struct development *development, struct visit_progress *progress,
                         double *noise, struct nacre_error *error)
{
    struct visitor visitor = {.state = development,
                              .result_size = resampler_size(development->resampler),
                              .work = work_frame,
                              .take = take_black};
    int visited;
    int missing;
    int status = visit_patterns(development->session, PATTERN_BLACK, NOISE_FRAMES,
                                &development->calibration->noise, &visitor, progress, &visited,
                                &missing, error);
    double frames = development->calibration->black_frames;
    *noise = frames > 1 && development->entries
                 ? sqrt(development->squares / (double)development->entries * frames / (frames - 1))
                 : NAN;
    return status;
}

static int check_light(const struct development *development, double noise,
                       struct nacre_error *error)
{
    const struct extract_sums *sums = &development->sums;
    const char *path = development->session->path;
    if (sums->missing == sums->entries) {
        return nacre_fail(
            error,
            "%s: every grid frame is saturated at every exposure; scan with a shorter exposure or "
            "a smaller aperture",
            path);
    }
    double count = (double)sums->responses * development->info.channels;
    double mean = sums->centre / count;
    if (!(mean > 5 * noise / sqrt(count))) {
        return isnan(noise) && mean > 0
                   ? NACRE_OK
                   : nacre_fail(error,
                                "%s: the grid frames show no light where points were lit (R_d "
                                "%.2g, noise %.2g); "
                                "was the projector on and the white layer taken off?",
                                path, mean, noise);
    }
    return NACRE_OK;
}

static double pixels_per_point(const struct camera_map *map, double x, double y)
{
    struct point a = camera_map_apply(map, (struct point){x - 0.5, y});
    struct point b = camera_map_apply(map, (struct point){x + 0.5, y});
    return hypot(b.x - a.x, b.y - a.y);
}

static void fill_report(const struct development *development, struct develop_report *report)
{
    const struct calibration *calibration = development->calibration;
    const struct nacre_scan_info *info = &development->info;
    const struct extract_sums *sums = &development->sums;
    report->width = info->width;
    report->height = info->height;
    report->window = info->window;
    report->channels = info->channels;
    report->white_frames = calibration->white_frames;
    report->black_frames = calibration->black_frames;
    report->dots_frames = calibration->dots_frames;
    report->responses = sums->responses;
    report->missing_entries = sums->missing;
    report->saturated_share = (double)development->saturated / (double)development->pixels;
    report->black_level = calibration->black_median;
    report->frame_noise = calibration->noise_median;
    report->centre = sums->centre / ((double)sums->responses * info->channels);
    report->rim_share = extract_rim_share(sums, info->window);
    report->overlap = extract_overlap(sums, info->window);
    report->pixels_per_point =
        pixels_per_point(&calibration->map, info->width / 2.0, info->height / 2.0);
    report->linearity = calibration->linearity;
    report->align = calibration->align;
    report->white_seconds = calibration->white_seconds;
    report->black_seconds = calibration->black_seconds;
    report->dots_seconds = calibration->dots_seconds;
}

/* Develop all grids into the scan at `path`, divided by white. */
static int develop_grids(struct development *development, const char *path,
                         const struct nacre_scan_info *info, struct visit_progress *progress,
                         struct develop_report *report, struct nacre_error *error)
{
    struct visitor visitor = {.state = development,
                              .result_size = resampler_size(development->resampler),
                              .work = work_frame,
                              .take = take_grid};
    int status = nacre_scan_create(path, info, &development->writer, error);
    if (status != NACRE_OK) {
        return status;
    }
    status =
        visit_patterns(development->session, PATTERN_GRID, 0, &development->calibration->noise,
                       &visitor, progress, &report->patterns, &report->missing_patterns, error);
    if (status == NACRE_OK) {
        status = check_light(development, report->noise, error);
    }
    if (status == NACRE_OK) {
        status = nacre_scan_commit(development->writer, error);
        development->writer = NULL;
    }
    return status;
}

/* What the pairs say of the fall-off, into report and warnings; even light where it is not to be believed. */
static int find_falloff(const struct development *development, struct falloff *falloff,
                        struct develop_report *report, struct nacre_error *error)
{
    int status = falloff_find(&development->pairs, falloff, error);
    if (status != NACRE_OK) {
        return status;
    }
    report->falloff_pairs = falloff->pairs;
    report->falloff = falloff->range;
    report->falloff_doubt = falloff->doubt;
    bool told = falloff->pairs > 0 && falloff->doubt <= doubt_limit;
    if (!told) {
        warnings_add(&report->warnings,
                     "the projector's fall-off was not taken out: of the lit points %zu pairs lie "
                     "%d or %d apart and see each other, too few or too dark to tell it; measure "
                     "more grids, or a wider window",
                     falloff->pairs, FALLOFF_NEAREST, FALLOFF_REACH);
    } else if (falloff->range > falloff_limit) {
        warnings_add(&report->warnings,
                     "light seems to take its way through the sample in one direction better than "
                     "in the other, by a factor of up to %.2g over the region, which no projector "
                     "does; its fall-off was not taken out",
                     1 + falloff->range);
    }
    if (!told || falloff->range > falloff_limit) {
        report->falloff_pairs = 0;
        for (size_t i = 0; i < (size_t)falloff->width * (size_t)falloff->height; i++) {
            falloff->light[i] = 1;
        }
    }
    return NACRE_OK;
}

/* Develop all grids, then tell the projector's fall-off from the responses and take it out: in a second file, as the
 * fall-off is known when the last response is. */
static int develop_evenly(struct development *development, const char *output,
                          struct visit_progress *progress, struct develop_report *report,
                          struct nacre_error *error)
{
    struct falloff falloff = {0};
    struct nacre_scan_info uneven = development->info;
    char *path = NULL;
    int status = NACRE_OK;
    uneven.pixel = NACRE_FLOAT;
    uneven.compress = false;
    if (asprintf(&path, "%s.uneven", output) < 0) {
        path = NULL;
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    status = falloff_pairs_init(&development->pairs, uneven.width, uneven.height, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = develop_grids(development, path, &uneven, progress, report, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = find_falloff(development, &falloff, report, error);
    if (status == NACRE_OK) {
        status = even_scan(path, &falloff, &development->info, output, error);
    }
    (void)unlink(path); /* nothing is lost if it stays */
out:
    falloff_finish(&falloff);
    falloff_pairs_finish(&development->pairs);
    free(path);
    return status;
}

/* What can be said before anything is developed. */
static void warn_of_settings(const struct session *session, struct warnings *warnings)
{
    const struct station_camera *camera = &session->station.camera;
    for (size_t e = 0; e < session->plan.exposure_count; e++) {
        double turns = session->plan.exposure_turns[e];
        double wrong = wheel_colour_error(turns);
        if (wrong > colour_limit) {
            warnings_add(warnings,
                         "the exposure of %g turns of the colour wheel is no whole number of them: "
                         "expect each colour in it to be wrong by %.2g %% (root mean square); use "
                         "whole turns in exposure_turns",
                         turns, 100 * wrong);
        }
    }
    if (camera->read_noise > 0 && camera->pedestal < pedestal_deviations * camera->read_noise) {
        warnings_add(warnings,
                     "the camera's pedestal of %g is below %g deviations of its read noise of %g: "
                     "the sensor cuts off the lower end of the noise, and dark entries read "
                     "bright; raise its black level or brightness",
                     camera->pedestal, pedestal_deviations, camera->read_noise);
    }
}

static void warn_of_dots(const struct align_report *align, struct warnings *warnings)
{
    if (align->missed[0]) {
        warnings_add(warnings,
                     "%zu of %zu dots were found: %s; if something stood in the view, remove the "
                     "files of such patterns from calibration/ and resume the scan",
                     align->matched + align->rejected, align->dots, align->missed);
    }
}

static void warn_of_pulses(const struct development *development, struct warnings *warnings)
{
    if (development->pulse_error > colour_limit) {
        warnings_add(warnings,
                     "a trigger pulse was measured at %.4f turns of the colour wheel: expect each "
                     "colour of its exposure to be wrong by %.2g %% (root mean square); check "
                     "wheel_hz and the wiring of the wheel's index",
                     development->pulse_turns, 100 * development->pulse_error);
    }
}

static double count_patterns(const struct session *session)
{
    double total = 0;
    for (int kind = 0; kind < PATTERN_KINDS; kind++) {
        int count = plan_pattern_count(&session->plan, (enum pattern_kind)kind);
        for (int n = 0; n < count; n++) {
            total += session_has(session, (struct pattern){(enum pattern_kind)kind, n}) ? 1 : 0;
        }
    }
    return total + NOISE_FRAMES + MISFIT_FRAMES;
}

int develop_session(const char *session_path, const struct develop_options *options,
                    const char *output, struct progress *progress, struct develop_report *report,
                    struct nacre_error *error)
{
    struct session session = {0};
    struct calibration calibration = {0};
    struct development development = {.session = &session, .calibration = &calibration};
    struct develop_report own = {0};
    double began = now_seconds();
    int status = session_open(session_path, &session, error);
    if (status != NACRE_OK) {
        goto out;
    }
    warn_of_settings(&session, &own.warnings);
    status = check_grids(&session, error);
    if (status != NACRE_OK) {
        goto out;
    }
    struct visit_progress visits = {progress, 0, count_patterns(&session)};
    status = calibrate(&session, options->black, options->confidence, &visits, &calibration, error);
    if (status != NACRE_OK) {
        goto out;
    }
    double mapped = now_seconds();
    status = choose_resampler(&development, options->demosaic, &visits, &own, error);
    if (status != NACRE_OK) {
        goto out;
    }
    describe(&session, options, own.demosaic, calibration.flat.channels, &development.info);
    status = measure_noise(&development, &visits, &own.noise, error);
    if (status != NACRE_OK) {
        goto out;
    }
    own.map_seconds = now_seconds() - mapped;
    development.response =
        malloc(nacre_scan_response_size(&development.info) * sizeof *development.response);
    if (!development.response) {
        status = nacre_fail_memory(error, "a response");
        goto out;
    }
    double grids = now_seconds();
    development.separate = options->flat == FLAT_SEPARATE;
    status = development.separate
                 ? develop_evenly(&development, output, &visits, &own, error)
                 : develop_grids(&development, output, &development.info, &visits, &own, error);
    if (status != NACRE_OK) {
        goto out;
    }
    warn_of_dots(&calibration.align, &own.warnings);
    warn_of_pulses(&development, &own.warnings);
    fill_report(&development, &own);
    own.grid_seconds = now_seconds() - grids;
    own.total_seconds = now_seconds() - began;
    if (report) {
        *report = own;
    }
out:
    nacre_scan_discard(development.writer);
    free(development.response);
    resampler_free(development.resampler);
    calibration_finish(&calibration);
    session_finish(&session);
    return status;
}
