/* Malvar, He and Cutler's filters against the tables of their paper. */
#include "made.h"
#include "rig/develop/demosaic.h"
#include "unity.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 13, HEIGHT = 9 };

/* Figure 2 of the paper, in eighths, row by row. */
static const double green_at_other[5][5] = {
    {0, 0, -1, 0, 0}, {0, 0, 2, 0, 0}, {-1, 2, 4, 2, -1}, {0, 0, 2, 0, 0}, {0, 0, -1, 0, 0}};
/* R at green in R row, B column; and B at green in B row, R column. */
static const double other_in_own_row[5][5] = {
    {0, 0, 0.5, 0, 0}, {0, -1, 0, -1, 0}, {-1, 4, 5, 4, -1}, {0, -1, 0, -1, 0}, {0, 0, 0.5, 0, 0}};
/* R at green in B row, R column; and B at green in R row, B column. */
static const double other_in_own_column[5][5] = {
    {0, 0, -1, 0, 0}, {0, -1, 4, -1, 0}, {0.5, 0, 5, 0, 0.5}, {0, -1, 4, -1, 0}, {0, 0, -1, 0, 0}};
/* R at blue and B at red. */
static const double other_at_opposite[5][5] = {{0, 0, -1.5, 0, 0},
                                               {0, 2, 0, 2, 0},
                                               {-1.5, 0, 6, 0, -1.5},
                                               {0, 2, 0, 2, 0},
                                               {0, 0, -1.5, 0, 0}};

static float mosaic[HEIGHT][WIDTH], planes[3][HEIGHT][WIDTH];

void setUp(void)
{
    struct made_random noise = {11};
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            mosaic[y][x] = (float)(1 + made_uniform(&noise));
        }
    }
}

void tearDown(void)
{
}

static double filtered(const double table[5][5], int x, int y)
{
    double sum = 0;
    for (int j = -2; j <= 2; j++) {
        for (int i = -2; i <= 2; i++) {
            int column = x + i < 0 ? -(x + i) : x + i;
            int row = y + j < 0 ? -(y + j) : y + j;
            column = column > WIDTH - 1 ? 2 * (WIDTH - 1) - column : column;
            row = row > HEIGHT - 1 ? 2 * (HEIGHT - 1) - row : row;
            sum += table[j + 2][i + 2] / 8 * (double)mosaic[row][column];
        }
    }
    return sum;
}

/* What the paper says for colour `wanted` at (x, y), worked out from the letters of the order's name. */
static double published(const char *order, char wanted, int x, int y)
{
    char here = order[(y & 1) * 2 + (x & 1)];
    const char *row = order + (y & 1) * 2;
    if (here == wanted) {
        return (double)mosaic[y][x];
    }
    if (wanted == 'G') {
        return filtered(green_at_other, x, y);
    }
    if (here != 'G') {
        return filtered(other_at_opposite, x, y);
    }
    return filtered(row[0] == wanted || row[1] == wanted ? other_in_own_row : other_in_own_column,
                    x, y);
}

static void every_order_agrees_with_the_published_filters(void)
{
    for (int bayer = BAYER_RGGB; bayer <= BAYER_GBRG; bayer++) {
        demosaic_malvar(mosaic[0], WIDTH, HEIGHT, (enum bayer)bayer, planes[0][0]);
        for (int c = 0; c < 3; c++) {
            for (int y = 0; y < HEIGHT; y++) {
                for (int x = 0; x < WIDTH; x++) {
                    /* A dozen float operations on numbers about 1. */
                    TEST_ASSERT_DOUBLE_WITHIN(3e-6, published(bayer_names[bayer], "RGB"[c], x, y),
                                              (double)planes[c][y][x]);
                }
            }
        }
    }
}

static void grey_ramps_are_kept_inside(void)
{
    /* All filters sum to 1 and are symmetric, so a linear grey picture comes back; mirrored borders bend it. */
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            mosaic[y][x] = (float)(3 + 0.25 * x - 0.125 * y);
        }
    }
    demosaic_malvar(mosaic[0], WIDTH, HEIGHT, BAYER_GRBG, planes[0][0]);
    for (int c = 0; c < 3; c++) {
        for (int y = 2; y < HEIGHT - 2; y++) {
            for (int x = 2; x < WIDTH - 2; x++) {
                TEST_ASSERT_DOUBLE_WITHIN(1e-5, 3 + 0.25 * x - 0.125 * y, (double)planes[c][y][x]);
            }
        }
    }
}

static void unmeasured_pixels_spread_no_farther_than_the_filters(void)
{
    mosaic[4][6] = NAN;
    demosaic_malvar(mosaic[0], WIDTH, HEIGHT, BAYER_RGGB, planes[0][0]);
    for (int c = 0; c < 3; c++) {
        TEST_ASSERT_TRUE(isnan(planes[c][4][6]));
        TEST_ASSERT_FALSE(isnan(planes[c][4][9]));
        TEST_ASSERT_FALSE(isnan(planes[c][1][6]));
        TEST_ASSERT_FALSE(isnan(planes[c][2][4]));
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(every_order_agrees_with_the_published_filters);
    RUN_TEST(grey_ramps_are_kept_inside);
    RUN_TEST(unmeasured_pixels_spread_no_farther_than_the_filters);
    return UNITY_END();
}
