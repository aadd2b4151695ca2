/* Pictures through POV-Ray: their values are what the lights and materials say, and the way they are turned. */
#include "render/irradiance.h"
#include "render/render.h"
#include "stand.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

static struct scene scene;
static struct picture picture;
static struct render_report report;
static struct render_settings settings;
static struct nacre_error error;
static char *path; /* the variable PATH, where a test changes it */

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
    settings = (struct render_settings){
        .bake = {.density = 16, .rays = 16, .seed = 1, .quiet = true}, .triangle_limit = 200000};
}

void tearDown(void)
{
    if (path) {
        (void)setenv("PATH", path, 1);
        free(path);
        path = NULL;
    }
    scene_finish(&scene);
    picture_finish(&picture);
    render_report_finish(&report);
    scratch_remove();
}

static int render(const char *text)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, scene_parse("scene.yaml", scratch_path(""), text, strlen(text), &scene, &error),
        error.text);
    return render_scene(&scene, &settings, stand_opencl(), &picture, &report, &error);
}

static void must_render(const char *text)
{
    picture_finish(&picture);
    render_report_finish(&report);
    scene_finish(&scene);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, render(text), error.text);
}

static const float *pixel(int x, int y)
{
    return picture.rgb + ((size_t)y * (size_t)picture.width + (size_t)x) * 3;
}

/* A camera above the origin that sees 40 x 40 mm of z = 0, x to the right and y up. A little aside, as POV-Ray's rays
 * slip between triangles where they hit an edge exactly. */
#define FROM_ABOVE                                                                                 \
    "camera: {position_mm: [0.013, 0.007, 400], at_mm: [0.013, 0.007, 0], up: [0, 1, 0], "         \
    "angle_deg: 5.7248105}\n"
#define SMALL "image: {width: 40, height: 40, exposure: 0.5}\n"
#define FINE  "image: {width: 200, height: 200, exposure: 0.5}\n"

/* Where the middle of a pixel of a fine picture is on z = 0. */
static struct vec3 place_of(int x, int y)
{
    return (struct vec3){(x + 0.5) / 5 - 20 + 0.013, 20 - (y + 0.5) / 5 + 0.007, 0};
}

/* Pixels all over a fine picture of a ground of reflectance 0.8 must show, to 1 %, what the first `count` lights
 * bring. */
static void check_ground(size_t count)
{
    struct light lights[4];
    double most = 0;
    for (size_t l = 0; l < count; l++) {
        TEST_ASSERT_EQUAL_INT(NACRE_OK, light_make(&lights[l], &scene.lights[l], &error));
    }
    for (int i = 0; i < 64; i++) {
        int x = i % 8 * 25 + 12, y = (i - i % 8) / 8 * 25 + 12;
        double sum[3] = {0};
        for (size_t l = 0; l < count; l++) {
            for (int k = 0; k < 1024; k++) {
                int column = k % 32, row = k / 32;
                const double u[2] = {(column + 0.5) / 32, (row + 0.5) / 32};
                struct light_arrival arrival =
                    light_arrive(&lights[l], place_of(x, y), (struct vec3){0, 0, 1}, u);
                for (int c = 0; c < 3; c++) {
                    sum[c] += arrival.irradiance[c] / 1024;
                }
            }
        }
        for (int c = 0; c < 3; c++) {
            double expected = 0.5 * 0.8 * sum[c];
            most = fmax(most, expected);
            TEST_ASSERT_DOUBLE_WITHIN(0.01 * expected + 1e-4, expected, pixel(x, y)[c]);
        }
    }
    TEST_ASSERT_TRUE(most > 0.1);
    for (size_t l = 0; l < count; l++) {
        light_finish(&lights[l]);
    }
}

#define WHITE_GROUND "objects: [{shape: quad, size_mm: [90, 90, 1], color: 0.8}]\n"

static void point_and_spot_lights_are_right_to_one_per_cent(void)
{
    must_render(FINE FROM_ABOVE WHITE_GROUND
                "lights: [{kind: point, position_mm: [10, 5, 30], irradiance: [1, 0.5, 0.25]}]\n");
    check_ground(1);
    must_render(FINE FROM_ABOVE WHITE_GROUND
                "lights: [{kind: spot, position_mm: [10, 5, 90], angle_deg: 20, soft_deg: 8}]\n");
    check_ground(1);
}

#define AREA                                                                                       \
    "  - {kind: area, position_mm: [30, -20, 50], size_mm: [40, 20], irradiance: [1, 2, 0.5]}\n"

static void area_lights_are_right_to_one_per_cent_by_either_way(void)
{
    must_render(FINE FROM_ABOVE WHITE_GROUND "lights:\n" AREA);
    check_ground(1);
    settings.povray_shadows = true;
    must_render(FINE FROM_ABOVE WHITE_GROUND "lights:\n" AREA);
    check_ground(1);
}

static void lights_of_several_kinds_add_up(void)
{
    must_render(FINE FROM_ABOVE WHITE_GROUND
                "lights:\n" AREA "  - {kind: point, position_mm: [-20, 5, 40], irradiance: 0.7}\n");
    check_ground(2);
}

static void a_projected_picture_lands_where_it_should(void)
{
    char text[2048];
    struct picture slide;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&slide, 64, 64, &error));
    for (int i = 0; i < 64 * 64 * 3; i++) {
        /* Smooth, and different along x, along y and in each colour. */
        int column = i / 3 % 64, row = i / 192;
        slide.rgb[i] = 0.2F + 0.01F * (float)column + (i % 3 == 1 ? 0.02F * (float)row : 0);
    }
    char *file = strdup(scratch_path("slide.exr"));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(file, &slide, NULL, &error));
    picture_finish(&slide);
    (void)snprintf(
        text, sizeof text,
        FINE FROM_ABOVE WHITE_GROUND
        "lights: [{kind: projector, position_mm: [10, 5, 60], at_mm: [2, 0, 0], up: [0, 1, 0], "
        "angle_deg: 60, texture: {image: %s}}]\n",
        file);
    free(file);
    must_render(text);
    check_ground(1);
}

static void light_does_not_go_round_the_slide(void)
{
    must_render(
        SMALL FROM_ABOVE WHITE_GROUND
        "lights: [{kind: projector, position_mm: [0, 0, 60], at_mm: [0, 0, 0], up: [0, 1, 0], "
        "angle_deg: 10, texture: {pattern: checks, count: 1}}]\n");
    /* Half the picture's width is 5.2 mm. */
    TEST_ASSERT_TRUE(pixel(20, 20)[0] > 0.3F && pixel(23, 17)[0] > 0.3F);
    TEST_ASSERT_EQUAL_FLOAT(0, pixel(27, 20)[0]);
    TEST_ASSERT_EQUAL_FLOAT(0, pixel(20, 12)[0]);
    TEST_ASSERT_EQUAL_FLOAT(0, pixel(2, 2)[0]);
}

static void a_picture_is_not_mirrored(void)
{
    must_render(SMALL FROM_ABOVE
                "lights: [{kind: point, position_mm: [0, 0, 300]}]\n"
                "objects:\n" /* an L: a long stroke up, a short one to the right at its foot */
                "  - {shape: box, size_mm: [4, 30, 1], position_mm: [-8, 0, 0], color: 0.8}\n"
                "  - {shape: box, size_mm: [16, 4, 1], position_mm: [2, -13, 0], color: 0.8}\n");
    TEST_ASSERT_TRUE(pixel(11, 8)[0] > 0.2F && pixel(11, 33)[0] > 0.2F);
    TEST_ASSERT_TRUE(pixel(25, 33)[0] > 0.2F);
    TEST_ASSERT_EQUAL_FLOAT(0, pixel(25, 8)[0]);
    TEST_ASSERT_EQUAL_FLOAT(0, pixel(20, 20)[0]);
}

static void background_and_exposure_are_as_stated(void)
{
    must_render("image: {width: 8, height: 6, exposure: 3, background: [0.25, 0.5, 2]}\n" FROM_ABOVE
                "lights: []\nobjects: [{shape: quad, size_mm: 1, position_mm: [900, 0, 0]}]\n");
    TEST_ASSERT_EQUAL_INT(8, picture.width);
    TEST_ASSERT_EQUAL_INT(6, picture.height);
    TEST_ASSERT_FLOAT_WITHIN(1e-3F, 0.25F, pixel(4, 3)[0]);
    TEST_ASSERT_FLOAT_WITHIN(2e-3F, 2, pixel(4, 3)[2]);
}

static void write_material(void)
{
    struct nacre_material material = stand_even_material(20, 7, 1.5, 0.6);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_write(scratch_path("material.exr"), &material, &error),
        error.text);
    nacre_material_finish(&material);
}

#define TRANSLUCENT                                                                                \
    "objects: [{shape: quad, size_mm: [60, 60, 1], material: {file: material.exr, mapping: "       \
    "planar, point_mm: 1.5}}]\n"

static void a_translucent_ground_under_even_light_shows_its_albedo(void)
{
    write_material();
    must_render(SMALL FROM_ABOVE TRANSLUCENT
                "lights: [{kind: area, position_mm: [0, 0, 20000], size_mm: [900, 900]}]\n");
    TEST_ASSERT_TRUE(report.objects[0].translucent && report.objects[0].counts.samples > 10000);
    for (int i = 0; i < 1600; i++) {
        /* The samples scatter by 1 %. */
        TEST_ASSERT_DOUBLE_WITHIN(0.03 * 0.3, 0.5 * 0.6, picture.rgb[(size_t)i * 3]);
    }
    settings.albedo = true;
    must_render(SMALL FROM_ABOVE TRANSLUCENT
                "lights: [{kind: area, position_mm: [0, 0, 20000], size_mm: [900, 900]}]\n");
    for (int i = 0; i < 1600; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(0.002 * 0.3, 0.5 * 0.6, picture.rgb[i * 3 + 1]);
    }
}

static void highlights_come_on_top(void)
{
    write_material();
    must_render(SMALL FROM_ABOVE
                "lights: [{kind: point, position_mm: [0, 0, 300]}]\n"
                "objects:\n  - shape: sphere\n    size_mm: 30\n"
                "    material: {file: material.exr, mapping: sphere, point_mm: 1.5}\n"
                "    gloss: {specular: 1, roughness: 0.01}\n");
    float with = pixel(20, 20)[0], aside = pixel(27, 20)[0];
    TEST_ASSERT_TRUE(with > 0.6F && aside > 0.15F && aside < 0.32F);
}

static void the_same_seed_gives_the_same_picture(void)
{
    const char *text = SMALL FROM_ABOVE TRANSLUCENT
        "lights: [{kind: area, position_mm: [0, 30, 50], size_mm: [20, 20]}]\n";
    write_material();
    must_render(text);
    struct picture first = picture;
    picture = (struct picture){0};
    must_render(text);
    TEST_ASSERT_EQUAL_MEMORY(first.rgb, picture.rgb, 1600 * 3 * sizeof(float));
    picture_finish(&first);
}

static void pov_files_stay_where_they_are_asked_for(void)
{
    struct stat status;
    char *folder = strdup(scratch_path("pov")), file[1024];
    settings.pov_folder = folder;
    must_render(SMALL FROM_ABOVE WHITE_GROUND "lights:\n" AREA);
    const char *const names[] = {"scene.pov", "object-0.inc", "povray.log", "picture.exr"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        (void)snprintf(file, sizeof file, "%s/%s", folder, names[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, stat(file, &status), file);
        (void)unlink(file);
    }
    TEST_ASSERT_EQUAL_INT(0, rmdir(folder)); /* nothing else was left */
    free(folder);
}

/* A smooth sky, different all around and up and down, in each colour. */
static void write_sky(void)
{
    struct picture sky;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&sky, 128, 64, &error));
    for (int i = 0; i < 128 * 64; i++) {
        int column = i % 128, row = i / 128;
        double azimuth = 2 * acos(-1.0) * (column + 0.5) / 128;
        sky.rgb[3 * i] = (float)(1 + 0.5 * sin(azimuth));
        sky.rgb[3 * i + 1] = (float)(1 + 0.5 * cos(azimuth));
        sky.rgb[3 * i + 2] = 0.2F + (float)row / 64;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(scratch_path("sky.exr"), &sky, NULL, &error));
    picture_finish(&sky);
}

static void a_sky_is_seen_where_its_light_comes_from(void)
{
    const double looks[][3] = {{1, 0, 0}, {-1, 0.1, 0.2}, {0, 1, 0.5}, {0.3, -1, -0.7}, {1, 1, 2}};
    write_sky();
    for (size_t i = 0; i < sizeof looks / sizeof *looks; i++) {
        char text[1024];
        struct light light;
        double value[3];
        (void)snprintf(text, sizeof text,
                       "image: {width: 21, height: 21, exposure: 0.5}\n"
                       "camera: {position_mm: [0, 0, 0], at_mm: [%g, %g, %g], angle_deg: 20}\n"
                       "environment: {image: sky.exr, color: [1, 0.5, 2], rotation_deg: 25}\n"
                       "lights: []\n"
                       "objects: [{shape: quad, size_mm: 1, position_mm: [900, 900, -900]}]\n",
                       looks[i][0], looks[i][1], looks[i][2]);
        must_render(text);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, light_make_environment(&light, &scene.environment, &error));
        environment_value(&light.environment, vec3_unit(vec3_from_doubles(looks[i])), value);
        for (int c = 0; c < 3; c++) {
            /* Half floats, and half a pixel of the sky by which POV-Ray's middle of a pixel may differ: 1.4 degrees at
             * a slope of 1 per radian. */
            TEST_ASSERT_DOUBLE_WITHIN(0.013 * (c + 1), 0.5 * value[c], pixel(10, 10)[c]);
        }
        light_finish(&light);
    }
}

static void a_plain_ground_is_lit_by_the_sky(void)
{
    must_render(SMALL FROM_ABOVE WHITE_GROUND "environment: {color: [1, 0.5, 2]}\nlights: []\n");
    for (int c = 0; c < 3; c++) {
        /* Beside a triangle's edge, as in the middle, POV-Ray's means of its corners are off by 0.002. */
        TEST_ASSERT_DOUBLE_WITHIN(0.001, 0.5 * 0.8 * scene.environment.color[c], pixel(23, 21)[c]);
    }
    settings.povray_shadows = true; /* which POV-Ray could not do */
    must_render(SMALL FROM_ABOVE WHITE_GROUND "environment: {color: [1, 0.5, 2]}\nlights: []\n");
    TEST_ASSERT_DOUBLE_WITHIN(0.001, 0.5 * 0.8, pixel(23, 21)[0]);
}

/* Seen at 60 degrees to the normal. */
#define SLANTED                                                                                    \
    "image: {width: 40, height: 40, exposure: 0.5}\n"                                              \
    "camera: {position_mm: [0.01, -346.41, 200], at_mm: [0.01, 0.02, 0], angle_deg: 3}\n"

static void light_leaves_a_surface_with_an_index_by_its_angle(void)
{
    write_material();
    must_render(SLANTED
                "lights: [{kind: point, position_mm: [0, 0, 20000]}]\n"
                "objects: [{shape: quad, size_mm: [60, 60, 1], index: 1.5, material: {file: "
                "material.exr, mapping: planar, point_mm: 1.5}}]\n");
    /* Of 60 degrees 0.0892 is mirrored (Fresnel), of 0 degrees 0.04; samples scatter by 1 %. */
    TEST_ASSERT_DOUBLE_WITHIN(0.03 * 0.3, 0.5 * 0.6 * (1 - 0.0892) / 0.96, pixel(20, 20)[0]);
    must_render(SLANTED
                "without: [Fresnel transmission]\n"
                "lights: [{kind: point, position_mm: [0, 0, 20000]}]\n"
                "objects: [{shape: quad, size_mm: [60, 60, 1], index: 1.5, material: {file: "
                "material.exr, mapping: planar, point_mm: 1.5}}]\n");
    TEST_ASSERT_DOUBLE_WITHIN(0.03 * 0.3, 0.5 * 0.6, pixel(20, 20)[0]);
}

static void a_polished_surface_mirrors_the_sky(void)
{
    must_render(SLANTED "environment: {color: [1, 0.5, 2]}\nlights: []\n"
                        "objects: [{shape: quad, size_mm: [60, 60, 1], index: 1.5, color: 0, "
                        "gloss: {reflection: 1}}]\n");
    /* Fresnel at 60 degrees; half floats. */
    TEST_ASSERT_DOUBLE_WITHIN(5e-4, 0.5 * 0.0892, pixel(20, 20)[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0.5 * 2 * 0.0892, pixel(20, 20)[2]);
    must_render(SLANTED "environment: {}\nlights: []\n"
                        "objects: [{shape: quad, size_mm: [60, 60, 1], color: 0, gloss: "
                        "{reflection: 0.25}}]\n");
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0.5 * 0.25, pixel(20, 20)[1]);
}

/* A wall on a ground, both of which a point light shines on: what the plain light of POV-Ray lacks comes on top. */
static void light_passes_from_plain_to_plain(void)
{
    static const char room[] = SMALL FROM_ABOVE
        "lights: [{kind: point, position_mm: [-15, 0, 25]}]\n"
        "objects:\n  - {shape: quad, size_mm: [90, 90, 1], color: 0.8}\n"
        "  - {shape: box, size_mm: [2, 90, 30], position_mm: [12, 0, 0], color: [0.9, 0, 0]}\n";
    char text[1024];
    must_render(room);
    float before = pixel(29, 20)[0], blue = pixel(29, 20)[2];
    (void)snprintf(text, sizeof text, "bounces: 1\n%s", room);
    must_render(text);
    /* Beside a wall of 0.9 under about half of the light, which fills a third of the view. */
    TEST_ASSERT_TRUE(pixel(29, 20)[0] > 1.1F * before);
    TEST_ASSERT_FLOAT_WITHIN(0.001F, blue, pixel(29, 20)[2]);
}

static void fails_with(const char *text, const char *why)
{
    int before = scratch_count();
    (void)setenv("TMPDIR", scratch_path(""), 1);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, render(text));
    (void)unsetenv("TMPDIR");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL(picture.rgb);
    TEST_ASSERT_EQUAL_INT_MESSAGE(before, scratch_count(), "something was left");
    scene_finish(&scene);
    render_report_finish(&report);
}

static void set_path(const char *value)
{
    const char *before = getenv("PATH");
    path = strdup(before ? before : "");
    (void)setenv("PATH", value, 1);
}

static void a_missing_povray_is_told(void)
{
    set_path("/nowhere");
    fails_with(SMALL FROM_ABOVE WHITE_GROUND "lights: []\n", "povray");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "apt install"), error.text);
}

static void put_povray(const char *script)
{
    char *value = NULL;
    scratch_store("povray", script, strlen(script));
    (void)chmod(scratch_path("povray"), 0755);
    TEST_ASSERT_TRUE(asprintf(&value, "%s:/bin:/usr/bin", scratch_path("")) > 0);
    set_path(value);
    free(value);
}

static void a_failing_povray_speaks_for_itself(void)
{
    put_povray("#!/bin/sh\necho 'all was well'\n"
               "echo 'cannot open the user configuration file povray.conf'\n"
               "echo \"File 'scene.pov' line 7: Parse Error: no moon\" >&2\nexit 1\n");
    fails_with(SMALL FROM_ABOVE WHITE_GROUND "lights: []\n", "Parse Error: no moon");
    TEST_ASSERT_NULL_MESSAGE(strstr(error.text, "all was well"), error.text);
    TEST_ASSERT_NULL_MESSAGE(strstr(error.text, "configuration"), error.text);
}

static void a_povray_that_is_killed_or_leaves_nothing_is_told(void)
{
    put_povray("#!/bin/sh\nkill -9 $$\n");
    fails_with(SMALL FROM_ABOVE WHITE_GROUND "lights: []\n", "signal 9");
    scratch_store("povray", "#!/bin/sh\n", strlen("#!/bin/sh\n"));
    fails_with(SMALL FROM_ABOVE WHITE_GROUND "lights: []\n", "left no picture");
}

static void what_a_scene_names_must_be_there(void)
{
    fails_with(SMALL FROM_ABOVE TRANSLUCENT "lights: []\n", "material.exr");
    fails_with(SMALL FROM_ABOVE "objects: [{shape: mesh, file: absent.ply}]\nlights: []\n",
               "absent.ply");
    fails_with(
        SMALL FROM_ABOVE WHITE_GROUND
        "lights: [{kind: projector, position_mm: [0, 0, 9], texture: {image: absent.png}}]\n",
        "absent.png");
}

/* POV-Ray writes half floats: nothing above 65504, nothing below 6e-8, and few digits below 6e-5. */
static void values_beyond_half_floats_come_through(void)
{
    static const char *const exposures[] = {"1e6", "1e-6"};
    const double factors[] = {1e6, 1e-6};
    const char *rest = FROM_ABOVE WHITE_GROUND
        "lights: [{kind: point, position_mm: [10, 5, 30], irradiance: [1, 0.5, 0.25]}]\n";
    char text[2048];
    (void)snprintf(text, sizeof text, "image: {width: 40, height: 40}\n%s", rest);
    must_render(text);
    struct picture plain = picture;
    picture = (struct picture){0};
    for (int k = 0; k < 2; k++) {
        (void)snprintf(text, sizeof text, "image: {width: 40, height: 40, exposure: %s}\n%s",
                       exposures[k], rest);
        must_render(text);
        for (int i = 0; i < 1600 * 3; i++) {
            /* Two roundings to 11 bits. */
            double expected = plain.rgb[i] * factors[k];
            TEST_ASSERT_DOUBLE_WITHIN(expected / 1024, expected, picture.rgb[i]);
        }
    }
    picture_finish(&plain);
}

static void a_light_inside_a_translucent_object_is_told(void)
{
    write_material();
    fails_with(
        SMALL FROM_ABOVE "lights:\n  - {kind: point, position_mm: [1, 2, 16], at_mm: [9, 9, 9]}\n"
                         "objects:\n  - shape: sphere\n    size_mm: 30\n"
                         "    material: {file: material.exr, mapping: sphere, point_mm: 1.5}\n",
        "the light at line 4, column 5 is inside the translucent object at line 6, column 5");
    /* Under it, or beside it between two, it is outside. */
    must_render(SMALL FROM_ABOVE
                "lights:\n  - {kind: point, position_mm: [1, 2, 36], at_mm: [9, 9, 9]}\n"
                "objects:\n  - shape: sphere\n    size_mm: 30\n"
                "    material: {file: material.exr, mapping: sphere, point_mm: 1.5}\n"
                "  - {shape: box, size_mm: 90, position_mm: [0, 0, -10]}\n");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(point_and_spot_lights_are_right_to_one_per_cent);
    RUN_TEST(area_lights_are_right_to_one_per_cent_by_either_way);
    RUN_TEST(lights_of_several_kinds_add_up);
    RUN_TEST(a_projected_picture_lands_where_it_should);
    RUN_TEST(light_does_not_go_round_the_slide);
    RUN_TEST(a_picture_is_not_mirrored);
    RUN_TEST(background_and_exposure_are_as_stated);
    RUN_TEST(a_translucent_ground_under_even_light_shows_its_albedo);
    RUN_TEST(highlights_come_on_top);
    RUN_TEST(the_same_seed_gives_the_same_picture);
    RUN_TEST(a_sky_is_seen_where_its_light_comes_from);
    RUN_TEST(a_plain_ground_is_lit_by_the_sky);
    RUN_TEST(light_leaves_a_surface_with_an_index_by_its_angle);
    RUN_TEST(a_polished_surface_mirrors_the_sky);
    RUN_TEST(light_passes_from_plain_to_plain);
    RUN_TEST(pov_files_stay_where_they_are_asked_for);
    RUN_TEST(a_missing_povray_is_told);
    RUN_TEST(a_failing_povray_speaks_for_itself);
    RUN_TEST(a_povray_that_is_killed_or_leaves_nothing_is_told);
    RUN_TEST(what_a_scene_names_must_be_there);
    RUN_TEST(values_beyond_half_floats_come_through);
    RUN_TEST(a_light_inside_a_translucent_object_is_told);
    return UNITY_END();
}
