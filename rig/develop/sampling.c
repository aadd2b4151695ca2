/* How a session's camera pixels become surface points, asked of some of its frames, and what noise that leaves. */
#include "rig/develop/development.h"

#include <math.h>

/* The largest misfit at which the fit is used; measured, not derived. The virtual station's sharp camera stays below 0.03. Light that is blurred
 * by a tenth of a point exceeds it, and Malvar is nearer (tests/develop/test_resample.c). A lens out of focus by a
 * pixel exceeds it too, though the fit would still be nearer: the misfit cannot tell the two. */
static const double misfit_limit = 0.1;

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

int development_choose(struct development *development, enum demosaic wanted,
                       struct nacre_error *error)
{
    int visited;
    int missing;
    struct develop_report *report = development->report;
    struct asking asking = {.development = development};
    struct visitor visitor = {
        .state = &asking, .result_size = 2, .work = work_misfit, .take = take_misfit};
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
                            &development->calibration->noise, &visitor, development->progress,
                            &visited, &missing, error);
    if (status != NACRE_OK) {
        return status;
    }
    struct misfit misfit = asking.misfit;
    report->misfit = misfit.all > 0 ? sqrt(fmax(misfit.unexplained, 0) / misfit.all) : NAN;
    report->demosaic = report->misfit > misfit_limit ? mean : DEMOSAIC_FIT;
    return report->demosaic == DEMOSAIC_FIT ? NACRE_OK : make_resampler(development, mean, error);
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
