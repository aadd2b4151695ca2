/* The file of a material with a kernel per term. */
#include "bench.h"
#include "device.h"
#include "recipe.h"

#include "nacre/exr_file.h"
#include "tests/files.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct opencl opencl;
static char *folder;

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

static int compare_floats(const void *a, const void *b)
{
    float left = *(const float *)a, right = *(const float *)b;
    return (left > right) - (left < right);
}

static int distinct(const float *values, size_t count)
{
    float *sorted = malloc(count * sizeof *sorted);
    int found = 1;
    TEST_ASSERT_NOT_NULL(sorted);
    memcpy(sorted, values, count * sizeof *sorted);
    qsort(sorted, count, sizeof *sorted, compare_floats);
    for (size_t i = 1; i < count; i++) {
        found += sorted[i] != sorted[i - 1];
    }
    free(sorted);
    return found;
}

/* Values are told by formulas and not listed, a kilobyte a part. */
static void expect_formulas(const char *path)
{
    static const char *const parts[][2] = {
        {"F", "nacre.roots"}, {"centre", "nacre.logarithms"}, {"albedo", "nacre.logarithms"}};
    struct exr_file file = {0};
    struct nacre_error error = {0};
    bench_succeed(exr_file_read(path, &file, &error), &error);
    for (size_t i = 0; i < 3; i++) {
        const struct exr_part *part = exr_file_find_part(&file, parts[i][0]);
        TEST_ASSERT_NOT_NULL(part);
        TEST_ASSERT_NOT_NULL_MESSAGE(exr_part_find(part, parts[i][1], EXR_FLOATS), parts[i][0]);
        TEST_ASSERT_NULL(exr_part_find(part, "nacre.values", EXR_FLOATS));
    }
    exr_file_finish(&file);
}

/* What is read back is what was written, bit for bit, and planes have no more values than their bits say. */
static void files_hold_planes_of_few_values(void)
{
    const int bits[] = {8, 6, 3};
    struct recipe recipe = {.noise = true, .slope = 0.4, .scale = 1};
    struct sample sample = recipe_make(&recipe, 20, 16, 3, 7);
    char *path = path_join(folder, "m.exr");
    for (int i = 0; i < 3; i++) {
        struct factor_options options = recipe_options(3, 8);
        struct factor_summary summary;
        struct nacre_error error = {0};
        struct nacre_material back, m;
        options.bits = bits[i];
        options.reciprocity = i == 0 ? TERMS_GAINED : TERMS_RECIPROCAL;
        m = recipe_fit(&opencl, &sample, &options, &summary);
        bench_succeed(nacre_material_write(path, &m, &error), &error);
        bench_succeed(nacre_material_read(path, &back, &error), &error);
        size_t points = 20 * 16, area = 49;
        TEST_ASSERT_EQUAL_MEMORY(m.f, back.f, 3 * points * sizeof(float));
        TEST_ASSERT_EQUAL_MEMORY(m.centre, back.centre, 3 * points * sizeof(float));
        TEST_ASSERT_EQUAL_MEMORY(m.kernels, back.kernels, 9 * area * sizeof(float));
        TEST_ASSERT_EQUAL_MEMORY(m.albedo, back.albedo, 3 * points * sizeof(float));
        TEST_ASSERT_TRUE(distinct(m.albedo, 3 * points) <= 64);
        TEST_ASSERT_EQUAL_INT(i == 0, back.gain != NULL);
        TEST_ASSERT_EQUAL_INT(i == 0, back.h != NULL);
        for (size_t t = 0; i > 0 && t < 3; t++) {
            TEST_ASSERT_TRUE(distinct(m.f + t * points, points) <= 1 << bits[i]);
            TEST_ASSERT_TRUE(distinct(m.centre + t * points, points) <= 256);
        }
        /* Planes and gain at their bits, the centre at 8, 3 x 3 profiles of floats. */
        size_t planes = 3 + (i == 0 ? 1 : 0);
        TEST_ASSERT_EQUAL_INT((points * (planes * (size_t)bits[i] + 3 * 8) + 7) / 8 +
                                  9 * (size_t)m.radii * sizeof(float),
                              nacre_material_size(&m));
        expect_formulas(path);
        factor_summary_finish(&summary);
        nacre_material_finish(&m);
        nacre_material_finish(&back);
    }
    free(path);
    sample_finish(&sample);
}

/* Change one thing in a good file, and expect the reading to be refused with a word. */
static void expect_refused(const char *path, int what, const char *word)
{
    struct exr_file file;
    struct nacre_error error = {0};
    struct nacre_material m;
    char *changed = path_join(folder, "changed.exr");
    bench_succeed(exr_file_read(path, &file, &error), &error);
    for (size_t i = 0; i < file.parts[0].attribute_count; i++) {
        struct exr_attribute *a = &file.parts[0].attributes[i];
        if (what == 0 && strcmp(a->name, "nacre.radii") == 0) {
            a->floats[2] = a->floats[1];
        }
        if (what == 1 && strcmp(a->name, "nacre.radii") == 0) {
            a->count--;
        }
    }
    for (size_t p = 0; p < file.part_count && what >= 4; p++) {
        for (size_t i = 0; i < file.parts[p].attribute_count; i++) {
            struct exr_attribute *a = &file.parts[p].attributes[i];
            bool roots = strcmp(a->name, "nacre.roots") == 0;
            bool logarithms = strcmp(a->name, "nacre.logarithms") == 0;
            if (what == 4 && roots) {
                a->floats[1] = 1e9F; /* so many numbers */
            }
            if (what == 5 && roots) {
                a->count--;
            }
            if (what == 6 && logarithms) {
                a->floats[0] = 0; /* the least value */
            }
            if (what == 7 && logarithms) {
                a->floats[1] = NAN;
            }
        }
    }
    if (what == 2) {
        exr_file_find_part(&file, "F")->planes[0].values[5] = 1000 * 0x1p-24F;
    }
    if (what == 3) {
        exr_file_find_part(&file, "gain")->planes[0].values[5] = 0;
    }
    bench_succeed(exr_file_write(changed, &file, EXR_ZIP, &error), &error);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, nacre_material_read(changed, &m, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, word), error.text);
    exr_file_finish(&file);
    free(changed);
}

static void damaged_files_are_refused(void)
{
    struct recipe recipe = {.noise = true, .slope = 0.4, .scale = 1};
    struct sample sample = recipe_make(&recipe, 20, 16, 1, 7);
    struct factor_options options = recipe_options(2, 3);
    struct factor_summary summary;
    struct nacre_error error = {0};
    char *path = path_join(folder, "m.exr");
    options.reciprocity = TERMS_GAINED;
    struct nacre_material m = recipe_fit(&opencl, &sample, &options, &summary);
    bench_succeed(nacre_material_write(path, &m, &error), &error);
    expect_refused(path, 0, "nacre.radii");
    expect_refused(path, 1, "part kernel");
    expect_refused(path, 2, "no number of");
    expect_refused(path, 4, "nacre.roots");
    expect_refused(path, 5, "nacre.roots");
    expect_refused(path, 6, "nacre.logarithms");
    expect_refused(path, 7, "nacre.logarithms");
    expect_refused(path, 3, "part gain");
    free(path);
    factor_summary_finish(&summary);
    nacre_material_finish(&m);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(files_hold_planes_of_few_values);
    RUN_TEST(damaged_files_are_refused);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
