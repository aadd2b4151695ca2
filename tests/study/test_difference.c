/* One scan against another. */
#include "../nacre/scratch.h"
#include "study/difference.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 6, HEIGHT = 5, WINDOW = 3, SIZE = 3 * WINDOW * WINDOW };

static struct nacre_error error;
static struct nacre_scan *exact, *other;

void setUp(void)
{
    scratch_make();
}

void tearDown(void)
{
    nacre_scan_close(exact);
    nacre_scan_close(other);
    exact = other = NULL;
    scratch_remove();
}

/* Entry k of point i is (1 + k + i) times `factor`; the first entry of all points but the border's is off by `one`. */
static struct nacre_scan *made(const char *name, int window, float factor, float one, int points)
{
    struct nacre_scan *scan = NULL;
    struct nacre_scan_writer *writer = NULL;
    struct nacre_scan_info info = {WIDTH, HEIGHT, window, 3, NACRE_FLOAT, false, 0.5, "made"};
    float response[3 * 25];
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_create(scratch_path(name), &info, &writer, &error));
    for (int i = 0; i < points; i++) {
        for (int k = 0; k < 3 * window * window; k++) {
            response[k] = factor * (float)(1 + k + i) + (k == 0 ? one : 0);
        }
        TEST_ASSERT_EQUAL_INT(NACRE_OK,
                              nacre_scan_write(writer, i % WIDTH, i / WIDTH, response, &error));
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_commit(writer, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_open(scratch_path(name), &scan, &error));
    return scan;
}

static void scaled_scan_is_off_by_the_factor(void)
{
    struct scan_difference found;
    exact = made("a", WINDOW, 1, 0, WIDTH * HEIGHT);
    other = made("b", WINDOW, 1.25F, 0, WIDTH * HEIGHT);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan_difference(exact, other, &found, &error));
    TEST_ASSERT_EQUAL_UINT(WIDTH * HEIGHT, found.points);
    /* All values are exact in floats. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.25, found.least);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.25, found.mean);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.25, found.greatest);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.25, found.bias);
}

static void error_is_that_of_the_norm(void)
{
    struct scan_difference found;
    double greatest = 0;
    exact = made("a", WINDOW, 1, 0, WIDTH * HEIGHT);
    other = made("b", WINDOW, 1, 3, WIDTH * HEIGHT);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan_difference(exact, other, &found, &error));
    /* The first entry lies inside the sample for all but the first row and column. */
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        int x = i % WIDTH;
        int y = i / WIDTH;
        double square = 0;
        for (int k = 0; k < SIZE; k++) {
            int u = x + k % WINDOW - 1;
            int v = y + k / WINDOW % WINDOW - 1;
            bool inside = u >= 0 && v >= 0 && u < WIDTH && v < HEIGHT;
            square += inside ? (1.0 + k + i) * (1.0 + k + i) : 0;
        }
        greatest = x > 0 && y > 0 ? fmax(greatest, 3 / sqrt(square)) : greatest;
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, greatest, found.greatest);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0, found.least);
}

static void points_not_measured_are_left_out(void)
{
    struct scan_difference found;
    exact = made("a", WINDOW, 1, 0, WIDTH * HEIGHT);
    other = made("b", WINDOW, 2, 0, 20);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, scan_difference(exact, other, &found, &error));
    TEST_ASSERT_EQUAL_UINT(20, found.points);
    TEST_ASSERT_EQUAL_UINT(10, found.left_out);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1, found.mean);
}

static void other_windows_are_refused(void)
{
    struct scan_difference found;
    exact = made("a", WINDOW, 1, 0, WIDTH * HEIGHT);
    other = made("b", 5, 1, 0, WIDTH * HEIGHT);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan_difference(exact, other, &found, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "window 5"), error.text);
}

static void nothing_in_common_is_an_error(void)
{
    struct scan_difference found;
    exact = made("a", WINDOW, 1, 0, WIDTH * HEIGHT);
    other = made("b", WINDOW, 1, 0, 0);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan_difference(exact, other, &found, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "in common"), error.text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(scaled_scan_is_off_by_the_factor);
    RUN_TEST(error_is_that_of_the_norm);
    RUN_TEST(points_not_measured_are_left_out);
    RUN_TEST(other_windows_are_refused);
    RUN_TEST(nothing_in_common_is_an_error);
    return UNITY_END();
}
