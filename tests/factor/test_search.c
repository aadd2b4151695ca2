/* Holding an error and a time: what a search tries, and whether it keeps its word. */
#include "device.h"
#include "outcome.h"
#include "paced.h"

#include "factor/layout.h"
#include "factor/probe.h"
#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct opencl opencl;
static struct nacre_error error;

void setUp(void)
{
    error = (struct nacre_error){0};
}

void tearDown(void)
{
}

/* The paper's candle: a term takes 392 KB as half floats, a cluster 29 KB. */
static struct search candle(bool cheapest)
{
    return (struct search){.most_terms = 64,
                           .most_clusters = 100,
                           .most_bytes = 240e6,
                           .cheapest = cheapest,
                           .points = 212 * 154,
                           .channels = 3,
                           .window = 49,
                           .value_bytes = 2};
}

/* A world where terms matter more than clusters, and both ever less. */
static double world(int terms, int clusters)
{
    return 0.12 / terms + 0.02 / clusters;
}

/* Search the world; the number of tries. */
static int search_world(struct search *s, double wanted)
{
    int terms = 0, clusters = 0;
    while (search_next(s, &terms, &clusters)) {
        for (int i = 0; i < s->count; i++) {
            TEST_ASSERT_FALSE(s->tries[i].terms == terms && s->tries[i].clusters == clusters);
        }
        search_note(s, &(struct search_try){.terms = terms,
                                            .clusters = clusters,
                                            .error = world(terms, clusters),
                                            .bytes = search_bytes(s, terms, clusters),
                                            .held = world(terms, clusters) <= wanted});
        TEST_ASSERT_TRUE(s->count < SEARCH_TRIES);
    }
    return s->count;
}

static double smallest_held(const struct search *s)
{
    double smallest = INFINITY;
    for (int i = 0; i < s->count; i++) {
        smallest = s->tries[i].held ? fmin(smallest, s->tries[i].bytes) : smallest;
    }
    return smallest;
}

/* Against all terms to 64 and clusters to 100, of which the search tries but a grid whose steps are up to a third apart
 * for terms, and twice for clusters, which take a thirteenth: within two fifths of the best. */
static void the_material_found_is_nearly_the_smallest_there_is(void)
{
    static const double wanted[] = {0.5, 0.1, 0.05, 0.03, 0.02, 0.012, 0.006};
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        struct search s = candle(true);
        double smallest = INFINITY;
        for (int terms = 1; terms <= 64; terms++) {
            for (int clusters = 1; clusters <= 100; clusters++) {
                if (world(terms, clusters) <= wanted[i]) {
                    smallest = fmin(smallest, search_bytes(&s, terms, clusters));
                }
            }
        }
        int tries = search_world(&s, wanted[i]);
        TEST_ASSERT_TRUE(tries <= 20);
        TEST_ASSERT_TRUE(smallest_held(&s) >= smallest);
        TEST_ASSERT_TRUE(smallest_held(&s) <= 1.4 * smallest);
    }
}

static void one_term_that_holds_is_one_try(void)
{
    struct search s = candle(true);
    TEST_ASSERT_EQUAL_INT(1, search_world(&s, 1));
    TEST_ASSERT_EQUAL_INT(1, s.tries[0].terms);
    TEST_ASSERT_EQUAL_INT(1, s.tries[0].clusters);
}

static void what_cannot_be_held_ends_with_the_largest(void)
{
    struct search s = candle(true);
    int tries = search_world(&s, 0);
    TEST_ASSERT_TRUE(tries >= 5);
    TEST_ASSERT_EQUAL_INT(64, s.tries[tries - 1].terms);
    TEST_ASSERT_EQUAL_INT(100, s.tries[tries - 1].clusters);
    TEST_ASSERT_TRUE(isinf(smallest_held(&s)));
}

static void what_the_user_fixed_stays_fixed(void)
{
    struct search s = candle(true);
    s.terms = 7;
    TEST_ASSERT_TRUE(search_world(&s, 0.02) > 3);
    for (int i = 0; i < s.count; i++) {
        TEST_ASSERT_EQUAL_INT(7, s.tries[i].terms);
    }
    s = candle(true);
    s.clusters = 9;
    TEST_ASSERT_TRUE(search_world(&s, 0.02) > 3);
    TEST_ASSERT_FALSE(isinf(smallest_held(&s)));
    for (int i = 0; i < s.count; i++) {
        TEST_ASSERT_EQUAL_INT(9, s.tries[i].clusters);
    }
    s.terms = 12;
    s.count = 0;
    TEST_ASSERT_EQUAL_INT(1, search_world(&s, 0.5));
}

static void no_more_clusters_are_tried_than_there_are_points(void)
{
    struct search s = candle(true);
    s.most_clusters = 3;
    TEST_ASSERT_TRUE(search_world(&s, 0.001) > 3);
    for (int i = 0; i < s.count; i++) {
        TEST_ASSERT_TRUE(s.tries[i].clusters <= 3);
    }
}

static void no_material_is_tried_that_is_too_large(void)
{
    struct search s = candle(false);
    s.most_bytes = search_bytes(&s, 16, 32);
    TEST_ASSERT_EQUAL_INT(3, search_world(&s, 0));
    TEST_ASSERT_EQUAL_INT(16, s.tries[2].terms);
    s = candle(false);
    s.most_bytes = 0; /* something must be tried all the same */
    TEST_ASSERT_EQUAL_INT(1, search_world(&s, 0));
}

/* Factors to look at: random, reproducible. */
static struct factors make_factors(const struct problem *problem, uint64_t seed)
{
    struct factors factors;
    const struct responses *r = problem->responses;
    size_t count = (size_t)problem->terms * (size_t)r->width * (size_t)r->height;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, factors_allocate(&factors, problem, &error));
    for (size_t c = 0; c < (size_t)r->channels; c++) {
        for (size_t i = 0; i < count; i++) {
            factors.f[c][i] = (float)random_uniform(seed, 6 * i + c);
            factors.h[c][i] = (float)random_uniform(seed, 6 * i + c + 3);
        }
    }
    return factors;
}

/* ||measured - factored|| / ||measured|| of a point by its definition, NaN where there is none. */
static double error_of_point(const struct sample *s, const struct responses *r,
                             const struct problem *p, const struct factors *factors, int x, int y)
{
    int half = s->window / 2, area = s->window * s->window, plane = s->width * s->height;
    double difference = 0, norm = 0;
    for (int i = 0; i < s->channels * area; i++) {
        int c = i / area, xo = x + i % s->window - half, yo = y + i % area / s->window - half;
        double value = (double)sample_at(s, x, y)[i], model = 0;
        if (xo < 0 || xo >= s->width || yo < 0 || yo >= s->height || isnan(value)) {
            continue;
        }
        for (int t = 0; t < p->terms; t++) {
            model += (double)factors->f[c][t * plane + y * s->width + x] *
                     (double)factors->h[c][t * plane + yo * s->width + xo];
        }
        int cluster = (int)p->ids[y * s->width + x];
        model *= (double)p->kernels[(cluster * s->channels + c) * area + i % area];
        model = ldexp(model, r->exponent[c]);
        difference += (value - model) * (value - model);
        norm += value * value;
    }
    return norm > 0 ? sqrt(difference / norm) : (double)NAN;
}

enum { WIDTH = 17, HEIGHT = 14, WINDOW = 7, TERMS = 3, POINTS = WIDTH * HEIGHT };

static void check_probe(const struct sample *sample, size_t most)
{
    struct responses r = sample_load(sample, layout_lanes(&opencl));
    uint32_t ids[POINTS];
    float kernels[2 * 3 * WINDOW * WINDOW];
    struct problem problem = {
        .responses = &r, .ids = ids, .kernels = kernels, .clusters = 2, .terms = TERMS};
    struct factors factors;
    struct probe probe;
    double sum = 0;
    size_t count = 0;
    for (uint32_t i = 0; i < POINTS; i++) {
        ids[i] = i % 2;
    }
    for (uint64_t i = 0; i < sizeof kernels / sizeof *kernels; i++) {
        kernels[i] = 0.2F * (float)random_uniform(4, i);
    }
    factors = make_factors(&problem, 5);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, probe_begin(&probe, &r, most, 3, &error));
    TEST_ASSERT_EQUAL_UINT64(most < r.measured_count ? most : r.measured_count, probe.count);
    for (size_t i = 0; i < probe.count; i++) {
        TEST_ASSERT_TRUE(r.measured[probe.points[i]]);
        TEST_ASSERT_TRUE(i == 0 || probe.points[i] > probe.points[i - 1]);
        double of_point =
            error_of_point(sample, &r, &problem, &factors, (int)probe.points[i] % WIDTH,
                           (int)probe.points[i] / WIDTH);
        sum += isnan(of_point) ? 0 : of_point;
        count += !isnan(of_point);
    }
    /* The model is evaluated in float: about 1e-6 of what it says. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5 * sum / (double)count, sum / (double)count,
                              probe_measure(&probe, &problem, &factors));
    probe_finish(&probe);
    factors_finish(&factors);
    responses_finish(&r);
}

static void the_probe_is_the_mean_error_of_its_points(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 3, WINDOW, 3);
    check_probe(&sample, 1000);
    check_probe(&sample, 40);
    check_probe(&sample, 1);
    sample_punch_holes(&sample);
    for (int i = 0; i < 3 * WINDOW * WINDOW; i++) {
        sample_at(&sample, 2, 1)[i] = 0;
    }
    check_probe(&sample, 1000);
    check_probe(&sample, 190);
    sample_finish(&sample);
}

/* Of fewer terms the strongest are kept, more are random and small. */
static void factors_of_other_terms_start_from_those_there_are(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 1, WINDOW, 3);
    struct responses r = sample_load(&sample, layout_lanes(&opencl));
    struct problem problem = {.responses = &r, .terms = 4};
    struct factors four = make_factors(&problem, 5), six, two;
    problem.terms = 6;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, factors_allocate(&six, &problem, &error));
    problem.terms = 2;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, factors_allocate(&two, &problem, &error));
    for (size_t i = 0; i < POINTS; i++) {
        four.f[0][i] *= 0.1F;
        four.h[0][2 * POINTS + i] *= 0.1F;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, factors_fit(&four, 1, &six, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, factors_fit(&four, 1, &two, &error));
    TEST_ASSERT_EQUAL_MEMORY(four.f[0], six.f[0], 4 * POINTS * sizeof(float));
    TEST_ASSERT_EQUAL_MEMORY(four.h[0], six.h[0], 4 * POINTS * sizeof(float));
    for (size_t i = 4 * POINTS; i < 6 * POINTS; i++) {
        TEST_ASSERT_TRUE(six.f[0][i] > 0 && six.f[0][i] < 0.1F);
        TEST_ASSERT_TRUE(six.h[0][i] > 0 && six.h[0][i] < 0.1F);
    }
    TEST_ASSERT_EQUAL_MEMORY(four.f[0] + POINTS, two.f[0], POINTS * sizeof(float));
    TEST_ASSERT_EQUAL_MEMORY(four.f[0] + 3 * POINTS, two.f[0] + POINTS, POINTS * sizeof(float));
    TEST_ASSERT_EQUAL_MEMORY(four.h[0] + 3 * POINTS, two.h[0] + POINTS, POINTS * sizeof(float));
    factors_finish(&four);
    factors_finish(&six);
    factors_finish(&two);
    responses_finish(&r);
    sample_finish(&sample);
}

static struct outcome run(const struct sample *sample, const struct factor_options *options)
{
    return outcome_of(sample, options, &opencl, &error);
}

static struct factor_options free_options(void)
{
    struct factor_options options = factor_options_default();
    options.terms = options.clusters = options.iterations = 0;
    return options;
}

/* Measured anew from the sample itself. */
static double mean_error(const struct sample *sample, const struct nacre_material *material)
{
    struct error_report report = outcome_judge(sample, material);
    double mean = report.whole.mean;
    error_report_finish(&report);
    return mean;
}

static void an_error_asked_for_is_held(void)
{
    static const double wanted[] = {0.2, 0.03};
    struct sample sample = sample_new(22, 18, 3, WINDOW, 3);
    double bytes[2] = {0};
    for (int i = 0; i < 2; i++) {
        struct factor_options options = free_options();
        options.error = wanted[i];
        struct outcome outcome = run(&sample, &options);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
        TEST_ASSERT_TRUE(outcome.summary.error_held);
        TEST_ASSERT_EQUAL_STRING("error", outcome.summary.stopped_by);
        TEST_ASSERT_TRUE(outcome.material.error_mean <= wanted[i]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-5 * wanted[i], outcome.material.error_mean,
                                  mean_error(&sample, &outcome.material));
        bytes[i] = (double)nacre_material_size(&outcome.material);
        outcome_finish(&outcome);
    }
    TEST_ASSERT_TRUE(bytes[0] < bytes[1]);
    sample_finish(&sample);
}

/* R_d = F H g is met by one term and one kernel up to the half floats' 2^-12. */
static void an_error_that_one_term_meets_takes_one_try(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    struct factor_options options = free_options();
    for (int y = 0; y < 12; y++) {
        for (int x = 0; x < 16; x++) {
            for (int i = 0; i < WINDOW * WINDOW; i++) {
                int dx = i % WINDOW - WINDOW / 2, dy = i / WINDOW - WINDOW / 2;
                float there = 1 + 0.5F * sinf((float)(x + dx)) * cosf((float)(y + dy));
                sample_at(&sample, x, y)[i] =
                    (1 + 0.1F * (float)(x % 3)) * there * expf(-(float)hypot(dx, dy));
            }
        }
    }
    options.error = 0.01;
    struct outcome outcome = run(&sample, &options);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
    TEST_ASSERT_TRUE(outcome.summary.error_held);
    TEST_ASSERT_EQUAL_INT(1, outcome.summary.search.count);
    TEST_ASSERT_EQUAL_INT(1, outcome.material.terms);
    TEST_ASSERT_EQUAL_INT(1, outcome.material.clusters);
    outcome_finish(&outcome);
    sample_finish(&sample);
}

/* Nothing holds an error of 0. The best of what was tried comes out, and the tries say so. */
static void an_error_that_cannot_be_held_gives_the_best_and_all_that_was_tried(void)
{
    struct sample sample = sample_new(14, 12, 1, WINDOW, 3);
    struct factor_options options = free_options();
    options.error = 0;
    struct outcome outcome = run(&sample, &options);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
    TEST_ASSERT_FALSE(outcome.summary.error_held);
    TEST_ASSERT_NOT_NULL(outcome.material.f);
    TEST_ASSERT_TRUE(outcome.summary.search.count >= 3);
    for (int i = 0; i < outcome.summary.search.count; i++) {
        TEST_ASSERT_FALSE(outcome.summary.search.tries[i].held);
        /* All points are probed here, so that only the rounding to half floats lies between the two. */
        TEST_ASSERT_TRUE(outcome.summary.search.tries[i].error >=
                         0.99 * outcome.material.error_mean);
    }
    outcome_finish(&outcome);
    sample_finish(&sample);
}

static void given_terms_and_clusters_are_kept_while_an_error_is_held(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    struct factor_options options = free_options();
    options.error = 0.05;
    options.terms = 5;
    options.clusters = 3;
    struct outcome outcome = run(&sample, &options);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
    TEST_ASSERT_TRUE(outcome.summary.error_held);
    TEST_ASSERT_EQUAL_INT(1, outcome.summary.search.count);
    TEST_ASSERT_EQUAL_INT(5, outcome.material.terms);
    TEST_ASSERT_EQUAL_INT(3, outcome.material.clusters);
    outcome_finish(&outcome);
    options.clusters = 0;
    options.iterations = 4;
    options.error = 0.001;
    outcome = run(&sample, &options);
    TEST_ASSERT_FALSE(outcome.summary.error_held);
    TEST_ASSERT_TRUE(outcome.summary.search.count > 1);
    for (int i = 0; i < outcome.summary.search.count; i++) {
        TEST_ASSERT_EQUAL_INT(5, outcome.summary.search.tries[i].terms);
        TEST_ASSERT_TRUE(outcome.summary.search.tries[i].iterations <= 4);
    }
    outcome_finish(&outcome);
    sample_finish(&sample);
}

static void the_same_search_gives_the_same_material(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    struct factor_options options = free_options();
    options.error = 0.04;
    struct outcome a = run(&sample, &options), b = run(&sample, &options);
    size_t count = (size_t)a.material.terms * 16 * 12;
    TEST_ASSERT_EQUAL_INT(a.material.terms, b.material.terms);
    TEST_ASSERT_EQUAL_INT(a.material.clusters, b.material.clusters);
    TEST_ASSERT_EQUAL_MEMORY(a.material.f, b.material.f, count * sizeof *a.material.f);
    TEST_ASSERT_EQUAL_MEMORY(a.material.h, b.material.h, count * sizeof *a.material.h);
    outcome_finish(&a);
    outcome_finish(&b);
    sample_finish(&sample);
}

static void a_dark_sample_holds_any_error(void)
{
    struct sample sample = sample_new(9, 8, 1, 5, 3);
    struct factor_options options = free_options();
    options.error = 0.01;
    sample_scale(&sample, 0);
    struct outcome outcome = run(&sample, &options);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
    TEST_ASSERT_TRUE(outcome.summary.error_held);
    outcome_finish(&outcome);
    sample_finish(&sample);
}

/* Clusters, reading and closing cost nothing on this clock, iterations a second a term or more. */
static struct outcome run_within(const struct sample *sample, struct paced *paced, double seconds,
                                 int terms, int clusters)
{
    struct factor_options options = free_options();
    paced_apply(paced, &options);
    options.terms = terms;
    options.clusters = clusters;
    options.seconds = seconds;
    return run(sample, &options);
}

static void a_time_is_kept(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    for (int method = 0; method < 2; method++) {
        struct paced paced;
        paced_begin(&paced, &opencl, (enum factor_method)method);
        paced.seconds_per_term = 0.1;
        struct outcome outcome = run_within(&sample, &paced, 60, 0, 0);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
        TEST_ASSERT_TRUE(paced_seconds(&paced) <= 60);
        TEST_ASSERT_TRUE(outcome.summary.error_held);
        /* It did not give up long before, unless all was done: no material of more than 8 terms is small enough here. */
        TEST_ASSERT_TRUE(paced_seconds(&paced) >= 40 ||
                         strcmp(outcome.summary.stopped_by, "time") != 0);
        TEST_ASSERT_TRUE(outcome.summary.search.count >= 2);
        outcome_finish(&outcome);
    }
    sample_finish(&sample);
}

/* From the 6th iteration on each takes ten times as long. Nobody can know that before; the excess is that iteration. */
static void a_method_that_suddenly_gets_slow_costs_one_iteration_at_most(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    for (int from = 2; from <= 14; from += 4) {
        struct paced paced;
        paced_begin(&paced, &opencl, FACTOR_METHOD_HALS);
        paced.seconds_per_term = 1;
        paced.slow_from = from;
        paced.slow_factor = 10;
        struct outcome outcome = run_within(&sample, &paced, 4.0 * from, 4, 2);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
        TEST_ASSERT_EQUAL_STRING("time", outcome.summary.stopped_by);
        TEST_ASSERT_TRUE(paced_seconds(&paced) <= 4.0 * from + paced.longest);
        TEST_ASSERT_TRUE(paced.iterations <= from);
        outcome_finish(&outcome);
    }
    sample_finish(&sample);
}

/* No larger settings are begun that there is no time for: one iteration of 8 terms takes 80 s. */
static void settings_that_take_too_long_are_not_begun(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    struct paced paced;
    paced_begin(&paced, &opencl, FACTOR_METHOD_MU);
    paced.seconds_per_term = 10;
    struct outcome outcome = run_within(&sample, &paced, 600, 0, 0);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
    TEST_ASSERT_TRUE(paced_seconds(&paced) <= 600);
    TEST_ASSERT_EQUAL_INT(4, outcome.material.terms);
    outcome_finish(&outcome);
    sample_finish(&sample);
}

static void more_time_than_needed_is_not_used(void)
{
    struct sample sample = sample_new(10, 9, 1, 5, 3);
    struct paced paced;
    paced_begin(&paced, &opencl, FACTOR_METHOD_HALS);
    paced.seconds_per_term = 0.1;
    struct outcome outcome = run_within(&sample, &paced, 1e6, 0, 0);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
    TEST_ASSERT_TRUE(paced_seconds(&paced) < 1e5);
    TEST_ASSERT_EQUAL_STRING("tolerance", outcome.summary.stopped_by);
    outcome_finish(&outcome);
    sample_finish(&sample);
}

static void too_little_time_is_refused_with_what_is_needed(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    struct paced paced;
    paced_begin(&paced, &opencl, FACTOR_METHOD_HALS);
    struct outcome outcome = run_within(&sample, &paced, 0.01, 0, 0);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, outcome.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "too few"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "or more"), error.text);
    TEST_ASSERT_NULL(outcome.material.f);
    TEST_ASSERT_EQUAL_INT(0, paced.iterations);
    outcome_finish(&outcome);
    sample_finish(&sample);
}

/* The error comes first, but the time ends the search: three iterations are no more than a beginning. */
static void of_error_and_time_the_time_wins(void)
{
    struct sample sample = sample_new(16, 12, 1, WINDOW, 3);
    struct paced paced;
    struct factor_options options = free_options();
    paced_begin(&paced, &opencl, FACTOR_METHOD_HALS);
    paced_apply(&paced, &options);
    paced.seconds_per_term = 1;
    options.error = 1e-4;
    options.seconds = 30;
    struct outcome outcome = run(&sample, &options);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, outcome.status, error.text);
    TEST_ASSERT_FALSE(outcome.summary.error_held);
    TEST_ASSERT_EQUAL_STRING("time", outcome.summary.stopped_by);
    TEST_ASSERT_TRUE(paced_seconds(&paced) <= 30);
    outcome_finish(&outcome);
    paced_begin(&paced, &opencl, FACTOR_METHOD_HALS);
    paced.seconds_per_term = 1e-3;
    options.error = 0.1;
    outcome = run(&sample, &options);
    TEST_ASSERT_TRUE(outcome.summary.error_held);
    TEST_ASSERT_EQUAL_STRING("error", outcome.summary.stopped_by);
    outcome_finish(&outcome);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(the_material_found_is_nearly_the_smallest_there_is);
    RUN_TEST(one_term_that_holds_is_one_try);
    RUN_TEST(what_cannot_be_held_ends_with_the_largest);
    RUN_TEST(what_the_user_fixed_stays_fixed);
    RUN_TEST(no_more_clusters_are_tried_than_there_are_points);
    RUN_TEST(no_material_is_tried_that_is_too_large);
    RUN_TEST(the_probe_is_the_mean_error_of_its_points);
    RUN_TEST(factors_of_other_terms_start_from_those_there_are);
    RUN_TEST(an_error_asked_for_is_held);
    RUN_TEST(an_error_that_one_term_meets_takes_one_try);
    RUN_TEST(an_error_that_cannot_be_held_gives_the_best_and_all_that_was_tried);
    RUN_TEST(given_terms_and_clusters_are_kept_while_an_error_is_held);
    RUN_TEST(the_same_search_gives_the_same_material);
    RUN_TEST(a_dark_sample_holds_any_error);
    RUN_TEST(a_time_is_kept);
    RUN_TEST(a_method_that_suddenly_gets_slow_costs_one_iteration_at_most);
    RUN_TEST(settings_that_take_too_long_are_not_begun);
    RUN_TEST(more_time_than_needed_is_not_used);
    RUN_TEST(too_little_time_is_refused_with_what_is_needed);
    RUN_TEST(of_error_and_time_the_time_wins);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
