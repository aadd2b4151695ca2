/* Tests of plans adapted to a pilot. */
#include "made.h"
#include "rig/develop/adapt.h"
#include "rig/sequence.h"
#include "tests/files.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 192, BORDER = 88, HEIGHT = 64, WINDOW = 31, HALF = WINDOW / 2 };

static const char station_text[] =
    "sample: {width: 192, height: 64, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 300, height: 300, bayer: RGGB, bits: 10, pedestal: 24,\n"
    "         read_noise: 0.8, electrons: 15}\n"
    "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\n"
    "virtual: {sample: sample.yaml}\n";

static const char plan_text[] = "black_frames: 40\ngrid_spacing: 31\nwindow: 31\n"
                                "grid_patterns: 20\nexposure_turns: [1, 4, 15, 60, 240]\n";

static struct nacre_error error;
static struct station station;
static struct plan plan;
static struct pilot pilot;
static struct adapt_result result;
static char *folder;

void setUp(void)
{
    char path[256];
    folder = folder_make();
    (void)snprintf(path, sizeof path, "%s/station.yaml", folder);
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs(station_text, file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, station_read(path, &station, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, plan_parse("plan.yaml", plan_text, strlen(plan_text), &plan, &error), error.text);
}

void tearDown(void)
{
    folder_remove(folder);
    pilot_finish(&pilot);
    plan_finish(&plan);
    station_finish(&station);
}

/* What reaches `reach` points and has `light` in all; entries without noise. */
struct kind {
    double reach, light;
};

static double entry(struct kind kind, double r)
{
    double x = r / kind.reach;
    return kind.light * exp(-x) / (6.283 * kind.reach * kind.reach); /* e^-x over the plane */
}

/* Responses every 37 points, so far from the sample's border: those of `left` up to BORDER, of `right` beyond. */
static void measure_inside(struct kind left, struct kind right, int margin)
{
    static float response[3 * WINDOW * WINDOW];
    const struct nacre_scan_info info = {
        .width = WIDTH, .height = HEIGHT, .window = WINDOW, .channels = 3};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, pilot_init(&pilot, &info, 2e-5, &error));
    for (int c = 0; c < 3; c++) {
        pilot.white[c] = 20000;
    }
    for (int i = 0; i < WIDTH * HEIGHT; i += 37) {
        int x = i % WIDTH, y = i / WIDTH;
        if (x < margin || y < margin || x >= WIDTH - margin || y >= HEIGHT - margin) {
            continue;
        }
        for (int k = 0; k < 3 * WINDOW * WINDOW; k++) {
            response[k] = (float)entry(x < BORDER ? left : right,
                                       hypot(k % WINDOW - HALF, k / WINDOW % WINDOW - HALF));
        }
        TEST_ASSERT_EQUAL_INT(NACRE_OK, pilot_add(&pilot, &info, x, y, response, &error));
    }
}

static void measure(struct kind left, struct kind right)
{
    measure_inside(left, right, 0);
}

static void adapt(double overlap, double noise, int block, double seconds)
{
    /* The tails alone decide. */
    const struct adapt_wish wish = {overlap, 10, noise, block, seconds};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, adapt_plan(&pilot, &station, &wish, &plan, &result, &error), error.text);
    struct sequence_needs needs;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, sequence_estimate(&station, &plan, NULL, &needs, &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 * needs.seconds, needs.seconds, result.seconds);
    TEST_ASSERT_EQUAL_DOUBLE(1, plan.exposure_turns[0]);
}

static void spacing_follows_the_footprint(void)
{
    const struct kind wide = {3, 0.5};
    measure(wide, wide);
    /* Beyond r lies (1 + x) e^-x of e^-x over the plane, x = r / 3; of a square of half side h less than beyond h, and
     * more than beyond h sqrt(2). 5 % leave between 4.74 * 3 / sqrt(2) = 10 and 14.2. */
    adapt(0.05, 0.02, 0, 0);
    TEST_ASSERT_TRUE(plan.grid_spacing >= 2 * 10 + 1 && plan.grid_spacing <= 2 * 14 + 1);
    TEST_ASSERT_EQUAL_INT(0, plan.region_count);
    TEST_ASSERT_EQUAL_INT(plan.grid_spacing * plan.grid_spacing, result.grids);
    TEST_ASSERT_TRUE(plan.profile_count > 0); /* windows of 31 overlap */
}

static void wide_windows_without_overlap_need_no_profile(void)
{
    const struct kind wide = {3, 0.5};
    measure(wide, wide);
    adapt(1e-6, 0.02, 0, 0); /* as wide as the window */
    TEST_ASSERT_EQUAL_INT(WINDOW, plan.grid_spacing);
    TEST_ASSERT_EQUAL_UINT(0, plan.profile_count);
}

static void less_noise_takes_longer(void)
{
    const struct kind kind = {3, 0.5};
    double before = 0;
    measure(kind, kind);
    for (int halvings = 0; halvings < 4; halvings++) {
        double noise = ldexp(0.8, -halvings);
        struct plan wished = plan;
        TEST_ASSERT_EQUAL_INT_MESSAGE(
            NACRE_OK, plan_parse("plan.yaml", plan_text, strlen(plan_text), &wished, &error),
            error.text);
        plan_finish(&plan);
        plan = wished;
        adapt(0.05, noise, 0, 0);
        TEST_ASSERT_EQUAL_UINT(0, result.noisy);
        TEST_ASSERT_TRUE(result.tails.worst <= noise);
        TEST_ASSERT_TRUE(result.seconds >= before);
        before = result.seconds;
    }
}

/* 1 over the variance of merged exposures, of so much light in raw units a second. */
static double weight_of(const double *turns, size_t count, double light)
{
    double weight = 0;
    for (size_t e = 0; e < count; e++) {
        double t = turns[e] / 30;
        double variance = 0.64 + 1.0 / 12 + light * t / 15;
        weight += e == 0 || light * t + 4 * sqrt(variance) < 1022 - 24 ? t * t / variance : 0;
    }
    return weight;
}

/* The mean of the light on the ring of the chessboard at distance `ring`. */
static double ring_light(struct kind kind, int ring)
{
    double sum = 0;
    for (int along = -ring; along < ring; along++) {
        sum += 4 * entry(kind, hypot(ring, along));
    }
    return sum / (8 * ring);
}

/* The noise of a response off its centre over its light, of the plan's exposures: entry by entry, or with the light of
 * each ring's mean. */
static double tails_of(struct kind kind, bool by_rings)
{
    static const double turns[] = {1, 4, 15, 60, 240};
    double power = 0, noise = 0, dark_weight = weight_of(turns, 5, pilot.black);
    for (int k = 0; k < 3 * WINDOW * WINDOW; k++) {
        int channel = k / (WINDOW * WINDOW);
        int u = abs(k % WINDOW - HALF), v = abs(k / WINDOW % WINDOW - HALF);
        if (u || v) {
            double value = entry(kind, hypot(u, v));
            double light = by_rings ? ring_light(kind, u > v ? u : v) : value;
            double deviation = pilot.channel_noise[channel];
            power += value * value - pilot.noise * pilot.noise;
            noise += deviation * deviation * dark_weight /
                     weight_of(plan.exposure_turns, plan.exposure_count,
                               light * pilot.white[channel] + pilot.black);
        }
    }
    return sqrt(noise / power);
}

static void noise_is_foretold_by_the_sensor(void)
{
    const struct kind kind = {3, 0.5};
    measure_inside(kind, kind,
                   HALF); /* whole windows: what lies outside would be taken to be as the rest */
    pilot.black = 60;
    pilot.white[1] = 28000;
    pilot.channel_noise[1] = 1e-5;
    adapt(0.05, 1e-9, 0, 0); /* the best there are */
    TEST_ASSERT_EQUAL_UINT(pilot.responses, result.noisy);
    /* An entry without light scatters by channel_noise in the pilot with its exposures; with those that were chosen, and with
     * light, as the sensor's variances weigh them. The black level, too, is light. */
    double expected = tails_of(kind, true);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 * expected, expected, result.tails.mean); /* of floats */
    /* The plan knows rings of the chessboard by their mean only, within which light varies: entry by entry it is 0.9 % more. */
    TEST_ASSERT_DOUBLE_WITHIN(0.01 * expected, tails_of(kind, false), result.tails.mean);
}

/* Seconds of exposing, 30 turns a second, by the plan's exposures and those that each grid has: 4 white, 9 dots and the
 * black frames have all. */
static double seconds_by_count(void)
{
    double turns = 0;
    for (int g = 0; g < result.grids; g++) {
        for (size_t e = 0; e < plan.grids->exposures[g]; e++) {
            turns += plan.exposure_turns[e];
        }
    }
    for (size_t e = 0; e < plan.exposure_count; e++) {
        turns += (4 + 9 + plan.black_frames) * plan.exposure_turns[e];
    }
    return turns / 30;
}

static void narrow_and_dim_regions_get_long_exposures_alone(void)
{
    /* On the left narrow and dark, on the right wide and bright. */
    measure((struct kind){1.2, 0.02}, (struct kind){3, 0.8});
    adapt(0.05, 0.3, 16, 0);
    TEST_ASSERT_TRUE(plan.region_count > 0);
    TEST_ASSERT_TRUE(result.narrowest < result.widest);
    size_t most = 0;
    int with_most = 0;
    for (int g = 0; g < result.grids; g++) {
        most = plan.grids->exposures[g] > most ? plan.grids->exposures[g] : most;
    }
    for (int g = 0; g < result.grids; g++) {
        with_most += plan.grids->exposures[g] == most;
    }
    /* The column of blocks where the two meet is both wide and dark: 16 of the columns of the wide lattice need long
     * exposures. The narrow lattice fits among these, or at worst into none of them. */
    int wide = result.widest * result.widest;
    int border = 16 * result.widest;
    TEST_ASSERT_TRUE(with_most >= border);
    TEST_ASSERT_TRUE(with_most <= border + result.narrowest * result.narrowest);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 * result.seconds, seconds_by_count(), result.seconds);
    double apart = result.seconds;
    double longest = plan.exposure_turns[most - 1];
    struct plan again;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          plan_parse("plan.yaml", plan_text, strlen(plan_text), &again, &error));
    plan_finish(&plan);
    plan = again;
    adapt(0.05, 0.3, 0, 0);
    TEST_ASSERT_EQUAL_INT(wide, result.grids);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 * result.seconds, seconds_by_count(), result.seconds);
    /* All alike, every grid has the longest exposure, without which the left is lost. What regions save of these comes back in
     * part: two exposures more, of 5 and 11 turns, in all grids, and such grids as the narrow lattice leaves over, at most as
     * many again as there were. */
    TEST_ASSERT_EQUAL_DOUBLE(longest, plan.exposure_turns[plan.exposure_count - 1]);
    double saved = (wide - with_most) * longest / 30;
    TEST_ASSERT_TRUE(apart < result.seconds - saved + 2 * wide * (1 + 5 + 11) / 30.0);
}

/* No set of four exposures is within 5 % of the best for responses that saturate early and for those that do not. */
static void wishes_beyond_reach_get_what_is_best_for_all(void)
{
    measure((struct kind){1.2, 0.02}, (struct kind){1.2, 0.8});
    adapt(0.05, 1e-9, 0, 0);
    TEST_ASSERT_EQUAL_UINT(pilot.responses, result.noisy);
    /* The dark ones decide: 240 turns have a weight of 57,600 with them, and what four exposures of the ladder below them have is
     * 240^2 + 160^2 + 107^2 = 94,649 at most. */
    double least = 94649.0 / 57600;
    TEST_ASSERT_EQUAL_DOUBLE(240, plan.exposure_turns[plan.exposure_count - 1]);
    double dark = result.tails.worst;
    tearDown();
    setUp();
    measure((struct kind){1.2, 0.02}, (struct kind){1.2, 0.02});
    adapt(0.05, 1e-9, 0, 0);
    TEST_ASSERT_TRUE(dark < 1.001 * sqrt(least) * result.tails.worst);
}

static void pilots_that_tell_no_noise_are_refused(void)
{
    const struct kind kind = {3, 0.5};
    const struct adapt_wish wish = {0.05, 0.02, 0.02, 0, 0};
    for (int what = 0; what < 3; what++) {
        measure(kind, kind);
        pilot.channel_noise[1] = what == 0 ? NAN : what == 1 ? 0 : 1e-5;
        pilot.white[2] = what == 2 ? 0 : 20000;
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                              adapt_plan(&pilot, &station, &wish, &plan, &result, &error));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "black and white frames"), error.text);
        pilot_finish(&pilot);
    }
}

static void time_is_kept_by_wider_bounds(void)
{
    const struct kind kind = {3, 0.5};
    measure(kind, kind);
    adapt(0.05, 0.02, 0, 600);
    TEST_ASSERT_TRUE(result.seconds <= 600);
    TEST_ASSERT_TRUE(result.widened > 1);
    /* No more than needed: bounds a step of 1.1 narrower, wished without a limit, take longer. */
    double narrower = result.widened / 1.1;
    struct plan again;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          plan_parse("plan.yaml", plan_text, strlen(plan_text), &again, &error));
    plan_finish(&plan);
    plan = again;
    adapt(0.05 * narrower, 0.02 * narrower, 0, 0);
    TEST_ASSERT_TRUE(result.seconds > 600);
}

static void time_that_cannot_be_kept_is_refused(void)
{
    const struct kind kind = {3, 0.5};
    const struct adapt_wish wish = {0.05, 0.02, 0.02, 0, 0.5};
    measure(kind, kind);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          adapt_plan(&pilot, &station, &wish, &plan, &result, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no plan takes less"), error.text);
}

static void dark_levels_are_measured_until_they_add_little(void)
{
    measure((struct kind){3, 0.5}, (struct kind){3, 0.5});
    adapt(0.05, 0.2, 0, 0);
    int bright = plan.black_frames;
    double noise = 0.2;
    /* The mean's deviation of all entries, over the root of the responses' squares, is a quarter of the noise allowed or less. */
    double dark = 0;
    double best = 0;
    for (size_t e = 0; e < plan.exposure_count; e++) {
        dark += plan.exposure_turns[e] * plan.exposure_turns[e];
    }
    for (int e = 0; e < 5; e++) {
        const double turns[] = {1, 4, 15, 60, 240};
        best += turns[e] * turns[e];
    }
    double entries = 3.0 * WINDOW * WINDOW * 4e-10 * best / dark;
    TEST_ASSERT_TRUE(sqrt(entries / bright / pilot.places[0].power) <= 0.25 * noise * 1.001);
    TEST_ASSERT_TRUE(bright >= 16);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(spacing_follows_the_footprint);
    RUN_TEST(wide_windows_without_overlap_need_no_profile);
    RUN_TEST(less_noise_takes_longer);
    RUN_TEST(noise_is_foretold_by_the_sensor);
    RUN_TEST(narrow_and_dim_regions_get_long_exposures_alone);
    RUN_TEST(wishes_beyond_reach_get_what_is_best_for_all);
    RUN_TEST(pilots_that_tell_no_noise_are_refused);
    RUN_TEST(time_is_kept_by_wider_bounds);
    RUN_TEST(time_that_cannot_be_kept_is_refused);
    RUN_TEST(dark_levels_are_measured_until_they_add_little);
    return UNITY_END();
}
