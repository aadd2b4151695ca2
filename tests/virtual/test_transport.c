/* Lit pictures and scans of samples: reciprocity, linearity, determinism, shadows, and what is refused. */
#include "nacre/scan.h"
#include "rig/virtual/explain.h"
#include "rig/virtual/transport.h"
#include "slab.h"
#include "tests/files.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

/* As omp.h has them; clang-tidy has no such header. */
int omp_get_max_threads(void);
void omp_set_num_threads(int threads);

void setUp(void)
{
    scratch_make();
}

void tearDown(void)
{
    scratch_remove();
}

static struct nacre_error error;

static struct transport *prepare(const struct sample *sample)
{
    struct transport *transport = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, transport_new(sample, &transport, &error), error.text);
    return transport;
}

static size_t point_count(const struct transport *transport)
{
    struct transport_facts facts = transport_facts(transport);
    return (size_t)facts.width * (size_t)facts.height;
}

/* radiosity[3][points] under irradiance[3][points]; heap memory. */
static float *apply(struct transport *transport, const float *irradiance)
{
    float *radiosity = calloc(3 * point_count(transport), sizeof *radiosity);
    TEST_ASSERT_NOT_NULL(radiosity);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, transport_apply(transport, irradiance, radiosity, &error),
                                  error.text);
    return radiosity;
}

static float *light_one(struct transport *transport, size_t point)
{
    size_t points = point_count(transport);
    float *irradiance = calloc(3 * points, sizeof *irradiance);
    TEST_ASSERT_NOT_NULL(irradiance);
    for (size_t c = 0; c < 3; c++) {
        irradiance[c * points + point] = 1;
    }
    float *radiosity = apply(transport, irradiance);
    free(irradiance);
    return radiosity;
}

static const char *write_scan(struct transport *transport, int window, const char *name)
{
    const char *path = scratch_path(name);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, transport_write_scan(transport, window, path, NULL, &error),
                                  error.text);
    return path;
}

static void responses_are_reciprocal(void)
{
    struct slab slab;
    slab_make_mixed(&slab);
    struct transport *transport = prepare(&slab.sample);
    size_t points = point_count(transport);
    float *responses[20];
    TEST_ASSERT_EQUAL_UINT64(20, points);
    for (size_t i = 0; i < points; i++) {
        responses[i] = light_one(transport, i);
    }
    for (size_t c = 0; c < 3; c++) {
        for (size_t a = 0; a < points; a++) {
            for (size_t b = 0; b < a; b++) {
                /* The solver's tolerance, see test_diffusion.c. */
                double scale = sqrt((double)responses[a][c * points + a] *
                                    (double)responses[b][c * points + b]);
                TEST_ASSERT_DOUBLE_WITHIN(3e-6 * scale, (double)responses[a][c * points + b],
                                          (double)responses[b][c * points + a]);
            }
        }
    }
    for (size_t i = 0; i < points; i++) {
        free(responses[i]);
    }
    transport_free(transport);
}

static void light_adds_up(void)
{
    struct slab slab;
    slab_make_mixed(&slab);
    struct transport *transport = prepare(&slab.sample);
    size_t points = point_count(transport);
    float *mixed = calloc(3 * points, sizeof *mixed);
    double *expected = calloc(3 * points, sizeof *expected);
    TEST_ASSERT_TRUE(mixed && expected);
    for (size_t i = 0; i < points; i++) {
        float *one = light_one(transport, i);
        for (size_t c = 0; c < 3; c++) {
            mixed[c * points + i] = (float)((i * 7 + c * 3) % 11) * 100;
            for (size_t j = 0; j < points; j++) {
                expected[c * points + j] +=
                    (double)mixed[c * points + i] * (double)one[c * points + j];
            }
        }
        free(one);
    }
    float *seen = apply(transport, mixed);
    for (size_t i = 0; i < 3 * points; i++) {
        /* Twenty errors of 3e-6 of light up to 1000 on responses up to 0.2. */
        TEST_ASSERT_DOUBLE_WITHIN(20 * 3e-6 * 1000 * 0.2, expected[i], (double)seen[i]);
        TEST_ASSERT_TRUE(expected[i] > 1); /* the bound is less than a hundredth of it */
    }
    free(seen);
    free(expected);
    free(mixed);
    transport_free(transport);
}

static void no_light_gives_no_light(void)
{
    struct slab slab;
    slab_make_mixed(&slab);
    struct transport *transport = prepare(&slab.sample);
    float *dark = calloc(3 * point_count(transport), sizeof *dark);
    float *seen = apply(transport, dark);
    for (size_t i = 0; i < 3 * point_count(transport); i++) {
        TEST_ASSERT_EQUAL_FLOAT(0, seen[i]);
    }
    free(seen);
    free(dark);
    transport_free(transport);
}

/* Sizes that are no multiple of the 4 x 4 points solved at once, and a slab wider than a response's reach. */
static struct sample make_wide(struct slab *slab)
{
    slab_make_mixed(slab);
    slab->sample.width = 21;
    slab->sample.height = 6;
    slab->sample.margin_points = 3;
    slab->sample.thickness_mm = 1;
    slab->sample.inclusion_count = 2; /* without the layer, which lies deeper */
    return slab->sample;
}

static void scan_holds_the_responses_of_single_points(void)
{
    enum { K = 7, PLANE = K * K };
    struct slab slab;
    struct sample sample = make_wide(&slab);
    struct transport *transport = prepare(&sample);
    struct nacre_scan *scan = NULL;
    size_t points = point_count(transport);
    float response[3 * PLANE];
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        0, nacre_scan_open(write_scan(transport, K, "scan.exr"), &scan, &error), error.text);
    struct transport_facts facts = transport_facts(transport);
    TEST_ASSERT_TRUE(K / 2 + facts.reach_points[0] < sample.width); /* the boxes are really cut */
    TEST_ASSERT_EQUAL_INT(21, nacre_scan_info(scan)->width);
    TEST_ASSERT_EQUAL_INT(6, nacre_scan_info(scan)->height);
    TEST_ASSERT_EQUAL_INT(3, nacre_scan_info(scan)->channels);
    TEST_ASSERT_EQUAL_INT(NACRE_FLOAT, nacre_scan_info(scan)->pixel);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, nacre_scan_info(scan)->pitch_mm);
    for (size_t i = 0; i < points; i++) {
        int x = (int)i % 21;
        int y = (int)i / 21;
        float *seen = light_one(transport, i);
        TEST_ASSERT_EQUAL_INT(0, nacre_scan_read(scan, x, y, response, &error));
        for (int entry = 0; entry < 3 * PLANE; entry++) {
            int out_x = x + entry % K - K / 2;
            int out_y = y + entry / K % K - K / 2;
            double expected = 0;
            if (out_x >= 0 && out_x < 21 && out_y >= 0 && out_y < 6) {
                expected =
                    (double)seen[(size_t)(entry / PLANE) * points + (size_t)(out_y * 21 + out_x)];
            }
            double peak = (double)seen[(size_t)(entry / PLANE) * points + i];
            /* The solver's tolerance, and what is cut off beyond the reach: some millionths of the response's sum, of
             * which the peak has a third. */
            TEST_ASSERT_DOUBLE_WITHIN(1e-5 * peak, expected, (double)response[entry]);
            TEST_ASSERT_TRUE(response[entry] >= 0);
        }
        free(seen);
    }
    nacre_scan_close(scan);
    transport_free(transport);
}

static void light_outside_the_window_is_told(void)
{
    struct slab slab;
    struct sample sample = make_wide(&slab);
    struct transport *transport = prepare(&sample);
    (void)write_scan(transport, 3, "narrow.exr");
    struct transport_facts narrow = transport_facts(transport);
    (void)write_scan(transport, 25, "broad.exr");
    struct transport_facts broad = transport_facts(transport);
    TEST_ASSERT_TRUE(narrow.outside_max >= narrow.outside_mean);
    TEST_ASSERT_TRUE(narrow.outside_mean > 0.05 && narrow.outside_max < 0.9);
    TEST_ASSERT_TRUE(broad.outside_mean < 1e-3);
    transport_free(transport);
}

static void scan_does_not_depend_on_the_number_of_threads(void)
{
    struct slab slab;
    struct sample sample = make_wide(&slab);
    uint8_t *bytes[2];
    size_t sizes[2];
    int threads = omp_get_max_threads();
    for (int i = 0; i < 2; i++) {
        omp_set_num_threads(1 + 2 * i);
        struct transport *transport = prepare(&sample);
        bytes[i] = file_read(write_scan(transport, 7, "scan.exr"), &sizes[i]);
        TEST_ASSERT_NOT_NULL(bytes[i]);
        transport_free(transport);
    }
    omp_set_num_threads(threads);
    TEST_ASSERT_EQUAL_UINT64(sizes[0], sizes[1]);
    TEST_ASSERT_EQUAL_INT(0, memcmp(bytes[0], bytes[1], sizes[0]));
    free(bytes[0]);
    free(bytes[1]);
}

static void medium_that_only_absorbs_is_black(void)
{
    struct sample_material material;
    struct sample sample = slab_make(&material, 0, 2, 1.3);
    sample.width = sample.height = 5;
    sample.pitch_mm = 0.5;
    sample.thickness_mm = 2;
    struct transport *transport = prepare(&sample);
    float *seen = light_one(transport, 12);
    for (size_t i = 0; i < 3 * point_count(transport); i++) {
        TEST_ASSERT_EQUAL_FLOAT(0, seen[i]);
    }
    free(seen);
    transport_free(transport);
}

static void vein_casts_a_shadow(void)
{
    double points_mm[] = {4.25, -10, 4.25, 20}; /* along the ninth column */
    struct sample_material materials[2];
    struct sample_inclusion vein = {
        .material_index = 1,
        .depth_mm = {0, 1e6},
        .vein = {.points_mm = points_mm, .point_count = 4, .width_mm = 0.5, .line = 1}};
    struct sample sample = slab_make(&materials[0], 2, 0.02, 1);
    (void)slab_make(&materials[1], 1, 4, 1);
    sample.material_count = 2;
    sample.inclusions = &vein;
    sample.inclusion_count = 1;
    sample.width = 13;
    sample.height = 9;
    sample.margin_points = 6;
    sample.pitch_mm = 0.5;
    sample.thickness_mm = 4;
    struct transport *transport = prepare(&sample);
    float *seen = light_one(transport, 4 * 13 + 6);
    const float *row = seen + (size_t)4 * 13;
    /* Lit is column 6, the vein is column 8: column 10 lies behind it, column 2 as far on the other side. */
    TEST_ASSERT_TRUE(row[10] > 0);
    TEST_ASSERT_TRUE(3 * row[10] < row[2]);
    /* The vein itself is darker than the point on the other side. */
    TEST_ASSERT_TRUE(3 * row[8] < row[4]);
    free(seen);
    transport_free(transport);
}

static void scan_refuses_an_even_window(void)
{
    struct slab slab;
    slab_make_mixed(&slab);
    struct transport *transport = prepare(&slab.sample);
    TEST_ASSERT_EQUAL_INT(
        NACRE_FAILED, transport_write_scan(transport, 8, scratch_path("scan.exr"), NULL, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "8"));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "odd"));
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
    transport_free(transport);
}

static void scan_needs_a_folder_to_be_written_to(void)
{
    struct slab slab;
    slab_make_mixed(&slab);
    struct transport *transport = prepare(&slab.sample);
    TEST_ASSERT_EQUAL_INT(
        NACRE_FAILED,
        transport_write_scan(transport, 5, scratch_path("none/scan.exr"), NULL, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "none"));
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
    transport_free(transport);
}

static void slab_of_too_many_voxels_is_refused(void)
{
    struct sample_material material;
    struct sample sample = slab_make(&material, 10, 0.1, 1);
    struct transport *transport = NULL;
    sample.width = sample.height = 8192;
    sample.pitch_mm = 0.1;
    sample.thickness_mm = 10;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, transport_new(&sample, &transport, &error));
    TEST_ASSERT_NULL(transport);
    TEST_ASSERT_NOT_NULL(strstr(error.text, "voxels"));
}

static struct solver_choice choose(const struct sample *sample, int window, double tolerance)
{
    struct solver_choice choice;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        0, solver_choose(sample, window, tolerance, 1, 1, &choice, &error), error.text);
    return choice;
}

static const struct effect *find_effect(const struct effect *effects, size_t count,
                                        const char *name)
{
    for (size_t i = 0; i < count; i++) {
        if (strcmp(effects[i].name, name) == 0) {
            return &effects[i];
        }
    }
    TEST_FAIL_MESSAGE(name);
    return NULL;
}

static void effects_are_told_with_the_line_that_calls_for_them(void)
{
    struct slab slab;
    slab_make_mixed(&slab);
    slab.materials[0].scattering_line = 11;
    slab.materials[0].anisotropy_line = 13;
    slab.materials[0].index_line = 14;
    slab.inclusions[1].line = 27;
    slab.materials[1].name = (char[]){"rust"};
    slab.materials[2].name = (char[]){"ink"};
    slab.inclusions[0].material = slab.materials[1].name;
    slab.inclusions[1].material = slab.materials[2].name;
    slab.inclusions[2].material = slab.materials[2].name;
    struct transport *transport = prepare(&slab.sample);
    struct effect *effects = NULL;
    size_t count = 0;
    struct solver_choice choice = choose(&slab.sample, 9, 0);
    TEST_ASSERT_EQUAL_INT(SOLVER_DIFFUSION, choice.solver);
    TEST_ASSERT_EQUAL_INT(
        0, explain_effects(&slab.sample, transport, &choice, &effects, &count, &error));
    const struct effect *effect = find_effect(effects, count, "multiple scattering");
    TEST_ASSERT_TRUE(effect->simulated);
    TEST_ASSERT_EQUAL_INT(11, effect->line);
    effect = find_effect(effects, count, solver_name(SOLVER_DIFFUSION));
    TEST_ASSERT_TRUE(effect->simulated && effect->seconds > 0);
    TEST_ASSERT_EQUAL_INT(11, effect->line);
    effect = find_effect(effects, count, solver_name(SOLVER_CLOSED));
    TEST_ASSERT_FALSE(effect->simulated);
    TEST_ASSERT_NOT_NULL(strstr(effect->reason, "homogeneous"));
    TEST_ASSERT_FALSE(find_effect(effects, count, solver_name(SOLVER_MONTECARLO))->simulated);
    effect = find_effect(effects, count, "directed scattering");
    TEST_ASSERT_TRUE(effect->simulated);
    TEST_ASSERT_EQUAL_INT(13, effect->line);
    effect = find_effect(effects, count, "reflection inside the surface");
    TEST_ASSERT_TRUE(effect->simulated);
    TEST_ASSERT_EQUAL_INT(14, effect->line);
    effect = find_effect(effects, count, "cells of ink");
    TEST_ASSERT_TRUE(effect->simulated);
    TEST_ASSERT_EQUAL_INT(27, effect->line);
    TEST_ASSERT_FALSE(find_effect(effects, count, "local reflection")->simulated);
    TEST_ASSERT_FALSE(find_effect(effects, count, "refraction between materials")->simulated);
    free(effects);
    transport_free(transport);
}

static void effects_that_nothing_calls_for_are_left_out(void)
{
    struct sample_material material;
    struct sample sample = slab_make(&material, 1, 0, 1);
    struct effect *effects = NULL;
    size_t count = 0;
    sample.width = sample.height = 3;
    sample.pitch_mm = 1;
    sample.thickness_mm = 3;
    struct transport *transport = prepare(&sample);
    struct solver_choice choice = choose(&sample, 3, 0);
    TEST_ASSERT_EQUAL_INT(0,
                          explain_effects(&sample, transport, &choice, &effects, &count, &error));
    static const char *const absent[] = {"absorption", "directed scattering",
                                         "reflection inside the surface", "heterogeneity"};
    for (size_t i = 0; i < sizeof absent / sizeof *absent; i++) {
        const struct effect *effect = find_effect(effects, count, absent[i]);
        TEST_ASSERT_FALSE_MESSAGE(effect->simulated, absent[i]);
        TEST_ASSERT_EQUAL_INT(0, effect->line);
    }
    free(effects);
    transport_free(transport);
}

/* The flag stays set: run this last. */
static void interrupted_scan_leaves_no_file(void)
{
    struct slab slab;
    slab_make_mixed(&slab);
    struct transport *transport = prepare(&slab.sample);
    progress_catch_signals();
    TEST_ASSERT_EQUAL_INT(0, raise(SIGINT));
    TEST_ASSERT_EQUAL_INT(
        NACRE_CANCELLED,
        transport_write_scan(transport, 5, scratch_path("scan.exr"), NULL, &error));
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
    transport_free(transport);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(responses_are_reciprocal);
    RUN_TEST(light_adds_up);
    RUN_TEST(no_light_gives_no_light);
    RUN_TEST(scan_holds_the_responses_of_single_points);
    RUN_TEST(light_outside_the_window_is_told);
    RUN_TEST(scan_does_not_depend_on_the_number_of_threads);
    RUN_TEST(medium_that_only_absorbs_is_black);
    RUN_TEST(vein_casts_a_shadow);
    RUN_TEST(scan_refuses_an_even_window);
    RUN_TEST(scan_needs_a_folder_to_be_written_to);
    RUN_TEST(slab_of_too_many_voxels_is_refused);
    RUN_TEST(effects_are_told_with_the_line_that_calls_for_them);
    RUN_TEST(effects_that_nothing_calls_for_are_left_out);
    RUN_TEST(interrupted_scan_leaves_no_file);
    return UNITY_END();
}
