/* A session's frames made into a scan: calibration, then every grid pattern merged, cleaned, resampled and cut up. */
#include "rig/develop/development.h"

#include "base/clock.h"
#include "rig/develop/wheel.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

const char *const flat_mode_names[] = {"separate", "paper", NULL};

/* A colour that the wheel makes more wrong than that is worth a warning: a tenth of what all else is wrong by, 1 %, and so
 * half a per cent of it, as independent errors add. Pulses are measured to much less (docs/trigger-board.md). */
static const double colour_limit = 1e-3;

/* A pedestal below so many deviations of the read noise cuts off its lower end. At k deviations that adds phi(k) - k (1 -
 * Phi(k)) of one to the mean, 0.0085 at 2: with the paper's exposures and 0.7 raw units, 0.1 % of the darkest of 10,000:1. */
static const double pedestal_deviations = 2;

/* A pitch that is wrong by 1 % makes a material as wrong in size, which no picture of it shows. */
static const double pitch_limit = 0.01;

/* The same for points that are not square. */
static const double square_limit = 0.02;

static double now_seconds(void)
{
    struct clock clock = clock_monotonic();
    return (double)clock_now_ns(&clock) * 1e-9;
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

static double pixels_per_point(const struct camera_map *map, double x, double y)
{
    struct point a = camera_map_apply(map, (struct point){x - 0.5, y});
    struct point b = camera_map_apply(map, (struct point){x + 0.5, y});
    return hypot(b.x - a.x, b.y - a.y);
}

static void fill_report(const struct development *development)
{
    const struct calibration *calibration = development->calibration;
    const struct nacre_scan_info *info = &development->info;
    struct develop_report *report = development->report;
    report->width = info->width;
    report->height = info->height;
    report->window = info->window;
    report->channels = info->channels;
    report->white_frames = calibration->white_frames;
    report->black_frames = calibration->black_frames;
    report->dots_frames = calibration->dots_frames;
    report->black_level = calibration->black_median;
    report->frame_noise = calibration->noise_median;
    for (int c = 0; c < info->channels; c++) {
        report->white[c] = calibration->flat.levels[c] / calibration->flat.reflectance[c];
    }
    report->pixels_per_point =
        pixels_per_point(&calibration->map, info->width / 2.0, info->height / 2.0);
    report->linearity = calibration->linearity;
    report->align = calibration->align;
    report->white_seconds = calibration->white_seconds;
    report->black_seconds = calibration->black_seconds;
    report->dots_seconds = calibration->dots_seconds;
}

/* What the target says of the pitch, and whether the station file agrees. */
static int find_pitch(const struct develop_options *options, struct progress *progress,
                      struct nacre_scan_info *info, struct develop_report *report,
                      struct nacre_error *error)
{
    struct target_report *target = &report->target;
    report->pitch_mm = info->pitch_mm;
    if (!options->target) {
        return NACRE_OK;
    }
    int status =
        target_measure(options->target, options->target_spacing_mm, progress, target, error);
    if (status != NACRE_OK) {
        return status;
    }
    double off = target->pitch_mm / info->pitch_mm - 1;
    if (fabs(off) > fmax(pitch_limit, 5 * target->doubt)) {
        warnings_add(&report->warnings,
                     "the target says that surface points are %.4g mm apart, the station file %.4g "
                     "mm; the scan has the target's; put pitch_mm right",
                     target->pitch_mm, info->pitch_mm);
    }
    if (fabs(target->across / target->down - 1) > square_limit || target->uneven > square_limit) {
        warnings_add(&report->warnings,
                     "surface points are %.4g mm apart along rows and %.4g mm along columns, and "
                     "vary by %.2g %% over the region: a scan has one pitch for all; turn the "
                     "projector square to the stage",
                     target->across, target->down, 100 * target->uneven);
    }
    info->pitch_mm = report->pitch_mm = target->pitch_mm;
    return NACRE_OK;
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

static void warn_of_pulses(struct develop_report *report)
{
    if (report->pulse_error > colour_limit) {
        warnings_add(&report->warnings,
                     "a trigger pulse was measured at %.4f turns of the colour wheel: expect each "
                     "colour of its exposure to be wrong by %.2g %% (root mean square); check "
                     "wheel_hz and the wiring of the wheel's index",
                     report->pulse_turns, 100 * report->pulse_error);
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
    struct develop_report own = {0};
    struct visit_progress visits = {.progress = progress};
    struct development development = {
        .session = &session, .calibration = &calibration, .progress = &visits, .report = &own};
    const struct calibrate_options calibrate_options = {options->black, options->confidence,
                                                        options->known_pixels, options->pixels};
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
    visits.total = count_patterns(&session);
    status = calibrate(&session, &calibrate_options, &visits, &calibration, error);
    if (status != NACRE_OK) {
        goto out;
    }
    double mapped = now_seconds();
    status = development_choose(&development, options->demosaic, error);
    if (status != NACRE_OK) {
        goto out;
    }
    describe(&session, options, own.demosaic, calibration.flat.channels, &development.info);
    status = find_pitch(options, progress, &development.info, &own, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = development_measure_noise(&development, error);
    if (status != NACRE_OK) {
        goto out;
    }
    double grids = now_seconds();
    own.map_seconds = grids - mapped;
    status = development_write(&development, options, output, error);
    if (status != NACRE_OK) {
        goto out;
    }
    warn_of_dots(&calibration.align, &own.warnings);
    warn_of_pulses(&own);
    fill_report(&development);
    own.grid_seconds = now_seconds() - grids;
    own.total_seconds = now_seconds() - began;
    if (report) {
        *report = own;
    }
out:
    resampler_free(development.resampler);
    calibration_finish(&calibration);
    session_finish(&session);
    return status;
}
