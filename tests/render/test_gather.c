/* Light gathered through a material: on level surfaces it gives the material back; on others it agrees with them. */
#include "nacre/evaluate.h"
#include "render/bake.h"
#include "render/receivers.h"
#include "stand.h"
#include "tests/nacre/made_material.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct nacre_material material;
static struct stand stand, other;
static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
    nacre_material_finish(&material);
    stand_finish(&stand);
    stand_finish(&other);
}

static const struct made_material kinds[] = {
    {NACRE_KERNEL_SINGLE, NACRE_FLOAT, 3, 3, 1, true, false},
    {NACRE_KERNEL_SINGLE, NACRE_FLOAT, 1, 1, 2, false, false},
    {NACRE_KERNEL_PAIR, NACRE_FLOAT, 3, 3, 2, true, false},
    {NACRE_KERNEL_PER_TERM, NACRE_FLOAT, 3, 1, 0, false, true},
    {NACRE_KERNEL_PER_TERM, NACRE_FLOAT, 3, 3, 0, true, true},
};

enum { KINDS = sizeof kinds / sizeof *kinds };

static const struct scene_material planar = {.mapping = MAPPING_PLANAR, .axis = 2};
static const struct scene_material by_uv = {.mapping = MAPPING_UV};

/* pi L at a vertex of what stand.radiosity holds, with the local part under irradiance e. */
static double radiosity_at(const struct stand *surface, size_t vertex, int c, double e)
{
    double local[3];
    receivers_lookup(&surface->mesh, &surface->mapping, vertex, surface->appearance.local, local);
    return surface->radiosity[vertex][c] + local[c] * e;
}

/* Root of the mean square of the difference of two stands' radiosities over that of the second's, over the vertices
 * that both have. */
static double rms_difference(const struct stand *a, const struct stand *b)
{
    double square = 0, reference = 0;
    size_t count =
        a->mesh.vertex_count < b->mesh.vertex_count ? a->mesh.vertex_count : b->mesh.vertex_count;
    for (size_t i = 0; i < count * 3; i++) {
        double one = a->radiosity[i / 3][i % 3], two = b->radiosity[i / 3][i % 3];
        square += (one - two) * (one - two);
        reference += two * two;
    }
    return sqrt(square / reference);
}

/* Lit at the centre of one surface point, a level grid shows that point's response: exactly, as kernels and H are then
 * read at their own places. The bound is single precision's: sums of a dozen products of numbers near 1. */
static void check_response(const struct scene_material *settings, int x, int y)
{
    size_t width = (size_t)material.width, lit = (size_t)y * width + (size_t)x;
    stand = stand_make(&material, stand_grid(material.width, material.height, material.pitch_mm),
                       settings);
    stand_add_sample_at(&stand, lit);
    (void)stand_gather(&stand, 1e-3);
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        for (int c = 0; c < 3; c++) {
            double expected = nacre_material_evaluate(&material, material.channels == 1 ? 0 : c, x,
                                                      y, (int)(i % width), (int)(i / width));
            double found = radiosity_at(&stand, i, c, i == lit);
            TEST_ASSERT_DOUBLE_WITHIN(2e-5, expected, found);
        }
    }
    stand_finish(&stand);
}

static void a_level_surface_gives_the_response_of_a_lit_point_back(void)
{
    for (size_t kind = 0; kind < KINDS; kind++) {
        material = made_material(kinds[kind]);
        check_response(&planar, 5, 4);
        check_response(&by_uv, 1, 7); /* its window passes the sample's border */
        nacre_material_finish(&material);
    }
}

/* Beyond the border the material goes on mirrored, so a point lit there answers as its mirror image does. */
static void a_mirrored_tile_answers_mirrored(void)
{
    material = made_material(kinds[0]);
    int w = material.width, x = 8, y = 4;
    struct scene_material shifted = planar;
    shifted.offset[0] = w; /* the grid lies on the second tile */
    stand = stand_make(&material, stand_grid(w, material.height, material.pitch_mm), &shifted);
    stand_add_sample_at(&stand, (size_t)(y * w + w - 1 - x));
    (void)stand_gather(&stand, 1e-3);
    for (int i = 0; i < w * material.height; i++) {
        int mirrored = w - 1 - i % w;
        double expected = nacre_material_evaluate(&material, 0, x, y, mirrored, i / w);
        double found = radiosity_at(&stand, (size_t)i, 0, i == y * w + w - 1 - x);
        TEST_ASSERT_DOUBLE_WITHIN(2e-5, expected, found);
    }
}

/* The grid cut between two columns, its right part on texture coordinates `shift` surface points away. */
static struct mesh cut_grid(int columns, int rows, int cut, double point_mm, int shift)
{
    struct mesh whole = stand_grid(columns, rows, point_mm), mesh;
    size_t old = whole.vertex_count, extra = (size_t)rows;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, mesh_allocate(&mesh, old + extra, whole.triangle_count, true, &error),
        error.text);
    memcpy(mesh.positions, whole.positions, old * sizeof *mesh.positions);
    memcpy(mesh.normals, whole.normals, old * sizeof *mesh.normals);
    memcpy(mesh.uv, whole.uv, old * sizeof *mesh.uv);
    memcpy(mesh.triangles, whole.triangles, whole.triangle_count * sizeof *mesh.triangles);
    for (size_t y = 0; y < (size_t)rows; y++) {
        size_t from = y * (size_t)columns + (size_t)cut, to = old + y;
        memcpy(mesh.positions[to], whole.positions[from], sizeof *mesh.positions);
        memcpy(mesh.normals[to], whole.normals[from], sizeof *mesh.normals);
        memcpy(mesh.uv[to], whole.uv[from], sizeof *mesh.uv);
        mesh.uv[to][0] += (float)(shift * point_mm);
    }
    for (size_t i = 0; i < old; i++) {
        mesh.uv[i][0] += i % (size_t)columns > (size_t)cut ? (float)(shift * point_mm) : 0;
    }
    for (size_t i = 0; i < mesh.triangle_count * 3; i++) {
        uint32_t *corner = &mesh.triangles[i / 3][i % 3];
        /* A triangle of the right part has a corner right of the cut. */
        bool right = false;
        for (int k = 0; k < 3; k++) {
            uint32_t v = mesh.triangles[i / 3][k];
            right = right || (v < old && v % (uint32_t)columns > (uint32_t)cut);
        }
        if (right && *corner < old && *corner % (uint32_t)columns == (uint32_t)cut) {
            *corner = (uint32_t)(old + *corner / (uint32_t)columns);
        }
    }
    mesh_finish(&whole);
    return mesh;
}

static void a_cut_in_the_texture_coordinates_does_not_show(void)
{
    material = made_material(kinds[2]);
    int columns = material.width, rows = material.height;
    stand = stand_make(&material, stand_grid(columns, rows, material.pitch_mm), &by_uv);
    other =
        stand_make(&material, cut_grid(columns, rows, 5, material.pitch_mm, 4 * columns), &by_uv);
    stand_light_evenly(&stand, 9);
    stand_light_evenly(&other, 9);
    (void)stand_gather(&stand, 2e-3);
    (void)stand_gather(&other, 2e-3);
    /* Across the cut F is read at places that are rounded from the offset, and may fall on the neighbour of the
     * surface point that the sample itself lies on only where both are on its border: a rare rounding. Without the
     * provision for cuts the difference is above 0.3. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, rms_difference(&stand, &other));
}

/* Of the vertices on one side of a column, over the second's. */
static double side_difference(const struct stand *a, const struct stand *b, int columns, int cut,
                              bool right)
{
    double square = 0, reference = 0;
    for (size_t i = 0; i < b->mesh.vertex_count; i++) {
        int column = (int)(i % (size_t)columns);
        for (int c = 0; c < 3 && (right ? column > cut : column < cut); c++) {
            double one = a->radiosity[i][c], two = b->radiosity[i][c];
            square += (one - two) * (one - two);
            reference += two * two;
        }
    }
    return sqrt(square / reference);
}

/* Where the right part shows another part of the material, each side is lit as if all of the grid lay where it does
 * itself: F of light from beyond the cut is read at the offset from x_o, not where the light's own side lies. The bound is
 * that of the test before. */
static void each_side_of_a_cut_continues_its_own_part_of_the_material(void)
{
    enum { CUT = 5 };
    material = made_material(kinds[2]);
    int columns = material.width, rows = material.height, shift = 2 * columns + 3;
    other = stand_make(&material, cut_grid(columns, rows, CUT, material.pitch_mm, shift), &by_uv);
    stand_light_evenly(&other, 9);
    (void)stand_gather(&other, 2e-3);
    for (int right = 0; right < 2; right++) {
        struct mesh whole = stand_grid(columns, rows, material.pitch_mm);
        for (size_t i = 0; i < whole.vertex_count; i++) {
            whole.uv[i][0] += right ? (float)(shift * material.pitch_mm) : 0;
        }
        stand_finish(&stand);
        stand = stand_make(&material, whole, &by_uv);
        stand_light_evenly(&stand, 9);
        (void)stand_gather(&stand, 2e-3);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, side_difference(&other, &stand, columns, CUT, right));
        TEST_ASSERT_TRUE(side_difference(&other, &stand, columns, CUT, !right) > 0.05);
    }
}

static void a_light_spot_between_surface_points_keeps_its_energy(void)
{
    material = stand_even_material(24, 9, 2, 0.8);
    stand = stand_make(&material, stand_grid(24, 24, material.pitch_mm), &planar);
    stand_add_sample(&stand, 2 * (11 * 23 + 12), 0.31, 0.17);
    (void)stand_gather(&stand, 1e-3);
    double sum = 0, smooth = 0.8 - (double)stand.appearance.local[0];
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        sum += stand.radiosity[i][1];
    }
    /* The bilinear weights of one place sum to 1; offsets keep their length and turn with the plane. Rounding only. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, smooth, sum);
}

/* Bake a stand's mesh under lights, alone in the world. */
static int try_to_bake_alone(struct stand *surface, const struct light *lights, size_t light_count,
                             int mode, const struct bake_settings *settings)
{
    const struct mesh *meshes[1] = {&surface->mesh};
    const bool albedo = mode == MODE_ALBEDO;
    const struct render_object_effects effects = {
        .albedo = albedo, .local = !albedo, .subsurface = !albedo && surface->appearance.gathers};
    const struct lit_surface lit = {&surface->mesh, &surface->mapping, 0, 1, NULL};
    struct world *world = NULL;
    struct bake_counts counts = {0};
    memset(surface->radiosity, 0, surface->mesh.vertex_count * sizeof *surface->radiosity);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, world_new(meshes, 1, &world, &error), error.text);
    const struct lighting lighting = {.world = world,
                                      .lights = lights,
                                      .light_count = light_count,
                                      .shadows = true,
                                      .rays = settings->rays,
                                      .seed = settings->seed};
    int status = bake_object(&lit, &surface->appearance, &effects, &lighting, stand_opencl(),
                             settings, surface->radiosity, &counts, &error);
    world_free(world);
    return status;
}

static void bake_alone(struct stand *surface, const struct light *lights, size_t light_count,
                       int mode, const struct bake_settings *settings)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, try_to_bake_alone(surface, lights, light_count, mode, settings), error.text);
}

static struct light light_of(struct scene_light settings)
{
    struct light light;
    settings.up[1] = 1;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, light_make(&light, &settings, &error), error.text);
    return light;
}

/* A point light so far above that it shines evenly on a surface of a few mm. */
static struct light far_light(void)
{
    return light_of((struct scene_light){.kind = LIGHT_POINT,
                                         .position_mm = {10, -10, 1e5},
                                         .at_mm = {10, -10, 0},
                                         .irradiance = {1, 1, 1}});
}

static void even_light_shows_the_albedo(void)
{
    const struct bake_settings settings = {.density = 36, .rays = 1, .seed = 1, .quiet = true};
    struct light light = far_light();
    size_t size = 40, checked = 0;
    material = stand_even_material((int)size, 9, 1.5, 0.7);
    stand = stand_make(&material, stand_grid((int)size, (int)size, material.pitch_mm), &planar);
    bake_alone(&stand, &light, 1, MODE_FULL, &settings);
    for (size_t i = 0; i < size * size; i++) {
        size_t x = i % size, y = i / size;
        if (x >= 6 && y >= 6 && x < size - 6 && y < size - 6) {
            /* 36 samples to a point, some 500 in the kernel's core, spread evenly: far better than their
             * 4 % of independent noise. */
            TEST_ASSERT_DOUBLE_WITHIN(0.007, 0.7, stand.radiosity[i][0]);
            checked++;
        }
    }
    TEST_ASSERT_EQUAL_UINT64(28 * 28, checked);
    light_finish(&light);
}

static void the_albedo_is_the_sum_of_what_arrives(void)
{
    for (size_t kind = 0; kind < KINDS; kind++) {
        material = made_material(kinds[kind]);
        stand = stand_make(&material, stand_grid(4, 4, 1), &planar);
        float *albedo =
            calloc((size_t)material.width * (size_t)material.height * 3, sizeof *albedo);
        TEST_ASSERT_NOT_NULL(albedo);
        appearance_albedo(&stand.appearance, true, albedo);
        /* Points whose whole window lies on the sample. */
        for (int y = 2; y < material.height - 2; y++) {
            for (int x = 2; x < material.width - 2; x++) {
                double sum = 0;
                for (int i = 0; i < 25; i++) {
                    sum += nacre_material_evaluate(&material, material.channels - 1, x + i % 5 - 2,
                                                   y + i / 5 - 2, x, y);
                }
                TEST_ASSERT_DOUBLE_WITHIN(2e-5 * sum, sum,
                                          albedo[(y * material.width + x) * 3 + 2]);
            }
        }
        free(albedo);
        stand_finish(&stand);
        nacre_material_finish(&material);
    }
}

static void a_kernel_of_no_width_is_plain_diffuse_reflection(void)
{
    const struct bake_settings settings = {.density = 9, .rays = 4, .seed = 1, .quiet = true};
    struct light light = light_of((struct scene_light){.kind = LIGHT_AREA,
                                                       .position_mm = {20, -3, 10},
                                                       .at_mm = {5, -5, 0},
                                                       .size_mm = {5, 5},
                                                       .irradiance = {1, 2, 3}});
    material = stand_even_material(16, 1, 1, 0.6);
    stand = stand_make(&material, stand_grid(16, 16, material.pitch_mm), &planar);
    other = stand_make(&material, stand_grid(16, 16, material.pitch_mm), &planar);
    bake_alone(&stand, &light, 1, MODE_FULL, &settings);
    bake_alone(&other, &light, 1, MODE_ALBEDO, &settings);
    TEST_ASSERT_FALSE(stand.appearance.gathers);
    TEST_ASSERT_DOUBLE_WITHIN(1e-7, 0, rms_difference(&stand, &other));
    TEST_ASSERT_TRUE(stand.radiosity[100][2] > 0.1F);
    light_finish(&light);
}

static struct mesh sphere(double radius_mm, double edge_mm)
{
    struct mesh mesh;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, mesh_make_sphere(&mesh, radius_mm, edge_mm, &error),
                                  error.text);
    return mesh;
}

/* On a sphere the area within a chord's length r is pi r^2 as on a plane, so a round kernel gathers all of even light;
 * a square one of 9 points nearly so when the radius is 40 points. Seams and poles of the mapping are included. */
static void a_large_sphere_is_like_a_plane(void)
{
    const int mappings[] = {MAPPING_UV, MAPPING_BOX, MAPPING_SPHERE, MAPPING_PLANAR,
                            MAPPING_CYLINDER};
    material = stand_even_material(30, 9, 1, 0.8);
    for (size_t k = 0; k < sizeof mappings / sizeof *mappings; k++) {
        const struct scene_material settings = {.mapping = mappings[k], .axis = 2};
        double mean = 0, square = 0, count;
        stand = stand_make(&material, sphere(20, 2), &settings);
        stand_light_evenly(&stand, 16);
        (void)stand_gather(&stand, 1e-3);
        count = (double)stand.mesh.vertex_count;
        double smooth = 0.8 - (double)stand.appearance.local[0];
        for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
            mean += stand.radiosity[i][0] / count;
        }
        for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
            double off = stand.radiosity[i][0] - mean;
            square += off * off / count;
        }
        /* The facets, 4 points long, lie under the sphere by 1 %; the samples scatter by 2 %. */
        TEST_ASSERT_DOUBLE_WITHIN(0.012 * smooth, smooth, mean);
        TEST_ASSERT_DOUBLE_WITHIN(0.03 * smooth, 0, sqrt(square));
        stand_finish(&stand);
    }
}

static void splitting_the_mesh_does_not_change_the_light_at_its_vertices(void)
{
    const struct bake_settings settings = {.density = 36, .rays = 4, .seed = 5, .quiet = true};
    struct light light = light_of((struct scene_light){.kind = LIGHT_AREA,
                                                       .position_mm = {20, 10, 40},
                                                       .size_mm = {15, 15},
                                                       .irradiance = {1, 1, 1}});
    const double edge = 0.3;
    bool limited;
    material = made_material(kinds[0]);
    const struct scene_material box = {.mapping = MAPPING_BOX, .point_mm = 0.5};
    stand = stand_make(&material, sphere(6, 1.2), &box);
    struct mesh fine = sphere(6, 1.2);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, mesh_subdivide(&fine, mesh_edge_even, &edge, 1000000, &limited, &error),
        error.text);
    other = stand_make(&material, fine, &box);
    TEST_ASSERT_TRUE(fine.triangle_count > 10 * stand.mesh.triangle_count);
    bake_alone(&stand, &light, 1, MODE_FULL, &settings);
    bake_alone(&other, &light, 1, MODE_FULL, &settings);
    /* Both carry the scatter of 36 samples to a surface point, of which some 36 fall in the local part's cone. */
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 0, rms_difference(&stand, &other));
    light_finish(&light);
}

static void the_kernel_agrees_with_the_reference(void)
{
    for (size_t kind = 0; kind < KINDS; kind++) {
        const struct scene_material settings = {.mapping = kind % 2 ? MAPPING_BOX : MAPPING_UV,
                                                .point_mm = 0.5,
                                                .tiling =
                                                    kind == 2 ? TILING_REPEAT : TILING_MIRROR};
        struct mesh knot, same;
        material = made_material(kinds[kind]);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_knot(&knot, 12, 0.6, 0.8, &error));
        TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_knot(&same, 12, 0.6, 0.8, &error));
        stand = stand_make(&material, knot, &settings);
        other = stand_make(&material, same, &settings);
        stand_light_evenly(&stand, 4);
        stand_light_evenly(&other, 4);
        stand_gather_reference(&other);
        (void)stand_gather(&stand, 0);
        /* Single against double precision: sums of hundreds of terms, and now and then F read from a neighbour where
         * rounding moves a place over the border between surface points, which in this material differ wildly. */
        TEST_ASSERT_DOUBLE_WITHIN(5e-4, 0, rms_difference(&stand, &other));
        /* Light summed up may be off by so much more than it says. */
        (void)stand_gather_summed(&stand, 4e-3);
        TEST_ASSERT_DOUBLE_WITHIN(5e-3, 0, rms_difference(&stand, &other));
        stand_finish(&stand);
        stand_finish(&other);
        nacre_material_finish(&material);
    }
}

enum { SETS = 12 };

/* What leaves a ball of a smooth material, [vertex * 3 + channel]; heap. */
static float *light_of_ball(const struct light *lights, const struct bake_settings *settings,
                            size_t *values)
{
    const struct scene_material box = {.mapping = MAPPING_BOX};
    stand = stand_make(&material, sphere(6, 0.4), &box);
    bake_alone(&stand, lights, 2, MODE_FULL, settings);
    *values = stand.mesh.vertex_count * 3;
    float *light = malloc(*values * sizeof *light);
    TEST_ASSERT_NOT_NULL(light);
    memcpy(light, stand.radiosity, *values * sizeof *light);
    stand_finish(&stand);
    return light;
}

/* Of (a - b) and (c - d), value by value. */
static double product_of_differences(const float *a, const float *b, const float *c, const float *d,
                                     size_t values)
{
    double sum = 0;
    for (size_t i = 0; i < values; i++) {
        sum += ((double)a[i] - b[i]) * ((double)c[i] - d[i]);
    }
    return sum;
}

static double total(const float *light, size_t values)
{
    double sum = 0;
    for (size_t i = 0; i < values; i++) {
        sum += (double)light[i];
    }
    return sum;
}

/* What exceeds the mean of a chi-square variable of so many degrees of freedom once in 10,000 times, over that mean, by
 * Wilson and Hilferty. */
static double chi_square_limit(double freedom)
{
    double step = 2 / (9 * freedom);
    return pow(1 - step + 3.72 * sqrt(step), 3);
}

/* Whether spread samples have the mean that independent sets of photons have, all light together and vertex by vertex.
 *
 * All together: Student's t with 11 degrees of freedom exceeds 5.5 less than once in 5,000 times; the spread samples'
 * own error comes on top of the mean's.
 *
 * Vertex by vertex: the square of the distance between the mean of the photon sets and one spread set has the
 * expectation tr C / SETS + tr S, for the covariances C of a photon set and S of a spread one, which halves of squared
 * distances within two sets tell. Neighbours share photons, so that it is as a chi-square of only
 * (tr C)^2 / tr C^2 degrees of freedom (Welch and Satterthwaite); tr C^2 is the mean square of the product of two
 * independent differences. */
static void check_agreement(float *const photons[SETS], float *const spread[2], size_t values)
{
    double trace = 0, square_trace = 0, sum = 0, square = 0, distance = 0, all = 0;
    enum { PAIRS = SETS / 2 };
    for (int i = 0; i < PAIRS; i++) {
        const float *a = photons[2 * i], *b = photons[2 * i + 1];
        trace += product_of_differences(a, b, a, b, values) / 2 / PAIRS;
        for (int j = 0; j < i; j++) {
            double product =
                product_of_differences(a, b, photons[2 * j], photons[2 * j + 1], values) / 2;
            square_trace += 2 * product * product / (PAIRS * (PAIRS - 1));
        }
    }
    for (int k = 0; k < SETS; k++) {
        double one = total(photons[k], values);
        sum += one / SETS;
        square += one * one / SETS;
    }
    double spread_trace =
        product_of_differences(spread[0], spread[1], spread[0], spread[1], values) / 2;
    double spread_total = total(spread[0], values);
    double spread_off = spread_total - total(spread[1], values);
    double deviation = sqrt((square - sum * sum) / (SETS - 1) + spread_off * spread_off / 2);
    for (size_t i = 0; i < values; i++) {
        double mean = 0;
        for (int k = 0; k < SETS; k++) {
            mean += (double)photons[k][i] / SETS;
        }
        distance += (mean - spread[0][i]) * (mean - spread[0][i]);
        all += (double)spread[0][i] * spread[0][i];
    }
    double freedom = fmin(fmax(trace * trace / square_trace, 1), (double)values);
    double limit = chi_square_limit(freedom) * (trace / SETS + spread_trace);
    TEST_ASSERT_DOUBLE_WITHIN(5.5 * deviation, spread_total, sum);
    TEST_ASSERT_TRUE(distance < limit);
    /* All this tells something: a mean that is off by 1 % fails, and so does one that is off by 2 % at each vertex. */
    TEST_ASSERT_TRUE(5.5 * deviation < 0.01 * spread_total);
    TEST_ASSERT_TRUE(limit < 0.02 * 0.02 * all);
}

/* Photons are the reference for spread samples. */
static void photons_and_spread_samples_agree(void)
{
    struct light lights[2] = {light_of((struct scene_light){.kind = LIGHT_AREA,
                                                            .position_mm = {20, 10, 40},
                                                            .size_mm = {15, 15},
                                                            .irradiance = {1, 1, 1}}),
                              light_of((struct scene_light){.kind = LIGHT_SPOT,
                                                            .position_mm = {-30, 0, 10},
                                                            .angle_deg = 16,
                                                            .soft_deg = 3,
                                                            .irradiance = {0.5, 0.2, 1}})};
    float *photons[SETS], *spread[2];
    size_t values;
    material = stand_even_material(30, 9, 2, 0.8);
    for (int k = 0; k < SETS; k++) {
        const struct bake_settings settings = {
            .photons = 150000, .seed = (uint64_t)k + 2, .quiet = true};
        photons[k] = light_of_ball(lights, &settings, &values);
    }
    for (int k = 0; k < 2; k++) {
        const struct bake_settings settings = {
            .density = 25, .rays = 16, .seed = (uint64_t)k + 1, .quiet = true};
        spread[k] = light_of_ball(lights, &settings, &values);
    }
    check_agreement(photons, spread, values);
    for (int k = 0; k < SETS; k++) {
        free(photons[k]);
    }
    free(spread[0]);
    free(spread[1]);
    light_finish(&lights[0]);
    light_finish(&lights[1]);
}

static void light_does_not_pass_to_the_other_side_where_it_must_not(void)
{
    const double size[3] = {8, 8, 1};
    const struct scene_material box = {.mapping = MAPPING_BOX};
    struct gather gather = {0};
    struct gather_counts counts;
    struct mesh slab;
    const double edge = 0.6;
    bool limited;
    material = stand_even_material(30, 9, 2, 0.8);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&slab, size, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mesh_subdivide(&slab, mesh_edge_even, &edge, 100000, &limited, &error));
    stand = stand_make(&material, slab, &box);
    for (size_t i = 0; i < stand.mesh.triangle_count; i++) {
        if (stand.mesh.normals[stand.mesh.triangles[i][0]][2] > 0.5F) {
            stand_add_sample(&stand, i, 0.3, 0.3); /* the upper side is lit */
        }
    }
    gather = (struct gather){&stand.mesh, &stand.mapping, &stand.appearance, &stand.samples,
                             true,        1e-3,           GATHER_SUMMED,     NULL};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, gather_run(&gather, stand_opencl(), NULL, stand.radiosity, &counts, &error),
        error.text);
    double above = 0, below = 0;
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        above += stand.mesh.normals[i][2] > 0.5F ? stand.radiosity[i][0] : 0;
        below += stand.mesh.normals[i][2] < -0.5F ? stand.radiosity[i][0] : 0;
    }
    TEST_ASSERT_TRUE(above > 1);
    TEST_ASSERT_EQUAL_DOUBLE(0, below);
    (void)stand_gather(&stand, 1e-3);
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        below += stand.mesh.normals[i][2] < -0.5F ? stand.radiosity[i][0] : 0;
    }
    TEST_ASSERT_TRUE(below > 0.1);
}

static void a_dark_surface_stays_dark(void)
{
    material = stand_even_material(10, 5, 1, 0.8);
    stand = stand_make(&material, stand_grid(10, 10, material.pitch_mm), &planar);
    (void)stand_gather(&stand, 1e-3);
    for (size_t i = 0; i < stand.mesh.vertex_count; i++) {
        TEST_ASSERT_EQUAL_FLOAT(0, stand.radiosity[i][0]);
    }
}

/* Light that overflows is told, and not drawn as black: the clamp to 0 of rounding would make that of it. */
static void light_that_is_not_finite_is_refused(void)
{
    const struct bake_settings settings = {.density = 2, .rays = 1, .seed = 1, .quiet = true};
    material = stand_even_material(16, 5, 1, 0.6);
    stand = stand_make(&material, stand_grid(16, 16, material.pitch_mm), &planar);
    struct light light = light_of((struct scene_light){
        .kind = LIGHT_POINT, .position_mm = {5, -5, 10}, .irradiance = {1, 1, 1}});
    TEST_ASSERT_EQUAL_INT(NACRE_OK, try_to_bake_alone(&stand, &light, 1, MODE_ALBEDO, &settings));
    light.intensity[1] = NAN;
    for (int k = 0; k < 2; k++) {
        error.text[0] = '\0';
        TEST_ASSERT_EQUAL_INT(
            NACRE_FAILED,
            try_to_bake_alone(&stand, &light, 1, k ? MODE_FULL : MODE_ALBEDO, &settings));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "not finite"), error.text);
    }
    light_finish(&light);
}

static void a_material_that_is_not_finite_is_refused(void)
{
    struct appearance appearance;
    material = stand_even_material(6, 3, 1, 0.8);
    material.f[8] = NAN;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, appearance_make(&appearance, &material, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "(2, 1)"));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_level_surface_gives_the_response_of_a_lit_point_back);
    RUN_TEST(a_mirrored_tile_answers_mirrored);
    RUN_TEST(a_cut_in_the_texture_coordinates_does_not_show);
    RUN_TEST(each_side_of_a_cut_continues_its_own_part_of_the_material);
    RUN_TEST(a_light_spot_between_surface_points_keeps_its_energy);
    RUN_TEST(even_light_shows_the_albedo);
    RUN_TEST(the_albedo_is_the_sum_of_what_arrives);
    RUN_TEST(a_kernel_of_no_width_is_plain_diffuse_reflection);
    RUN_TEST(a_large_sphere_is_like_a_plane);
    RUN_TEST(splitting_the_mesh_does_not_change_the_light_at_its_vertices);
    RUN_TEST(the_kernel_agrees_with_the_reference);
    RUN_TEST(photons_and_spread_samples_agree);
    RUN_TEST(light_does_not_pass_to_the_other_side_where_it_must_not);
    RUN_TEST(a_dark_surface_stays_dark);
    RUN_TEST(light_that_is_not_finite_is_refused);
    RUN_TEST(a_material_that_is_not_finite_is_refused);
    return UNITY_END();
}
