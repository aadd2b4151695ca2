/* Materials, written and read back, and what is refused as one. */
#include "made_material.h"
#include "nacre/exr_file.h"
#include "scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

void setUp(void)
{
    scratch_make();
}

void tearDown(void)
{
    scratch_limit_files(0);
    scratch_remove();
}

static const struct made_material paper = {.layout = NACRE_KERNEL_SINGLE,
                                           .pixel = NACRE_FLOAT,
                                           .channels = 3,
                                           .factor_channels = 3,
                                           .mixed = 1,
                                           .with_h = true};
static const struct made_material per_term = {.layout = NACRE_KERNEL_PER_TERM,
                                              .pixel = NACRE_HALF,
                                              .channels = 3,
                                              .factor_channels = 1,
                                              .with_centre = true};

static void write_material(const char *name, const struct nacre_material *material)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_write(scratch_path(name), material, &error), error.text);
}

static void expect_same(const float *expected, const float *got, size_t count)
{
    TEST_ASSERT_EQUAL_INT(!expected, !got);
    if (expected) {
        TEST_ASSERT_EQUAL_HEX32_ARRAY(expected, got, count);
    }
}

static void expect_round_trip(struct made_material wanted)
{
    struct nacre_error error = {0};
    struct nacre_material material = made_material(wanted);
    struct nacre_material back;
    nacre_material_round(&material);
    write_material("m.exr", &material);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_read(scratch_path("m.exr"), &back, &error), error.text);
    TEST_ASSERT_EQUAL_INT(material.width, back.width);
    TEST_ASSERT_EQUAL_INT(material.height, back.height);
    TEST_ASSERT_EQUAL_INT(material.channels, back.channels);
    TEST_ASSERT_EQUAL_INT(material.window, back.window);
    TEST_ASSERT_EQUAL_INT(material.terms, back.terms);
    TEST_ASSERT_EQUAL_INT(material.clusters, back.clusters);
    TEST_ASSERT_EQUAL_INT(material.mixed, back.mixed);
    TEST_ASSERT_EQUAL_INT(material.layout, back.layout);
    TEST_ASSERT_EQUAL_INT(material.pixel, back.pixel);
    TEST_ASSERT_EQUAL_INT(material.factor_channels, back.factor_channels);
    TEST_ASSERT_EQUAL_INT(material.bits, back.bits);
    TEST_ASSERT_EQUAL_UINT64(nacre_material_size(&material), nacre_material_size(&back));
    size_t points = 99;
    size_t factors = 3 * (size_t)material.factor_channels * points;
    size_t labels = (size_t)material.mixed * points;
    expect_same(material.albedo, back.albedo, (size_t)material.channels * points);
    expect_same(material.f, back.f, factors);
    expect_same(material.h, back.h, factors);
    expect_same(material.kernels, back.kernels,
                (size_t)nacre_material_kernel_count(&material) * (size_t)material.channels * 25);
    expect_same(material.weights, back.weights, labels);
    expect_same(material.centre, back.centre, (size_t)material.channels * points);
    if (labels > 0) {
        TEST_ASSERT_EQUAL_HEX32_ARRAY(material.ids, back.ids, labels);
    }
    nacre_material_finish(&material);
    nacre_material_finish(&back);
}

static void every_layout_comes_back_bit_for_bit(void)
{
    for (int layout = NACRE_KERNEL_SINGLE; layout <= NACRE_KERNEL_PER_TERM; layout++) {
        for (int variant = 0; variant < 32; variant++) {
            expect_round_trip((struct made_material){
                .layout = (enum nacre_layout)layout,
                .pixel = variant & 1 ? NACRE_HALF : NACRE_FLOAT,
                .channels = variant & 2 ? 3 : 1,
                .factor_channels = (variant & 6) == 6 ? 3 : 1,
                .mixed = variant & 8 ? 2 : 1,
                .with_h = variant & 4,
                .with_centre = variant & 16,
            });
        }
    }
}

static void numbers_history_and_warnings_come_back(void)
{
    struct nacre_error error = {0};
    struct nacre_material material = made_material(per_term);
    struct nacre_material back;
    material.bits = 8;
    material.history_count = 3;
    material.history_objective = calloc(3, sizeof(float));
    material.history_seconds = calloc(3, sizeof(float));
    material.history_error = calloc(3, sizeof(float));
    for (int i = 0; i < 3; i++) {
        material.history_objective[i] = 1.0f / (float)(i + 1);
        material.history_seconds[i] = 0.1f * (float)i;
        material.history_error[i] = i == 1 ? NAN : 0.02f;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_material_warn(&material, "dim \"blue\" <1>", &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_material_warn(&material, "", &error));
    material.albedo[5] = NAN;
    write_material("m.exr", &material);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_material_read(scratch_path("m.exr"), &back, &error));
    TEST_ASSERT_TRUE(back.pitch_mm == 0.25 && back.epsilon == 0.125);
    TEST_ASSERT_TRUE(back.error_min == 0.25 && back.error_mean == 0.5 && back.error_max == 0.75);
    TEST_ASSERT_EQUAL_INT(17, back.iterations);
    TEST_ASSERT_EQUAL_INT(-3, back.seed);
    TEST_ASSERT_EQUAL_INT(8, back.bits);
    TEST_ASSERT_EQUAL_STRING("hals", back.method);
    TEST_ASSERT_EQUAL_UINT64(3, back.history_count);
    expect_same(material.history_objective, back.history_objective, 3);
    expect_same(material.history_seconds, back.history_seconds, 3);
    TEST_ASSERT_NOT_NULL(back.history_error);
    TEST_ASSERT_EQUAL_FLOAT(0.02f, back.history_error[0]);
    TEST_ASSERT_TRUE(isnan(back.history_error[1]));
    TEST_ASSERT_EQUAL_FLOAT(0.02f, back.history_error[2]);
    TEST_ASSERT_EQUAL_UINT64(2, back.warning_count);
    TEST_ASSERT_EQUAL_STRING("dim \"blue\" <1>", back.warnings[0]);
    TEST_ASSERT_EQUAL_STRING("", back.warnings[1]);
    TEST_ASSERT_TRUE(isnan(back.albedo[5]));
    nacre_material_finish(&material);
    nacre_material_finish(&back);
}

/* Sizes by the rules of Table 1, worked out by hand for 11 x 9 points, K 5, T 3, k 4. */
static void size_counts_every_stored_number(void)
{
    struct nacre_material material = made_material(paper);
    /* F and H: 2 x 3 terms x 3 channels x 99 x 4; kernels: 4 x 3 x 25 x 4; labels: 99 x 1 */
    TEST_ASSERT_EQUAL_UINT64(7128 + 1200 + 99, nacre_material_size(&material));
    material.pixel = NACRE_HALF;
    TEST_ASSERT_EQUAL_UINT64(3564 + 1200 + 99, nacre_material_size(&material));
    nacre_material_finish(&material);
    struct made_material wanted = paper;
    wanted.mixed = 2;
    wanted.layout = NACRE_KERNEL_PAIR;
    material = made_material(wanted);
    /* 16 kernels; two ids and two weights a point */
    TEST_ASSERT_EQUAL_UINT64(7128 + 4800 + 99 * 16, nacre_material_size(&material));
    nacre_material_finish(&material);
    material = made_material(per_term);
    /* F alone, shared: 3 x 99 x 2; centre 3 x 99 x 2; 3 kernels: 3 x 3 x 25 x 4 */
    TEST_ASSERT_EQUAL_UINT64(594 + 594 + 900, nacre_material_size(&material));
    material.bits = 5;
    /* 297 numbers of F of 5 bits and 297 of the centre of 8: 3861 bits, 482.6 bytes */
    TEST_ASSERT_EQUAL_UINT64(483 + 900, nacre_material_size(&material));
    nacre_material_finish(&material);
}

/* 101 iterations of a quantised material: each sixth is told, the 101st among them, so 5, 11, ... 101; an error that was
 * looked at between is told with the next. */
static void a_long_history_is_thinned(void)
{
    enum { LONG = 101, KEPT = 17 };
    struct nacre_error error = {0};
    struct nacre_material material = made_material(per_term), back;
    material.bits = 8;
    material.history_count = LONG;
    material.history_objective = calloc(LONG, sizeof(float));
    material.history_seconds = calloc(LONG, sizeof(float));
    material.history_error = calloc(LONG, sizeof(float));
    for (int i = 0; i < LONG; i++) {
        material.history_objective[i] = 1.0f / (float)(i + 1);
        material.history_seconds[i] = (float)(i + 1);
        material.history_error[i] = i == 6 ? 0.25f : NAN;
    }
    write_material("m.exr", &material);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_material_read(scratch_path("m.exr"), &back, &error));
    TEST_ASSERT_EQUAL_INT(6, back.history_every);
    TEST_ASSERT_EQUAL_UINT64(KEPT, back.history_count);
    for (int i = 0; i < KEPT; i++) {
        TEST_ASSERT_EQUAL_FLOAT((float)(5 + 6 * i), back.history_seconds[i]);
        TEST_ASSERT_EQUAL_FLOAT(1.0f / (float)(5 + 6 * i), back.history_objective[i]);
    }
    TEST_ASSERT_TRUE(isnan(back.history_error[0]) && isnan(back.history_error[2]));
    TEST_ASSERT_EQUAL_FLOAT(0.25f, back.history_error[1]);
    nacre_material_finish(&back);
    material.bits = 0;
    write_material("m.exr", &material);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_material_read(scratch_path("m.exr"), &back, &error));
    TEST_ASSERT_EQUAL_UINT64(LONG, back.history_count);
    nacre_material_finish(&back);
    nacre_material_finish(&material);
}

static void expect_text(int status, const struct nacre_error *error, const char *text)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error->text, text), error->text);
    TEST_ASSERT_NULL_MESSAGE(strchr(error->text, '\n'), error->text);
}

static void expect_unwritable(const struct nacre_material *material, const char *text)
{
    struct nacre_error error = {0};
    expect_text(nacre_material_write(scratch_path("m.exr"), material, &error), &error, text);
    TEST_ASSERT_NOT_NULL(strstr(error.text, "m.exr: cannot write: "));
    TEST_ASSERT_EQUAL_INT(0, scratch_count());
}

static void values_that_no_model_has_are_not_written(void)
{
    struct made_material wanted = paper;
    wanted.mixed = 2;
    struct nacre_material material = made_material(wanted);
    struct nacre_material saved = material;
    float kept = material.f[99 * 4 + 13];
    material.f[99 * 4 + 13] = NAN; /* term 1, channel G, point (2, 1) */
    expect_unwritable(&material, "part F: term 1, channel G: the value at (2, 1) is ");
    material.f[99 * 4 + 13] = -1;
    expect_unwritable(&material, "is -1; it must be finite, not negative");
    material.f[99 * 4 + 13] = 70000;
    material.pixel = NACRE_HALF;
    expect_unwritable(&material, "is 70000; it must be finite, not negative, and at most 65504");
    material.f[99 * 4 + 13] = kept;
    material.pixel = NACRE_FLOAT;
    material.kernels[7] = INFINITY;
    expect_unwritable(&material, "part kernel: kernel 0, channel R: the value at (2, 1)");
    material.kernels[7] = 1;
    material.h[0] = -2;
    expect_unwritable(&material, "part H: term 0, channel R: the value at (0, 0) is -2");
    material.h[0] = 2;
    material.ids[3] = 4;
    expect_unwritable(&material, "channel id0: the id at (3, 0) is 4, and there are 4 clusters");
    material.ids[3] = material.ids[99 + 3];
    expect_unwritable(&material, "id0 and id1 name the same cluster at (3, 0)");
    material.ids[3] = (material.ids[99 + 3] + 1) % 4;
    material.weights[99 + 12] = 0.5f;
    expect_unwritable(&material, "the weights at (1, 1) sum to 0.833333, not 1");
    material.weights[99 + 12] = -0.5f;
    expect_unwritable(&material, "channel w1: the weight at (1, 1) is -0.5");
    material.weights[99 + 12] = 2.0f / 3;
    material.pitch_mm = 0;
    expect_unwritable(&material, "the pitch is 0 mm");
    material = saved;
    nacre_material_finish(&material);
}

static void sizes_that_cannot_be_are_not_allocated(void)
{
    struct nacre_error error = {0};
    struct nacre_material good = {.width = 4,
                                  .height = 4,
                                  .channels = 3,
                                  .window = 5,
                                  .terms = 2,
                                  .clusters = 2,
                                  .mixed = 1,
                                  .pixel = NACRE_HALF,
                                  .factor_channels = 3};
    struct nacre_material bad = good;
    bad.width = 0;
    expect_text(nacre_material_allocate(&bad, true, false, &error), &error, "0 x 4 surface points");
    bad = good;
    bad.channels = 2;
    expect_text(nacre_material_allocate(&bad, true, false, &error), &error, "2 channels");
    bad = good;
    bad.window = 4;
    expect_text(nacre_material_allocate(&bad, true, false, &error), &error, "a window of 4");
    bad = good;
    bad.terms = 0;
    expect_text(nacre_material_allocate(&bad, true, false, &error), &error, "0 terms");
    bad = good;
    bad.mixed = 3;
    expect_text(nacre_material_allocate(&bad, true, false, &error), &error,
                "2 clusters, 3 mixed at a point");
    bad = good;
    bad.layout = NACRE_KERNEL_PER_TERM;
    expect_text(nacre_material_allocate(&bad, true, false, &error), &error, "has no clusters");
    TEST_ASSERT_NULL(bad.f);
    nacre_material_finish(NULL);
}

/* Change a good material's file and expect the reader's words. */
static void expect_refusal(struct made_material wanted, void (*change)(struct exr_file *file),
                           const char *text)
{
    struct nacre_error error = {0};
    struct exr_file file;
    struct nacre_material material = made_material(wanted);
    write_material("m.exr", &material);
    nacre_material_finish(&material);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_read(scratch_path("m.exr"), &file, &error));
    change(&file);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, exr_file_write(scratch_path("m.exr"), &file, EXR_ZIP, &error), error.text);
    exr_file_finish(&file);
    scratch_hush();
    int status = nacre_material_read(scratch_path("m.exr"), &material, &error);
    scratch_hush_end();
    expect_text(status, &error, text);
    TEST_ASSERT_NOT_NULL(strstr(error.text, "m.exr: "));
    TEST_ASSERT_NULL(material.f);
}

static struct exr_attribute *attribute(struct exr_file *file, const char *name)
{
    struct exr_part *part = &file->parts[0];
    for (size_t i = 0; i < part->attribute_count; i++) {
        if (strcmp(part->attributes[i].name, name) == 0) {
            return &part->attributes[i];
        }
    }
    TEST_FAIL_MESSAGE(name);
    return NULL;
}

static void rename_attribute(struct exr_file *file, const char *name)
{
    (void)snprintf(attribute(file, name)->name, 64, "%s", "nacre.other");
}

static void set_string(struct exr_file *file, const char *name, const char *text)
{
    free(attribute(file, name)->string);
    attribute(file, name)->string = strdup(text);
}

static void without_format(struct exr_file *file)
{
    rename_attribute(file, "nacre.format");
}

static void with_other_format(struct exr_file *file)
{
    set_string(file, "nacre.format", "material 3");
}

static void with_other_kernels(struct exr_file *file)
{
    set_string(file, "nacre.kernels", "many");
}

static void without_pitch(struct exr_file *file)
{
    rename_attribute(file, "nacre.pitch");
}

static void with_pitch_zero(struct exr_file *file)
{
    attribute(file, "nacre.pitch")->real = 0;
}

static void without_seed(struct exr_file *file)
{
    rename_attribute(file, "nacre.seed");
}

static void without_clusters(struct exr_file *file)
{
    rename_attribute(file, "nacre.clusters");
}

static void with_even_window(struct exr_file *file)
{
    attribute(file, "nacre.window")->integer = 4;
}

static void with_other_window(struct exr_file *file)
{
    attribute(file, "nacre.window")->integer = 7;
}

static void with_many_terms(struct exr_file *file)
{
    attribute(file, "nacre.terms")->integer = 4096;
}

static void with_hostile_terms(struct exr_file *file)
{
    attribute(file, "nacre.terms")->integer = 2147483647;
}

static void with_hostile_clusters(struct exr_file *file)
{
    attribute(file, "nacre.clusters")->integer = 4096;
}

static void with_long_method(struct exr_file *file)
{
    set_string(file, "nacre.method", "a method whose name is much longer than a method's name");
}

static void with_short_error_history(struct exr_file *file)
{
    static const float values[2] = {1, 2};
    (void)exr_part_add_floats(&file->parts[0], "nacre.history.objective", values, 2);
    (void)exr_part_add_floats(&file->parts[0], "nacre.history.seconds", values, 2);
    (void)exr_part_add_floats(&file->parts[0], "nacre.history.error", values, 1);
}

static void with_short_history(struct exr_file *file)
{
    static const float values[2] = {1, 2};
    (void)exr_part_add_floats(&file->parts[0], "nacre.history.objective", values, 2);
    (void)exr_part_add_floats(&file->parts[0], "nacre.history.seconds", values, 1);
}

static void without_part(struct exr_file *file, const char *name)
{
    (void)snprintf(exr_file_find_part(file, name)->name, 64, "%s", "other");
}

static void without_albedo(struct exr_file *file)
{
    without_part(file, "albedo");
}

static void without_factor(struct exr_file *file)
{
    without_part(file, "F");
}

static void without_kernel(struct exr_file *file)
{
    without_part(file, "kernel");
}

static void without_cluster(struct exr_file *file)
{
    without_part(file, "cluster");
}

static void with_smaller_h(struct exr_file *file)
{
    exr_file_find_part(file, "H")->height = 8;
}

static void with_smaller_factor(struct exr_file *file)
{
    exr_file_find_part(file, "F")->width = 10;
}

static void rename_plane(struct exr_file *file, const char *part, const char *from, const char *to)
{
    (void)snprintf(exr_part_find_plane(exr_file_find_part(file, part), from)->name, 64, "%s", to);
}

static void with_term_twice(struct exr_file *file)
{
    rename_plane(file, "F", "t00.R", "t1.R");
}

static void with_unknown_term(struct exr_file *file)
{
    rename_plane(file, "F", "t02.G", "t03.G");
}

static void with_unknown_channel(struct exr_file *file)
{
    rename_plane(file, "H", "t02.G", "t02.A");
}

static void with_unparsable_term(struct exr_file *file)
{
    rename_plane(file, "F", "t02.G", "t-2.G");
}

static void with_unknown_albedo(struct exr_file *file)
{
    rename_plane(file, "albedo", "G", "A");
}

static void with_extra_kernel_channel(struct exr_file *file)
{
    (void)exr_part_add_plane(exr_file_find_part(file, "kernel"), "A", NACRE_FLOAT);
}

static void with_integer_factor(struct exr_file *file)
{
    exr_part_find_plane(exr_file_find_part(file, "F"), "t01.B")->pixel = NACRE_UINT;
}

static void with_float_ids(struct exr_file *file)
{
    exr_part_find_plane(exr_file_find_part(file, "cluster"), "id0")->pixel = NACRE_FLOAT;
}

static void with_unknown_id(struct exr_file *file)
{
    exr_part_find_plane(exr_file_find_part(file, "cluster"), "id0")->integers[98] = 77;
}

static void with_wrong_weight(struct exr_file *file)
{
    exr_part_find_plane(exr_file_find_part(file, "cluster"), "w0")->values[0] = 0.5f;
}

static void with_lone_weight(struct exr_file *file)
{
    (void)exr_part_add_plane(exr_file_find_part(file, "cluster"), "w1", NACRE_FLOAT);
}

static void with_infinite_kernel(struct exr_file *file)
{
    exr_part_find_plane(exr_file_find_part(file, "kernel"), "B")->values[30] = INFINITY;
}

static void with_negative_centre(struct exr_file *file)
{
    exr_part_find_plane(exr_file_find_part(file, "centre"), "R")->values[0] = -1;
}

static void with_clusters_per_term(struct exr_file *file)
{
    struct exr_part *part = exr_file_add_part(file, "cluster", 11, 9);
    (void)exr_part_add_plane(part, "id0", NACRE_UINT);
    (void)exr_part_add_plane(part, "w0", NACRE_FLOAT);
}

static void wrong_attributes_are_refused_by_name(void)
{
    expect_refusal(paper, without_format, "not a material: the attribute nacre.format is missing");
    expect_refusal(
        paper, with_other_format,
        "nacre.format is \"material 3\", and this program reads \"material 1\" and \"material 2\"");
    expect_refusal(paper, with_other_kernels, "nacre.kernels is \"many\"; it must be single");
    expect_refusal(paper, without_pitch, "part albedo: the attribute nacre.pitch (float)");
    expect_refusal(paper, with_pitch_zero, "nacre.pitch is 0 mm; it must be positive");
    expect_refusal(paper, without_seed, "the attribute nacre.seed (int) is missing");
    expect_refusal(paper, without_clusters, "the attribute nacre.clusters (int) is missing");
    expect_refusal(paper, with_even_window, "a window of 4");
    expect_refusal(paper, with_other_window, "part kernel is 5 x 20 pixels; it must be 7 x 28");
    expect_refusal(paper, with_many_terms, "part F has 9 channels; it must have 12288");
    expect_refusal(paper, with_hostile_terms, "2147483647 terms");
    expect_refusal(paper, with_hostile_clusters, "part kernel is 5 x 20 pixels; it must be 5 x");
    expect_refusal(paper, with_long_method, "nacre.method is longer than 31 characters");
    expect_refusal(paper, with_short_history, "differ in length");
    expect_refusal(paper, with_short_error_history, "nacre.history.error differ in length");
}

static void wrong_parts_are_refused_by_name(void)
{
    expect_refusal(paper, without_albedo, "the first part is \"other\"; it must be albedo");
    expect_refusal(paper, without_factor, "part F is missing");
    expect_refusal(paper, without_kernel, "part kernel is missing");
    expect_refusal(paper, without_cluster, "part cluster is missing");
    expect_refusal(paper, with_smaller_h, "part H is 11 x 8 pixels; it must be 11 x 9");
    expect_refusal(paper, with_smaller_factor, "part F is 10 x 9 pixels; it must be 11 x 9");
    expect_refusal(per_term, with_clusters_per_term,
                   "part cluster: a material with a kernel per term has none");
}

static void wrong_channels_are_refused_by_name(void)
{
    expect_refusal(paper, with_term_twice, "part F: channel t1.R is there twice");
    expect_refusal(paper, with_unknown_term, "part F: channel t03.G is none of t0 to t2");
    expect_refusal(paper, with_unknown_channel, "part H: channel t02.A is none of");
    expect_refusal(paper, with_unparsable_term, "part F: channel t-2.G is none of");
    expect_refusal(paper, with_unknown_albedo, "part albedo: channel G is missing");
    expect_refusal(paper, with_extra_kernel_channel, "part kernel has 4 channels; it must have 3");
    expect_refusal(paper, with_integer_factor, "part F: channel t01.B must be HALF or FLOAT");
    expect_refusal(paper, with_float_ids, "part cluster: channel id0 must be UINT");
    expect_refusal(paper, with_lone_weight, "part cluster has 3 channels");
}

static void wrong_values_are_refused_by_point(void)
{
    expect_refusal(paper, with_unknown_id, "the id at (10, 8) is 77, and there are 4 clusters");
    expect_refusal(paper, with_wrong_weight, "the weights at (0, 0) sum to 0.5, not 1");
    expect_refusal(paper, with_infinite_kernel,
                   "part kernel: kernel 1, channel B: the value at (0, 1) is inf");
    expect_refusal(per_term, with_negative_centre,
                   "part centre: plane 0, channel R: the value at "
                   "(0, 0) is -1");
}

/* Channel order means nothing, and the number after t is parsed. */
static void shuffled_and_renumbered_channels_are_understood(void)
{
    struct nacre_error error = {0};
    struct exr_file file;
    struct nacre_material material = made_material(paper);
    struct nacre_material back;
    write_material("m.exr", &material);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_read(scratch_path("m.exr"), &file, &error));
    rename_plane(&file, "F", "t00.R", "t0000.R");
    rename_plane(&file, "F", "t02.B", "t2.B");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, exr_file_write(scratch_path("m.exr"), &file, EXR_ZIP, &error));
    exr_file_finish(&file);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_read(scratch_path("m.exr"), &back, &error), error.text);
    expect_same(material.f, back.f, (size_t)3 * 3 * 99);
    nacre_material_finish(&material);
    nacre_material_finish(&back);
}

static void file_cut_off_anywhere_is_refused(void)
{
    struct nacre_error error = {0};
    size_t size = 0;
    struct nacre_material material = made_material(per_term);
    write_material("m.exr", &material);
    nacre_material_finish(&material);
    unsigned char *bytes = scratch_load("m.exr", &size);
    scratch_hush();
    for (size_t length = 0; length < size; length += 23) {
        scratch_store("cut.exr", bytes, length);
        expect_text(nacre_material_read(scratch_path("cut.exr"), &material, &error), &error,
                    "cut.exr: ");
    }
    scratch_store("cut.exr", bytes, size - 1);
    expect_text(nacre_material_read(scratch_path("cut.exr"), &material, &error), &error,
                "part centre: ");
    scratch_hush_end();
    free(bytes);
}

static void damaged_bytes_never_crash(void)
{
    uint32_t state = 3;
    size_t size = 0;
    int refused = 0;
    struct made_material wanted = paper;
    wanted.pixel = NACRE_HALF;
    struct nacre_material material = made_material(wanted);
    write_material("m.exr", &material);
    nacre_material_finish(&material);
    unsigned char *bytes = scratch_load("m.exr", &size);
    scratch_hush();
    for (int i = 0; i < 1500; i++) {
        state = state * 1664525u + 1013904223u;
        size_t at = (state >> 8) % (i % 3 ? 2000 : size);
        unsigned char before = bytes[at];
        bytes[at] ^= (unsigned char)(1u << (state >> 5) % 8);
        scratch_store("bad.exr", bytes, size);
        refused += nacre_material_read(scratch_path("bad.exr"), &material, NULL) != NACRE_OK;
        nacre_material_finish(&material);
        bytes[at] = before;
    }
    scratch_hush_end();
    TEST_ASSERT_TRUE(refused > 300);
    free(bytes);
}

static void full_disk_leaves_the_old_material_alone(void)
{
    struct nacre_error error = {0};
    struct nacre_material material = made_material(paper);
    size_t size = 0;
    scratch_store("m.exr", "old", 3);
    scratch_limit_files(3000);
    int status = nacre_material_write(scratch_path("m.exr"), &material, &error);
    scratch_limit_files(0);
    expect_text(status, &error, "File too large");
    TEST_ASSERT_EQUAL_INT(1, scratch_count());
    free(scratch_load("m.exr", &size));
    TEST_ASSERT_EQUAL_UINT64(3, size);
    expect_text(nacre_material_write(scratch_path("no/m.exr"), &material, &error), &error,
                "does not exist");
    nacre_material_finish(&material);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(every_layout_comes_back_bit_for_bit);
    RUN_TEST(numbers_history_and_warnings_come_back);
    RUN_TEST(a_long_history_is_thinned);
    RUN_TEST(size_counts_every_stored_number);
    RUN_TEST(values_that_no_model_has_are_not_written);
    RUN_TEST(sizes_that_cannot_be_are_not_allocated);
    RUN_TEST(wrong_attributes_are_refused_by_name);
    RUN_TEST(wrong_parts_are_refused_by_name);
    RUN_TEST(wrong_channels_are_refused_by_name);
    RUN_TEST(wrong_values_are_refused_by_point);
    RUN_TEST(shuffled_and_renumbered_channels_are_understood);
    RUN_TEST(file_cut_off_anywhere_is_refused);
    RUN_TEST(damaged_bytes_never_crash);
    RUN_TEST(full_disk_leaves_the_old_material_alone);
    return UNITY_END();
}
