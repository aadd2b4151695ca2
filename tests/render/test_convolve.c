/* Light by convolution in the texture: on level surfaces the sum that the gather takes, on others never off by more than
 * was asked for, and left to the gather where the texture does not lie as space does. */
#include "render/convolve.h"
#include "render/convolve_ahead.h"
#include "render/convolve_fft.h"
#include "stand.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

/* As omp.h has them; clang-tidy has no such header. */
extern int omp_get_max_threads(void);
extern void omp_set_num_threads(int count);

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
    for (size_t i = 0; i < points * (size_t)terms * (size_t)factor_channels; i++) {
        material.f[i] = (float)(0.4 + 0.6 * random_share());
        material.h[i] = (float)(0.4 + 0.6 * random_share());
    }
    for (size_t k = 0; k < (size_t)terms * (size_t)channels; k++) {
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

/* Convolve what there is; what was asked for holds over all vertices, and so does what is told. Single precision adds 1e-5,
 * see below. */
static struct gather_counts check(double tolerance)
{
    struct gather_counts counts = stand_gather_convolved(&stand, tolerance);
    double off = difference().rms;
    TEST_ASSERT_TRUE(off <= tolerance);
    TEST_ASSERT_TRUE(counts.error <= tolerance);
    TEST_ASSERT_TRUE(off <= counts.error + 1e-5);
    return counts;
}

static void keep_gathered(void)
{
    (void)stand_gather(&stand, 0);
    exact = calloc(stand.mesh.vertex_count, sizeof *exact);
    TEST_ASSERT_NOT_NULL(exact);
    memcpy(exact, stand.radiosity, stand.mesh.vertex_count * sizeof *exact);
}

/* Offset and tiles such that a grid lies on parts of four tiles, its vertices on nodes. Single precision: transforms of a few
 * thousand points are off by 3e-7 of the root mean square of the light, a place 50 points away is known to 4e-6 points, over
 * which kernels change by their reach's inverse at most (1.8), and the sharpened kernels' cut tail is 4e-7: 1e-5. */
static void check_on_nodes(int window, int terms, int factor_channels, int tiling, bool one_color)
{
    make_material(window, terms, factor_channels, factor_channels);
    make_stand(stand_grid(33, 28, point_mm), tiling, MAPPING_PLANAR);
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
    check_on_nodes(3, 1, 3, TILING_MIRROR, false);
    check_on_nodes(9, 8, 3, TILING_REPEAT, false);
    check_on_nodes(9, 3, 1, TILING_MIRROR, true);
    check_on_nodes(25, 5, 1, TILING_MIRROR, false);
}

static void a_window_larger_than_the_surface_does_not_wrap_around(void)
{
    check_on_nodes(49, 2, 3, TILING_REPEAT, false);
    make_material(25, 2, 3, 3);
    make_stand(stand_grid(60, 40, point_mm), TILING_MIRROR, MAPPING_PLANAR);
    stand_add_sample_at(&stand, 0);
    (void)stand_gather_convolved(&stand, 0.01);
    float most = 0;
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        most = fmaxf(most, stand.radiosity[i][0]);
    }
    /* Beyond the window there is what transforms round to, a few 1e-7 of the largest. */
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        bool beyond = i % 60 > 13 || i / 60 > 13;
        TEST_ASSERT_TRUE(!beyond || fabsf(stand.radiosity[i][0]) <= 1e-6F * most);
    }
}

/* A grid whose vertices lie anywhere between nodes, bent round a cylinder of so many surface points; 0: level. */
static struct mesh bent(int columns, int rows, double radius)
{
    struct mesh mesh = stand_grid(columns, rows, point_mm);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        double r = radius * point_mm, u = mesh.uv[i][0] + 0.5 * point_mm * random_share();
        double v = mesh.uv[i][1] + 0.5 * point_mm * random_share(), angle = radius > 0 ? u / r : 0;
        mesh.uv[i][0] = (float)u;
        mesh.uv[i][1] = (float)v;
        mesh.positions[i][0] = (float)(radius > 0 ? r * sin(angle) : u);
        mesh.positions[i][1] = (float)v;
        mesh.positions[i][2] = (float)(radius > 0 ? r * cos(angle) - r : 0);
        mesh.normals[i][0] = (float)sin(angle);
        mesh.normals[i][2] = (float)cos(angle);
    }
    return mesh;
}

static void between_nodes_the_error_told_holds(void)
{
    make_material(9, 4, 3, 3);
    make_stand(bent(60, 50, 0), TILING_MIRROR, MAPPING_UV);
    light_in_stripes(4, false);
    keep_gathered();
    struct gather_counts coarse = check(0.02);
    TEST_ASSERT_EQUAL_UINT64(coarse.receivers, coarse.convolved);
    /* What one node to a surface point does not reach, two must: kernels that are read bilinearly have twice the change of
     * slope on the coarser lattice. */
    struct gather_counts fine = check(0.9 * coarse.error);
    TEST_ASSERT_EQUAL_UINT64(fine.receivers, fine.convolved);
    TEST_ASSERT_TRUE(fine.error < 0.8 * coarse.error);
}

/* Chords are shorter than arcs by r^2 / (24 R^2), 1.3e-4 at the window's border: next to nothing. */
static void a_gently_curved_surface_is_convolved(void)
{
    make_material(9, 4, 3, 3);
    make_stand(bent(60, 50, 80), TILING_MIRROR, MAPPING_UV);
    light_in_stripes(4, false);
    keep_gathered();
    struct gather_counts counts = check(0.02);
    TEST_ASSERT_EQUAL_UINT64(counts.receivers, counts.convolved);
}

/* The same by r^2 / (24 R^2) = 4 % for a window of 25 on a radius of 12. */
static void a_strongly_curved_surface_is_gathered(void)
{
    make_material(25, 4, 3, 3);
    make_stand(bent(60, 40, 12), TILING_MIRROR, MAPPING_UV);
    light_in_stripes(2, false);
    keep_gathered();
    TEST_ASSERT_EQUAL_UINT64(0, check(0.002).convolved);
}

/* Across a cut in the texture there is light that the texture knows nothing of: the vertices in its reach are gathered. */
static void along_a_cut_vertices_are_gathered(void)
{
    make_material(9, 2, 3, 3);
    struct mesh mesh = bent(80, 40, 0);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        mesh.uv[i][0] += i % 80 >= 30 ? (float)(2.3 * WIDTH * point_mm) : 0;
    }
    make_stand(mesh, TILING_MIRROR, MAPPING_UV);
    light_in_stripes(4, false);
    keep_gathered();
    struct gather_counts counts = check(0.02);
    /* A window reaches 7 points to the diagonal, and cells are of 2 points: at most 20 columns of 80 are in reach. */
    TEST_ASSERT_TRUE(counts.convolved >= counts.receivers * 55 / 80);
    TEST_ASSERT_TRUE(counts.convolved <= counts.receivers * 76 / 80);
}

/* A second sheet two points below lights the first: through is through. */
static void vertices_with_a_surface_behind_them_are_gathered(void)
{
    make_material(9, 2, 3, 3);
    struct mesh mesh = bent(80, 40, 0);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        size_t column = i % 80;
        /* The right third folds back under the left. */
        if (column >= 50) {
            mesh.positions[i][0] -= (float)(50 * point_mm);
            mesh.positions[i][2] = (float)(-2 * point_mm);
        }
    }
    make_stand(mesh, TILING_MIRROR, MAPPING_UV);
    light_in_stripes(4, false);
    keep_gathered();
    struct gather_counts counts = check(0.02);
    TEST_ASSERT_TRUE(counts.convolved > 0);
    TEST_ASSERT_TRUE(counts.convolved <= counts.receivers * 25 / 80);
}

/* A ramp, 20 surface points down a turn, seen from above. 63 columns are one turn. */
static uint64_t convolved_of_ramp(int columns)
{
    make_material(9, 2, 3, 3);
    struct mesh mesh = bent(columns, 40, 0);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        double r = 10 * point_mm, angle = mesh.uv[i][0] / r, out = 2 - mesh.uv[i][1] / r;
        mesh.positions[i][0] = (float)(r * out * sin(angle));
        mesh.positions[i][1] = (float)(r * out * cos(angle));
        mesh.positions[i][2] = (float)(20 * point_mm * angle / 6.28);
        mesh.uv[i][0] = mesh.positions[i][0];
        mesh.uv[i][1] = mesh.positions[i][1];
        mesh.normals[i][0] = 0;
        mesh.normals[i][2] = -1;
    }
    make_stand(mesh, TILING_MIRROR, MAPPING_UV);
    light_in_stripes(4, false);
    keep_gathered();
    uint64_t convolved = check(0.02).convolved;
    finish_stand();
    nacre_material_finish(&material);
    return convolved;
}

static void a_surface_over_itself_in_the_texture_is_gathered(void)
{
    TEST_ASSERT_TRUE(convolved_of_ramp(50) > 0); /* less than a turn */
    TEST_ASSERT_EQUAL_UINT64(0, convolved_of_ramp(90));
}

enum { SLAB_COLUMNS = 160, SLAB_ROWS = 120 };

/* Two sheets, eight points apart and facing away from each other; the lower is engraved where its vertices are no patch's. */
static struct mesh engraved_slab(void)
{
    struct mesh sheet = stand_grid(SLAB_COLUMNS, SLAB_ROWS, point_mm), mesh;
    size_t vertices = sheet.vertex_count, triangles = sheet.triangle_count;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mesh_allocate(&mesh, 2 * vertices, 2 * triangles, false, &error));
    for (size_t i = 0; i < 2 * vertices; i++) {
        size_t x = i % vertices % SLAB_COLUMNS, y = i % vertices / SLAB_COLUMNS;
        bool below = i >= vertices, engraved = x >= 20 && x < 32 && y >= 50 && y < 62;
        double depth = engraved && (x + y) % 2 ? 9.5 : 8;
        memcpy(mesh.positions[i], sheet.positions[i % vertices], sizeof *mesh.positions);
        mesh.positions[i][2] = below ? (float)(-depth * point_mm) : 0;
        mesh.normals[i][2] = below ? -1 : 1;
    }
    for (size_t i = 0; i < 2 * triangles; i++) {
        bool below = i >= triangles;
        const uint32_t *t = sheet.triangles[i % triangles];
        uint32_t first = below ? (uint32_t)vertices : 0;
        mesh.triangles[i][0] = first + t[0];
        mesh.triangles[i][1] = first + t[below ? 2 : 1];
        mesh.triangles[i][2] = first + t[below ? 1 : 2];
    }
    mesh_finish(&sheet);
    return mesh;
}

/* Light on the back must not be taken for light on the front, though it is as near in the texture. Most vertices above the
 * engraving, 1 in 270 of all, would be up to twice as bright, and the check does not look there: 2.5 % where 1 % is asked for. */
static void light_on_the_back_of_a_slab_stays_there(void)
{
    make_material(9, 2, 3, 3);
    make_stand(engraved_slab(), TILING_MIRROR, MAPPING_PLANAR);
    stand_light_evenly(&stand, 2);
    keep_gathered();
    struct gather_counts counts = stand_gather_convolved(&stand, 0.01);
    TEST_ASSERT_TRUE(counts.convolved > counts.receivers / 2);
    TEST_ASSERT_TRUE(difference().rms <= 0.01);
}

/* Longer than the longest that can be cut where tiles repeat: 8 blocks of 608 points at one node to a point, as their transforms
 * have 640 nodes, 32 of them for what kernels of 9 reach; of 300 at two nodes. */
static void patches_that_cannot_be_cut_are_gathered(void)
{
    make_material(9, 2, 3, 3);
    make_stand(stand_grid(4900, 4, point_mm), TILING_REPEAT, MAPPING_PLANAR);
    stand_light_evenly(&stand, 1);
    keep_gathered();
    TEST_ASSERT_EQUAL_UINT64(0, check(0.01).convolved);
    finish_stand();
    nacre_material_finish(&material);
    make_material(9, 4, 3, 3);
    make_stand(bent(2700, 4, 0), TILING_REPEAT, MAPPING_UV);
    stand_light_evenly(&stand, 1);
    keep_gathered();
    struct gather_counts coarse = check(0.05);
    TEST_ASSERT_EQUAL_UINT64(coarse.receivers, coarse.convolved);
    (void)check(0.9 * coarse.error);
}

static void light_is_the_same_on_any_number_of_threads(void)
{
    make_material(9, 3, 3, 1);
    make_stand(bent(80, 40, 0), TILING_MIRROR, MAPPING_UV);
    light_in_stripes(4, false);
    (void)stand_gather_convolved(&stand, 0.02);
    exact = calloc(stand.mesh.vertex_count, sizeof *exact);
    TEST_ASSERT_NOT_NULL(exact);
    memcpy(exact, stand.radiosity, stand.mesh.vertex_count * sizeof *exact);
    int threads = omp_get_max_threads();
    for (int i = 1; i < 6; i += 2) {
        omp_set_num_threads(i);
        struct gather_counts counts = stand_gather_convolved(&stand, 0.02);
        omp_set_num_threads(threads);
        TEST_ASSERT_EQUAL_UINT64(counts.receivers, counts.convolved);
        TEST_ASSERT_EQUAL_MEMORY(exact, stand.radiosity, stand.mesh.vertex_count * sizeof *exact);
    }
}

static void light_that_is_not_finite_is_left_to_the_gather(void)
{
    make_material(9, 2, 3, 3);
    make_stand(stand_grid(60, 50, point_mm), TILING_MIRROR, MAPPING_PLANAR);
    stand_light_evenly(&stand, 1);
    stand.samples.list[0].flux[1] = INFINITY;
    struct gather_counts counts = stand_gather_convolved(&stand, 0.01);
    TEST_ASSERT_EQUAL_UINT64(0, counts.convolved);
    TEST_ASSERT_TRUE(isfinite(stand.radiosity[59 * 50][1]));
}

static void no_light_makes_none(void)
{
    make_material(9, 2, 3, 3);
    make_stand(stand_grid(60, 50, point_mm), TILING_MIRROR, MAPPING_PLANAR);
    stand_light_evenly(&stand, 1);
    for (size_t i = 0; i < stand.samples.count; i++) {
        memset(stand.samples.list[i].flux, 0, sizeof stand.samples.list[i].flux);
    }
    TEST_ASSERT_EQUAL_UINT64(0, stand_gather_convolved(&stand, 0.01).convolved);
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        TEST_ASSERT_EQUAL_FLOAT(0, stand.radiosity[i][0]);
    }
}

/* Planes there and back for a material and light. */
static void check_planes(int channels, int factor_channels, bool one_color, int in, int out)
{
    struct source_set samples;
    make_material(3, 4, channels, factor_channels);
    make_stand(stand_grid(20, 20, point_mm), TILING_MIRROR, MAPPING_PLANAR);
    light_in_stripes(1, one_color);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, sources_take(&samples, &stand.samples, &error));
    struct convolve_light how = convolve_light(&stand.appearance, &samples);
    source_set_finish(&samples);
    TEST_ASSERT_TRUE(how.suits);
    TEST_ASSERT_EQUAL_INT(in, how.planes.in);
    TEST_ASSERT_EQUAL_INT(out, how.planes.out);
    finish_stand();
    nacre_material_finish(&material);
}

static void colours_share_transforms_where_planes_are_shared(void)
{
    check_planes(3, 3, false, 12, 12);
    check_planes(3, 3, true, 12, 12);
    check_planes(3, 1, false, 12, 12);
    check_planes(3, 1, true, 4, 12);
    check_planes(1, 1, true, 4, 4);
}

/* Every surface point is served by one block, whose transform has room for all that reaches it. */
static void blocks_cover_a_patch_once(void)
{
    const struct convolve_planes planes = {12, 12};
    struct appearance appearance = {.window = 25};
    for (int i = 0; i < 24; i++) {
        struct mapping mapping = {.mirror = i % 2 == 0, .width = 5 + 40 * (i % 3), .height = 31};
        struct convolve_patch patch = {
            .x = -70 + 13 * i, .y = -31, .width = 3 + 90 * (i % 7), .height = 62};
        struct convolve_plan plan;
        convolve_plan(&plan, &patch, &mapping, &appearance, planes, 1 + i % 2);
        TEST_ASSERT_TRUE(isfinite(plan.points));
        TEST_ASSERT_EQUAL_INT(patch.x, plan.x.starts[0]);
        TEST_ASSERT_EQUAL_INT(patch.x + patch.width, plan.x.starts[plan.x.count]);
        TEST_ASSERT_EQUAL_INT(patch.y + patch.height, plan.y.starts[plan.y.count]);
        for (int k = 0; k < plan.x.count; k++) {
            int width = plan.x.starts[k + 1] - plan.x.starts[k];
            TEST_ASSERT_TRUE(width > 0);
            /* Nodes that are read, and as many as kernels reach to both sides. */
            TEST_ASSERT_TRUE(plan.x.size >= width * plan.fine + 4 + 2 * plan.reach);
        }
        for (int k = 0; k < plan.y.count; k++) {
            int height = plan.y.starts[k + 1] - plan.y.starts[k];
            TEST_ASSERT_TRUE(height > 0);
            TEST_ASSERT_TRUE(plan.y.size >= height * plan.fine + 4 + 2 * plan.reach);
        }
    }
}

/* A plane there and back, and its spectrum against the sum; 1e-5 is single precision's for sums of 120 numbers below 1. */
static void transforms_agree_with_their_definition(void)
{
    enum { W = 12, H = 10 };
    struct fft_plane fft;
    float plane[H * W], back[H * W];
    float complex spectrum[(W / 2 + 1) * H];
    TEST_ASSERT_EQUAL_INT(NACRE_OK, fft_plane_make(&fft, W, H, &error));
    for (size_t i = 0; i < (size_t)H * W; i++) {
        plane[i] = (float)random_share();
    }
    fft_plane_forward(&fft, plane, 0, H, spectrum);
    for (int k = 0; k < (W / 2 + 1) * H; k++) {
        double complex sum = 0;
        for (int i = 0; i < H * W; i++) {
            double turn =
                (double)(k / H * (i % W)) / W + (double)(k % H * (i / W)) / H; /* NOLINT */
            sum += plane[i] * cexp(-2 * acos(-1.0) * I * turn);
        }
        TEST_ASSERT_TRUE(cabs(sum - spectrum[k]) <= 1e-5);
    }
    fft_plane_inverse(&fft, spectrum, 0, H, back);
    for (size_t i = 0; i < (size_t)H * W; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-5, plane[i], back[i] / (H * W));
    }
    fft_plane_finish(&fft);
}

static void sizes_of_transforms_are_even_and_of_small_factors(void)
{
    TEST_ASSERT_EQUAL_INT(2, fft_size(1));
    TEST_ASSERT_EQUAL_INT(100, fft_size(97));
    TEST_ASSERT_EQUAL_INT(128, fft_size(127));
    TEST_ASSERT_EQUAL_INT(640, fft_size(626));
}

/* By counts: a wide window over many vertices is convolved without being asked, a small one is not worth it. */
static void light_is_convolved_only_where_that_is_sooner(void)
{
    make_material(25, 4, 3, 3);
    make_stand(bent(110, 100, 0), TILING_MIRROR, MAPPING_UV);
    stand_light_evenly(&stand, 4);
    struct gather_counts counts = stand_gather(&stand, 0.01);
    TEST_ASSERT_EQUAL_UINT64(counts.receivers, counts.convolved);
    finish_stand();
    nacre_material_finish(&material);
    make_material(3, 4, 3, 3);
    make_stand(bent(30, 30, 0), TILING_MIRROR, MAPPING_UV);
    light_in_stripes(1, false);
    TEST_ASSERT_EQUAL_UINT64(0, stand_gather(&stand, 0.05).convolved);
}

/* As `--explain` tells it, from the surface alone. */
static struct convolve_ahead look_ahead(double gather_ns)
{
    const struct gather_cost cost = {gather_ns, HUGE_VAL};
    struct convolve_ahead ahead;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          convolve_ahead(&ahead, &stand.mesh, &stand.mapping, &stand.appearance,
                                         false, 0.002, 1000, cost, &error));
    return ahead;
}

static void the_choice_can_be_told_ahead(void)
{
    make_material(9, 2, 3, 3);
    make_stand(stand_grid(40, 30, point_mm), TILING_MIRROR, MAPPING_PLANAR);
    struct convolve_ahead ahead = look_ahead(1e9);
    TEST_ASSERT_TRUE(ahead.chosen && ahead.ns < 1e9);
    TEST_ASSERT_EQUAL_DOUBLE(40 * 30, ahead.fits);
    ahead = look_ahead(1e3); /* a microsecond */
    TEST_ASSERT_TRUE(!ahead.chosen);
    TEST_ASSERT_EQUAL_DOUBLE(1e3, ahead.ns);
    TEST_ASSERT_EQUAL_DOUBLE(40 * 30, ahead.fits);
    finish_stand();
    make_stand(bent(40, 30, 5), TILING_MIRROR, MAPPING_UV);
    TEST_ASSERT_TRUE(!look_ahead(1e9).chosen);
    finish_stand();
    nacre_material_finish(&material);
    material = stand_even_material(30, 9, 1, 0.5); /* layout single */
    make_stand(stand_grid(40, 30, point_mm), TILING_MIRROR, MAPPING_PLANAR);
    ahead = look_ahead(1e9);
    TEST_ASSERT_TRUE(!ahead.chosen);
    TEST_ASSERT_EQUAL_DOUBLE(0, ahead.fits);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(transforms_agree_with_their_definition);
    RUN_TEST(sizes_of_transforms_are_even_and_of_small_factors);
    RUN_TEST(blocks_cover_a_patch_once);
    RUN_TEST(colours_share_transforms_where_planes_are_shared);
    RUN_TEST(on_nodes_of_a_level_surface_the_sum_is_exact);
    RUN_TEST(a_window_larger_than_the_surface_does_not_wrap_around);
    RUN_TEST(between_nodes_the_error_told_holds);
    RUN_TEST(a_gently_curved_surface_is_convolved);
    RUN_TEST(a_strongly_curved_surface_is_gathered);
    RUN_TEST(along_a_cut_vertices_are_gathered);
    RUN_TEST(vertices_with_a_surface_behind_them_are_gathered);
    RUN_TEST(a_surface_over_itself_in_the_texture_is_gathered);
    RUN_TEST(light_on_the_back_of_a_slab_stays_there);
    RUN_TEST(patches_that_cannot_be_cut_are_gathered);
    RUN_TEST(light_is_the_same_on_any_number_of_threads);
    RUN_TEST(light_that_is_not_finite_is_left_to_the_gather);
    RUN_TEST(no_light_makes_none);
    RUN_TEST(the_choice_can_be_told_ahead);
    RUN_TEST(light_is_convolved_only_where_that_is_sooner);
    return UNITY_END();
}
