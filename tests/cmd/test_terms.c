/* What stands behind the factorizer takes a material with a kernel per term: error, report and render, each run as a user
 * runs it, on the small scan made by a formula, which is one such term. */
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
#include <unity.h>

enum { POINTS = MADE_WIDTH * MADE_HEIGHT, AREA = MADE_WINDOW * MADE_WINDOW, PIXELS = 32 * 24 };

static char *folder, *scan;

void setUp(void)
{
}

void tearDown(void)
{
}

#define RUN(...) told_well((const char *const[]){NACRE, __VA_ARGS__, NULL})

/* The response at the point with index i to itself. */
static double centre_of(int channel, int i)
{
    int x = i % MADE_WIDTH, y = i / MADE_WIDTH;
    return (double)made_response(channel, x, y, x, y);
}

/* The formula's kernel e(d), from the responses of the middle. */
static double kernel_of(int channel, int u, int v)
{
    int x = MADE_WIDTH / 2, y = MADE_HEIGHT / 2;
    int xo = x + u - MADE_WINDOW / 2, yo = y + v - MADE_WINDOW / 2;
    return (double)made_response(channel, x, y, xo, yo) /
           sqrt(centre_of(channel, y * MADE_WIDTH + x) * centre_of(channel, yo * MADE_WIDTH + xo));
}

/* The formula as a material: F = H = `scale` times the root of R(x, x) and the kernel e, as one term or as the paper's model
 * with one cluster. With a centre the kernel's middle entry is a third of e's, and the plane of the centre has the rest. */
static char *write_material(const char *name, enum nacre_layout layout, bool centre, double scale)
{
    bool terms = layout == NACRE_KERNEL_PER_TERM;
    struct nacre_error error = {""};
    struct nacre_material m = {.width = MADE_WIDTH,
                               .height = MADE_HEIGHT,
                               .channels = 3,
                               .factor_channels = 3,
                               .window = MADE_WINDOW,
                               .terms = 1,
                               .clusters = terms ? 0 : 1,
                               .mixed = terms ? 0 : 1,
                               .layout = layout,
                               .pixel = NACRE_FLOAT,
                               .pitch_mm = 0.5};
    char *path = path_join(folder, name);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_allocate(&m, !terms, centre, &error),
                                  error.text);
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < POINTS; i++) {
            double own = centre_of(c, i);
            m.albedo[c * POINTS + i] = 0.5f;
            m.f[c * POINTS + i] = (float)(scale * sqrt(own));
            if (centre) {
                m.centre[c * POINTS + i] = (float)(own * 2 / 3);
            }
            if (!terms) {
                m.h[c * POINTS + i] = m.f[c * POINTS + i];
                m.weights[i] = 1;
            }
        }
        for (int i = 0; i < AREA; i++) {
            double share = centre && i == AREA / 2 ? 1.0 / 3 : 1;
            m.kernels[c * AREA + i] =
                (float)(share * kernel_of(c, i % MADE_WINDOW, i / MADE_WINDOW));
        }
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_write(path, &m, &error), error.text);
    nacre_material_finish(&m);
    return path;
}

static double number_of(const char *measured, const char *path, const char *option,
                        const char *name)
{
    char *text = RUN("error", measured, path, option, "--json");
    json_t *root = told_parse(text);
    double value = told_number(root, name);
    json_decref(root);
    free(text);
    return value;
}

static double mean_of(const char *path, const char *name)
{
    return number_of(scan, path, "--quiet", name);
}

/* The scan's half floats are off by at most 2^-11 = 4.9e-4 of each entry, the material's floats by nothing beside that. */
static void the_formula_as_one_term_has_no_error(void)
{
    char *path = write_material("terms.exr", NACRE_KERNEL_PER_TERM, true, 1);
    TEST_ASSERT_DOUBLE_WITHIN(4.9e-4, 0, mean_of(path, "error.mean"));
    TEST_ASSERT_DOUBLE_WITHIN(4.9e-4, 0, mean_of(path, "error_without_centre.mean"));
    free(path);
}

/* F = H 1.1 times as large makes everything but the plane of the centre 1.21 times as large. At the centre that is a third:
 * 0.07 of it. */
static void an_error_of_one_term_is_told_with_and_without_the_centre(void)
{
    char *path = write_material("off.exr", NACRE_KERNEL_PER_TERM, true, 1.1);
    double whole = mean_of(path, "error.mean");
    TEST_ASSERT_DOUBLE_WITHIN(1.21 * 4.9e-4, 0.21, mean_of(path, "error_without_centre.mean"));
    TEST_ASSERT_TRUE(whole > 0.07 && whole < 0.21);
    free(path);
}

static void the_report_shows_the_term(void)
{
    char *path = write_material("terms.exr", NACRE_KERNEL_PER_TERM, true, 1);
    char *page = path_join(folder, "terms.html");
    size_t size = 0;
    free(RUN("report", scan, path, "-o", page));
    char *text = (char *)file_read(page, &size);
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_NOT_NULL(strstr(text, "<h2>Terms</h2>"));
    TEST_ASSERT_NOT_NULL(strstr(text, ">0</b>100 %"));
    TEST_ASSERT_NOT_NULL(strstr(text, "alt=\"kernel of a term"));
    TEST_ASSERT_NOT_NULL(strstr(text, "alt=\"plane of the centre"));
    TEST_ASSERT_NOT_NULL(strstr(text, "one per term"));
    free(text);
    free(page);
    free(path);
}

/* A picture of a slab of this material, red. */
static struct exr_file render(const char *material, const char *name)
{
    struct nacre_error error = {""};
    struct exr_file file = {0};
    char *scene = path_join(folder, "scene.yaml"), *picture = path_join(folder, name);
    stations_write_scene(scene, material);
    free(RUN("render", scene, "-o", picture));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, exr_file_read(picture, &file, &error), error.text);
    free(scene);
    free(picture);
    return file;
}

/* Red of a picture of the material that was written to `path`, which is freed. */
static double *red_of(char *path)
{
    struct exr_file file = render(path, "picture.exr");
    const struct exr_plane *plane = exr_part_find_plane(&file.parts[0], "R");
    double *red = calloc(PIXELS, sizeof *red);
    TEST_ASSERT_TRUE(plane && red);
    for (size_t i = 0; plane && red && i < PIXELS; i++) {
        red[i] = (double)plane->values[i];
    }
    exr_file_finish(&file);
    free(path);
    return red;
}

/* All but the brighter one are the same responses. Held as half floats on the way, each of F, g and H may be off by 2^-11, the
 * picture itself by as much: 2e-3 in all. Between points a centre is interpolated and F times H is the product of
 * interpolated ones; where the formula's 0.5 meets its 0.9 they differ by 8 % of what is at most a fifth of the light:
 * less than 1 % of the mean. */
static void the_picture_is_that_of_the_same_responses_otherwise_written(void)
{
    double *terms = red_of(write_material("terms.exr", NACRE_KERNEL_PER_TERM, false, 1));
    double *centred = red_of(write_material("centred.exr", NACRE_KERNEL_PER_TERM, true, 1));
    double *single = red_of(write_material("single.exr", NACRE_KERNEL_SINGLE, false, 1));
    double *bright = red_of(write_material("bright.exr", NACRE_KERNEL_PER_TERM, false, sqrt(2)));
    double sum[3] = {0};
    for (size_t i = 0; i < PIXELS; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(2e-3 * single[i], single[i], terms[i]);
        sum[0] += single[i];
        sum[1] += centred[i];
        sum[2] += bright[i];
    }
    TEST_ASSERT_TRUE(sum[0] > 10 * 0.1); /* the slab is seen, on ten pixels and more */
    TEST_ASSERT_DOUBLE_WITHIN(0.01 * sum[0], sum[0], sum[1]);
    TEST_ASSERT_DOUBLE_WITHIN(0.02 * sum[0], 2 * sum[0], sum[2]);
    free(terms);
    free(centred);
    free(single);
    free(bright);
}

/* The same through the factorizer: one term, found on the scan and stored at 8 bits. Its planes are the roots of two
 * values, 0.5 and 0.9 in red, 0.2 and 0.8 in blue, held to half a step of 255 in square root: the root of the greatest
 * is 1, a step of u is 2 sqrt(u) / 255 of it, so u = 0.5 / 0.9 is off by at most 0.0029 / 0.556 = 0.53 % and R by twice
 * that; u = 0.25, in blue, by 0.8 % and 1.6 %. Shared planes cannot be all of red, green and blue, whose ratios differ
 * (0.56, 0.41 and 0.25), so channels have planes of their own here. Half floats of the scan add 0.05 %. */
static void one_term_is_found_on_the_scan(void)
{
    char *path = path_join(folder, "factored.exr");
    struct nacre_material m = {0};
    struct nacre_error error = {""};
    char *told = RUN("factor", scan, "-o", path, "--terms", "1", "--planes", "separate", "--bits",
                     "8", "--json");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(told, "\"planes\": \"separate\""), told);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(told, "\"kernels\": \"radial\""), told);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(told, "\"bits\": 8"), told);
    free(told);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_read(path, &m, &error), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_KERNEL_PER_TERM, m.layout);
    TEST_ASSERT_EQUAL_INT(1, m.terms);
    TEST_ASSERT_EQUAL_INT(8, m.bits);
    TEST_ASSERT_DOUBLE_WITHIN(0.017, 0, mean_of(path, "error.mean"));
    TEST_ASSERT_DOUBLE_WITHIN(0.017, 0, mean_of(path, "error_without_centre.mean"));
    TEST_ASSERT_DOUBLE_WITHIN(0.017, 0, number_of(scan, path, "--cross", "cross.error"));
    nacre_material_finish(&m);
    free(path);
}

/* A gain of exp(0.4) over the sample makes points 3 apart differ by 6 % forth and back: it is found, and what is left is what
 * one term leaves without it, and what cosines leave of a straight line, 2 % of its rise at either end. With the gain divided
 * out --cross judges as it does the scan without: by what one term leaves, and what is left of the gain. */
static void a_scan_with_gains_is_factored(void)
{
    char *gained = path_join(folder, "gained-scan.exr"), *path = path_join(folder, "gained.exr");
    struct nacre_material m = {0};
    struct nacre_error error = {0};
    made_gained_scan_write(gained, 0.4);
    free(RUN("factor", gained, "-o", path, "--terms", "1", "--planes", "separate", "--json"));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_read(path, &m, &error), error.text);
    TEST_ASSERT_NOT_NULL(m.gain);
    TEST_ASSERT_TRUE(m.error_mean < 0.017 + 2 * 0.02 * 0.4);
    TEST_ASSERT_TRUE(number_of(gained, path, "--cross", "cross.error") < 0.017 + 2 * 0.02 * 0.4);
    nacre_material_finish(&m);
    free(gained);
    free(path);
}

int main(void)
{
    folder = folder_make();
    scan = path_join(folder, "scan.exr");
    made_scan_write(scan);
    UNITY_BEGIN();
    RUN_TEST(the_formula_as_one_term_has_no_error);
    RUN_TEST(an_error_of_one_term_is_told_with_and_without_the_centre);
    RUN_TEST(the_report_shows_the_term);
    RUN_TEST(the_picture_is_that_of_the_same_responses_otherwise_written);
    RUN_TEST(one_term_is_found_on_the_scan);
    RUN_TEST(a_scan_with_gains_is_factored);
    free(scan);
    folder_remove(folder);
    return UNITY_END();
}
