/* What a session's calibration frames say of its station: flat field, black level, geometry. */
#include "rig/develop/calibrate.h"

#include "base/clock.h"
#include "rig/develop/quad.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const double calibrate_dots_share = 0.1;

/* Statistics gathered over the frames of one kind. */
struct gathering {
    const struct noise_model *noise;
    struct moments values, variances;
    struct linearity linearity;
    int regressed, regressed_most; /* frames in the regression; 0: all */
};

/* Black frames in the regression: 16 know the dark counts of a pixel to a quarter of a sample's noise. */
enum { BLACK_REGRESSED = 16 };

/* Dots patterns on their way to the alignment. */
struct dots_gathering {
    const struct session *session;
    const struct flat *flat;
    struct dots_view *views; /* by pattern number; those not measured stay empty */
};

static double now_seconds(void)
{
    struct clock clock = clock_monotonic();
    return (double)clock_now_ns(&clock) * 1e-9;
}

static int take_frame(void *state, const struct merged *merged, const float *result,
                      struct nacre_error *error)
{
    struct gathering *gathering = state;
    (void)result;
    (void)error;
    moments_add(&gathering->values, merged->radiance);
    moments_add(&gathering->variances, merged->variance);
    if (gathering->regressed_most == 0 || gathering->regressed < gathering->regressed_most) {
        gathering->regressed++;
        linearity_add(&gathering->linearity, merged->frames, gathering->noise, merged->radiance);
    }
    return NACRE_OK;
}

static int gathering_init(struct gathering *gathering, const struct noise_model *noise,
                          size_t pixels, int regressed_most, struct nacre_error *error)
{
    *gathering = (struct gathering){.noise = noise, .regressed_most = regressed_most};
    int status = moments_init(&gathering->values, pixels, error);
    if (status == NACRE_OK) {
        status = moments_init(&gathering->variances, pixels, error);
    }
    if (status == NACRE_OK) {
        status = linearity_init(&gathering->linearity, pixels, error);
    }
    return status;
}

static void gathering_finish(struct gathering *gathering)
{
    moments_finish(&gathering->values);
    moments_finish(&gathering->variances);
    linearity_finish(&gathering->linearity);
}

/* Gather the frames of a kind. */
static int gather(const struct session *session, enum pattern_kind kind,
                  struct gathering *gathering, struct visit_progress *progress, int *frames,
                  struct nacre_error *error)
{
    int missing;
    struct visitor visitor = {.state = gathering, .take = take_frame};
    int status = visit_patterns(session, kind, 0, gathering->noise, &visitor, progress, frames,
                                &missing, error);
    if (status == NACRE_OK && *frames == 0) {
        status =
            nacre_fail(error, "%s: has no %s frame in calibration/; resume the scan to measure it",
                       session->path, pattern_kind_names[kind]);
    }
    return status;
}

/* Refuse white frames that say nothing: dark, or saturated at every exposure. */
static int check_white(const struct session *session, const struct gathering *white,
                       const float *mean, struct nacre_error *error)
{
    size_t pixels = white->values.pixels;
    size_t saturated = 0;
    size_t bright = 0;
    for (size_t i = 0; i < pixels; i++) {
        saturated += isnan(mean[i]) ? 1 : 0;
        bright += (double)mean[i] > 10 * sqrt(moments_mean(&white->variances, i)) ? 1 : 0;
    }
    if (20 * saturated > pixels) {
        return nacre_fail(
            error,
            "%s: the white frames are saturated at every exposure in %zu of %zu pixels; scan "
            "with a shorter exposure or a smaller aperture",
            session->path, saturated, pixels);
    }
    if (10 * bright < pixels) {
        return nacre_fail(
            error,
            "%s: the white frames are dark; were the projector on, the lens uncovered and the "
            "white layer in place?",
            session->path);
    }
    return NACRE_OK;
}

static float *means_of(const struct moments *moments)
{
    float *means = malloc(moments->pixels * sizeof *means);
    for (size_t i = 0; means && i < moments->pixels; i++) {
        means[i] = (float)moments_mean(moments, i);
    }
    return means;
}

static float *variances_of(const struct moments *moments)
{
    float *variances = malloc(moments->pixels * sizeof *variances);
    for (size_t i = 0; variances && i < moments->pixels; i++) {
        variances[i] = (float)moments_variance(moments, i);
    }
    return variances;
}

/* Judge the pixels, then make the flat field of those that can be trusted. */
static int make_flat(const struct session *session, const struct calibrate_options *options,
                     const struct gathering *white, const struct gathering *black,
                     const float *mean, struct calibration *calibration, struct nacre_error *error)
{
    const struct station_camera *camera = &session->station.camera;
    size_t pixels = white->values.pixels;
    struct pixel_map *map = &calibration->pixels;
    bool *defect = malloc(pixels * sizeof *defect);
    float *variance = variances_of(&black->values);
    float *foretold = means_of(&black->variances);
    /* Below 8 frames a pixel's own variance is too uncertain to judge it by. */
    bool enough = calibration->black_frames >= 8;
    const struct linearity_evidence evidence = {
        .white = &white->linearity,
        .black = &black->linearity,
        .noise = &calibration->noise,
        .longest_seconds =
            (double)session_exposure_ns(session, session->plan.exposure_count - 1) * 1e-9,
        .mean_white = mean,
        .black_variance = enough ? variance : NULL,
        .foretold_variance = foretold};
    int status = NACRE_OK;
    if (!defect || !variance || !foretold) {
        status = nacre_fail_memory(error, "the map of defect pixels");
        goto out;
    }
    status = pixel_map_init(map, camera->width, camera->height, (enum bayer)camera->bayer, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = linearity_judge(&evidence, map, &calibration->linearity, error);
    if (status == NACRE_OK && options->known_pixels) {
        status = pixel_map_add_known(map, options->known_pixels, error);
    }
    if (status == NACRE_OK && options->pixels) {
        status = pixel_map_write(map, options->pixels, error);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    for (size_t i = 0; i < pixels; i++) {
        defect[i] = map->classes[i] != PIXEL_GOOD;
    }
    status = flat_init(&calibration->flat, mean, defect, camera->width, camera->height,
                       (enum bayer)camera->bayer, session->station.white_reflectance, error);
out:
    free(defect);
    free(variance);
    free(foretold);
    return status;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Medians of level and deviation over the pixels that see the sample. */
static int note_black(const struct gathering *black, struct calibration *calibration,
                      struct nacre_error *error)
{
    size_t pixels = black->values.pixels;
    size_t used = 0;
    double *levels = malloc(2 * pixels * sizeof *levels);
    if (!levels) {
        return nacre_fail_memory(error, "the black level");
    }
    double *deviations = levels + pixels;
    for (size_t i = 0; i < pixels; i++) {
        if (calibration->flat.lit[i] && black->values.count[i]) {
            double own = moments_variance(&black->values, i);
            levels[used] = moments_mean(&black->values, i);
            deviations[used++] = sqrt(isnan(own) ? moments_mean(&black->variances, i) : own);
        }
    }
    qsort(levels, used, sizeof *levels, compare_doubles);
    qsort(deviations, used, sizeof *deviations, compare_doubles);
    calibration->black_median = used ? levels[used / 2] : NAN;
    calibration->noise_median = used ? deviations[used / 2] : NAN;
    free(levels);
    return used ? NACRE_OK
                : nacre_fail(
                      error,
                      "the black frames are saturated at every exposure; keep daylight off the "
                      "sample, or scan with a shorter exposure");
}

static int calibrate_levels(const struct session *session, const struct calibrate_options *options,
                            struct visit_progress *progress, struct calibration *calibration,
                            struct nacre_error *error)
{
    const struct station_camera *camera = &session->station.camera;
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    struct gathering white = {0};
    struct gathering black = {0};
    float *mean = NULL;
    double began = now_seconds();
    int status = gathering_init(&white, &calibration->noise, pixels, 0, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = gathering_init(&black, &calibration->noise, pixels, BLACK_REGRESSED, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = gather(session, PATTERN_WHITE, &white, progress, &calibration->white_frames, error);
    if (status != NACRE_OK) {
        goto out;
    }
    mean = means_of(&white.values);
    status = mean ? check_white(session, &white, mean, error)
                  : nacre_fail_memory(error, "the white frame");
    calibration->white_seconds = now_seconds() - began;
    if (status != NACRE_OK) {
        goto out;
    }
    began = now_seconds();
    status = gather(session, PATTERN_BLACK, &black, progress, &calibration->black_frames, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = make_flat(session, options, &white, &black, mean, calibration, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = note_black(&black, calibration, error);
    if (status != NACRE_OK) {
        status = nacre_fail_within(error, "%s", session->path);
        goto out;
    }
    status = black_level_init(&calibration->black, &black.values, &black.variances, options->black,
                              options->confidence, error);
    calibration->black_seconds = now_seconds() - began;
out:
    gathering_finish(&white);
    gathering_finish(&black);
    free(mean);
    return status;
}

/* Divide by white, find the dots, and draw what should be seen. Runs for several patterns at once; each writes its own
 * view. */
static int work_dots(void *state, const struct merged *merged, float *result,
                     struct nacre_error *error)
{
    struct dots_gathering *gathering = state;
    const struct flat *flat = gathering->flat;
    const struct station_sample *sample = &gathering->session->station.sample;
    const struct plan *plan = &gathering->session->plan;
    struct dots_view *view = &gathering->views[merged->pattern.number];
    size_t points = (size_t)sample->width * (size_t)sample->height;
    size_t pixels = (size_t)flat->width * (size_t)flat->height;
    uint8_t *levels = malloc(points);
    size_t lit = 0;
    int status = NACRE_OK;
    if (!levels) {
        return nacre_fail_memory(error, "a dots pattern");
    }
    plan_draw(plan, merged->pattern, sample->width, sample->height, levels);
    for (size_t i = 0; i < points; i++) {
        lit += levels[i] ? 1 : 0;
    }
    status = align_find_drawn(levels, sample->width, sample->height, &view->drawn,
                              &view->drawn_count, error);
    if (status != NACRE_OK || lit == 0) {
        goto out;
    }
    for (size_t i = 0; i < pixels; i++) {
        int channel = bayer_channel(flat->bayer, (int)(i % (size_t)flat->width),
                                    (int)(i / (size_t)flat->width));
        bool enough = (double)flat->white[i] > calibrate_dots_share * flat->levels[channel];
        result[i] = enough ? merged->radiance[i] / flat->white[i] : NAN;
    }
    status = dots_find(result, flat->width, flat->height, (double)lit / (double)points, &view->seen,
                       error);
out:
    free(levels);
    return status;
}

static int take_dots(void *state, const struct merged *merged, const float *result,
                     struct nacre_error *error)
{
    (void)state;
    (void)merged;
    (void)result;
    (void)error;
    return NACRE_OK;
}

static int calibrate_geometry(const struct session *session, struct visit_progress *progress,
                              struct calibration *calibration, struct nacre_error *error)
{
    const struct station *station = &session->station;
    const struct flat *flat = &calibration->flat;
    struct point corners[4];
    int missing;
    double began = now_seconds();
    size_t count = (size_t)plan_pattern_count(&session->plan, PATTERN_DOTS);
    struct dots_gathering gathering = {session, flat, calloc(count, sizeof(struct dots_view))};
    struct visitor visitor = {.state = &gathering,
                              .result_size = (size_t)flat->width * (size_t)flat->height,
                              .work = work_dots,
                              .take = take_dots};
    int status = NACRE_OK;
    if (!gathering.views) {
        return nacre_fail_memory(error, "the dots patterns");
    }
    status = visit_patterns(session, PATTERN_DOTS, 0, &calibration->noise, &visitor, progress,
                            &calibration->dots_frames, &missing, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (calibration->dots_frames == 0) {
        status = nacre_fail(error,
                            "%s: has no dots frame in calibration/; resume the scan to measure it",
                            session->path);
        goto out;
    }
    status = quad_find(flat->white, flat->width, flat->height, flat->bayer, corners, error);
    if (status == NACRE_OK) {
        status = align_dots(gathering.views, count, corners, station->sample.width,
                            station->sample.height,
                            (struct point){flat->width / 2.0, flat->height / 2.0},
                            &calibration->map, &calibration->align, error);
    }
    if (status != NACRE_OK) {
        status = nacre_fail_within(error, "%s/calibration", session->path);
    }
out:
    for (size_t v = 0; v < count; v++) {
        dots_view_finish(&gathering.views[v]);
    }
    free(gathering.views);
    calibration->dots_seconds = now_seconds() - began;
    return status;
}

int calibrate(const struct session *session, const struct calibrate_options *options,
              struct visit_progress *progress, struct calibration *calibration,
              struct nacre_error *error)
{
    const struct station_camera *camera = &session->station.camera;
    *calibration =
        (struct calibration){.noise = {camera->pedestal, camera->read_noise, camera->electrons}};
    int status = calibrate_levels(session, options, progress, calibration, error);
    if (status == NACRE_OK) {
        status = calibrate_geometry(session, progress, calibration, error);
    }
    if (status != NACRE_OK) {
        calibration_finish(calibration);
    }
    return status;
}

void calibration_finish(struct calibration *calibration)
{
    if (calibration) {
        flat_finish(&calibration->flat);
        pixel_map_finish(&calibration->pixels);
        black_level_finish(&calibration->black);
    }
}
