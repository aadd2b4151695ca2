/* Tests of the virtual camera's lens and of the sample's surface. */
#include "rig/virtual/lens.h"
#include "rig/virtual/surface.h"

#include "unity.h"

#include <math.h>

void setUp(void)
{
}

void tearDown(void)
{
}

static void straightening_inverts_brown_s_polynomial(void)
{
    static const double ks[][2] = {{-0.1, 0.02}, {0.15, 0.05}, {-0.002, 0.0005}, {0, -0.05}};
    enum { WIDTH = 300, HEIGHT = 200 };
    double corner = 0.5 * hypot(WIDTH, HEIGHT);
    for (int k = 0; k < 4; k++) {
        TEST_ASSERT_TRUE(lens_distortion_is_sound(ks[k], 1));
        for (int i = 0; i <= 20; i++) {
            double x = 20. * i - 200 + 0.3;
            double y = 11. * i - 110;
            double r2 = (x * x + y * y) / (corner * corner);
            double scale = 1 + r2 * (ks[k][0] + r2 * ks[k][1]);
            double u = 0.5 * WIDTH + x * scale;
            double v = 0.5 * HEIGHT + y * scale;
            lens_straighten(ks[k], WIDTH, HEIGHT, &u, &v);
            /* Roundings of numbers near 300. */
            TEST_ASSERT_DOUBLE_WITHIN(1e-10, 0.5 * WIDTH + x, u);
            TEST_ASSERT_DOUBLE_WITHIN(1e-10, 0.5 * HEIGHT + y, v);
        }
    }
}

static void distortion_that_folds_is_told_from_sound_one(void)
{
    TEST_ASSERT_TRUE(lens_distortion_is_sound((double[2]){0, 0}, 1));
    TEST_ASSERT_FALSE(lens_distortion_is_sound((double[2]){-0.4, 0}, 1));
    TEST_ASSERT_FALSE(lens_distortion_is_sound((double[2]){0, -0.3}, 1));
}

/* This one grows as far as the corners and falls soon beyond them. */
static void distortion_must_reach_as_far_as_a_defocused_lens_does(void)
{
    TEST_ASSERT_TRUE(lens_distortion_is_sound((double[2]){-0.14, 0}, 1));
    TEST_ASSERT_FALSE(lens_distortion_is_sound((double[2]){-0.14, 0}, 1.1));
    TEST_ASSERT_TRUE(lens_distortion_is_sound((double[2]){0, 0}, 5));
}

/* All that is sound, in steps of 0.04 of both numbers, is inverted everywhere that it must reach. */
static void every_sound_distortion_is_inverted(void)
{
    enum { SIDE = 200 };
    const double reach = 1.1;
    double corner = 0.5 * hypot(SIDE, SIDE);
    int sound = 0;
    for (int n = 0; n < 26 * 26; n++) {
        const int row = n / 26;
        const double k[2] = {0.04 * (n % 26) - 0.5, 0.04 * row - 0.5};
        bool good = lens_distortion_is_sound(k, reach);
        sound += good;
        for (int i = 1; i <= 50 && good; i++) {
            double seen = reach * i / 50;
            double u = 0.5 * SIDE + seen * corner;
            double v = 0.5 * SIDE;
            lens_straighten(k, SIDE, SIDE, &u, &v);
            double r = (u - 0.5 * SIDE) / corner;
            /* Roundings of numbers near 2. */
            TEST_ASSERT_DOUBLE_WITHIN(1e-12, seen, r * (1 + r * r * (k[0] + r * r * k[1])));
            TEST_ASSERT_TRUE(r > 0 && r < 2 * reach);
        }
    }
    TEST_ASSERT_TRUE(sound > 26 * 26 / 4);
}

/* Middle and variance of places: the square's 1/12, and the disc's d^2 / 16 where defocused. */
static void check_places(const struct lens_places *places, double variance, double tolerance)
{
    double sums[4] = {0};
    for (int i = 0; i < places->count; i++) {
        sums[0] += places->u[i] / places->count;
        sums[1] += places->v[i] / places->count;
        sums[2] += pow(places->u[i] - 0.5, 2) / places->count;
        sums[3] += pow(places->v[i] - 0.5, 2) / places->count;
    }
    TEST_ASSERT_DOUBLE_WITHIN(tolerance, 0.5, sums[0]);
    TEST_ASSERT_DOUBLE_WITHIN(tolerance, 0.5, sums[1]);
    TEST_ASSERT_DOUBLE_WITHIN(tolerance, variance, sums[2]);
    TEST_ASSERT_DOUBLE_WITHIN(tolerance, variance, sums[3]);
}

static void places_cover_the_pixel_and_the_circle_of_confusion(void)
{
    struct lens_places places;
    lens_places_sharp(&places);
    check_places(&places, 1. / 12 - 1. / 768, 1e-12); /* the middles of 8 parts of a side */
    lens_places_defocused(3, &places);
    /* 256 places of a sequence whose sums are off by some units of 1 / n. */
    check_places(&places, 1. / 12 + 9. / 16, 0.03);
}

static void surface_mirrors_as_its_facets_do(void)
{
    const double up[3] = {0, 0, 1};
    /* Straight down and back: pi D is 1 / m^2, nothing is shadowed, ((n - 1) / (n + 1))^2 is reflected. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, pow(0.5 / 2.5, 2) / (4 * 0.09),
                              surface_reflection(0.3, 1.5, up, up));
    /* Towards 40 degrees by facets that lie at 20: Fresnel's formulas at 20 degrees, written out. */
    const double degree = 3.14159265358979323846 / 180;
    const double aside[3] = {sin(40 * degree), 0, cos(40 * degree)};
    double inside = asin(sin(20 * degree) / 1.5);
    double s = sin(20 * degree - inside) / sin(20 * degree + inside);
    double p = tan(20 * degree - inside) / tan(20 * degree + inside);
    double tangent = tan(20 * degree);
    double facets = exp(-tangent * tangent / 0.04) / (0.04 * pow(cos(20 * degree), 4));
    /* cot 40 / 0.2 is 6: not shadowed. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, facets * 0.5 * (s * s + p * p) / (4 * cos(40 * degree)),
                              surface_reflection(0.2, 1.5, up, aside));
}

static void rougher_surface_sends_more_aside(void)
{
    const double up[3] = {0, 0, 1};
    const double aside[3] = {0.6, 0, 0.8};
    TEST_ASSERT_TRUE(surface_reflection(0.4, 1.4, up, aside) >
                     5 * surface_reflection(0.15, 1.4, up, aside));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(straightening_inverts_brown_s_polynomial);
    RUN_TEST(distortion_that_folds_is_told_from_sound_one);
    RUN_TEST(distortion_must_reach_as_far_as_a_defocused_lens_does);
    RUN_TEST(every_sound_distortion_is_inverted);
    RUN_TEST(places_cover_the_pixel_and_the_circle_of_confusion);
    RUN_TEST(surface_mirrors_as_its_facets_do);
    RUN_TEST(rougher_surface_sends_more_aside);
    return UNITY_END();
}
