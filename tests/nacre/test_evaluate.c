/* Evaluating and sampling a material, against its formula written out in double precision. */
#include "made_material.h"
#include "nacre/evaluate.h"

#include <math.h>
#include <stdlib.h>
#include <unity.h>

void setUp(void)
{
}

void tearDown(void)
{
}

static double kernel_at(const struct nacre_material *m, int j, int c, int dx, int dy)
{
    int radius = m->window / 2;
    return (double)
        m->kernels[((j * m->channels + c) * m->window + dy + radius) * m->window + dx + radius];
}

/* R_d(x_i, x_o) by the formulas of docs/formats.md, factor by factor. */
static double formula(const struct nacre_material *m, int c, int xi, int yi, int xo, int yo)
{
    int radius = m->window / 2;
    int dx = xo - xi;
    int dy = yo - yi;
    int points = m->width * m->height;
    int i = yi * m->width + xi;
    int o = yo * m->width + xo;
    const float *h = m->h ? m->h : m->f;
    if (abs(dx) > radius || abs(dy) > radius || xo < 0 || yo < 0 || xo >= m->width ||
        yo >= m->height) {
        return 0;
    }
    double g = 0;
    for (int a = 0; a < m->mixed; a++) {
        double wi = (double)m->weights[a * points + i];
        int ki = (int)m->ids[a * points + i];
        if (m->layout == NACRE_KERNEL_SINGLE) {
            g += wi * kernel_at(m, ki, c, dx, dy);
        }
        for (int b = 0; b < m->mixed && m->layout == NACRE_KERNEL_PAIR; b++) {
            int ko = (int)m->ids[b * points + o];
            g += wi * (double)m->weights[b * points + o] *
                 kernel_at(m, ki * m->clusters + ko, c, dx, dy);
        }
    }
    double sum = 0;
    for (int t = 0; t < m->terms; t++) {
        int plane = t * m->factor_channels + (m->factor_channels == 1 ? 0 : c);
        sum += (double)m->f[plane * points + i] * (double)h[plane * points + o] *
               (m->layout == NACRE_KERNEL_PER_TERM ? kernel_at(m, t, c, dx, dy) : g);
    }
    return sum + (m->centre && dx == 0 && dy == 0 ? (double)m->centre[c * points + i] : 0);
}

/* Float sums of at most 3 terms, 16 kernel products and one more, all positive: each operation is off by 6e-8, and
 * fewer than 30 stand behind each other. */
static const double tolerance = 30 * 6e-8;

static void expect_formula(struct made_material wanted)
{
    struct nacre_material material = made_material(wanted);
    int window = material.window;
    float *response =
        calloc((size_t)material.channels * (size_t)(window * window), sizeof *response);
    for (int yi = 0; yi < material.height; yi++) {
        for (int xi = 0; xi < material.width; xi++) {
            nacre_material_response(&material, xi, yi, response);
            for (int i = 0; i < material.channels * window * window; i++) {
                int xo = xi + i % window - window / 2;
                int yo = yi + i / window % window - window / 2;
                int c = i / (window * window);
                double expected = formula(&material, c, xi, yi, xo, yo);
                double value = (double)nacre_material_evaluate(&material, c, xi, yi, xo, yo);
                TEST_ASSERT_DOUBLE_WITHIN(tolerance * expected, expected, value);
                TEST_ASSERT_DOUBLE_WITHIN(tolerance * expected, expected, (double)response[i]);
            }
        }
    }
    free(response);
    nacre_material_finish(&material);
}

static void every_layout_follows_its_formula(void)
{
    for (int layout = NACRE_KERNEL_SINGLE; layout <= NACRE_KERNEL_PER_TERM; layout++) {
        for (int variant = 0; variant < 16; variant++) {
            expect_formula((struct made_material){
                .layout = (enum nacre_layout)layout,
                .pixel = NACRE_FLOAT,
                .channels = variant & 1 ? 3 : 1,
                .factor_channels = (variant & 3) == 3 ? 3 : 1,
                .mixed = variant & 4 ? 4 : 1,
                .with_h = variant & 2,
                .with_centre = variant & 8,
            });
        }
    }
}

static const struct made_material pairs = {.layout = NACRE_KERNEL_PAIR,
                                           .pixel = NACRE_FLOAT,
                                           .channels = 3,
                                           .factor_channels = 3,
                                           .mixed = 2,
                                           .with_h = true};

static void nothing_leaves_outside_window_and_sample(void)
{
    struct nacre_material material = made_material(pairs);
    TEST_ASSERT_TRUE(nacre_material_evaluate(&material, 0, 5, 4, 7, 6) > 0);
    TEST_ASSERT_TRUE(nacre_material_evaluate(&material, 0, 5, 4, 8, 4) == 0);
    TEST_ASSERT_TRUE(nacre_material_evaluate(&material, 0, 5, 4, 5, 1) == 0);
    TEST_ASSERT_TRUE(nacre_material_evaluate(&material, 0, 0, 0, -1, 0) == 0);
    TEST_ASSERT_TRUE(nacre_material_evaluate(&material, 0, 10, 8, 11, 8) == 0);
    TEST_ASSERT_TRUE(nacre_material_evaluate(&material, 0, 10, 8, 10, 9) == 0);
    TEST_ASSERT_TRUE(nacre_material_evaluate(&material, 0, 0, 0, 2147483647, -2147483647 - 1) == 0);
    nacre_material_finish(&material);
}

/* Frequencies of a stratified 200 x 200 grid of u against the response. Each cell of the map from u to entries is a
 * rectangle r x c in the unit square; a grid of n lines a side misses its area by at most (r + c) / n + 1 / n^2. */
static void expect_frequencies(struct made_material wanted, int channel, int xi, int yi)
{
    enum { N = 200, K = 5 };
    struct nacre_material material = made_material(wanted);
    int counts[K][K] = {{0}};
    double total = 0;
    for (int i = 0; i < K * K; i++) {
        total += formula(&material, channel, xi, yi, xi + i % K - 2, yi + i / K - 2);
    }
    for (int i = 0; i < N * N; i++) {
        int row = i / N;
        float u[2] = {((float)(i % N) + 0.5f) / N, ((float)row + 0.5f) / N};
        int xo = -1;
        int yo = -1;
        float probability = 0;
        float albedo = nacre_material_sample(&material, channel, xi, yi, u, &xo, &yo, &probability);
        double value = (double)nacre_material_evaluate(&material, channel, xi, yi, xo, yo);
        /* sums of 25 floats in double; then one division and one rounding to float */
        TEST_ASSERT_DOUBLE_WITHIN(tolerance * total, total, (double)albedo);
        TEST_ASSERT_DOUBLE_WITHIN(3e-7 * total, (double)albedo, value / (double)probability);
        counts[yo - yi + 2][xo - xi + 2]++;
    }
    double chi_square = 0;
    for (int i = 0; i < K * K; i++) {
        double share = formula(&material, channel, xi, yi, xi + i % K - 2, yi + i / K - 2) / total;
        int count = counts[i / K][i % K];
        double got = (double)count / (N * N);
        TEST_ASSERT_DOUBLE_WITHIN(2.0 / N + 1.0 / (N * N), share, got);
        if (share > 0) {
            chi_square += (got - share) * (got - share) / share * N * N;
        }
    }
    /* random numbers would give 24 +- 7; a stratified grid stays far below */
    TEST_ASSERT_TRUE(chi_square < 24);
    nacre_material_finish(&material);
}

static void samples_are_distributed_as_the_response(void)
{
    expect_frequencies(pairs, 0, 5, 4);
    expect_frequencies(pairs, 2, 0, 0);
    expect_frequencies(pairs, 1, 10, 8);
    struct made_material wanted = {.layout = NACRE_KERNEL_PER_TERM,
                                   .pixel = NACRE_FLOAT,
                                   .channels = 1,
                                   .factor_channels = 1,
                                   .with_centre = true};
    expect_frequencies(wanted, 0, 3, 3);
    wanted.layout = NACRE_KERNEL_SINGLE;
    wanted.mixed = 1;
    expect_frequencies(wanted, 0, 3, 8);
}

static void extreme_numbers_choose_entries_that_exist(void)
{
    static const float numbers[] = {0, 1e-30f, 0.5f, 0x1.fffffep-1f};
    struct nacre_material material = made_material(pairs);
    for (int i = 0; i < 16; i++) {
        float u[2] = {numbers[i % 4], numbers[i / 4]};
        int xo = -1;
        int yo = -1;
        float probability = 0;
        TEST_ASSERT_TRUE(nacre_material_sample(&material, 0, 0, 8, u, &xo, &yo, &probability) > 0);
        TEST_ASSERT_TRUE(probability > 0 && probability <= 1);
        TEST_ASSERT_TRUE(xo >= 0 && xo <= 2 && yo >= 6 && yo <= 8);
    }
    nacre_material_finish(&material);
}

static void point_from_which_nothing_leaves_gives_no_sample(void)
{
    static const float u[2] = {0.5f, 0.5f};
    struct nacre_material material = made_material(pairs);
    for (int t = 0; t < 3 * 3; t++) {
        material.f[t * 99 + 4 * 11 + 5] = 0;
    }
    int xo = -1;
    int yo = -1;
    float probability = -1;
    TEST_ASSERT_TRUE(nacre_material_sample(&material, 0, 5, 4, u, &xo, &yo, &probability) == 0);
    TEST_ASSERT_EQUAL_INT(5, xo);
    TEST_ASSERT_EQUAL_INT(4, yo);
    TEST_ASSERT_TRUE(probability == 0);
    nacre_material_finish(&material);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(every_layout_follows_its_formula);
    RUN_TEST(nothing_leaves_outside_window_and_sample);
    RUN_TEST(samples_are_distributed_as_the_response);
    RUN_TEST(extreme_numbers_choose_entries_that_exist);
    RUN_TEST(point_from_which_nothing_leaves_gives_no_sample);
    return UNITY_END();
}
