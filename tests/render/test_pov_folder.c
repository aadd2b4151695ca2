/* Folders for POV-Ray are to be edited: what somebody has changed, or never came from nacre, is not overwritten. */
#include "render/pov_folder.h"

#include "render/render.h"
#include "stand.h"
#include "tests/nacre/scratch.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

static struct scene scene;
static struct picture picture;
static struct render_report report;
static struct nacre_error error;

/* One of each kind of file. The sky is asked for by name, beside the folder's own files. */
static const char *const written[] = {"scene.pov", "object-0.inc", "slide-0.exr",
                                      "environment.exr"};
enum { WRITTEN = sizeof written / sizeof *written };

#define SCENE(exposure)                                                                            \
    "image: {width: 16, height: 12, exposure: " exposure "}\n"                                     \
    "camera: {position_mm: [0.01, -90, 40], at_mm: [0, 0, 0]}\n"                                   \
    "environment: {image: sky.exr}\n"                                                              \
    "lights: [{kind: projector, position_mm: [10, 5, 60], at_mm: [2, 0, 0], up: [0, 1, 0], "       \
    "texture: {pattern: checks}}]\n"                                                               \
    "objects: [{shape: quad, size_mm: [40, 40, 1], color: 0.8}]\n"

static void write_grey(const char *path, int width, float value, const char *const *attributes)
{
    struct picture grey;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&grey, width, width / 2, &error));
    for (int i = 0; i < width * (width / 2) * 3; i++) {
        grey.rgb[i] = value;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_write(path, &grey, attributes, &error),
                                  error.text);
    picture_finish(&grey);
}

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
    write_grey(scratch_path("sky.exr"), 16, 0.25F, NULL);
}

static void forget(void)
{
    scene_finish(&scene);
    picture_finish(&picture);
    render_report_finish(&report);
}

void tearDown(void)
{
    forget();
    scratch_remove();
}

static int render(const char *text)
{
    forget();
    const struct render_settings settings = {
        .bake = {.density = 16, .rays = 4, .seed = 1, .quiet = true},
        .triangle_limit = 200000,
        .pov_folder = scratch_path("")};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, scene_parse("scene.yaml", scratch_path(""), text, strlen(text), &scene, &error),
        error.text);
    return render_scene(&scene, &settings, stand_opencl(), &picture, &report, &error);
}

static void must_render(const char *text)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, render(text), error.text);
}

static void check_same(const char *name, const unsigned char *bytes, size_t size)
{
    size_t now = 0;
    unsigned char *found = scratch_load(name, &now);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(size, now, name);
    TEST_ASSERT_TRUE_MESSAGE(size == 0 || memcmp(bytes, found, size) == 0, name);
    free(found);
}

/* Rendering must name the file, before any mesh is looked at, and change nothing. */
static void must_refuse(const char *name)
{
    unsigned char *bytes[WRITTEN] = {NULL};
    size_t sizes[WRITTEN] = {0};
    int before = scratch_count();
    for (int i = 0; i < WRITTEN; i++) {
        if (access(scratch_path(written[i]), F_OK) == 0) {
            bytes[i] = scratch_load(written[i], &sizes[i]);
        }
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_FAILED, render(SCENE("3")), name);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, name), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "another folder"), error.text);
    TEST_ASSERT_NULL(report.objects);
    TEST_ASSERT_EQUAL_INT(before, scratch_count());
    for (int i = 0; i < WRITTEN; i++) {
        if (bytes[i]) {
            check_same(written[i], bytes[i], sizes[i]);
        }
        free(bytes[i]);
    }
}

static void files_that_nobody_changed_are_written_over(void)
{
    unsigned char *before[WRITTEN];
    size_t sizes[WRITTEN];
    must_render(SCENE("1"));
    for (int i = 0; i < WRITTEN; i++) {
        before[i] = scratch_load(written[i], &sizes[i]);
    }
    must_render(SCENE("2"));
    must_render(SCENE("1"));
    for (int i = 0; i < WRITTEN; i++) {
        check_same(written[i], before[i], sizes[i]);
        free(before[i]);
    }
}

/* One more of something, as an editor would leave it. */
static void edit_text(const char *name, const unsigned char *bytes, size_t size)
{
    unsigned char *edited = malloc(size);
    TEST_ASSERT_NOT_NULL(edited);
    memcpy(edited, bytes, size);
    char *digit = memchr(edited + size / 2, '0', size - size / 2);
    TEST_ASSERT_NOT_NULL_MESSAGE(digit, name);
    *digit = '1';
    scratch_store(name, edited, size);
    free(edited);
}

/* As an editor that keeps attributes would: one value of one pixel, a little. */
static void edit_picture(const char *name, const unsigned char *bytes, size_t size)
{
    static const char key[] = "nacre.crc32\0string\0\x08\0\0";
    char attribute[] = "crc32=01234567";
    const char *const attributes[] = {attribute, NULL};
    struct picture edited;
    size_t at = scratch_find(bytes, size, key, sizeof key);
    memcpy(attribute + strlen("crc32="), bytes + at + sizeof key, 8);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_read(scratch_path(name), &edited, &error));
    edited.rgb[5] = edited.rgb[5] * 1.002F + 0.001F;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(scratch_path(name), &edited, attributes, &error));
    picture_finish(&edited);
}

static void a_file_that_was_edited_is_kept(void)
{
    must_render(SCENE("1"));
    for (int i = 0; i < WRITTEN; i++) {
        size_t size = 0;
        unsigned char *bytes = scratch_load(written[i], &size);
        (strstr(written[i], ".exr") ? edit_picture : edit_text)(written[i], bytes, size);
        must_refuse(written[i]);
        scratch_store(written[i], bytes, size);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, pov_folder_check(scratch_path(""), &scene, &error),
                                      error.text);
        /* What is away is written again. */
        TEST_ASSERT_EQUAL_INT(0, unlink(scratch_path(written[i])));
        if (i > 0) { /* without it, what povray left would be of something else */
            TEST_ASSERT_EQUAL_INT_MESSAGE(
                NACRE_OK, pov_folder_check(scratch_path(""), &scene, &error), error.text);
        }
        scratch_store(written[i], bytes, size);
        free(bytes);
    }
}

static void several_edited_files_are_counted(void)
{
    must_render(SCENE("1"));
    scratch_store("object-0.inc", "", 0);
    scratch_store("slide-0.exr", "#", 1);
    must_refuse("object-0.inc (and 1 more)");
}

static void files_of_something_else_are_refused(void)
{
    static const char theirs[] = "#version 3.7;\nsphere { 0, 1 }\n";
    for (int i = 0; i < 2; i++) {
        scratch_store(written[i], theirs, strlen(theirs));
        must_refuse(written[i]);
        TEST_ASSERT_EQUAL_INT(0, unlink(scratch_path(written[i])));
    }
    for (int i = 2; i < WRITTEN; i++) {
        write_grey(scratch_path(written[i]), 8, 1, NULL);
        must_refuse(written[i]);
        TEST_ASSERT_EQUAL_INT(0, unlink(scratch_path(written[i])));
    }
    /* What povray itself writes carries no digest. */
    write_grey(scratch_path("picture.exr"), 8, 1, NULL);
    must_refuse("picture.exr");
}

static void files_that_are_not_written_are_nobodys_business(void)
{
    static const char plain[] =
        "image: {width: 16, height: 12}\ncamera: {position_mm: [0.01, -90, 40], at_mm: [0, 0, 0]}\n"
        "lights: [{kind: point, position_mm: [10, 5, 60]}]\n"
        "objects: [{shape: quad, size_mm: [40, 40, 1], color: 0.8}]\n";
    scratch_store("object-1.inc", "mine", 4);
    scratch_store("slide-0.exr", "mine", 4);
    scratch_store("environment.exr", "mine", 4);
    must_render(plain);
    check_same("object-1.inc", (const unsigned char *)"mine", 4);
    check_same("slide-0.exr", (const unsigned char *)"mine", 4);
    check_same("environment.exr", (const unsigned char *)"mine", 4);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(files_that_nobody_changed_are_written_over);
    RUN_TEST(a_file_that_was_edited_is_kept);
    RUN_TEST(several_edited_files_are_counted);
    RUN_TEST(files_of_something_else_are_refused);
    RUN_TEST(files_that_are_not_written_are_nobodys_business);
    return UNITY_END();
}
