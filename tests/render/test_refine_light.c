/* Scenes whose samples are chosen for an error or a time: the error that is told against a reference, and a time by the work
 * that is done. */
#include "refine_left.h"
#include "render/stage_refine.h"
#include "stand.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct nacre_error error;
static struct scene scene;
static struct stage stage;
static struct render_report report;

void setUp(void)
{
    struct nacre_material even = stand_even_material(12, 5, 1.2, 0.6);
    scratch_make();
    error.text[0] = '\0';
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          nacre_material_write(scratch_path("material.exr"), &even, &error));
    nacre_material_finish(&even);
}

static void finish(void)
{
    stage_finish(&stage);
    scene_finish(&scene);
    render_report_finish(&report);
}

void tearDown(void)
{
    finish();
    scratch_remove();
}

static void prepare(const char *text, const struct render_settings *settings)
{
    finish();
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, scene_parse("scene.yaml", scratch_path(""), text, strlen(text), &scene, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_prepare(&stage, &scene, settings, &report, &error), error.text);
}

/* A ball of 4,900 surface points, half in the shade of a plate, and a ground. */
#define BALL                                                                                       \
    "image: {width: 40, height: 30}\n"                                                             \
    "camera: {position_mm: [0, -100, 60], at_mm: [0, 0, 10]}\n"                                    \
    "lights:\n"                                                                                    \
    "  - {kind: area, position_mm: [40, -20, 70], at_mm: [0, 0, 10], size_mm: [25, 25]}\n"         \
    "objects:\n"                                                                                   \
    "  - {shape: sphere, size_mm: 20, position_mm: [0, 0, 0], material: {file: material.exr, "     \
    "mapping: sphere, point_mm: 0.5}}\n"                                                           \
    "  - {shape: quad, size_mm: [12, 12, 1], position_mm: [12, -8, 35], color: [0.5, 0.5, 0.5]}\n"

static int no_closing(void *context, double *seconds, struct nacre_error *e)
{
    (void)context;
    (void)e;
    *seconds = 0.1;
    return NACRE_OK;
}

/* What the ball's vertices have; the caller frees it. */
static float *light_of(const char *text, const struct render_settings *settings)
{
    prepare(text, settings);
    int status = settings->goal
                     ? stage_bake_refined(&stage, stand_opencl(), no_closing, NULL, &report, &error)
                     : stage_bake(&stage, stand_opencl(), &report, &error);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, status, error.text);
    size_t size = stage.objects[0].mesh.vertex_count * sizeof *stage.objects[0].light;
    float *copy = malloc(size);
    TEST_ASSERT_NOT_NULL(copy);
    memcpy(copy, stage.objects[0].light, size);
    return copy;
}

static double difference(const float *one, const float *two)
{
    double square = 0, sum = 0;
    for (size_t i = 0; i < 3 * stage.objects[0].mesh.vertex_count; i++) {
        square += ((double)one[i] - two[i]) * ((double)one[i] - two[i]);
        sum += (double)two[i] * two[i];
    }
    return sqrt(square / sum);
}

static const double reference_density = 60;

static struct render_settings settings_of(const struct refine_goal *goal)
{
    return (struct render_settings){.bake = {.density = reference_density,
                                             .tolerance = 1e-9,
                                             .rays = 4,
                                             .seed = 12345,
                                             .quiet = true},
                                    .goal = goal,
                                    .triangle_limit = 30000};
}

/* What all are compared with. */
static float *reference_light(void)
{
    static float *light; /* until the program ends */
    if (!light) {
        struct render_settings fine = settings_of(NULL);
        light = light_of(BALL, &fine);
    }
    return light;
}

/* The light is correlated within a kernel, 25 surface points, and half the ball is lit: 2,450 / 25 = 98 independent
 * places, in which both the true and the estimated root mean square scatter by 1 / sqrt(2 98) = 7 %, their ratio by 10
 * %; within four times that, 40 %. The reference has four times the samples and more, one even set: it is off by less
 * than half of the error, 12 % in the sum of squares, which the 40 % hold too. The tolerance is a bound on top. */
static void the_error_that_is_told_is_the_error(void)
{
    struct clock clock = clock_monotonic();
    const float *reference = reference_light();
    const struct refine_goal goal = {0.03, 0, &clock, clock_now_ns(&clock)};
    struct render_settings chosen = settings_of(&goal);
    chosen.bake.seed = 1;
    float *light = light_of(BALL, &chosen);
    double off = difference(light, reference);
    free(light);
    TEST_ASSERT_TRUE(report.refine.error_held);
    TEST_ASSERT_TRUE(off < 1.4 * report.refine.noise + report.refine.bias);
    TEST_ASSERT_TRUE(off > report.refine.noise / 1.4 - report.refine.bias);
    TEST_ASSERT_TRUE(off < 1.4 * goal.error);
}

/* Where light falls on a few surface points alone, the halves' difference is little more than one number, which may be
 * small by chance, and the first step's samples may all miss the light. The error told is not below what the light's
 * rim makes; true and told scatter by one number each, so that three standard errors are allowed, and half of a percent
 * for the reference, which has 1,400 samples in the light: 0.84 1400^(-3/4) = 0.4 %. */
static void light_on_a_few_surface_points_is_found(void)
{
    static const char text[] =
        "camera: {position_mm: [0, -60, 60], at_mm: [0, 0, 0]}\n"
        "lights: [{kind: spot, position_mm: [1.23, 0.78, 60], at_mm: [1.23, 0.78, 0], angle_deg: "
        "1, soft_deg: 0, irradiance: 10}]\n"
        "objects: [{shape: quad, size_mm: [20, 20, 1], material: {file: material.exr, mapping: "
        "planar, point_mm: 0.5}}]\n";
    struct clock clock = clock_monotonic();
    struct render_settings fine = settings_of(NULL);
    fine.bake.density = 400;
    float *reference = light_of(text, &fine);
    for (uint64_t seed = 1; seed <= 12; seed++) {
        const struct refine_goal goal = {0.2, 0, &clock, clock_now_ns(&clock)};
        struct render_settings chosen = settings_of(&goal);
        chosen.bake.seed = seed;
        float *light = light_of(text, &chosen);
        double off = difference(light, reference);
        TEST_ASSERT_TRUE(report.refine.error_held);
        TEST_ASSERT_TRUE(off < 3 * report.refine.error + 0.005);
        free(light);
    }
    free(reference);
}

/* Two halves of two steps are as good as one set of as many samples: nothing that was made is lost, and no sample comes
 * twice. Independent halves scatter by sqrt(2) more than one even set of twice the samples at worst (noise as 1 / N);
 * with the 40 % of above, 2. The error told is the error after several steps too. */
static void steps_add_up_to_one_large_set(void)
{
    struct clock clock = clock_monotonic();
    const float *reference = reference_light();
    const struct refine_goal goal = {0.016, 0, &clock, clock_now_ns(&clock)};
    struct render_settings chosen = settings_of(&goal);
    chosen.bake.seed = 1;
    float *light = light_of(BALL, &chosen);
    const struct refine_report told = report.refine;
    TEST_ASSERT_TRUE(told.count >= 2);
    TEST_ASSERT_TRUE(4 * told.steps[told.count - 1].density <= reference_density);
    double off = difference(light, reference);
    struct render_settings whole = settings_of(NULL);
    whole.bake.seed = 1;
    whole.bake.density = told.steps[told.count - 1].density;
    whole.bake.tolerance = told.bias;
    float *single = light_of(BALL, &whole);
    TEST_ASSERT_TRUE(off < 2 * difference(single, reference) + whole.bake.tolerance);
    TEST_ASSERT_TRUE(off < 1.4 * told.noise + told.bias && off > told.noise / 1.4 - told.bias);
    TEST_ASSERT_TRUE(told.error_held && off < 1.4 * goal.error);
    free(single);
    free(light);
}

/* Light from object to object is in both halves too. */
static void bounces_are_refined_as_well(void)
{
    static const char text[] = BALL "bounces: 1\n";
    struct clock clock = clock_monotonic();
    struct render_settings fine = settings_of(NULL);
    fine.bake.density = 20;
    float *reference = light_of(text, &fine);
    float *plain = malloc(stage.objects[1].mesh.vertex_count * sizeof *stage.objects[1].light);
    TEST_ASSERT_NOT_NULL(plain);
    size_t plain_size = stage.objects[1].mesh.vertex_count * sizeof *stage.objects[1].light;
    memcpy(plain, stage.objects[1].light, plain_size);
    const struct refine_goal goal = {0.02, 0, &clock, clock_now_ns(&clock)};
    struct render_settings chosen = settings_of(&goal);
    chosen.bake.seed = 1;
    float *light = light_of(text, &chosen);
    TEST_ASSERT_TRUE(difference(light, reference) < 1.4 * 0.02);
    /* The plain plate's light is a mean of both halves, not their sum. */
    double sum = 0, expected = 0;
    for (size_t i = 0; i < 3 * stage.objects[1].mesh.vertex_count; i++) {
        sum += ((const float *)stage.objects[1].light)[i];
        expected += plain[i];
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.05 * expected, expected, sum);
    free(light);
    free(plain);
    free(reference);
}

/* A clock by the work that is done: a microsecond for each ray, ten for each sample; ever more beyond some work. */
struct work_clock {
    struct clock clock;
    uint64_t steady; /* 0: for ever */
};

static uint64_t work_done(void)
{
    uint64_t work = 0;
    for (size_t i = 0; i < report.object_count; i++) {
        work += report.objects[i].counts.work.shadow_rays + 10 * report.objects[i].counts.samples;
    }
    return work;
}

static int64_t work_now_ns(struct clock *clock)
{
    uint64_t steady = ((struct work_clock *)clock)->steady, work = work_done();
    work += steady > 0 && work > steady ? 1000 * (work - steady) : 0;
    return INT64_C(1000000000000) + (int64_t)work * 1000;
}

static void work_sleep(struct clock *clock, int64_t time_ns)
{
    (void)clock;
    (void)time_ns;
    TEST_FAIL_MESSAGE("waiting is no work");
}

static const struct clock_ops work_ops = {
    .name = "work", .now_ns = work_now_ns, .sleep_until_ns = work_sleep};

static void a_time_is_kept_with_real_light(void)
{
    struct work_clock clock = {{&work_ops}, 0};
    for (int k = 0; k < 2; k++) {
        double seconds = 1.5 * (1 + k);
        const struct refine_goal goal = {1, seconds, &clock.clock, INT64_C(1000000000000)};
        struct render_settings chosen = settings_of(&goal);
        free(light_of(BALL, &chosen));
        double taken = refine_seconds(&goal) + 0.1;

        TEST_ASSERT_TRUE(taken <= seconds);
        TEST_ASSERT_TRUE(seconds - taken <= refine_left_at_most(&report.refine, 0.1) + 1e-6);
    }
}

/* A step that is given up when one half of it is made leaves light, error and counts as they were. */
static void a_step_that_is_cut_leaves_nothing_behind(void)
{
    struct work_clock clock = {{&work_ops}, 0};
    const struct refine_goal once = {1, 0.5, &clock.clock, INT64_C(1000000000000)},
                             twice = {1, 5, &clock.clock, INT64_C(1000000000000)};
    struct render_settings chosen = settings_of(&once);
    float *one = light_of(BALL, &chosen);
    struct refine_report single = report.refine;
    size_t samples = report.objects[0].counts.samples;
    clock.steady = work_done();
    TEST_ASSERT_EQUAL_INT(1, single.count);
    TEST_ASSERT_FALSE(single.cut);
    chosen.goal = &twice;
    float *cut = light_of(BALL, &chosen);
    TEST_ASSERT_TRUE(report.refine.cut);
    TEST_ASSERT_EQUAL_INT(1, report.refine.count);
    TEST_ASSERT_EQUAL_STRING("time", report.refine.stopped_by);
    TEST_ASSERT_EQUAL_DOUBLE(single.error, report.refine.error);
    TEST_ASSERT_EQUAL_UINT64(samples, report.objects[0].counts.samples);
    TEST_ASSERT_EQUAL_DOUBLE(0, difference(cut, one));
    TEST_ASSERT_EQUAL_STRING("", error.text);
    free(one);
    free(cut);
}

/* Both lists of the plain plate, one after the other; the caller frees them. */
static float *plate_light(size_t *count)
{
    const struct stage_object *plate = &stage.objects[1];
    size_t size = plate->mesh.vertex_count * sizeof *plate->light;
    float *copy = malloc(2 * size);
    TEST_ASSERT_NOT_NULL(copy);
    memcpy(copy, plate->light, size);
    memcpy((char *)copy + size, plate->soft, size);
    *count = 2 * size / sizeof *copy;
    return copy;
}

/* Where light passes on, each half lights the plain objects anew: wherever the step is given up, what soft lights make of
 * them is what it was, like the rest of their light, of which it is a part. */
static void a_step_that_is_cut_leaves_plain_objects_as_they_were(void)
{
    static const char text[] = BALL "bounces: 1\n";
    static const double later[] = {1, 1.6, 2.2, 2.8};
    struct work_clock clock = {{&work_ops}, 0};
    const struct refine_goal once = {1, 0.5, &clock.clock, INT64_C(1000000000000)},
                             twice = {1, 20, &clock.clock, INT64_C(1000000000000)};
    struct render_settings chosen = settings_of(&once);
    size_t count = 0;
    free(light_of(text, &chosen));
    TEST_ASSERT_EQUAL_INT(1, report.refine.count);
    uint64_t work = work_done();
    float *one = plate_light(&count);
    for (size_t i = 0; i < count / 2; i++) {
        /* A part of it, but for the rounding of either sum of two. */
        TEST_ASSERT_TRUE(one[i] >= (1 - 3e-7F) * one[count / 2 + i]);
    }
    chosen.goal = &twice;
    for (size_t i = 0; i < sizeof later / sizeof *later; i++) {
        clock.steady = (uint64_t)(later[i] * (double)work);
        free(light_of(text, &chosen));
        TEST_ASSERT_TRUE(report.refine.cut);
        TEST_ASSERT_EQUAL_INT(1, report.refine.count);
        float *cut = plate_light(&count);
        TEST_ASSERT_EQUAL_MEMORY(one, cut, count * sizeof *one);
        free(cut);
    }
    free(one);
}

/* Albedo alone has nothing to sum up, plain objects nothing to refine. */
static void scenes_without_a_gather_are_fine(void)
{
    struct clock clock = clock_monotonic();
    const struct refine_goal goal = {0.02, 0, &clock, clock_now_ns(&clock)};
    struct render_settings chosen = settings_of(&goal);
    chosen.albedo = true;
    free(light_of(BALL, &chosen));
    TEST_ASSERT_TRUE(report.refine.error_held && report.refine.noise > 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, report.refine.bias);
    static const char plain[] =
        "camera: {position_mm: [0, -100, 60], at_mm: [0, 0, 10]}\nlights: []\n"
        "environment: {color: [1, 1, 1]}\n"
        "objects:\n  - {shape: quad, size_mm: [12, 12, 1]}\n";
    free(light_of(plain, &chosen));
    TEST_ASSERT_EQUAL_INT(1, report.refine.count);
    /* Even light from all sides on a level plate, once and not twice. */
    TEST_ASSERT_FLOAT_WITHIN(0.01F, 1, stage.objects[0].light[0][0]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(the_error_that_is_told_is_the_error);
    RUN_TEST(light_on_a_few_surface_points_is_found);
    RUN_TEST(steps_add_up_to_one_large_set);
    RUN_TEST(bounces_are_refined_as_well);
    RUN_TEST(a_time_is_kept_with_real_light);
    RUN_TEST(a_step_that_is_cut_leaves_nothing_behind);
    RUN_TEST(a_step_that_is_cut_leaves_plain_objects_as_they_were);
    RUN_TEST(scenes_without_a_gather_are_fine);
    return UNITY_END();
}
