/* Previews by OpenGL: the same camera, the same values and the same shadows as POV-Ray's pictures. */
#include "render/preview.h"
#include "render/view.h"
#include "stand.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct nacre_error error;
static struct scene scene;
static struct picture traced, drawn;
static struct render_report report;
static const struct render_settings settings = {
    .bake = {.density = 4, .rays = 8, .seed = 1, .quiet = true}, .triangle_limit = 100000};

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
}

static void clear(void)
{
    picture_finish(&traced);
    picture_finish(&drawn);
    render_report_finish(&report);
    scene_finish(&scene);
}

void tearDown(void)
{
    clear();
    scratch_remove();
}

static void parse(const char *text)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, scene_parse("scene.yaml", scratch_path(""), text, strlen(text), &scene, &error),
        error.text);
}

static int take(void *context, int number, const struct picture *picture, struct nacre_error *e)
{
    struct picture *copy = context;
    (void)number;
    picture_finish(copy);
    int status = picture_allocate(copy, picture->width, picture->height, e);
    if (status == NACRE_OK) {
        memcpy(copy->rgb, picture->rgb,
               (size_t)picture->width * (size_t)picture->height * 3 * sizeof(float));
    }
    return status;
}

static void draw(int frames)
{
    render_report_finish(&report);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK,
        render_preview(&scene, &settings, stand_opencl(), frames, take, &drawn, &report, &error),
        error.text);
}

static void draw_both(const char *text)
{
    clear();
    parse(text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, render_scene(&scene, &settings, stand_opencl(), &traced, &report, &error),
        error.text);
    draw(1);
    TEST_ASSERT_EQUAL_INT(traced.width, drawn.width);
    TEST_ASSERT_EQUAL_INT(traced.height, drawn.height);
}

static const float *pixel(const struct picture *picture, int x, int y)
{
    return picture->rgb + ((size_t)y * (size_t)picture->width + (size_t)x) * 3;
}

/* How far a pixel is, in any channel, from between the least and the greatest of POV-Ray's pixels up to r away: an edge
 * that is at most r pixels off stays between them, whatever share of its pixels it covers. */
static double difference(int x, int y, int r)
{
    double most = 0;
    for (int c = 0; c < 3; c++) {
        double low = HUGE_VAL, high = -HUGE_VAL, value = pixel(&drawn, x, y)[c];
        for (int v = y - r; v <= y + r; v++) {
            for (int u = x - r; u <= x + r; u++) {
                if (u >= 0 && v >= 0 && u < traced.width && v < traced.height) {
                    low = fmin(low, pixel(&traced, u, v)[c]);
                    high = fmax(high, pixel(&traced, u, v)[c]);
                }
            }
        }
        most = fmax(most, fmax(low - value, value - high));
    }
    return most;
}

/* The share of pixels whose difference is more than `bound`. */
static double share_beyond(double bound, int r)
{
    int count = 0;
    for (int i = 0; i < traced.width * traced.height; i++) {
        count += difference(i % traced.width, i / traced.width, r) > bound;
    }
    return count / (double)(traced.width * traced.height);
}

/* From aside and turned, so that every mistake of handedness or angle shows. */
#define ASIDE                                                                                      \
    "image: {width: 120, height: 80, exposure: 0.8, background: [0.3, 0.1, 0.2]}\n"                \
    "camera: {position_mm: [90, -150, 80], at_mm: [5, 3, 12], up: [0.2, 0, 1], angle_deg: 35}\n"

#define THINGS                                                                                     \
    "objects:\n"                                                                                   \
    "  - {shape: box, size_mm: [30, 14, 22], position_mm: [-18, 4, 0], rotation_deg: [0, 0, 20], " \
    "color: [0.9, 0.4, 0.2]}\n"                                                                    \
    "  - {shape: sphere, size_mm: 24, position_mm: [22, -6, 0], color: [0.2, 0.5, 0.8]}\n"         \
    "  - {shape: quad, size_mm: [120, 90, 1], color: 0.7}\n"

/* Under light that only outlines show: emission is 0 everywhere, so things are black on the background. One of the
 * preview's four samples of a pixel, 0.075, may see a tip that lies between POV-Ray's. */
static void outlines_agree_within_a_pixel(void)
{
    draw_both(ASIDE "lights: []\n" THINGS);
    TEST_ASSERT_EQUAL_DOUBLE(0, share_beyond(0.08, 1));
    /* And they are there: about half of the picture is ground. */
    TEST_ASSERT_EQUAL_FLOAT(0, pixel(&drawn, 60, 45)[0]);
    TEST_ASSERT_FLOAT_WITHIN(1e-6F, 0.3F, pixel(&drawn, 2, 2)[0]);
    TEST_ASSERT_TRUE(share_beyond(0.15, 0) < 0.03);
}

static void a_shifted_picture_would_be_noticed(void)
{
    draw_both(ASIDE "lights: []\n" THINGS);
    size_t row = (size_t)drawn.width * 3;
    memmove(drawn.rgb, drawn.rgb + 2 * row, ((size_t)drawn.height - 2) * row * sizeof *drawn.rgb);
    TEST_ASSERT_TRUE(share_beyond(0.08, 1) > 0.001);
}

static void points_appear_where_the_view_says(void)
{
    double at[2];
    clear();
    parse(ASIDE "lights: [{kind: point, position_mm: [40, -90, 80], at_mm: [20, 15, 30]}]\n"
                "objects: [{shape: sphere, size_mm: 3, position_mm: [20, 15, 30]}]\n");
    draw(1);
    struct view view = view_make(&scene, 0);
    double sum = 0, x = 0, y = 0;
    for (int i = 0; i < 120 * 80; i++) {
        double weight = fabs((double)drawn.rgb[3 * i] - 0.3) + fabs(drawn.rgb[3 * i + 1] - 0.1);
        sum += weight;
        x += weight * (i % 120 + 0.5);
        y += weight * (i / 120 + 0.5); /* NOLINT(bugprone-integer-division): the row */
    }
    view_project(&view, (struct vec3){20, 15, 31.5}, at);
    /* The sphere is 2.4 pixels wide; its lit side weighs more. */
    TEST_ASSERT_DOUBLE_WITHIN(1, at[0] * 120, x / sum);
    TEST_ASSERT_DOUBLE_WITHIN(1, at[1] * 80, y / sum);
}

/* Values agree but for shadows' edges, where a map's texel and the vertices' distance show. */
static void each_kind_of_light_is_as_bright_as_pov_ray_s(void)
{
    static const char *const lights[] = {
        "lights: [{kind: point, position_mm: [-60, -80, 120]}]\n",
        "lights: [{kind: spot, position_mm: [-60, -80, 120], angle_deg: 30, soft_deg: 6}]\n",
        "lights: [{kind: projector, position_mm: [-60, -80, 120], up: [0, 1, 0.5], angle_deg: 50, "
        "texture: {pattern: checks, count: 6, bright: [1, 0.5, 0.2], dark: 0.1}}]\n",
        "lights: [{kind: area, position_mm: [-60, -80, 120], size_mm: [50, 50]}]\n",
    };
    for (size_t i = 0; i < sizeof lights / sizeof *lights; i++) {
        char text[2048];
        (void)snprintf(text, sizeof text, "%s%s%s", ASIDE, lights[i], THINGS);
        draw_both(text);
        double all = share_beyond(0.02, 1), strict = share_beyond(0.05, 0);
        char message[200];
        (void)snprintf(message, sizeof message, "light %zu: %g and %g of the pixels differ", i, all,
                       strict);
        TEST_ASSERT_TRUE_MESSAGE(all < 0.005 && strict < 0.06, message);
    }
}

static void an_environment_lights_things_and_is_seen_behind_them(void)
{
    draw_both("image: {width: 120, height: 80}\n"
              "camera: {position_mm: [90, -150, 40], at_mm: [5, 3, 12], angle_deg: 35}\n"
              "environment: {color: [0.4, 0.3, 0.2]}\nlights: []\n" THINGS);
    TEST_ASSERT_FLOAT_WITHIN(1e-3F, 0.3F, pixel(&drawn, 2, 2)[1]);
    /* Rays to the environment scatter alike in both, as they are cast beforehand. */
    TEST_ASSERT_TRUE(share_beyond(0.02, 1) < 0.005);
}

static void translucent_objects_show_their_radiosity_and_highlights(void)
{
    struct nacre_material material = stand_even_material(20, 7, 1.5, 0.6);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          nacre_material_write(scratch_path("material.exr"), &material, &error));
    nacre_material_finish(&material);
    draw_both(ASIDE
              "lights:\n"
              "  - {kind: area, position_mm: [-60, -80, 120], size_mm: [50, 50], irradiance: 0.5}\n"
              "  - {kind: point, position_mm: [60, -120, 120], irradiance: 0.5}\n"
              "objects:\n"
              "  - shape: sphere\n    size_mm: 40\n"
              "    material: {file: material.exr, mapping: sphere, point_mm: 1.5}\n"
              "    gloss: {specular: 0.8, roughness: 0.02}\n");
    TEST_ASSERT_TRUE(share_beyond(0.03, 1) < 0.005);
    float brightest = 0;
    for (int i = 0; i < 120 * 80; i++) {
        brightest = fmaxf(brightest, drawn.rgb[3 * i + 1]);
    }
    TEST_ASSERT_TRUE(brightest > 0.5F); /* without highlights 0.8 * 0.6 * 1 at most */
}

static void a_turntable_goes_round(void)
{
    /* After half a turn of two frames the camera is where a scene with its place mirrored has it. */
    clear();
    parse("image: {width: 60, height: 40}\n"
          "camera: {position_mm: [0, -200, 80], at_mm: [0, 0, 10], angle_deg: 25}\n"
          "lights: [{kind: point, position_mm: [-60, -80, 120]}]\n" THINGS);
    draw(2);
    traced = drawn;
    drawn = (struct picture){0};
    render_report_finish(&report);
    scene_finish(&scene);
    parse("image: {width: 60, height: 40}\n"
          "camera: {position_mm: [0, 200, 80], at_mm: [0, 0, 10], angle_deg: 25}\n"
          "lights: [{kind: point, position_mm: [-60, -80, 120]}]\n" THINGS);
    draw(1); /* smooth, where frames of a turntable are not */
    char message[100];
    (void)snprintf(message, sizeof message, "%g %g", share_beyond(0.1, 1), share_beyond(0.1, 0));
    TEST_ASSERT_TRUE_MESSAGE(share_beyond(0.1, 1) < 0.002 && share_beyond(0.1, 0) < 0.05, message);
}

static void what_cannot_be_previewed_is_told(void)
{
    char text[4096];
    int used = snprintf(text, sizeof text, "%slights:\n", ASIDE THINGS);
    struct preview *preview = NULL;
    struct stage stage = {0};
    for (int i = 0; i < PREVIEW_LIGHTS_MAXIMUM + 1; i++) {
        used += snprintf(text + used, sizeof text - (size_t)used,
                         "  - {kind: point, position_mm: [1, 2, 99]}\n");
    }
    parse(text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, stage_prepare(&stage, &scene, &settings, &report, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, preview_open(&stage, true, &preview, &error));
    stage_finish(&stage);
    TEST_ASSERT_NULL(preview);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "at most 8 lights"), error.text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(outlines_agree_within_a_pixel);
    RUN_TEST(a_shifted_picture_would_be_noticed);
    RUN_TEST(points_appear_where_the_view_says);
    RUN_TEST(each_kind_of_light_is_as_bright_as_pov_ray_s);
    RUN_TEST(an_environment_lights_things_and_is_seen_behind_them);
    RUN_TEST(translucent_objects_show_their_radiosity_and_highlights);
    RUN_TEST(a_turntable_goes_round);
    RUN_TEST(what_cannot_be_previewed_is_told);
    return UNITY_END();
}
