/* Light by convolution in the texture: on level surfaces the sum that the gather takes, on others never off by more than
 * was asked for, and left to the gather where the texture does not lie as space does. */
#include "render/convolve.h"
#include "render/convolve_cost.h"
#include "render/convolve_fft.h"
#include "stand.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct nacre_material material;
static struct stand stand;
static float (*exact)[3];
static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

static void finish_stand(void)
{
    stand_finish(&stand);
    free(exact);
    exact = NULL;
}

void tearDown(void)
{
    nacre_material_finish(&material);
    finish_stand();
}

enum { WIDTH = 23, HEIGHT = 18 };

static const double point_mm = 0.5;

static double random_share(void)
{
    static uint32_t state = 1;
    state = state * 1664525u + 1013904223u;
    return (double)(state >> 8) / 16777216.0;
}

/* F and H vary from one surface point to the next; kernels are exp(-r / reach), each its own and none symmetric, so that one
 * that is mirrored the wrong way shows. */
static void make_material(int window, int terms, int channels, int factor_channels)
{
    material = (struct nacre_material){.width = WIDTH,
                                       .height = HEIGHT,
                                       .channels = channels,
                                       .window = window,
                                       .terms = terms,
                                       .layout = NACRE_KERNEL_PER_TERM,
                                       .pixel = NACRE_FLOAT,
                                       .factor_channels = factor_channels,
                                       .pitch_mm = point_mm,
                                       .method = "made"};
    size_t points = (size_t)WIDTH * HEIGHT, side = (size_t)window;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_allocate(&material, true, false, &error),
                                  error.text);
    for (size_t i = 0; i < points * (size_t)(terms * factor_channels); i++) {
        material.f[i] = (float)(0.4 + 0.6 * random_share());
        material.h[i] = (float)(0.4 + 0.6 * random_share());
    }
    for (size_t k = 0; k < (size_t)(terms * channels); k++) {
        double reach = window / 9.0 * (1 + 0.1 * (double)k), sum = 0;
        float *kernel = material.kernels + k * side * side;
        for (size_t i = 0; i < side * side; i++) {
            double x = (double)(i % side) - (double)(side - 1) / 2;
            double y = (double)(i - i % side) / (double)side - (double)(side - 1) / 2;
            double r = hypot(x, y) + 0.3 * x - 0.2 * y;
            kernel[i] = (float)exp(-r / reach);
            sum += kernel[i];
        }
        for (size_t i = 0; i < side * side; i++) {
            kernel[i] = (float)(kernel[i] / sum);
        }
    }
    for (size_t i = 0; i < points * (size_t)channels; i++) {
        material.albedo[i] = 0.5F;
    }
}

/* Light that changes from sample to sample and ends in a shadow's edge; of one colour, or not. */
static void light_in_stripes(double density, bool one_color)
{
    stand_light_evenly(&stand, density);
    for (size_t i = 0; i < stand.samples.count; i++) {
        struct light_sample *sample = &stand.samples.list[i];
        double share = random_share();
        for (int c = 0; c < 3; c++) {
            double x = sample->position[0], wave = one_color ? share : 1.2 + sin(x + c);
            sample->flux[c] *= x > 7 ? 0.0F : (float)(wave * (c == 1 ? 0.5 : 1));
        }
    }
}

static void make_stand(struct mesh mesh, int tiling, int mapping)
{
    const struct scene_material settings = {
        .mapping = mapping, .axis = 2, .point_mm = point_mm, .tiling = tiling, .offset = {-9, 4}};
    stand = stand_make(&material, mesh, &settings);
}

static void keep_reference(void)
{
    stand_gather_reference(&stand);
    exact = calloc(stand.mesh.vertex_count, sizeof *exact);
    TEST_ASSERT_NOT_NULL(exact);
    memcpy(exact, stand.radiosity, stand.mesh.vertex_count * sizeof *exact);
}

/* Root mean square over all vertices and channels, and the largest, over the root mean square of the light. */
struct difference {
    double rms, most;
};

static struct difference difference(void)
{
    double off = 0, all = 0, most = 0, count = (double)stand.mesh.vertex_count * 3;
    for (size_t i = 0; i < stand.mesh.vertex_count * 3; i++) {
        double one = stand.radiosity[i / 3][i % 3], two = exact[i / 3][i % 3];
        off += (one - two) * (one - two);
        all += two * two;
        most = fmax(most, fabs(one - two));
    }
    return (struct difference){sqrt(off / all), most / sqrt(all / count)};
}

/* Offset and tiles such that a grid lies on parts of nine tiles, its vertices on nodes. Single precision: transforms of a few
 * thousand points are off by 3e-7 of the root mean square of the light, a place 50 points away is known to 4e-6 points, over
 * which kernels change by their reach's inverse at most (1.8), and the sharpened kernels' cut tail is 4e-7: 1e-5. */
static void check_on_nodes(int window, int terms, int factor_channels, int tiling, bool one_color)
{
    make_material(window, terms, factor_channels, factor_channels);
    make_stand(stand_grid(47, 40, point_mm), tiling, MAPPING_PLANAR);
    light_in_stripes(2, one_color);
    keep_reference();
    struct gather_counts counts = stand_gather_convolved(&stand, 0.01);
    TEST_ASSERT_EQUAL_UINT64(counts.receivers, counts.convolved);
    TEST_ASSERT_TRUE(difference().most <= 1e-5);
    finish_stand();
    nacre_material_finish(&material);
}

static void on_nodes_of_a_level_surface_the_sum_is_exact(void)
{
    const int windows[] = {3, 9, 25};
    for (int i = 0; i < 3; i++) {
        check_on_nodes(windows[i], 1, 3, TILING_MIRROR, false);
        check_on_nodes(windows[i], 8, 3, TILING_REPEAT, false);
        check_on_nodes(windows[i], 5, 1, i == 1 ? TILING_REPEAT : TILING_MIRROR, i == 1);
    }
    check_on_nodes(9, 3, 1, TILING_MIRROR, true);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(on_nodes_of_a_level_surface_the_sum_is_exact);
    return UNITY_END();
}
