/* The plan of effects: what scenes call for, what that changes, and that what is not called for does no work. */
#include "render/effects_list.h"
#include "render/stage.h"
#include "stand.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct scene scene;
static struct stage stage;
static struct render_report report;
static struct nacre_error error;
static const struct render_settings settings = {
    .bake = {.density = 3, .rays = 4, .seed = 1, .quiet = true}, .triangle_limit = 20000};

void setUp(void)
{
    struct nacre_material even = stand_even_material(12, 5, 1.2, 0.6);
    struct nacre_material narrow = stand_even_material(12, 5, 0.05, 0.6);
    scratch_make();
    error.text[0] = '\0';
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          nacre_material_write(scratch_path("material.exr"), &even, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          nacre_material_write(scratch_path("narrow.exr"), &narrow, &error));
    nacre_material_finish(&even);
    nacre_material_finish(&narrow);
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

static void prepare(const char *text)
{
    finish();
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, scene_parse("scene.yaml", scratch_path(""), text, strlen(text), &scene, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_prepare(&stage, &scene, &settings, &report, &error), error.text);
}

static void bake(const char *text)
{
    prepare(text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, stage_bake(&stage, stand_opencl(), &report, &error),
                                  error.text);
}

#define VIEW                                                                                       \
    "image: {width: 64, height: 48}\n"                                                             \
    "camera: {position_mm: [0, -60, 40], at_mm: [0, 0, 5], angle_deg: 30}\n"
#define POINT_LIGHT "  - {kind: point, position_mm: [10, -20, 60]}\n"
#define AREA_LIGHT  "  - {kind: area, position_mm: [10, -20, 60], size_mm: [20, 20]}\n"
#define BALL                                                                                       \
    "  - shape: sphere\n"                                                                          \
    "    size_mm: 20\n"                                                                            \
    "    material: {file: material.exr, mapping: sphere, point_mm: 1.5}\n"
#define GROUND "  - {shape: quad, size_mm: [80, 80, 1]}\n"

/* What is called for, by one letter an effect in the order of the enum. */
static const char *called(void)
{
    static char text[RENDER_EFFECTS + 1];
    static const char letters[] = "SAPEIFLGTKCHM";
    for (int i = 0; i < RENDER_EFFECTS; i++) {
        text[i] = stage.effects.called[i] ? letters[i] : '-';
    }
    return text;
}

static void scenes_call_for_what_they_name(void)
{
    prepare(VIEW "lights:\n" POINT_LIGHT "objects:\n" BALL);
    TEST_ASSERT_EQUAL_STRING("------LGT----", called());
    prepare(VIEW "lights:\n" POINT_LIGHT "objects:\n" BALL GROUND);
    TEST_ASSERT_EQUAL_STRING("S-----LGT----", called());
    prepare(VIEW "lights:\n" AREA_LIGHT "objects:\n" BALL GROUND);
    TEST_ASSERT_EQUAL_STRING("SA----LGT----", called());
    prepare(VIEW "lights:\n" AREA_LIGHT "objects:\n" BALL); /* near for its size */
    TEST_ASSERT_EQUAL_STRING("-A----LGT----", called());
    prepare(VIEW "lights: [{kind: area, position_mm: [0, 0, 9000], size_mm: [9, 9]}]\n"
                 "objects:\n" BALL);
    TEST_ASSERT_EQUAL_STRING("------LGT----", called());
    prepare(VIEW "lights: [{kind: projector, position_mm: [0, 0, 90], texture: {pattern: grid}, "
                 "irradiance: [1, 0.5, 0.2]}]\nobjects:\n" BALL);
    TEST_ASSERT_EQUAL_STRING("--P---LGT-C--", called());
    prepare(VIEW "environment: {color: [1, 0.9, 0.8]}\nbounces: 1\nlights: []\nobjects:\n" BALL
                 "    index: 1.4\n    gloss: {specular: 0.3, reflection: 1}\n" GROUND);
    TEST_ASSERT_EQUAL_STRING("S--EIFLGT-C-M", called());
}

static void forbidden_effects_are_left_out(void)
{
    prepare(VIEW "without: [subsurface scattering, interreflection, mirror reflection]\n"
                 "environment: {}\nbounces: 1\nlights: []\nobjects:\n" BALL
                 "    gloss: {reflection: 1}\n" GROUND);
    TEST_ASSERT_EQUAL_STRING("S--E--L------", called());
    TEST_ASSERT_TRUE(stage.effects.objects[0].albedo);
    prepare(VIEW "without: [thin parts]\nlights:\n" POINT_LIGHT "objects:\n" BALL);
    TEST_ASSERT_TRUE(stage.effects.objects[0].same_side);
}

static void refuses(const char *text, const char *place, const char *why)
{
    finish();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scene_parse("scene.yaml", scratch_path(""), text,
                                                    strlen(text), &scene, &error));
    TEST_ASSERT_EQUAL_STRING_LEN(place, error.text, strlen(place));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
}

static void what_cannot_be_forbidden_is_refused(void)
{
    refuses(VIEW "without: [moonshine]\nlights: []\nobjects:\n" BALL,
            "scene.yaml:3:11: ", "moonshine");
    refuses(VIEW "without:\n  - shadows\n  - colour\nlights: []\nobjects:\n" BALL,
            "scene.yaml:5:5: ", "colour");
    refuses(VIEW "without: [highlight]\nlights: []\nobjects:\n" BALL,
            "scene.yaml:3:11: ", "perhaps 'highlights'");
}

/* Narrower than half a surface point, or than half a pixel: the albedo, and no gather. */
static void narrow_kernels_fall_to_the_albedo(void)
{
    prepare(VIEW "lights:\n" POINT_LIGHT
                 "objects:\n  - {shape: sphere, size_mm: 20, material: {file: narrow.exr, "
                 "mapping: sphere, point_mm: 1.5}}\n");
    TEST_ASSERT_TRUE(stage.effects.objects[0].albedo && !stage.effects.objects[0].subsurface);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, stage_bake(&stage, NULL, &report, &error)); /* no device */
    TEST_ASSERT_EQUAL_UINT64(0, report.objects[0].counts.gather.receivers);
    TEST_ASSERT_EQUAL_UINT64(0, report.objects[0].counts.products);
    prepare("image: {width: 64, height: 48}\n"
            "camera: {position_mm: [0, -2000, 0], at_mm: [0, 0, 0], angle_deg: 30}\n"
            "lights:\n" POINT_LIGHT "objects:\n" BALL);
    TEST_ASSERT_TRUE(stage.effects.objects[0].albedo && !stage.effects.objects[0].subsurface);
}

/* A copy of an object's light. */
static float (*keep_light(size_t object))[3]
{
    size_t size = stage.objects[object].mesh.vertex_count * sizeof(float[3]);
    float(*copy)[3] = malloc(size + 1);
    TEST_ASSERT_NOT_NULL(copy);
    memcpy(copy, stage.objects[object].light, size);
    return copy;
}

/* That nothing can be in the way is the plan's claim: the rays that it saves find nothing. */
static void shadow_rays_on_a_convex_body_change_nothing(void)
{
    bake(VIEW "lights:\n" AREA_LIGHT "objects:\n" BALL);
    size_t size = stage.objects[0].mesh.vertex_count * sizeof(float[3]);
    float(*without)[3] = keep_light(0);
    TEST_ASSERT_EQUAL_UINT64(0, report.objects[0].counts.work.shadow_rays);
    prepare(VIEW "lights:\n" AREA_LIGHT "objects:\n" BALL);
    stage.effects.called[RENDER_SHADOWS] = true;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, stage_bake(&stage, stand_opencl(), &report, &error));
    TEST_ASSERT_TRUE(report.objects[0].counts.work.shadow_rays > 2000);
    TEST_ASSERT_EQUAL_MEMORY(without, stage.objects[0].light, size);
    free(without);
}

/* RMS difference of the light of object 0 over its RMS, and both works. */
static double changed_by(const char *with, const char *without, struct light_work *more,
                         struct light_work *less)
{
    double difference = 0, square = 0;
    bake(with);
    size_t count = stage.objects[0].mesh.vertex_count;
    float(*light)[3] = keep_light(0);
    *more = report.objects[0].counts.work;
    bake(without);
    *less = report.objects[0].counts.work;
    TEST_ASSERT_EQUAL_UINT64(count, stage.objects[0].mesh.vertex_count);
    for (size_t i = 0; i < count; i++) {
        for (int c = 0; c < 3; c++) {
            double away = (double)light[i][c] - stage.objects[0].light[i][c];
            difference += away * away;
            square += (double)light[i][c] * light[i][c];
        }
    }
    free(light);
    return sqrt(difference / square);
}

/* Twelve terms that differ, grey; a kernel for each, or two that are mixed. */
static void write_terms(const char *name, bool per_term)
{
    struct nacre_material material = {.width = 12,
                                      .height = 12,
                                      .channels = 1,
                                      .window = 5,
                                      .terms = 12,
                                      .clusters = per_term ? 0 : 2,
                                      .mixed = per_term ? 0 : 2,
                                      .layout =
                                          per_term ? NACRE_KERNEL_PER_TERM : NACRE_KERNEL_SINGLE,
                                      .pixel = NACRE_FLOAT,
                                      .factor_channels = 1,
                                      .pitch_mm = 1,
                                      .method = "made"};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_material_allocate(&material, true, false, &error));
    for (int i = 0; i < 12 * 144; i++) {
        material.f[i] = (float)(0.3 + 0.2 * sin(i * 0.7));
        material.h[i] = (float)(0.3 + 0.2 * cos(i * 1.3));
    }
    for (int i = 0; i < (per_term ? 12 : 2) * 25; i++) {
        material.kernels[i] =
            (float)(0.03 / (1 + hypot(i % 5 - 2, i / 5 % 5 - 2)) * (1 + i / 25)); /* NOLINT */
    }
    for (int i = 0; !per_term && i < 2 * 144; i++) {
        material.ids[i] = (uint32_t)(i / 144);
        material.weights[i] = i / 144 == 0 ? 0.75F : 0.25F; /* NOLINT(bugprone-integer-division) */
    }
    for (int i = 0; i < 144; i++) {
        material.albedo[i] = 0.5F;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_write(scratch_path(name), &material, &error), error.text);
    nacre_material_finish(&material);
}

#define LIT(irradiance, file)                                                                      \
    VIEW "lights:\n  - {kind: point, position_mm: [10, -20, 60], irradiance: " irradiance "}\n"    \
         "objects:\n  - {shape: sphere, size_mm: 20, material: {file: " file                       \
         ", mapping: sphere, point_mm: 1.5}}\n"

/* Reflectance of object 0 under even light, [point][3]; heap. */
static float *albedo_of(void)
{
    const struct appearance *appearance = &stage.objects[0].appearance;
    float *albedo =
        calloc((size_t)appearance->width * (size_t)appearance->height * 3, sizeof *albedo);
    TEST_ASSERT_NOT_NULL(albedo);
    appearance_albedo(appearance, true, albedo);
    return albedo;
}

/* Where light and material are grey, a third of the products gives the light that all would give. The colours beside it
 * have the first one's light. Summing up may change each of the two by 2e-3; sums in another order change less. */
static void grey_light_takes_a_third_of_the_work(void)
{
    static const char *const scenes[2][2] = {
        {LIT("1", "single.exr"), LIT("[1, 0.5, 0.25]", "single.exr")},
        {LIT("1", "terms.exr"), LIT("[1, 0.5, 0.25]", "terms.exr")}};
    write_terms("single.exr", false);
    write_terms("terms.exr", true);
    for (int k = 0; k < 2; k++) {
        double square = 0, difference = 0;
        bake(scenes[k][1]);
        TEST_ASSERT_TRUE(stage.effects.called[RENDER_COLOR]);
        float(*color)[3] = keep_light(0);
        float *albedo = albedo_of();
        struct bake_counts with = report.objects[0].counts;
        bake(scenes[k][0]);
        TEST_ASSERT_FALSE(stage.effects.called[RENDER_COLOR]);
        struct bake_counts without = report.objects[0].counts;
        TEST_ASSERT_EQUAL_UINT64(36, with.products);
        TEST_ASSERT_EQUAL_UINT64(12, without.products);
        TEST_ASSERT_EQUAL_UINT64(with.samples, without.samples);
        TEST_ASSERT_EQUAL_UINT64(with.gather.receivers, without.gather.receivers);
        for (size_t i = 0; i < stage.objects[0].mesh.vertex_count; i++) {
            const float *light = stage.objects[0].light[i];
            TEST_ASSERT_EQUAL_FLOAT(light[0], light[1]);
            TEST_ASSERT_EQUAL_FLOAT(light[0], light[2]);
            square += (double)light[0] * light[0];
            difference += ((double)light[0] - color[i][0]) * ((double)light[0] - color[i][0]);
        }
        free(color);
        float *grey_albedo = albedo_of();
        for (int i = 0; i < 144 * 3; i++) {
            TEST_ASSERT_FLOAT_WITHIN(1e-5F * albedo[i], albedo[i], grey_albedo[i]);
        }
        free(albedo);
        free(grey_albedo);
        TEST_ASSERT_TRUE(square > 0);
        TEST_ASSERT_TRUE(sqrt(difference / square) < 4e-3);
    }
}

/* A coloured neighbour's light is not grey where it passes on. */
static void a_coloured_neighbour_calls_for_colours(void)
{
    static const char neighbour[] =
        "  - {shape: quad, size_mm: [80, 80, 1], color: [1, 0.5, 0.5]}\n";
    char text[1024];
    (void)snprintf(text, sizeof text, "%slights:\n%sobjects:\n%s%s", VIEW, POINT_LIGHT, BALL,
                   neighbour);
    prepare(text);
    TEST_ASSERT_FALSE(stage.effects.called[RENDER_COLOR]);
    (void)snprintf(text, sizeof text, "bounces: 1\n%slights:\n%sobjects:\n%s%s", VIEW, POINT_LIGHT,
                   BALL, neighbour);
    prepare(text);
    TEST_ASSERT_TRUE(stage.effects.called[RENDER_COLOR]);
}

#define FULL                                                                                       \
    VIEW                                                                                           \
        "environment: {color: [0.5, 0.4, 0.3]}\nbounces: 1\nlights:\n" AREA_LIGHT                  \
        "  - {kind: projector, position_mm: [-20, -10, 50], at_mm: [0, 0, 8], texture: {pattern: " \
        "checks}}\nobjects:\n" BALL "    index: 1.4\n" GROUND
#define WITHOUT(name) "without: [" name "]\n" FULL

/* Each counts its own work, which is 0 without it, changes nobody else's, and changes the light by more than is stated:
 * half of what the scene's numbers lead to expect. */
static void what_is_called_for_matters_and_nothing_else_works(void)
{
    struct light_work with, less;
    /* The ground's shadow side: the ball's lower half gets less than half of the sky. */
    TEST_ASSERT_TRUE(changed_by(FULL, WITHOUT("shadows"), &with, &less) > 0.02);
    TEST_ASSERT_EQUAL_UINT64(0, less.shadow_rays);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SLIDE], less.lookups[LOOKUP_SLIDE]);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SKY], less.lookups[LOOKUP_SKY]);
    TEST_ASSERT_EQUAL_UINT64(with.bounce_rays, less.bounce_rays);
    /* Half of the checks are dark. */
    TEST_ASSERT_TRUE(changed_by(FULL, WITHOUT("projected picture"), &with, &less) > 0.1);
    TEST_ASSERT_EQUAL_UINT64(0, less.lookups[LOOKUP_SLIDE]);
    TEST_ASSERT_TRUE(with.lookups[LOOKUP_SLIDE] > 500);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SKY], less.lookups[LOOKUP_SKY]);
    TEST_ASSERT_EQUAL_UINT64(with.bounce_rays, less.bounce_rays);
    /* 0.4 beside lights of 1 and 1. */
    TEST_ASSERT_TRUE(changed_by(FULL, WITHOUT("environment"), &with, &less) > 0.1);
    TEST_ASSERT_EQUAL_UINT64(0, less.lookups[LOOKUP_SKY]);
    TEST_ASSERT_TRUE(with.lookups[LOOKUP_SKY] > 1000);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SLIDE], less.lookups[LOOKUP_SLIDE]);
    TEST_ASSERT_EQUAL_UINT64(with.bounce_rays, less.bounce_rays);
    /* A ground of 0.5 under 2 in half of the view of half of the ball. */
    TEST_ASSERT_TRUE(changed_by(FULL, WITHOUT("interreflection"), &with, &less) > 0.05);
    TEST_ASSERT_EQUAL_UINT64(0, less.bounce_rays);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SLIDE], less.lookups[LOOKUP_SLIDE]);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SKY], less.lookups[LOOKUP_SKY]);
    TEST_ASSERT_EQUAL_UINT64(with.shadow_rays, less.shadow_rays);
    /* 1 - 0.9 / 0.97 of even light, more where it grazes. */
    TEST_ASSERT_TRUE(changed_by(FULL, WITHOUT("Fresnel transmission"), &with, &less) > 0.02);
    TEST_ASSERT_EQUAL_UINT64(0, less.transmittances);
    TEST_ASSERT_TRUE(with.transmittances > 1000);
    TEST_ASSERT_EQUAL_UINT64(with.shadow_rays, less.shadow_rays);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SKY], less.lookups[LOOKUP_SKY]);
    /* Checks of 6 mm on kernels of 2 mm. */
    TEST_ASSERT_TRUE(changed_by(FULL, WITHOUT("subsurface scattering"), &with, &less) > 0.02);
    TEST_ASSERT_EQUAL_UINT64(0, report.objects[0].counts.gather.receivers);
    TEST_ASSERT_EQUAL_UINT64(with.shadow_rays, less.shadow_rays);
    /* A light of 20 at 60: noise of 4 rays, and a penumbra. */
    TEST_ASSERT_TRUE(changed_by(FULL, WITHOUT("soft light"), &with, &less) > 0.002);
    TEST_ASSERT_TRUE(less.shadow_rays < with.shadow_rays);
    TEST_ASSERT_EQUAL_UINT64(with.lookups[LOOKUP_SKY], less.lookups[LOOKUP_SKY]);
}

static const struct effect *find(const struct effect *effects, size_t count, const char *name)
{
    for (size_t i = 0; i < count; i++) {
        if (strcmp(effects[i].name, name) == 0) {
            return &effects[i];
        }
    }
    TEST_FAIL_MESSAGE(name);
    return NULL;
}

static void the_list_names_lines_and_reasons(void)
{
    struct effect *effects = NULL;
    size_t count = 0;
    prepare("without: [shadows]\n" VIEW "lights:\n" AREA_LIGHT "objects:\n" BALL GROUND);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, render_effects_list(&stage, &effects, &count, &error));
    TEST_ASSERT_EQUAL_UINT64(RENDER_EFFECTS, count);
    const struct effect *effect = find(effects, count, "shadows");
    TEST_ASSERT_FALSE(effect->simulated);
    TEST_ASSERT_EQUAL_INT(1, effect->line);
    effect = find(effects, count, "subsurface scattering");
    TEST_ASSERT_TRUE(effect->simulated && effect->seconds > 0);
    TEST_ASSERT_EQUAL_INT(9, effect->line);
    effect = find(effects, count, "soft light");
    TEST_ASSERT_TRUE(effect->simulated);
    TEST_ASSERT_EQUAL_INT(5, effect->line);
    effect = find(effects, count, "environment");
    TEST_ASSERT_FALSE(effect->simulated);
    TEST_ASSERT_EQUAL_STRING("no environment", effect->reason);
    TEST_ASSERT_EQUAL_DOUBLE(0, effect->seconds);
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_TRUE_MESSAGE(strlen(effects[i].reason) > 5, effects[i].name);
        TEST_ASSERT_TRUE_MESSAGE(!effects[i].simulated || effects[i].line > 0, effects[i].name);
    }
    free(effects);
}

/* What --explain counts is what is done: seconds over the cost of one are rays, to the half. Half of all samples are taken
 * to face each light, and a sky to be seen by all; the ball's neighbours hide some. */
static void costs_follow_the_work(void)
{
    struct effect *effects = NULL;
    struct light_work work = {0};
    size_t count = 0;
    bake(FULL);
    for (size_t i = 0; i < scene.object_count; i++) {
        light_work_add(&work, &report.objects[i].counts.work);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, render_effects_list(&stage, &effects, &count, &error));
    double shadows = find(effects, count, "shadows")->seconds / 2.2e-7;
    double bounces = find(effects, count, "interreflection")->seconds / 2.2e-7;
    double sky = find(effects, count, "environment")->seconds / 5e-8;
    free(effects);
    TEST_ASSERT_DOUBLE_WITHIN(0.5 * (double)work.shadow_rays, (double)work.shadow_rays, shadows);
    TEST_ASSERT_DOUBLE_WITHIN(0.5 * (double)work.bounce_rays, (double)work.bounce_rays, bounces);
    TEST_ASSERT_DOUBLE_WITHIN(0.5 * (double)work.lookups[LOOKUP_SKY],
                              (double)work.lookups[LOOKUP_SKY], sky);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(scenes_call_for_what_they_name);
    RUN_TEST(forbidden_effects_are_left_out);
    RUN_TEST(what_cannot_be_forbidden_is_refused);
    RUN_TEST(narrow_kernels_fall_to_the_albedo);
    RUN_TEST(shadow_rays_on_a_convex_body_change_nothing);
    RUN_TEST(grey_light_takes_a_third_of_the_work);
    RUN_TEST(a_coloured_neighbour_calls_for_colours);
    RUN_TEST(what_is_called_for_matters_and_nothing_else_works);
    RUN_TEST(costs_follow_the_work);
    RUN_TEST(the_list_names_lines_and_reasons);
    return UNITY_END();
}
