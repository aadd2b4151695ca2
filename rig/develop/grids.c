/* All grids of a session developed into a work file, and the scan written from that. */
#include "rig/develop/development.h"
#include "rig/develop/extract.h"
#include "rig/develop/falloff.h"
#include "rig/develop/share.h"
#include "rig/develop/wheel.h"
#include "rig/develop/work.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Light that varies more over the region is no projector's: the sample is not alike in both directions. Projectors keep half
 * of their light in the corners, poor ones as well, and 20 degrees from the axis cos^4 leaves 0.78 of that: 1 to 2.56. */
static const double falloff_limit = 1.5;

/* A fall-off known no better than this (of log E, middle to corner) is not worth taking out: over a window that reaches a fifth
 * of that way it is off by 1 %, as much as all else is (docs/accuracy.md), and what it could mend is seldom more. */
static const double doubt_limit = 0.05;

/* Everything that the visitor of grid frames needs. */
struct grids {
    const struct development *development;
    struct work *work;
    float *responses;    /* of one grid */
    struct share *share; /* NULL: windows do not overlap */
    struct extract_sums sums;
    bool separate;              /* gather what tells the fall-off */
    struct falloff_pairs pairs; /* where `separate` */
    struct falloff falloff;     /* the same */
    struct work_note worst;     /* the pulse that is the most wrong of all */
    uint64_t saturated, pixels;
    int taken_over;
};

/* Remember the pulse that the wheel makes the most wrong, if it is surely no whole number of turns. */
static void note_pulses(const struct session *session, const struct pattern_frames *frames,
                        struct work_note *note)
{
    double wheel_hz = session->station.projector.wheel_hz;
    for (size_t e = 0; e < frames->count; e++) {
        const struct exposure *exposure = &frames->exposures[e];
        int64_t off = llabs(exposure->pulse_ns - exposure->exposure_ns);
        if (exposure->pulse_ns > 0 && off > exposure->pulse_doubt_ns) {
            double turns = (double)exposure->pulse_ns * 1e-9 * wheel_hz;
            double wrong = wheel_colour_error(turns);
            if (wrong > note->pulse_error) {
                note->pulse_error = wrong;
                note->pulse_turns = turns;
            }
        }
    }
}

/* Size and last change of a grid's frame file; zeros where there is none. */
static void note_file(const struct session *session, struct pattern pattern, struct work_note *note)
{
    struct stat found;
    char *path = session_pattern_path(session, pattern);
    if (path && stat(path, &found) == 0) {
        note->frame_size = found.st_size;
        note->frame_ns = (int64_t)found.st_mtim.tv_sec * 1000000000 + found.st_mtim.tv_nsec;
    }
    free(path);
}

static bool knows_grid(void *state, struct pattern pattern)
{
    const struct grids *grids = state;
    struct work_note note = {0};
    note_file(grids->development->session, pattern, &note);
    return work_has(grids->work, pattern.number, note.frame_size, note.frame_ns);
}

static int work_grid(void *state, const struct merged *merged, float *result,
                     struct nacre_error *error)
{
    const struct grids *grids = state;
    return development_resample(grids->development, merged, result, error);
}

/* Cut a fresh grid's responses out of the light per point, into the work file. */
static int cut_grid(struct grids *grids, const struct merged *merged, const float *reflected,
                    struct work_note *note, struct nacre_error *error)
{
    const struct session *session = grids->development->session;
    const struct nacre_scan_info *info = &grids->development->info;
    int grid = merged->pattern.number;
    size_t size = nacre_scan_response_size(info);
    *note = (struct work_note){.saturated = merged->saturated,
                               .pixels = (uint64_t)merged->frames->width *
                                         (uint64_t)merged->frames->height};
    note_file(session, merged->pattern, note);
    note_pulses(session, merged->frames, note);
    if (grids->share) {
        share_begin(grids->share, grid, reflected);
    }
    for (size_t i = 0; i < work_count(grids->work, grid); i++) {
        int x;
        int y;
        work_place(grids->work, grid, i, &x, &y);
        extract_window(info, reflected, x, y, grids->responses + i * size);
        if (grids->share) {
            share_apply(grids->share, i, grids->responses + i * size);
        }
    }
    return work_write(grids->work, grid, note, grids->responses, error);
}

static int take_grid(void *state, const struct merged *merged, const float *result,
                     struct nacre_error *error)
{
    struct grids *grids = state;
    const struct nacre_scan_info *info = &grids->development->info;
    int grid = merged->pattern.number;
    size_t size = nacre_scan_response_size(info);
    struct work_note note;
    int status = merged->frames ? cut_grid(grids, merged, result, &note, error)
                                : work_read(grids->work, grid, &note, grids->responses, error);
    if (status != NACRE_OK) {
        return status;
    }
    grids->taken_over += merged->frames ? 0 : 1;
    grids->saturated += note.saturated;
    grids->pixels += note.pixels;
    if (note.pulse_error > grids->worst.pulse_error) {
        grids->worst = note;
    }
    for (size_t i = 0; i < work_count(grids->work, grid); i++) {
        const float *response = grids->responses + i * size;
        int x;
        int y;
        work_place(grids->work, grid, i, &x, &y);
        extract_add(info, x, y, response, &grids->sums);
        if (grids->separate) {
            falloff_pairs_add(&grids->pairs, info, x, y, response);
        }
    }
    return NACRE_OK;
}

static int check_light(const struct grids *grids, struct nacre_error *error)
{
    const struct extract_sums *sums = &grids->sums;
    const char *path = grids->development->session->path;
    double noise = grids->development->report->noise;
    if (sums->missing == sums->entries) {
        return nacre_fail(
            error,
            "%s: every grid frame is saturated at every exposure; scan with a shorter exposure or "
            "a smaller aperture",
            path);
    }
    double count = (double)sums->responses * grids->development->info.channels;
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

/* What the pairs say of the fall-off, into report and warnings; it is taken out only where it is to be believed. */
static int find_falloff(struct grids *grids, struct nacre_error *error)
{
    struct develop_report *report = grids->development->report;
    struct falloff *falloff = &grids->falloff;
    int status = falloff_find(&grids->pairs, falloff, error);
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
        grids->separate = false;
    }
    return NACRE_OK;
}

/* The scan from the work file, whole or not at all. */
static int write_scan(const struct grids *grids, const char *output, struct nacre_error *error)
{
    const struct nacre_scan_info *info = &grids->development->info;
    struct visit_progress *progress = grids->development->progress;
    struct nacre_scan_writer *writer = NULL;
    int status = NACRE_OK;
    float *response = malloc(nacre_scan_response_size(info) * sizeof *response);
    if (!response) {
        status = nacre_fail_memory(error, "a response");
        goto out;
    }
    status = nacre_scan_create(output, info, &writer, error);
    for (int y = 0; status == NACRE_OK && y < info->height; y++) {
        for (int x = 0; status == NACRE_OK && x < info->width; x++) {
            bool counts;
            status = work_read_point(grids->work, x, y, response, &counts, error);
            if (status == NACRE_OK && counts) {
                if (grids->separate) {
                    falloff_apply(&grids->falloff, info, x, y, response);
                }
                status = nacre_scan_write(writer, x, y, response, error);
            }
        }
        if (status == NACRE_OK) {
            status = progress_step(progress->progress, progress->done, progress->total, "writing",
                                   error);
        }
    }
    if (status == NACRE_OK) {
        status = nacre_scan_commit(writer, error);
        writer = NULL;
    }
out:
    nacre_scan_discard(writer);
    free(response);
    return status;
}

/* A number for all that responses depend on beside their own frames. */
static uint64_t key_of(const struct development *development)
{
    const struct calibration *calibration = development->calibration;
    const struct flat *flat = &calibration->flat;
    const struct camera_map *map = &calibration->map;
    const struct nacre_scan_info *info = &development->info;
    const struct plan *plan = &development->session->plan;
    size_t pixels = (size_t)flat->width * (size_t)flat->height;
    const int sizes[] = {
        info->width,        info->height, info->window,     info->channels,
        flat->width,        flat->height, (int)flat->bayer, (int)development->report->demosaic,
        plan->grid_spacing, plan->seed};
    const double numbers[] = {calibration->noise.pedestal,
                              calibration->noise.read_noise,
                              calibration->noise.electrons,
                              development->report->blur_px,
                              map->lens.centre.x,
                              map->lens.centre.y,
                              map->lens.unit,
                              map->lens.k1,
                              map->lens.k2,
                              flat->reflectance[0],
                              flat->reflectance[1],
                              flat->reflectance[2],
                              development->session->station.projector.wheel_hz};
    static const char built[] = NACRE_VERSION;
    uint64_t key = work_key(0, built, sizeof built);
    key = work_key(key, development->session->id, sizeof development->session->id);
    key = work_key(key, sizes, sizeof sizes);
    key = work_key(key, numbers, sizeof numbers);
    key = work_key(key, map->plane.m, sizeof map->plane.m);
    key = work_key(key, plan->exposure_turns, plan->exposure_count * sizeof(double));
    for (size_t i = 0; i < plan->region_count; i++) {
        const struct plan_region *region = &plan->regions[i];
        const int place[] = {region->x, region->y, region->width, region->height, region->spacing};
        key = work_key(key, place, sizeof place);
    }
    key = work_key(key, plan->profile, plan->profile_count * sizeof(double));
    key = work_key(key, flat->white, pixels * sizeof *flat->white);
    key = work_key(key, calibration->black.mean, pixels * sizeof(float));
    return work_key(key, calibration->black.limit, pixels * sizeof(float));
}

static void fill_report(const struct grids *grids)
{
    const struct nacre_scan_info *info = &grids->development->info;
    const struct extract_sums *sums = &grids->sums;
    struct develop_report *report = grids->development->report;
    report->taken_over = grids->taken_over;
    report->responses = sums->responses;
    report->missing_entries = sums->missing;
    report->saturated_share = (double)grids->saturated / (double)grids->pixels;
    report->centre = sums->centre / ((double)sums->responses * info->channels);
    report->rim_share = extract_rim_share(sums, info->window);
    report->overlap = extract_overlap(sums, info->window);
    report->pulse_turns = grids->worst.pulse_turns;
    report->pulse_error = grids->worst.pulse_error;
}

/* A place where no scan can be written is told before the work, not after it. */
static int check_place(const char *output, const struct nacre_scan_info *info,
                       struct nacre_error *error)
{
    struct nacre_scan_writer *writer = NULL;
    int status = nacre_scan_create(output, info, &writer, error);
    if (status == NACRE_OK) {
        nacre_scan_discard(writer);
    }
    return status;
}

static int make_ready(struct grids *grids, const struct develop_options *options,
                      const char *output, struct nacre_error *error)
{
    const struct development *development = grids->development;
    const struct nacre_scan_info *info = &development->info;
    const struct plan *plan = &development->session->plan;
    size_t most = 1;
    int status = check_place(output, info, error);
    if (status == NACRE_OK) {
        status = work_open(output, info, plan, key_of(development), options->resume, &grids->work,
                           error);
    }
    if (status == NACRE_OK && grids->separate) {
        status = falloff_pairs_init(&grids->pairs, info->width, info->height, error);
    }
    if (status == NACRE_OK) {
        status = share_new(info, plan, &grids->share, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    for (int g = 0; g < plan_pattern_count(plan, PATTERN_GRID); g++) {
        size_t count = work_count(grids->work, g);
        most = count > most ? count : most;
    }
    grids->responses = malloc(most * nacre_scan_response_size(info) * sizeof *grids->responses);
    return grids->responses ? NACRE_OK : nacre_fail_memory(error, "a grid's responses");
}

static void tell_of_work(int status, const char *output, struct nacre_error *error)
{
    if (status == NACRE_CANCELLED) {
        (void)nacre_fail(error, "%s: stopped on request; go on with --resume", output);
    } else if (error) {
        struct nacre_error cause = *error;
        (void)nacre_fail(error, "%s; then go on with --resume: %s.work holds what is developed",
                         cause.text, output);
    }
}

int development_write(struct development *development, const struct develop_options *options,
                      const char *output, struct nacre_error *error)
{
    struct grids grids = {.development = development, .separate = options->flat == FLAT_SEPARATE};
    struct develop_report *report = development->report;
    struct visitor visitor = {.state = &grids,
                              .result_size = resampler_size(development->resampler),
                              .knows = knows_grid,
                              .work = work_grid,
                              .take = take_grid};
    bool keep = !options->once;
    int status = make_ready(&grids, options, output, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = visit_patterns(development->session, PATTERN_GRID, 0, &development->calibration->noise,
                            &visitor, development->progress, &report->patterns,
                            &report->missing_patterns, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check_light(&grids, error);
    if (status != NACRE_OK) {
        keep = false; /* there is nothing in it */
        goto out;
    }
    if (grids.separate) {
        status = find_falloff(&grids, error);
    }
    if (status == NACRE_OK) {
        status = write_scan(&grids, output, error);
    }
    fill_report(&grids);
out:
    /* What was stopped can go on, and so can what failed once its cause is removed: a damaged frame, a full disk. */
    if (work_close(grids.work, keep && status != NACRE_OK)) {
        tell_of_work(status, output, error);
    }
    share_free(grids.share);
    falloff_finish(&grids.falloff);
    falloff_pairs_finish(&grids.pairs);
    free(grids.responses);
    return status;
}
