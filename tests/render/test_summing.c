/* Light that is summed up before it is gathered: never off by more than was asked for, whatever the material's layout and
 * window and the mesh's shape and texture coordinates. */
#include "render/bake.h"
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

void tearDown(void)
{
    nacre_material_finish(&material);
    stand_finish(&stand);
    free(exact);
    exact = NULL;
}

enum { SIZE = 36, TERMS = 3, CLUSTERS = 4 };

/* F and H vary over the material, and from one surface point to the next. */
static void fill_factors(size_t count)
{
    uint32_t state = 1;
    for (size_t t = 0; t < TERMS; t++) {
        for (size_t c = 0; c < 3; c++) {
            for (size_t i = 0; i < count; i++) {
                double x = (double)(i % SIZE), y = (double)i / SIZE;
                state = state * 1664525u + 1013904223u;
                double noise = (double)(state >> 8) / 16777216.0;
                double wave = sin(0.3 * x * (double)(t + 1) + (double)c) * cos(0.2 * y);
                material.f[(t * 3 + c) * count + i] = (float)(0.6 + 0.3 * wave + 0.4 * noise);
                material.h[(t * 3 + c) * count + i] = (float)(0.7 - 0.3 * wave);
            }
        }
    }
}

/* Kernels that fall off as exp(-r / reach), longer along one axis, each its own. */
static void fill_kernels(int count)
{
    size_t side = (size_t)material.window;
    for (int k = 0; k < count; k++) {
        for (size_t c = 0; c < 3; c++) {
            double reach = material.window / 12.0 * (1 + 0.2 * (k % 5)) * (1 + 0.3 * (double)c);
            double longer = 1 + 0.1 * (k % 3), sum = 0;
            float *kernel = material.kernels + ((size_t)k * 3 + c) * side * side;
            for (size_t i = 0; i < side * side; i++) {
                double x = (double)(i % side) - (double)(side - 1) / 2;
                double y = (double)(i - i % side) / (double)side - (double)(side - 1) / 2;
                kernel[i] = (float)exp(-hypot(x, longer * y) / reach);
                sum += kernel[i];
            }
            for (size_t i = 0; i < side * side; i++) {
                kernel[i] = (float)(kernel[i] / sum);
            }
        }
    }
}

static void make_material(enum nacre_layout layout, int window)
{
    bool per_term = layout == NACRE_KERNEL_PER_TERM;
    material = (struct nacre_material){.width = SIZE,
                                       .height = SIZE,
                                       .channels = 3,
                                       .window = window,
                                       .terms = TERMS,
                                       .clusters = per_term ? 0 : CLUSTERS,
                                       .mixed = per_term ? 0 : 1,
                                       .layout = layout,
                                       .pixel = NACRE_FLOAT,
                                       .factor_channels = 3,
                                       .pitch_mm = 0.5,
                                       .method = "made"};
    size_t count = (size_t)SIZE * SIZE;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_allocate(&material, true, false, &error),
                                  error.text);
    fill_factors(count);
    fill_kernels(nacre_material_kernel_count(&material));
    for (size_t i = 0; i < count; i++) {
        material.albedo[i] = material.albedo[count + i] = material.albedo[2 * count + i] = 0.5F;
        if (!per_term) {
            material.ids[i] = (uint32_t)(i % SIZE / 9 + i / SIZE / 5) % CLUSTERS;
            material.weights[i] = 1;
        }
    }
}

/* A grid with hills, up to 40 degrees steep. */
static struct mesh hills(double height)
{
    struct mesh mesh = stand_grid(46, 40, 0.5);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        double x = mesh.positions[i][0], y = mesh.positions[i][1];
        struct vec3 normal = {-height * cos(x) * sin(0.9 * y),
                              -0.9 * height * sin(x) * cos(0.9 * y), 1};
        mesh.positions[i][2] = (float)(height * sin(x) * sin(0.9 * y));
        vec3_store(vec3_unit(normal), mesh.normals[i]);
    }
    return mesh;
}

/* The right half's texture coordinates lie elsewhere: the triangles between go, which leaves a slit. */
static struct mesh slit(void)
{
    struct mesh mesh = stand_grid(46, 40, 0.5);
    size_t kept = 0;
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        bool left = false, right = false;
        for (int k = 0; k < 3; k++) {
            bool beyond = mesh.triangles[i][k] % 46 >= 21;
            right = right || beyond;
            left = left || !beyond;
        }
        if (!(left && right)) {
            memmove(mesh.triangles[kept++], mesh.triangles[i], sizeof *mesh.triangles);
        }
    }
    mesh.triangle_count = kept;
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        mesh.uv[i][0] += i % 46 >= 21 ? (float)(4.3 * SIZE * 0.5) : 0;
    }
    return mesh;
}

enum shape { FLAT, HILLS, SLIT, BALL, BALL_BOX, BALL_PLANAR, KNOT, SHAPES };

/* Light that changes over the surface, and ends in a shadow's edge. */
static void light_in_stripes(void)
{
    stand_light_evenly(&stand, 2);
    for (size_t i = 0; i < stand.samples.count; i++) {
        struct light_sample *sample = &stand.samples.list[i];
        for (int c = 0; c < 3; c++) {
            double x = sample->position[c % 2];
            sample->flux[c] *= x > 7 ? 0.0F : (float)(1.2 + sin(x));
        }
    }
}

static void make_stand(enum shape shape)
{
    const int mappings[SHAPES] = {MAPPING_PLANAR, MAPPING_UV,     MAPPING_UV, MAPPING_UV,
                                  MAPPING_BOX,    MAPPING_PLANAR, MAPPING_UV};
    const struct scene_material settings = {.mapping = mappings[shape], .axis = 2, .point_mm = 0.5};
    struct mesh mesh;
    switch (shape) {
    case FLAT:
        mesh = stand_grid(46, 40, 0.5);
        break;
    case HILLS:
        mesh = hills(0.8);
        break;
    case SLIT:
        mesh = slit();
        break;
    case KNOT:
        TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_knot(&mesh, 20, 0.6, 0.7, &error));
        break;
    default:
        TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_sphere(&mesh, 6, 0.6, &error));
    }
    stand = stand_make(&material, mesh, &settings);
    light_in_stripes();
    exact = calloc(stand.mesh.vertex_count, sizeof *exact);
    TEST_ASSERT_NOT_NULL(exact);
    (void)stand_gather(&stand, 0);
    memcpy(exact, stand.radiosity, stand.mesh.vertex_count * sizeof *exact);
}

static void finish_stand(void)
{
    stand_finish(&stand);
    free(exact);
    exact = NULL;
}

/* Root mean square over all vertices and channels, over that of the light. */
static double difference(void)
{
    double off = 0, all = 0;
    for (size_t i = 0; i < stand.mesh.vertex_count * 3; i++) {
        double one = stand.radiosity[i / 3][i % 3], two = exact[i / 3][i % 3];
        off += (one - two) * (one - two);
        all += two * two;
    }
    return sqrt(off / all);
}

/* What was asked for holds over all vertices, and so does what the gather says of itself, which it knows from some.
 * Single precision adds what sums of a few thousand numbers of one sign may: 1e-5. */
static struct gather_counts check(double tolerance)
{
    struct gather_counts counts = stand_gather_summed(&stand, tolerance);
    double off = difference();
    TEST_ASSERT_TRUE(off <= tolerance);
    TEST_ASSERT_TRUE(counts.error <= tolerance);
    TEST_ASSERT_TRUE(off <= counts.error + 1e-5);
    return counts;
}

/* Each layout with each window on two shapes, which take turns. */
static void check_layout(enum nacre_layout layout, int turn)
{
    const int windows[] = {5, 25, 49};
    for (int w = 0; w < 3; w++) {
        make_material(layout, windows[w]);
        for (int i = 0; i < 2; i++) {
            int shape = (turn + 2 * w + i) % SHAPES;
            make_stand((enum shape)shape);
            struct gather_counts counts = check(0.02);
            /* Where the texture lies evenly there is room for squares. */
            bool even = shape == FLAT || shape == HILLS || shape == SLIT;
            TEST_ASSERT_TRUE(windows[w] < 25 || !even || counts.squares > 0);
            (void)check(0.003);
            finish_stand();
        }
        nacre_material_finish(&material);
    }
}

static void a_kernel_for_each_cluster_stays_within_the_tolerance(void)
{
    check_layout(NACRE_KERNEL_SINGLE, 0);
}

static void a_kernel_for_each_pair_of_clusters_stays_within_the_tolerance(void)
{
    check_layout(NACRE_KERNEL_PAIR, 3);
}

static void a_kernel_for_each_term_stays_within_the_tolerance(void)
{
    check_layout(NACRE_KERNEL_PER_TERM, 5);
}

/* Counting pairs ahead chooses: no squares for a small window, squares for a wide one and many samples. */
static void light_is_summed_up_only_where_that_is_sooner(void)
{
    make_material(NACRE_KERNEL_SINGLE, 5);
    make_stand(FLAT);
    struct gather_counts counts = stand_gather(&stand, 0.01);
    TEST_ASSERT_EQUAL_UINT64(0, counts.squares);
    TEST_ASSERT_EQUAL_DOUBLE(0, counts.error);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, difference());
    finish_stand();
    nacre_material_finish(&material);
    make_material(NACRE_KERNEL_SINGLE, 49);
    const struct scene_material planar = {.mapping = MAPPING_PLANAR, .axis = 2, .point_mm = 0.5};
    stand = stand_make(&material, stand_grid(120, 100, 0.5), &planar);
    stand_light_evenly(&stand, 4);
    counts = stand_gather(&stand, 0.01);
    TEST_ASSERT_TRUE(counts.squares > 0);
    TEST_ASSERT_TRUE(counts.error > 0 && counts.error <= 0.01);
}

/* A spot so small that most vertices drawn to measure are dark. */
static void a_small_spot_of_light_stays_within_the_tolerance(void)
{
    make_material(NACRE_KERNEL_SINGLE, 25);
    const struct scene_material planar = {.mapping = MAPPING_PLANAR, .axis = 2, .point_mm = 0.5};
    stand = stand_make(&material, stand_grid(120, 100, 0.5), &planar);
    stand_light_evenly(&stand, 4);
    for (size_t i = 0; i < stand.samples.count; i++) {
        struct light_sample *sample = &stand.samples.list[i];
        double away = hypot((double)sample->position[0] - 47, (double)sample->position[1] + 12);
        for (int c = 0; c < 3; c++) {
            sample->flux[c] *= away < 2 ? 1 : 0;
        }
    }
    exact = calloc(stand.mesh.vertex_count, sizeof *exact);
    TEST_ASSERT_NOT_NULL(exact);
    (void)stand_gather(&stand, 0);
    memcpy(exact, stand.radiosity, stand.mesh.vertex_count * sizeof *exact);
    TEST_ASSERT_TRUE(check(0.01).error > 0); /* it was not taken sample by sample */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_kernel_for_each_cluster_stays_within_the_tolerance);
    RUN_TEST(a_kernel_for_each_pair_of_clusters_stays_within_the_tolerance);
    RUN_TEST(a_kernel_for_each_term_stays_within_the_tolerance);
    RUN_TEST(light_is_summed_up_only_where_that_is_sooner);
    RUN_TEST(a_small_spot_of_light_stays_within_the_tolerance);
    return UNITY_END();
}
