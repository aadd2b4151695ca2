/* Choosing the next step from what the steps so far brought and took. */
#include "render/refine.h"

#include <math.h>

/* About as many as the sampler takes at least, one in each triangle; fewer would cost as much. */
static const double first_density = 3;

static const double usual_tolerance = 5e-3, coarsest_tolerance = 2e-2, finest_tolerance = 2.5e-4;

/* Wishes for less than this share more are not worth a step. */
static const double least_growth = 1.2;

/* The first steps say little of how the error goes on. */
static const double most_growth = 8;

/* Of all samples so far in a half. Beyond, floats' rounding counts. */
static const double density_limit = 1e5;

/* Samples in one step of a half: what memory holds. */
static const double step_samples = 4e6;

/* Steps and the picture take this much longer than foreseen. */
static const double step_caution = 1.2, closing_caution = 1.15;

/* Of the time that is left for steps, what one aims at: other programs may slow the machine down while it is under way. */
static const double step_share = 0.6;

/* Beyond this share of the time, looking how long the picture takes would take what it needs. */
static const double closing_share = 0.4;

/* The halves cannot tell what they share: where light ends within few kernels' widths, their difference is one number, and
 * may be small by chance. How many of N samples, one or more to a triangle, fall inside a patch of light hangs on the
 * triangles at its rim, of which there are 3.5 N^(1/2), each off by 0.2^(1/2) of a sample: sqrt(0.7) N^(-3/4) of the light
 * in one half, and the mean of two has less by sqrt(2). */
static const double rim_noise = 0.6, rim_power = -0.75;

/* Samples to a surface point, in a half, that find no light where there is none. */
static const double dark_density = 24;

/* 30 years: nanoseconds of far more do not fit into 64 bits. */
static const double longest_seconds = 1e9;

struct run {
    const struct refine_goal *goal;
    const struct refine_work *work;
    struct refine_report *report;
    double density; /* so far, in a half */
    double samples_per_density;
    double samples, lit;  /* so far, in a half */
    double weighted_bias; /* sum of what summing up changes, times density */
    double closing;       /* seconds */
};

static bool wants_error(const struct run *run)
{
    return run->goal->error < 1;
}

static bool has_deadline(const struct run *run)
{
    return run->goal->seconds > 0;
}

double refine_seconds(const struct refine_goal *goal)
{
    return (double)(clock_now_ns(goal->clock) - goal->begun_ns) * 1e-9;
}

/* When the picture has to be begun; the first step is of use whenever it ends. */
static int64_t steps_end_ns(const struct run *run)
{
    double seconds = fmin(run->goal->seconds - run->closing, longest_seconds);
    return has_deadline(run) && run->report->count > 0
               ? run->goal->begun_ns + (int64_t)(seconds * 1e9)
               : 0;
}

/* Of the mean of both halves; 1: no light was found yet where there may be some. */
static double noise_so_far(const struct run *run)
{
    double measured = run->work->noise(run->work->context);
    if (run->samples > 0 && !(run->lit > 0)) {
        return run->density < dark_density ? 1 : 0;
    }
    return measured > 0 ? fmax(measured, rim_noise * pow(run->lit, rim_power)) : 0;
}

static int take(struct run *run, double density, double tolerance, struct nacre_error *error)
{
    const struct refine_step step = {density, run->density, tolerance, steps_end_ns(run)};
    struct refine_report *report = run->report;
    struct refine_outcome outcome = {0};
    double begun = refine_seconds(run->goal);
    int status = run->work->bake(run->work->context, &step, &outcome, error);
    if (status != NACRE_OK || outcome.cut) {
        report->cut = outcome.cut;
        return status;
    }
    run->density += density;
    run->weighted_bias += outcome.summed * density;
    run->samples_per_density = (double)outcome.samples / density;
    run->samples += (double)outcome.samples;
    run->lit += (double)outcome.lit;
    report->noise = noise_so_far(run);
    report->bias = run->weighted_bias / run->density;
    report->error = hypot(report->noise, report->bias);
    report->steps[report->count++] = (struct refine_try){2 * run->density, tolerance, report->noise,
                                                         refine_seconds(run->goal) - begun};
    return NACRE_OK;
}

/* How the noise goes on: as the power of the number of samples by which it fell last, within reason. */
static double noise_power(const struct refine_report *report)
{
    if (report->count < 2) {
        return 0.5;
    }
    const struct refine_try *two = &report->steps[report->count - 1], *one = two - 1;
    double power = log(one->noise / two->noise) / log(two->density / one->density);
    return isfinite(power) ? fmin(fmax(power, 0.4), 0.75) : 0.5;
}

/* What a step takes at most for each unit of density: what the last took. Telling what does not grow with the density
 * apart would foresee too little wherever the machine's speed changes. */
static double step_rate(const struct refine_report *report)
{
    const struct refine_try *last = &report->steps[report->count - 1];
    double before = report->count > 1 ? last[-1].density : 0;
    return last->seconds / ((last->density - before) / 2);
}

/* The largest step that there is time for. */
static double affordable(const struct run *run)
{
    double left = run->goal->seconds - refine_seconds(run->goal) - run->closing;
    return left / (step_caution * fmax(step_rate(run->report), 1e-12));
}

/* The noise that leaves the bias room below the error asked for. */
static double wanted_noise(const struct run *run)
{
    double bias = run->report->bias, error = run->goal->error;
    return sqrt(fmax(error * error - bias * bias, error * error / 4));
}

/* Of the step that is to come; 0: none is worth it, *reason tells why. */
static double next_density(const struct run *run, const char **reason)
{
    const struct refine_report *report = run->report;
    double growth = most_growth;
    if (run->density >= density_limit || report->count >= REFINE_STEPS_MAXIMUM) {
        *reason = "limit";
        return 0;
    }
    if (wants_error(run)) {
        double ratio = report->noise / fmax(wanted_noise(run), 1e-12);
        growth = fmin(fmax(1.1 * pow(ratio, 1 / noise_power(report)), least_growth), most_growth);
    }
    double memory = step_samples / fmax(run->samples_per_density, 1e-9);
    double least = fmin(fmax((least_growth - 1) * run->density, first_density), memory);
    double density = fmin(fmax((growth - 1) * run->density, first_density), memory);
    if (has_deadline(run)) {
        double most = affordable(run);
        if (most < least) {
            *reason = "time";
            return 0;
        }
        density = fmin(density, fmax(step_share * most, least));
    }
    return density;
}

/* Half of the error, which leaves 87 % of it to noise at least. Without one, half of the noise that is to be expected. */
static double next_tolerance(const struct run *run, double density)
{
    const struct refine_report *report = run->report;
    if (wants_error(run) && run->goal->error > 0) {
        return fmin(run->goal->error / 2, coarsest_tolerance);
    }
    if (report->count == 0) {
        return usual_tolerance;
    }
    double last = report->steps[report->count - 1].tolerance;
    double noise = report->noise * pow(run->density / (run->density + density), 0.5);
    return fmin(last, fmax(fmax(noise / 2, last / 2), finest_tolerance));
}

static int look_at_closing(struct run *run, struct nacre_error *error)
{
    struct refine_report *report = run->report;
    if (!has_deadline(run) || refine_seconds(run->goal) > closing_share * run->goal->seconds) {
        return NACRE_OK;
    }
    int status = run->work->closing(run->work->context, &report->closing_seconds, error);
    run->closing = closing_caution * report->closing_seconds;
    return status;
}

int refine_run(const struct refine_goal *goal, const struct refine_work *work,
               struct refine_report *report, struct nacre_error *error)
{
    struct run run = {.goal = goal, .work = work, .report = report};
    *report = (struct refine_report){0};
    int status = take(&run, first_density, next_tolerance(&run, 0), error);
    if (status == NACRE_OK) {
        status = look_at_closing(&run, error);
    }
    bool blind = has_deadline(&run) && !(report->closing_seconds > 0);
    while (status == NACRE_OK) {
        report->error_held = !wants_error(&run) || report->error <= goal->error;
        if (report->noise <= 0 || (wants_error(&run) && report->error_held)) {
            report->stopped_by = "error";
            break;
        }
        if (blind) {
            report->stopped_by = "time";
            break;
        }
        double density = next_density(&run, &report->stopped_by);
        if (!(density > 0)) {
            break;
        }
        status = take(&run, density, next_tolerance(&run, density), error);
        if (report->cut) {
            report->stopped_by = "time";
            break;
        }
    }
    return status;
}
