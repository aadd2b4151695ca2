/* Sample files: the documented example and the shipped ones, what lies where, and what is refused. */
#include "rig/virtual/medium.h"
#include "rig/virtual/sample.h"
#include "tests/docs.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct nacre_error error;
static struct sample sample;

void setUp(void)
{
    scratch_make();
    memset(&sample, 0, sizeof sample);
}

void tearDown(void)
{
    sample_finish(&sample);
    scratch_remove();
}

#define HEAD                                                                                       \
    "width: 8\nheight: 6\npitch_mm: 0.5\nthickness_mm: 4\nbase: wax\n" /* lines 1 to 5 */          \
    "materials:\n"                                                                                 \
    "  - {name: wax, scattering_per_mm: 2, absorption_per_mm: 0.1}\n" /* 7 */                      \
    "  - {name: ink, scattering_per_mm: 1, absorption_per_mm: 2}\n"   /* 8 */

static void read_text(const char *text)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, sample_read(scratch_text("sample.yaml", text), &sample, &error), error.text);
}

/* The text is refused at that line ("sample.yaml:7:") with a message that holds `words`. */
static void refuse(const char *text, const char *place, const char *words)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          sample_read(scratch_text("sample.yaml", text), &sample, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, place), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, words), error.text);
    TEST_ASSERT_NULL(sample.materials);
}

/* The index of the material at a place. */
static int at(double x, double y, double z)
{
    return (int)sample_material_at(&sample, (double[]){x, y, z});
}

static void documented_example_is_read(void)
{
    char *text = docs_example("formats.md", "sample.yaml");
    read_text(text);
    free(text);
    TEST_ASSERT_EQUAL_INT(32, sample.width);
    TEST_ASSERT_EQUAL_UINT64(3, sample.material_count);
    TEST_ASSERT_EQUAL_UINT64(6, sample.inclusion_count);
    TEST_ASSERT_EQUAL_INT(2, sample.voxels.subdivide);
}

static void shipped_samples_are_read(void)
{
    static const struct {
        const char *path;
        int width, height;
    } shipped[] = {{SAMPLES "/demo.yaml", 48, 48}, {SAMPLES "/small.yaml", 12, 10}};
    for (size_t i = 0; i < sizeof shipped / sizeof *shipped; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, sample_read(shipped[i].path, &sample, &error),
                                      error.text);
        TEST_ASSERT_EQUAL_INT(shipped[i].width, sample.width);
        TEST_ASSERT_EQUAL_INT(shipped[i].height, sample.height);
        sample_finish(&sample);
    }
}

static void albedo_and_mean_free_path_become_coefficients(void)
{
    read_text("width: 8\nheight: 6\npitch_mm: 0.5\nthickness_mm: 4\nbase: wax\nmaterials:\n"
              "  - {name: wax, albedo: [0.75, 0.5, 1], mean_free_path_mm: [0.25, 0.5, 2]}\n");
    const struct sample_material *wax = &sample.materials[0];
    TEST_ASSERT_EQUAL_DOUBLE(3, wax->scattering_per_mm[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1, wax->absorption_per_mm[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1, wax->scattering_per_mm[1]);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, wax->scattering_per_mm[2]);
    TEST_ASSERT_EQUAL_DOUBLE(0, wax->absorption_per_mm[2]);
    TEST_ASSERT_EQUAL_DOUBLE(1, wax->index);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, sample_shortest_path_mm(&sample));
}

static void entries_remember_their_lines(void)
{
    read_text(HEAD "inclusions:\n"                                 /* 9 */
                   "  - material: ink\n"                           /* 10 */
                   "    depth_mm: [0, 1]\n"                        /* 11 */
                   "    checker: {square_mm: 1}\n"                 /* 12 */
                   "  - {material: wax, clouds: {size_mm: 2}}\n"); /* 13 */
    TEST_ASSERT_EQUAL_INT(7, sample.materials[0].line);
    TEST_ASSERT_EQUAL_INT(8, sample.materials[1].absorption_line);
    TEST_ASSERT_EQUAL_INT(0, sample.materials[1].albedo_line);
    TEST_ASSERT_EQUAL_INT(4, sample.thickness_line);
    TEST_ASSERT_EQUAL_INT(10, sample.inclusions[0].line);
    TEST_ASSERT_EQUAL_INT(11, sample.inclusions[0].depth_line);
    TEST_ASSERT_EQUAL_INT(12, sample.inclusions[0].checker.line);
    TEST_ASSERT_EQUAL_INT(0, sample.inclusions[0].vein.line);
    TEST_ASSERT_EQUAL_INT(13, sample.inclusions[1].clouds.line);
}

static void base_fills_what_nothing_is_painted_on(void)
{
    read_text(HEAD);
    TEST_ASSERT_EQUAL_INT(0, at(0, 0, 0));
    TEST_ASSERT_EQUAL_INT(0, at(-100, 3, 3.9));
}

static void later_inclusions_cover_earlier_ones(void)
{
    read_text(HEAD "inclusions:\n  - {material: ink, depth_mm: [0, 2]}\n"
                   "  - {material: wax, depth_mm: [1, 3], checker: {square_mm: 100}}\n");
    TEST_ASSERT_EQUAL_INT(1, at(1, 1, 0));
    TEST_ASSERT_EQUAL_INT(1, at(1, 1, 0.99));
    TEST_ASSERT_EQUAL_INT(0, at(1, 1, 1));
    TEST_ASSERT_EQUAL_INT(0, at(1, 1, 2.5));
}

static void vein_follows_its_points(void)
{
    read_text(HEAD "inclusions:\n  - {material: ink, vein: {points_mm: [0, 1, 2, 1, 2, 3], "
                   "width_mm: 0.5}, depth_mm: [0.5, 4]}\n");
    TEST_ASSERT_EQUAL_INT(1, at(1, 1.24, 1));
    TEST_ASSERT_EQUAL_INT(0, at(1, 1.26, 1));
    TEST_ASSERT_EQUAL_INT(1, at(1.8, 2.5, 1));
    TEST_ASSERT_EQUAL_INT(0, at(1.7, 2.5, 1));
    TEST_ASSERT_EQUAL_INT(1, at(2, 3.24, 1)); /* its ends are round */
    TEST_ASSERT_EQUAL_INT(0, at(2.2, 3.2, 1));
    TEST_ASSERT_EQUAL_INT(0, at(1, 1, 0.4)); /* above it */
}

static void leaning_shape_moves_with_depth(void)
{
    read_text(HEAD
              "inclusions:\n  - {material: ink, vein: {points_mm: [0, 1, 4, 1], width_mm: 0.5}, "
              "lean: [0, 0.5]}\n");
    TEST_ASSERT_EQUAL_INT(1, at(2, 1, 0));
    TEST_ASSERT_EQUAL_INT(0, at(2, 1, 2));
    TEST_ASSERT_EQUAL_INT(1, at(2, 2, 2));
}

static void bands_repeat(void)
{
    read_text(HEAD "inclusions:\n  - {material: ink, bands: {angle_deg: 0, period_mm: 2, fraction: "
                   "0.25, start_mm: 0.5}}\n");
    for (int i = -2; i <= 2; i++) {
        TEST_ASSERT_EQUAL_INT(0, at(7, 0.45 + 2 * i, 1));
        TEST_ASSERT_EQUAL_INT(1, at(7, 0.55 + 2 * i, 1));
        TEST_ASSERT_EQUAL_INT(1, at(3, 0.95 + 2 * i, 1));
        TEST_ASSERT_EQUAL_INT(0, at(3, 1.05 + 2 * i, 1));
    }
    sample_finish(&sample);
    read_text(HEAD "inclusions:\n  - {material: ink, bands: {angle_deg: 90, period_mm: 2}}\n");
    TEST_ASSERT_EQUAL_INT(1, at(-0.5, 3, 1)); /* across the stripes is -x */
    TEST_ASSERT_EQUAL_INT(0, at(0.5, 3, 1));
    TEST_ASSERT_EQUAL_INT(0, at(0.5, 7, 1));
}

static void checker_alternates_on_both_sides_of_its_origin(void)
{
    read_text(HEAD
              "inclusions:\n  - {material: ink, checker: {square_mm: 2, origin_mm: [1, 1]}}\n");
    for (int row = -3; row <= 3; row++) {
        for (int column = -3; column <= 3; column++) {
            TEST_ASSERT_EQUAL_INT((row + column) % 2 == 0, at(1.1 + 2 * column, 2.9 + 2 * row, 1));
        }
    }
}

/* The share of a lattice of places that is ink. */
static double painted_share(double span)
{
    enum { SIDE = 100 };
    int count = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        int row = i / SIDE;
        count += at((i % SIDE) * span / SIDE, row * span / SIDE, 1 + i % 7 * 0.3);
    }
    return (double)count / (SIDE * SIDE);
}

static void cells_are_painted_by_their_fraction(void)
{
    read_text(HEAD
              "inclusions:\n  - {material: ink, seed: 3, cells: {size_mm: 1, fraction: 0.3}}\n");
    /* 1600 cells: three standard deviations of their number are 0.034, cells of unequal area make it 0.05. */
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 0.3, painted_share(40));
    int first = at(5.5, 5.5, 0);
    TEST_ASSERT_EQUAL_INT(first, at(5.5, 5.5, 3)); /* columns */
}

static void seams_are_as_wide_as_they_are_said_to_be(void)
{
    read_text(HEAD
              "inclusions:\n  - {material: ink, seed: 3, cells: {size_mm: 2, seam_mm: 0.2}}\n");
    /* A Poisson-Voronoi mosaic has 2 / size of seam a mm^2, a jittered lattice's somewhat less: 0.2 mm wide they cover
     * up to 0.2; seams met at an angle count wider. */
    double thin = painted_share(40);
    TEST_ASSERT_DOUBLE_WITHIN(0.07, 0.2, thin);
    sample.inclusions[0].cells.seam_mm = 0.4;
    TEST_ASSERT_DOUBLE_WITHIN(0.3, 2, painted_share(40) / thin);
}

static void clouds_fill_roughly_their_fraction(void)
{
    static const double fractions[] = {0.1, 0.3, 0.5, 0.8};
    read_text(HEAD "inclusions:\n  - {material: ink, seed: 3, clouds: {size_mm: 1}}\n");
    for (size_t i = 0; i < sizeof fractions / sizeof *fractions; i++) {
        sample.inclusions[0].clouds.fraction = fractions[i];
        TEST_ASSERT_DOUBLE_WITHIN(0.06, fractions[i], painted_share(60));
    }
}

static void outline_wanders_no_farther_than_it_may(void)
{
    read_text(HEAD "inclusions:\n  - {material: ink, wander_mm: 0.7, wander_size_mm: 3, seed: 5,"
                   " vein: {points_mm: [-50, 10, 90, 10], width_mm: 0.5}}\n");
    double lowest = INFINITY;
    double highest = -INFINITY;
    for (int i = 0; i < 400 * 200; i++) {
        double x = i % 400 * 0.1;
        int row = i / 400;
        double y = 8 + row * 0.02;
        if (at(x, y, 1)) {
            lowest = fmin(lowest, y);
            highest = fmax(highest, y);
        }
    }
    TEST_ASSERT_TRUE(lowest >= 10 - 0.25 - 0.7 - 1e-9 && highest <= 10 + 0.25 + 0.7 + 1e-9);
    TEST_ASSERT_TRUE(lowest < 10 - 0.45 && highest > 10 + 0.45); /* and it does wander */
}

static void seed_changes_what_is_random(void)
{
    int differ = 0;
    read_text(HEAD "inclusions:\n  - {material: ink, seed: 1, clouds: {size_mm: 1}}\n");
    for (int i = 0; i < 100; i++) {
        sample.inclusions[0].seed = 1;
        int before = at(i * 0.73, i * 0.31, 1);
        TEST_ASSERT_EQUAL_INT(before, at(i * 0.73, i * 0.31, 1));
        sample.inclusions[0].seed = 2;
        differ += before != at(i * 0.73, i * 0.31, 1);
    }
    TEST_ASSERT_TRUE(differ > 20 && differ < 80);
}

static void voxels_take_the_mean_of_what_they_hold(void)
{
    struct medium *medium = NULL;
    read_text(HEAD "margin_points: 1\nvoxels: {subdivide: 1, depth_cells: 8}\n"
                   "inclusions:\n  - {material: ink, vein: {points_mm: [0.75, -9, 0.75, 9], "
                   "width_mm: 0.25}}\n");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, medium_new(&sample, &medium, &error));
    TEST_ASSERT_EQUAL_INT(10, medium->nx);
    TEST_ASSERT_EQUAL_INT(8, medium->ny);
    TEST_ASSERT_EQUAL_INT(8, medium->nz);
    TEST_ASSERT_EQUAL_DOUBLE(0, medium->edges_mm[0]);
    TEST_ASSERT_EQUAL_DOUBLE(4, medium->edges_mm[8]);
    for (int z = 0; z < 8; z++) {
        TEST_ASSERT_TRUE(medium->edges_mm[z + 1] > medium->edges_mm[z]);
    }
    /* Point 1, voxel 2 with the margin, is half vein. */
    TEST_ASSERT_EQUAL_FLOAT(1.5F, medium->scattering[medium_cell(medium, 2, 3, 4)]);
    TEST_ASSERT_EQUAL_FLOAT(1.05F, medium->absorption[medium_cell(medium, 2, 3, 4)]);
    TEST_ASSERT_EQUAL_FLOAT(2, medium->scattering[medium_cell(medium, 3, 3, 4)]);
    medium_free(medium);
}

/* Points that begin a quarter of a mm lower see stripes that begin a quarter of a mm higher. */
static void voxels_begin_where_the_points_do(void)
{
    static const char *const starts[2] = {"0.625", "0.375"};
    struct medium *media[2];
    for (int i = 0; i < 2; i++) {
        char text[1024];
        (void)snprintf(text, sizeof text,
                       "%sinclusions:\n  - {material: ink, bands: {angle_deg: 0, period_mm: 2, "
                       "start_mm: %s}}\n",
                       HEAD, starts[i]);
        read_text(text);
        sample.corner_mm[1] = i == 0 ? 0.25 : 0;
        TEST_ASSERT_EQUAL_INT(NACRE_OK, medium_new(&sample, &media[i], &error));
        sample_finish(&sample);
    }
    size_t size = MEDIUM_CHANNELS * medium_cells(media[0]);
    TEST_ASSERT_EQUAL_FLOAT_ARRAY(media[0]->scattering, media[1]->scattering, size);
    TEST_ASSERT_TRUE(memcmp(media[0]->scattering, media[0]->scattering + medium_cells(media[0]) / 2,
                            medium_cells(media[0]) / 2) != 0);
    medium_free(media[0]);
    medium_free(media[1]);
    read_text(HEAD); /* for tearDown */
}

static void anisotropy_reduces_scattering(void)
{
    struct medium *medium = NULL;
    read_text("width: 2\nheight: 2\npitch_mm: 0.5\nthickness_mm: 4\nbase: wax\nmaterials:\n"
              "  - {name: wax, scattering_per_mm: 10, absorption_per_mm: 0.1, anisotropy: [0.8, 0, "
              "0.5]}\nvoxels: {subdivide: 4}\n");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, medium_new(&sample, &medium, &error));
    TEST_ASSERT_EQUAL_FLOAT(2, medium->scattering[0]);
    TEST_ASSERT_EQUAL_FLOAT(10, medium->scattering[medium_cells(medium)]);
    TEST_ASSERT_EQUAL_FLOAT(5, medium->scattering[2 * medium_cells(medium)]);
    medium_free(medium);
}

static void resolution_follows_the_mean_free_path(void)
{
    struct medium *medium = NULL;
    read_text("width: 2\nheight: 2\npitch_mm: 0.5\nthickness_mm: 4\nbase: wax\nmaterials:\n"
              "  - {name: wax, scattering_per_mm: 11.9, absorption_per_mm: 0.1}\n");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, medium_new(&sample, &medium, &error));
    /* 1 / 12 mm: 0.5 mm are 6 of them, 3 voxels of 2. */
    TEST_ASSERT_EQUAL_INT(3, medium->subdivide);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.4 / 12, medium->edges_mm[1]);
    medium_free(medium);
}

static void unknown_material_is_refused_with_its_line(void)
{
    refuse(HEAD "inclusions:\n  - material: jam\n    depth_mm: [0, 1]\n",
           "sample.yaml:10:", "'jam'");
    refuse("width: 8\nheight: 6\npitch_mm: 0.5\nthickness_mm: 4\nbase: jam\nmaterials:\n"
           "  - {name: wax, scattering_per_mm: 2, absorption_per_mm: 0.1}\n",
           "sample.yaml:5:", "'jam'");
}

static void second_material_of_a_name_is_refused(void)
{
    refuse(HEAD "  - {name: wax, scattering_per_mm: 2, absorption_per_mm: 0.1}\n",
           "sample.yaml:9:", "'wax'");
}

static void negative_absorption_is_refused_with_its_line(void)
{
    refuse(HEAD "  - {name: jam, scattering_per_mm: 2, absorption_per_mm: [0, -0.1, 0]}\n",
           "sample.yaml:9:", "absorption_per_mm");
}

static void half_described_material_is_refused(void)
{
    refuse(HEAD "  - {name: jam, scattering_per_mm: 2}\n", "sample.yaml:9:", "'jam'");
    refuse(HEAD "  - {name: jam, albedo: 0.5}\n", "sample.yaml:9:", "'jam'");
    refuse(HEAD "  - {name: jam}\n", "sample.yaml:9:", "'jam'");
    refuse(HEAD "  - {name: jam, scattering_per_mm: 2, absorption_per_mm: 1, albedo: 0.5, "
                "mean_free_path_mm: 1}\n",
           "sample.yaml:9:", "'jam'");
}

static void clear_material_is_refused(void)
{
    refuse(HEAD "  - {name: air, scattering_per_mm: [1, 0, 1], absorption_per_mm: 0}\n",
           "sample.yaml:9:", "'air'");
}

static void inclusion_has_one_shape(void)
{
    refuse(HEAD
           "inclusions:\n  - {material: ink, checker: {square_mm: 1}, bands: {period_mm: 1}}\n",
           "sample.yaml:10:", "one shape");
    refuse(HEAD "inclusions:\n  - {material: ink}\n", "sample.yaml:10:", "one shape");
}

static void layer_outside_the_slab_is_refused(void)
{
    refuse(HEAD "inclusions:\n  - {material: ink, depth_mm: [4, 5]}\n",
           "sample.yaml:10:", "depth_mm");
    refuse(HEAD "inclusions:\n  - {material: ink, depth_mm: [2, 2]}\n",
           "sample.yaml:10:", "depth_mm");
}

static void layers_that_overlap_are_refused_with_both_lines(void)
{
    refuse(HEAD "inclusions:\n  - {material: ink, depth_mm: [0, 2]}\n"
                "  - {material: wax, checker: {square_mm: 1}}\n"
                "  - {material: wax, depth_mm: [1.5, 3]}\n",
           "sample.yaml:12:", "line 10 from 1.5 to 2 mm");
    refuse(HEAD "inclusions:\n  - {material: ink, depth_mm: [1, 2]}\n"
                "  - {material: wax, depth_mm: [0, 4]}\n",
           "sample.yaml:11:", "line 10 from 1 to 2 mm");
    read_text(HEAD "inclusions:\n  - {material: ink, depth_mm: [2, 4]}\n"
                   "  - {material: wax, depth_mm: [0, 2]}\n");
}

static void vein_needs_two_points(void)
{
    refuse(HEAD "inclusions:\n  - {material: ink, vein: {points_mm: [1, 2], width_mm: 1}}\n",
           "sample.yaml:10:", "points_mm");
    refuse(HEAD
           "inclusions:\n  - {material: ink, vein: {points_mm: [1, 2, 3, 4, 5], width_mm: 1}}\n",
           "sample.yaml:10:", "points_mm");
}

static void mean_free_path_below_a_voxel_is_refused_with_the_resolution_it_takes(void)
{
    /* 1 / 24 mm: voxels of up to 1 / 12 mm, 6 to a point of 0.5 mm, more than are chosen unasked. */
    refuse(HEAD "  - {name: milk, scattering_per_mm: 24, absorption_per_mm: 0}\n",
           "sample.yaml:", "subdivide to 6 or more");
    read_text(HEAD "  - {name: milk, scattering_per_mm: 24, absorption_per_mm: 0}\n"
                   "voxels: {subdivide: 6}\n");
}

static void slab_thinner_than_a_mean_free_path_is_refused(void)
{
    refuse("width: 8\nheight: 6\npitch_mm: 0.5\nthickness_mm: 0.4\nbase: wax\nmaterials:\n"
           "  - {name: wax, scattering_per_mm: 2, absorption_per_mm: 0}\n",
           "sample.yaml:4:", "thickness_mm");
}

static void unknown_key_is_refused_with_its_line(void)
{
    refuse(HEAD "inclusions:\n  - {material: ink, depth_mm: [0, 1], colour: red}\n",
           "sample.yaml:10:", "colour");
}

static void missing_file_is_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, sample_read(scratch_path("none.yaml"), &sample, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "none.yaml"));
}

/* The stand-ins of Table 1: as many points, as large, and readable. */
static void stand_ins_have_the_resolution_and_size_of_table_1(void)
{
    static const struct {
        const char *name;
        int width, height;
        double width_cm, height_cm;
    } rows[] = {{"candle", 212, 154, 19.8, 14.3},       {"marble-4x4", 277, 277, 12.6, 12.6},
                {"marble-8x8", 222, 222, 25.1, 25.1},   {"onyx-lines", 229, 229, 15.2, 15.2},
                {"crystal-onyx", 270, 260, 18.5, 17.6}, {"marble-close", 128, 128, 2.6, 2.6},
                {"marble-dense", 213, 211, 13.0, 13.0}, {"marble-slight", 207, 207, 17.9, 17.9}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char path[512];
        (void)snprintf(path, sizeof path, SAMPLES "/table1/%s.yaml", rows[i].name);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, sample_read(path, &sample, &error), error.text);
        TEST_ASSERT_EQUAL_INT(rows[i].width, sample.width);
        TEST_ASSERT_EQUAL_INT(rows[i].height, sample.height);
        /* Points are squares and the table's sides are rounded to a millimetre, some by more: 2 %. */
        TEST_ASSERT_DOUBLE_WITHIN(0.02 * rows[i].width_cm, rows[i].width_cm,
                                  sample.width * sample.pitch_mm / 10);
        TEST_ASSERT_DOUBLE_WITHIN(0.02 * rows[i].height_cm, rows[i].height_cm,
                                  sample.height * sample.pitch_mm / 10);
        TEST_ASSERT_TRUE(sample.inclusion_count > 0);
        double pitch = sample.pitch_mm;
        sample_finish(&sample);
        (void)snprintf(path, sizeof path, SAMPLES "/table1/%s-small.yaml", rows[i].name);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, sample_read(path, &sample, &error), error.text);
        TEST_ASSERT_EQUAL_INT((rows[i].width + 2) / 4, sample.width);
        TEST_ASSERT_EQUAL_DOUBLE(pitch, sample.pitch_mm);
        sample_finish(&sample);
    }
}

static void map_paints_where_its_picture_is_bright(void)
{
    struct picture picture = {0};
    TEST_ASSERT_EQUAL_INT(0, picture_allocate(&picture, 2, 2, &error));
    picture.rgb[3] = picture.rgb[4] = picture.rgb[5] = 0.9F; /* upper right */
    TEST_ASSERT_EQUAL_INT(0, picture_write(scratch_path("map.exr"), &picture, NULL, &error));
    picture_finish(&picture);
    read_text(HEAD
              "inclusions:\n"
              "  - {material: ink, map: {image: map.exr, origin_mm: [1, 0.5], size_mm: [2, 1]}}\n");
    TEST_ASSERT_EQUAL_INT(1, at(2.01, 0.51, 1));
    TEST_ASSERT_EQUAL_INT(1, at(2.99, 0.99, 1));
    TEST_ASSERT_EQUAL_INT(0, at(1.99, 0.51, 1));
    TEST_ASSERT_EQUAL_INT(0, at(2.01, 1.01, 1));
    TEST_ASSERT_EQUAL_INT(0, at(3.01, 0.51, 1));
    TEST_ASSERT_EQUAL_INT(0, at(2.01, 0.49, 1));
}

static void map_without_its_picture_is_refused(void)
{
    refuse(HEAD "inclusions:\n"
                "  - material: ink\n"
                "    map: {image: none.png, size_mm: [2, 1]}\n",
           "sample.yaml:11:", "none.png");
}

static void inclusion_that_paints_nothing_is_refused(void)
{
    static const char *const hidden[] = {
        "  - {material: ink, depth_mm: [1, 2], vein: {points_mm: [0, 1, 4, 1], width_mm: 1}}\n"
        "  - {material: wax, depth_mm: [0.5, 3]}\n",
        "  - {material: ink, vein: {points_mm: [90, 0, 90, 9], width_mm: 1}}\n"};
    for (int i = 0; i < 2; i++) {
        char text[1024];
        struct medium *medium = NULL;
        (void)snprintf(text, sizeof text, HEAD "margin_points: 1\ninclusions:\n%s", hidden[i]);
        read_text(text);
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, medium_new(&sample, &medium, &error));
        TEST_ASSERT_NULL(medium);
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "line 11"), error.text);
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "paints nothing"), error.text);
        sample_finish(&sample);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(documented_example_is_read);
    RUN_TEST(shipped_samples_are_read);
    RUN_TEST(albedo_and_mean_free_path_become_coefficients);
    RUN_TEST(entries_remember_their_lines);
    RUN_TEST(base_fills_what_nothing_is_painted_on);
    RUN_TEST(later_inclusions_cover_earlier_ones);
    RUN_TEST(vein_follows_its_points);
    RUN_TEST(leaning_shape_moves_with_depth);
    RUN_TEST(bands_repeat);
    RUN_TEST(checker_alternates_on_both_sides_of_its_origin);
    RUN_TEST(cells_are_painted_by_their_fraction);
    RUN_TEST(seams_are_as_wide_as_they_are_said_to_be);
    RUN_TEST(clouds_fill_roughly_their_fraction);
    RUN_TEST(outline_wanders_no_farther_than_it_may);
    RUN_TEST(seed_changes_what_is_random);
    RUN_TEST(voxels_take_the_mean_of_what_they_hold);
    RUN_TEST(voxels_begin_where_the_points_do);
    RUN_TEST(anisotropy_reduces_scattering);
    RUN_TEST(resolution_follows_the_mean_free_path);
    RUN_TEST(unknown_material_is_refused_with_its_line);
    RUN_TEST(second_material_of_a_name_is_refused);
    RUN_TEST(negative_absorption_is_refused_with_its_line);
    RUN_TEST(half_described_material_is_refused);
    RUN_TEST(clear_material_is_refused);
    RUN_TEST(inclusion_has_one_shape);
    RUN_TEST(layer_outside_the_slab_is_refused);
    RUN_TEST(layers_that_overlap_are_refused_with_both_lines);
    RUN_TEST(vein_needs_two_points);
    RUN_TEST(mean_free_path_below_a_voxel_is_refused_with_the_resolution_it_takes);
    RUN_TEST(slab_thinner_than_a_mean_free_path_is_refused);
    RUN_TEST(unknown_key_is_refused_with_its_line);
    RUN_TEST(missing_file_is_refused);
    RUN_TEST(stand_ins_have_the_resolution_and_size_of_table_1);
    RUN_TEST(map_paints_where_its_picture_is_bright);
    RUN_TEST(map_without_its_picture_is_refused);
    RUN_TEST(inclusion_that_paints_nothing_is_refused);
    return UNITY_END();
}
