/* The stages behind the camera on responses from elsewhere: factor, error, render and report on a small scan made by a
 * formula, each run as a user runs it. */
#include "nacre/exr_file.h"
#include "nacre/material.h"
#include "tests/cmd/made.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"
#include "tests/cmd/told.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

static char *folder, *scan, *material;

void setUp(void)
{
}

void tearDown(void)
{
}

#define RUN(...) told_well((const char *const[]){NACRE, __VA_ARGS__, NULL})

static json_t *parse(char *text)
{
    json_t *root = told_parse(text);
    free(text);
    return root;
}

/* The formula is a kernel e(d) times a factor of x_i times one of x_o. The kernel that is found is the average response,
 * e(d) times the mean over x_i of a(x_i) a(x_i + d), which varies over the window by 0.9, 1.5 and 1.7 % in R, G and B
 * (weighted by e^2, computed apart); one term's F and H can take back none of what varies with d alone. Rounding them
 * to half adds 0.05 %. */
static void a_separable_material_needs_one_term(void)
{
    char *output = path_join(folder, "one.exr");
    json_t *result = parse(RUN("factor", scan, "-o", output, "--terms", "1", "--clusters", "1",
                               "--iterations", "200", "--json"));
    TEST_ASSERT_DOUBLE_WITHIN(0.0175, 0, told_number(result, "error.mean"));
    TEST_ASSERT_DOUBLE_WITHIN(0, MADE_WIDTH * MADE_HEIGHT, told_number(result, "error.points"));
    json_decref(result);
    free(output);
}

static void the_file_holds_the_error_that_was_printed(void)
{
    struct nacre_error error = {""};
    struct nacre_material read = {0};
    json_t *made = parse(RUN("factor", scan, "-o", material, "--terms", "3", "--clusters", "2",
                             "--iterations", "20", "--json"));
    json_t *measured = parse(RUN("error", scan, material, "--json"));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_read(material, &read, &error),
                                  error.text);
    /* The attribute is a float: 24 bits. */
    double mean = told_number(made, "error.mean");
    TEST_ASSERT_DOUBLE_WITHIN(1e-7, read.error_mean, mean);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, mean, told_number(measured, "error.mean"));
    TEST_ASSERT_EQUAL_INT(3, read.terms);
    TEST_ASSERT_EQUAL_INT(2, read.clusters);
    TEST_ASSERT_EQUAL_INT(20, read.iterations);
    nacre_material_finish(&read);
    json_decref(made);
    json_decref(measured);
}

static void a_scan_does_not_differ_from_itself(void)
{
    json_t *measured = parse(RUN("error", scan, scan, "--json"));
    TEST_ASSERT_DOUBLE_WITHIN(0, 0, told_number(measured, "max"));
    TEST_ASSERT_DOUBLE_WITHIN(0, MADE_WIDTH * MADE_HEIGHT, told_number(measured, "points"));
    json_decref(measured);
}

/* The formula is reciprocal and has no noise but the half float's rounding. */
static void the_error_against_the_noise_free_response_is_estimated(void)
{
    char *output = path_join(folder, "cross.exr");
    json_decref(parse(RUN("factor", scan, "-o", output, "--terms", "3", "--clusters", "2",
                          "--iterations", "20", "--weight", "response", "--json")));
    json_t *measured = parse(RUN("error", scan, output, "--cross", "--json"));
    const json_t *cross = json_object_get(measured, "cross");
    TEST_ASSERT_TRUE(told_number(cross, "noise") < 1e-3);
    TEST_ASSERT_TRUE(told_number(cross, "pairs") > 1000);
    /* Half as many entries are fitted, and the norm is another: of the same size. */
    TEST_ASSERT_TRUE(told_number(cross, "error") <
                     2 * told_number(measured, "error_without_centre.mean"));
    json_decref(measured);
    free(output);
}

/* The history of seconds differs from run to run, so planes are compared and not files. */
static void the_same_seed_gives_the_same_factors(void)
{
    const char *const seeds[] = {"4", "4", "5"};
    struct nacre_material read[3] = {0};
    struct nacre_error error = {""};
    for (int i = 0; i < 3; i++) {
        char *path = path_join(folder, "seeded.exr");
        free(RUN("factor", scan, "-o", path, "--terms", "2", "--clusters", "5", "--iterations", "5",
                 "--json", "--seed", seeds[i]));
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_read(path, &read[i], &error),
                                      error.text);
        free(path);
    }
    size_t bytes = sizeof(float) * 2 * 3 * MADE_WIDTH * MADE_HEIGHT;
    TEST_ASSERT_EQUAL_INT(0, memcmp(read[0].f, read[1].f, bytes));
    TEST_ASSERT_EQUAL_INT(0, memcmp(read[0].h, read[1].h, bytes));
    TEST_ASSERT_TRUE(memcmp(read[0].f, read[2].f, bytes) != 0);
    for (int i = 0; i < 3; i++) {
        nacre_material_finish(&read[i]);
    }
}

static void with_a_source_date_two_runs_give_the_same_file(void)
{
    char *path = path_join(folder, "dated.exr");
    uint8_t *bytes[2] = {NULL};
    size_t sizes[2] = {0};
    TEST_ASSERT_EQUAL_INT(0, setenv("SOURCE_DATE_EPOCH", "1", 1));
    for (int i = 0; i < 2; i++) {
        free(RUN("factor", scan, "-o", path, "--terms", "2", "--iterations", "5", "--json"));
        bytes[i] = file_read(path, &sizes[i]);
        TEST_ASSERT_NOT_NULL(bytes[i]);
    }
    TEST_ASSERT_EQUAL_INT(0, unsetenv("SOURCE_DATE_EPOCH"));
    TEST_ASSERT_EQUAL_UINT64(sizes[0], sizes[1]);
    TEST_ASSERT_TRUE(sizes[0] > 1000);
    TEST_ASSERT_EQUAL_INT(0, memcmp(bytes[0], bytes[1], sizes[0]));
    free(bytes[0]);
    free(bytes[1]);
    free(path);
}

/* The slab is 10 x 7 mm and lies flat under a light that makes irradiance 1 at its middle; the camera sees it there.
 * Its value is the sum of the responses that reach the pixel's points, times what the light's slant and distance leave
 * (1 in the middle): between the dark material's 0.1 and the bright one's 1 in red. Blue is darker than red by the
 * formula, and the corners of the picture hold the background. */
static void a_rendering_shows_the_material(void)
{
    char *scene = path_join(folder, "scene.yaml");
    char *picture = path_join(folder, "picture.exr");
    struct exr_file file = {0};
    struct nacre_error error = {""};
    stations_write_scene(scene, material);
    free(RUN("render", scene, "-o", picture));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(picture, &file, &error), error.text);
    const struct exr_part *part = &file.parts[0];
    const struct exr_plane *red = exr_part_find_plane(part, "R");
    const struct exr_plane *blue = exr_part_find_plane(part, "B");
    TEST_ASSERT_EQUAL_INT(32, part->width);
    TEST_ASSERT_EQUAL_INT(24, part->height);
    TEST_ASSERT_TRUE(red && blue);
    if (!red || !blue) {
        abort(); /* cannot be, which analysers do not know */
    }
    size_t middle = 12 * 32 + 16;
    TEST_ASSERT_TRUE(red->values[middle] > 0.1F && red->values[middle] < 1);
    TEST_ASSERT_TRUE(blue->values[middle] < red->values[middle]);
    TEST_ASSERT_TRUE(blue->values[middle] > 0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, red->values[0]);
    exr_file_finish(&file);
    free(scene);
    free(picture);
}

/* 10 % is coarse enough for the least number of samples; what was reached is told and stands in the picture. */
static void a_rendering_holds_an_error(void)
{
    char *scene = path_join(folder, "scene.yaml");
    char *picture = path_join(folder, "held.exr");
    struct exr_file file = {0};
    struct nacre_error error = {""};
    stations_write_scene(scene, material);
    json_t *root = parse(RUN("render", scene, "-o", picture, "--error", "10%", "--json"));
    const json_t *refined = json_object_get(root, "refined");
    double reached = told_number(refined, "error");
    TEST_ASSERT_TRUE(reached > 0 && reached <= 0.1);
    TEST_ASSERT_TRUE(json_is_true(json_object_get(refined, "error_held")));
    TEST_ASSERT_TRUE(json_array_size(json_object_get(refined, "steps")) >= 1);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(picture, &file, &error), error.text);
    const struct exr_attribute *stands = exr_part_find(&file.parts[0], "nacre.error", EXR_STRING);
    TEST_ASSERT_NOT_NULL(stands);
    /* Three digits. */
    TEST_ASSERT_DOUBLE_WITHIN(0.006 * reached, reached, strtod(stands ? stands->string : "", NULL));
    exr_file_finish(&file);
    json_decref(root);
    free(scene);
    free(picture);
}

/* A picture comes all the same, and what could not be had is said with what was. */
static void a_rendering_that_cannot_be_in_time_is_told(void)
{
    char *scene = path_join(folder, "scene.yaml");
    char *picture = path_join(folder, "late.exr");
    stations_write_scene(scene, material);
    const char *const late[] = {NACRE,      "render", scene,     "-o", picture,
                                "--within", "1ms",    "--quiet", NULL};
    struct spawned run = spawn(late, NULL);
    TEST_ASSERT_EQUAL_INT(1, run.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.errors, "cannot be done in 0.001 s"), run.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.errors, picture), run.errors);
    TEST_ASSERT_EQUAL_INT(0, access(picture, R_OK));
    spawned_finish(&run);
    free(scene);
    free(picture);
}

static const json_t *explained(const json_t *list, const char *name)
{
    size_t index;
    json_t *entry;
    json_array_foreach(list, index, entry)
    {
        if (strcmp(json_string_value(json_object_get(entry, "effect")), name) == 0) {
            return entry;
        }
    }
    TEST_FAIL_MESSAGE(name);
    return NULL;
}

/* Every effect with the line that calls for it and what it costs, or why it is left out; no picture is made. */
static void a_rendering_is_explained(void)
{
    char *scene = path_join(folder, "scene.yaml");
    stations_write_scene(scene, material);
    json_t *list = parse(RUN("render", scene, "--explain", "--json"));
    json_t *finer = parse(RUN("render", scene, "--explain", "--json", "--samples", "48"));
    TEST_ASSERT_EQUAL_UINT64(13, json_array_size(list));
    const json_t *gather = explained(list, "subsurface scattering");
    TEST_ASSERT_TRUE(json_is_true(json_object_get(gather, "simulated")));
    TEST_ASSERT_EQUAL_STRING(scene, json_string_value(json_object_get(gather, "file")));
    TEST_ASSERT_TRUE(told_number(gather, "line") > 1);
    /* Four times the samples take longer, but not more than as many times. */
    double cost = told_number(gather, "seconds");
    double more = told_number(explained(finer, "subsurface scattering"), "seconds");
    TEST_ASSERT_TRUE(cost > 0 && more > 1.2 * cost && more < 4.01 * cost);
    const json_t *sky = explained(list, "environment");
    TEST_ASSERT_FALSE(json_is_true(json_object_get(sky, "simulated")));
    TEST_ASSERT_EQUAL_DOUBLE(0, told_number(sky, "seconds"));
    TEST_ASSERT_EQUAL_STRING("no environment", json_string_value(json_object_get(sky, "reason")));
    char *text = RUN("render", scene, "--explain");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "simulated subsurface scattering"), text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "left out  environment"), text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "scene.yaml:"), text);
    free(text);
    json_decref(list);
    json_decref(finer);
    free(scene);
}

/* Nothing of the page is fetched from elsewhere. */
static void the_report_is_one_self_contained_page(void)
{
    char *page = path_join(folder, "report.html");
    size_t size = 0;
    free(RUN("report", scan, material, "-o", page));
    char *text = (char *)file_read(page, &size);
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_NOT_NULL(strstr(text, "<!DOCTYPE html>"));
    TEST_ASSERT_NOT_NULL(strstr(text, "</html>"));
    TEST_ASSERT_NOT_NULL(strstr(text, "data:image/png;base64,"));
    TEST_ASSERT_NULL(strstr(text, "src=\"http"));
    TEST_ASSERT_NULL(strstr(text, "<link"));
    TEST_ASSERT_NULL(strstr(text, "<script src"));
    free(text);
    free(page);
}

/* Effects of the station's and the sample's file, with a line each; nothing is measured. */
static void scan_explains_what_a_station_simulates(void)
{
    char *text = NULL;
    char *session = path_join(folder, "explained");
    char *station = path_join(folder, "station.yaml");
    stations_write(folder);
    json_t *list = parse(RUN("scan", session, "--station", station, "--explain", "--json"));
    size_t index;
    json_t *entry;
    bool noisy = false;
    bool lit = true;
    json_array_foreach(list, index, entry)
    {
        const char *effect = json_string_value(json_object_get(entry, "effect"));
        bool simulated = json_is_true(json_object_get(entry, "simulated"));
        TEST_ASSERT_NOT_NULL(effect);
        if (strcmp(effect, "read noise") == 0) {
            noisy = simulated && json_integer_value(json_object_get(entry, "line")) == 3;
            TEST_ASSERT_EQUAL_STRING(station, json_string_value(json_object_get(entry, "file")));
        } else if (strcmp(effect, "dust") == 0) {
            lit = simulated;
        }
    }
    TEST_ASSERT_TRUE(noisy);
    TEST_ASSERT_FALSE(lit);
    text = RUN("scan", session, "--station", station, "--explain", "--dry-run");
    TEST_ASSERT_NOT_NULL(strstr(text, "to measure"));
    TEST_ASSERT_NOT_NULL(strstr(text, "left out  dust"));
    TEST_ASSERT_TRUE(access(session, F_OK) != 0);
    json_decref(list);
    free(text);
    free(session);
    free(station);
}

int main(void)
{
    folder = folder_make();
    scan = path_join(folder, "scan.exr");
    material = path_join(folder, "material.exr");
    made_scan_write(scan);
    UNITY_BEGIN();
    RUN_TEST(a_separable_material_needs_one_term);
    RUN_TEST(the_file_holds_the_error_that_was_printed);
    RUN_TEST(a_scan_does_not_differ_from_itself);
    RUN_TEST(the_error_against_the_noise_free_response_is_estimated);
    RUN_TEST(the_same_seed_gives_the_same_factors);
    RUN_TEST(with_a_source_date_two_runs_give_the_same_file);
    RUN_TEST(a_rendering_shows_the_material);
    RUN_TEST(a_rendering_is_explained);
    RUN_TEST(a_rendering_holds_an_error);
    RUN_TEST(a_rendering_that_cannot_be_in_time_is_told);
    RUN_TEST(the_report_is_one_self_contained_page);
    RUN_TEST(scan_explains_what_a_station_simulates);
    free(scan);
    free(material);
    folder_remove(folder);
    return UNITY_END();
}
