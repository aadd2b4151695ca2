/* How a session's camera pixels become surface points, asked of some of its frames, and what noise that leaves. */
#include "rig/develop/blur.h"
#include "rig/develop/development.h"

#include <math.h>

/* The largest misfit at which the fit is used; measured, not derived. The virtual station's sharp camera stays below
 * 0.03. Light that is blurred by a tenth of a point exceeds it, and Malvar is nearer (tests/develop/test_resample.c). */
static const double misfit_limit = 0.1;

/* What a sharp camera leaves, and how much of it a blur that is believed leaves at most. */
static const double sharp_limit = 0.03, believed = 0.8;

/* Sums over the entries of developed black frames, and what the fit leaves of grids. */
struct asking {
    const struct development *development;
    double squares[3];
    size_t entries[3];
    struct misfit misfit;
};

int development_resample(const struct development *development, const struct merged *merged,
                         float *reflected, struct nacre_error *error)
{
    black_level_subtract(&development->calibration->black, merged->radiance);
    return resampler_apply(development->resampler, merged->radiance, reflected, error);
}

static int work_black(void *state, const struct merged *merged, float *result,
                      struct nacre_error *error)
{
    const struct asking *asking = state;
    return development_resample(asking->development, merged, result, error);
}

static int take_black(void *state, const struct merged *merged, const float *result,
                      struct nacre_error *error)
{
    struct asking *asking = state;
    size_t points = resampler_size(asking->development->resampler) /
                    (size_t)asking->development->calibration->flat.channels;
    (void)merged;
    (void)error;
    for (int c = 0; c < asking->development->calibration->flat.channels; c++) {
        for (size_t i = 0; i < points; i++, result++) {
            if (!isnan(*result)) {
                asking->squares[c] += (double)*result * (double)*result;
                asking->entries[c]++;
            }
        }
    }
    return NACRE_OK;
}

static int work_misfit(void *state, const struct merged *merged, float *result,
                       struct nacre_error *error)
{
    const struct development *development = ((const struct asking *)state)->development;
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
    struct asking *asking = state;
    (void)merged;
    (void)error;
    asking->misfit.unexplained += (double)result[0];
    asking->misfit.all += (double)result[1];
    return NACRE_OK;
}

static int make_resampler(struct development *development, enum demosaic demosaic, double blur,
                          struct nacre_error *error)
{
    const struct calibration *calibration = development->calibration;
    const struct station_sample *sample = &development->session->station.sample;
    resampler_free(development->resampler);
    development->resampler = NULL;
    return resampler_new(&calibration->flat, &calibration->map, sample->width, sample->height,
                         demosaic, blur, &development->resampler, error);
}

/* What the fit for a camera out of focus by so many pixels leaves of frames of a kind, relative; NaN where nothing is to be seen
 * in them. */
static int measure_misfit(struct development *development, double blur, enum pattern_kind kind,
                          double *misfit, struct nacre_error *error)
{
    int visited;
    int missing;
    struct asking asking = {.development = development};
    struct visitor visitor = {
        .state = &asking, .result_size = 2, .work = work_misfit, .take = take_misfit};
    int status = make_resampler(development, DEMOSAIC_FIT, blur, error);
    if (status == NACRE_OK) {
        status = visit_patterns(development->session, kind, MISFIT_FRAMES,
                                &development->calibration->noise, &visitor, development->progress,
                                &visited, &missing, error);
    }
    const struct misfit *sums = &asking.misfit;
    *misfit = sums->all > 0 ? sqrt(fmax(sums->unexplained, 0) / sums->all) : NAN;
    return status;
}

/* The blur that leaves least of the frames of dots, by the golden section, to a fortieth of a pixel. */
static int find_blur(struct development *development, double *blur, double *misfit,
                     struct nacre_error *error)
{
    enum { STEPS = 10 };
    const double golden = 0.6180339887498949;
    double from = 0, to = BLUR_MOST, places[2], found[2] = {NAN, NAN};
    int status = NACRE_OK;
    for (int i = 0; i < 2 && status == NACRE_OK; i++) {
        places[i] = from + (i ? golden : 1 - golden) * (to - from);
        status = measure_misfit(development, places[i], PATTERN_DOTS, &found[i], error);
    }
    for (int step = 2; step < STEPS && status == NACRE_OK; step++) {
        int worse = found[0] < found[1];
        *(worse ? &to : &from) = places[worse];
        places[worse] = places[!worse];
        found[worse] = found[!worse];
        places[!worse] = from + (worse ? 1 - golden : golden) * (to - from);
        status = measure_misfit(development, places[!worse], PATTERN_DOTS, &found[!worse], error);
    }
    int better = found[1] < found[0];
    *blur = places[better];
    *misfit = found[better];
    return status;
}

/* Whether the camera is out of focus. The dots lie on the white layer, which is sharp, so that what blurs them blurs the grids,
 * too: a blur is believed if both agree with it. Light that is soft in the sample alone leaves the dots sharp, and what makes
 * soft dots alone, as a white layer that spreads light, does not become the grids. */
static int look_for_blur(struct development *development, struct nacre_error *error)
{
    struct develop_report *report = development->report;
    double sharp = NAN, blurred = NAN, grids = NAN, blur = 0;
    int status = measure_misfit(development, 0, PATTERN_DOTS, &sharp, error);
    if (status != NACRE_OK || !(sharp > sharp_limit)) {
        return status;
    }
    status = find_blur(development, &blur, &blurred, error);
    if (status == NACRE_OK && blurred < believed * sharp) {
        status = measure_misfit(development, blur, PATTERN_GRID, &grids, error);
    }
    if (status == NACRE_OK && grids < believed * report->misfit) {
        report->misfit = grids;
        report->blur_px = blur;
    }
    return status;
}

int development_choose(struct development *development, enum demosaic wanted,
                       struct nacre_error *error)
{
    struct develop_report *report = development->report;
    enum demosaic mean =
        development->calibration->flat.channels == 1 ? DEMOSAIC_AREA : DEMOSAIC_MALVAR;
    report->demosaic = wanted;
    report->misfit = NAN;
    report->blur_px = 0;
    if (wanted != DEMOSAIC_AUTO) {
        return make_resampler(development, wanted, 0, error);
    }
    int status = measure_misfit(development, 0, PATTERN_GRID, &report->misfit, error);
    if (status == NACRE_OK && report->misfit > sharp_limit) {
        status = look_for_blur(development, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    report->demosaic = report->misfit > misfit_limit ? mean : DEMOSAIC_FIT;
    return make_resampler(development, report->demosaic, report->blur_px, error);
}

/* What one entry of R_d scatters by: black frames developed as if they were grids. They had their part in the mean
 * that was taken off them, which hides 1/n of their variance. */
int development_measure_noise(struct development *development, struct nacre_error *error)
{
    struct asking asking = {.development = development};
    struct visitor visitor = {.state = &asking,
                              .result_size = resampler_size(development->resampler),
                              .work = work_black,
                              .take = take_black};
    int visited;
    int missing;
    int status = visit_patterns(development->session, PATTERN_BLACK, NOISE_FRAMES,
                                &development->calibration->noise, &visitor, development->progress,
                                &visited, &missing, error);
    struct develop_report *report = development->report;
    double frames = development->calibration->black_frames;
    double squares = 0;
    double entries = 0;
    for (int c = 0; c < 3; c++) {
        squares += asking.squares[c];
        entries += (double)asking.entries[c];
        report->channel_noise[c] =
            frames > 1 && asking.entries[c]
                ? sqrt(asking.squares[c] / (double)asking.entries[c] * frames / (frames - 1))
                : NAN;
    }
    report->noise =
        frames > 1 && entries > 0 ? sqrt(squares / entries * frames / (frames - 1)) : NAN;
    return status;
}
