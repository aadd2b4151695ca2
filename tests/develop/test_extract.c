/* Cutting responses out of the surface's picture, and what their rims say. */
#include "rig/develop/extract.h"
#include "unity.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 20, HEIGHT = 16, K = 7 };

static const struct nacre_scan_info info = {
    .width = WIDTH, .height = HEIGHT, .window = K, .channels = 3};
static float reflected[3][HEIGHT][WIDTH], response[3][K][K];
static struct extract_sums sums;

void setUp(void)
{
    memset(&sums, 0, sizeof sums);
    for (int c = 0; c < 3; c++) {
        for (int y = 0; y < HEIGHT; y++) {
            for (int x = 0; x < WIDTH; x++) {
                reflected[c][y][x] = (float)(10000 * c + 100 * y + x + 1);
            }
        }
    }
}

void tearDown(void)
{
}

static void cut(const float *from, int x, int y)
{
    extract_window(&info, from, x, y, response[0][0]);
    extract_add(&info, x, y, response[0][0], &sums);
}

static void window_is_centred_on_the_lit_point(void)
{
    cut(reflected[0][0], 9, 8);
    for (int c = 0; c < 3; c++) {
        for (int v = 0; v < K; v++) {
            for (int u = 0; u < K; u++) {
                TEST_ASSERT_EQUAL_FLOAT(reflected[c][8 + v - 3][9 + u - 3], response[c][v][u]);
            }
        }
    }
    TEST_ASSERT_EQUAL_UINT(1, sums.responses);
    TEST_ASSERT_EQUAL_UINT(3 * K * K, sums.entries);
    TEST_ASSERT_EQUAL_DOUBLE(3 * 810 + 30000, sums.centre);
}

static void entries_beside_the_sample_are_zero(void)
{
    cut(reflected[0][0], 0, HEIGHT - 1);
    TEST_ASSERT_EQUAL_FLOAT(0, response[0][0][2]);
    TEST_ASSERT_EQUAL_FLOAT(0, response[2][4][3]);
    TEST_ASSERT_EQUAL_FLOAT(reflected[2][HEIGHT - 1][0], response[2][3][3]);
    TEST_ASSERT_EQUAL_FLOAT(reflected[1][HEIGHT - 4][3], response[1][0][6]);
    TEST_ASSERT_EQUAL_UINT(3 * 4 * 4, sums.entries);
    /* A window that is not whole says nothing of the fall-off. */
    TEST_ASSERT_TRUE(isnan(extract_rim_share(&sums, K)));
    TEST_ASSERT_TRUE(isnan(extract_overlap(&sums, K)));
}

static void unmeasured_entries_stay_so_and_are_counted(void)
{
    reflected[1][8][9] = NAN;
    reflected[0][5][6] = NAN;
    cut(reflected[0][0], 9, 8);
    TEST_ASSERT_TRUE(isnan(response[1][3][3]));
    TEST_ASSERT_TRUE(isnan(response[0][0][0]));
    TEST_ASSERT_EQUAL_UINT(2, sums.missing);
    TEST_ASSERT_EQUAL_DOUBLE(2 * 810 + 20000, sums.centre);
}

static void overlap_of_a_geometric_fall_off_is_exact(void)
{
    /* Rings whose sums fall by 0.4 each: outside the third lies 0.4^4 / (1 - 0.4) of what starts with 1. */
    for (int c = 0; c < 3; c++) {
        for (int y = 0; y < HEIGHT; y++) {
            for (int x = 0; x < WIDTH; x++) {
                int across = x > 9 ? x - 9 : 9 - x;
                int down = y > 8 ? y - 8 : 8 - y;
                int ring = across > down ? across : down;
                reflected[c][y][x] = (float)(pow(0.4, ring) / (ring ? 8 * ring : 1));
            }
        }
    }
    cut(reflected[0][0], 9, 8);
    double all = 1 / (1 - 0.4);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, pow(0.4, 4), extract_overlap(&sums, K)); /* of `all` */
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, pow(0.4, 3) / (all * (1 - pow(0.4, 4))),
                              extract_rim_share(&sums, K));
}

static void response_that_does_not_fall_overlaps_wholly(void)
{
    for (int c = 0; c < 3; c++) {
        for (int y = 0; y < HEIGHT; y++) {
            for (int x = 0; x < WIDTH; x++) {
                reflected[c][y][x] = 1;
            }
        }
    }
    cut(reflected[0][0], 9, 8);
    TEST_ASSERT_EQUAL_DOUBLE(1, extract_overlap(&sums, K));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(window_is_centred_on_the_lit_point);
    RUN_TEST(entries_beside_the_sample_are_zero);
    RUN_TEST(unmeasured_entries_stay_so_and_are_counted);
    RUN_TEST(overlap_of_a_geometric_fall_off_is_exact);
    RUN_TEST(response_that_does_not_fall_overlaps_wholly);
    return UNITY_END();
}
