/* Scene files: the documented one, the shipped ones, and wrong ones. */
#include "render/scene.h"
#include "tests/docs.h"
#include "tests/nacre/scratch.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct scene scene;
static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
    scene_finish(&scene);
}

static int parse(const char *text)
{
    return scene_parse("scene.yaml", "/folder", text, strlen(text), &scene, &error);
}

static void documented_example_is_read(void)
{
    char *text = docs_example("formats.md", "scene.yaml");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(text), error.text);
    free(text);
    TEST_ASSERT_EQUAL_UINT64(4, scene.light_count);
    TEST_ASSERT_EQUAL_UINT64(2, scene.object_count);
    TEST_ASSERT_EQUAL_INT(LIGHT_PROJECTOR, scene.lights[1].kind);
    TEST_ASSERT_EQUAL_INT(PATTERN_CHECKS, scene.lights[1].texture.pattern);
    TEST_ASSERT_EQUAL_STRING("/folder/material.exr", scene.objects[0].material.file);
    TEST_ASSERT_EQUAL_DOUBLE(1.4, scene.objects[0].material.point_mm);
    TEST_ASSERT_NULL(scene.objects[1].material.file);
    TEST_ASSERT_EQUAL_DOUBLE(0.42, scene.objects[1].color[2]);
    TEST_ASSERT_TRUE(scene.environment.line > 0);
    TEST_ASSERT_EQUAL_DOUBLE(0.13, scene.environment.color[2]);
    TEST_ASSERT_EQUAL_INT(1, scene.bounces);
    TEST_ASSERT_EQUAL_DOUBLE(1.3, scene.objects[0].index);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, scene.objects[0].gloss.reflection);
    TEST_ASSERT_EQUAL_DOUBLE(1, scene.objects[1].index);
}

static void shipped_scenes_are_read(void)
{
    static const char *const names[] = {"area",
                                        "albedo",
                                        "projector",
                                        "gallery/bunny-area",
                                        "gallery/bunny-albedo",
                                        "gallery/bunny-projector",
                                        "gallery/knot",
                                        "gallery/terrain",
                                        "gallery/vessel",
                                        "gallery/vessel-projector"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char path[1024];
        (void)snprintf(path, sizeof path, "%s/%s.yaml", EXAMPLES, names[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scene_read(path, &scene, &error), error.text);
        TEST_ASSERT_EQUAL_INT(strstr(names[i], "albedo") ? MODE_ALBEDO : MODE_FULL,
                              scene.objects[0].material.mode);
        scene_finish(&scene);
    }
}

#define CAMERA "camera: {position_mm: [0, -9, 9], at_mm: [0, 0, 0]}\n"
#define LIGHT  "lights: [{kind: point, position_mm: [0, 0, 9]}]\n"
#define OBJECT "objects: [{shape: quad}]\n"

static void defaults_fill_what_is_left_out(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(CAMERA LIGHT OBJECT), error.text);
    TEST_ASSERT_EQUAL_INT(640, scene.image.width);
    TEST_ASSERT_EQUAL_DOUBLE(1, scene.camera.up[2]);
    TEST_ASSERT_EQUAL_DOUBLE(1, scene.lights[0].irradiance[1]);
    TEST_ASSERT_EQUAL_DOUBLE(100, scene.objects[0].size_mm[1]);
    TEST_ASSERT_NULL(scene.objects[0].material.file);
}

/* The scene must be refused with a message that begins with `place` and holds `why`. */
static void refuses(const char *text, const char *place, const char *why)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_FAILED, parse(text), text);
    TEST_ASSERT_EQUAL_STRING_LEN_MESSAGE(place, error.text, strlen(place), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL(scene.objects);
}

static void unknown_keys_are_refused_with_their_place(void)
{
    refuses(CAMERA LIGHT "objects:\n  - shape: quad\n    colour: 1\n",
            "scene.yaml:5:5: ", "colour");
    refuses(CAMERA "lights: [{kind: point, position_mm: [0, 0, 9], softnes: 2}]\n" OBJECT,
            "scene.yaml:2:48: ", "softnes");
}

static void wrong_values_are_refused_with_their_place(void)
{
    refuses(CAMERA LIGHT "objects: [{shape: cube}]\n", "scene.yaml:3:19: ", "cube");
    refuses(CAMERA LIGHT "objects: [{shape: quad, color: 1.5}]\n", "scene.yaml:3:", "1.5");
    refuses("image: {width: 0}\n" CAMERA LIGHT OBJECT, "scene.yaml:1:16: ", "width");
    refuses(CAMERA LIGHT "objects: [{shape: quad, material: {mapping: box}}]\n",
            "scene.yaml:3:", "file");
    refuses(LIGHT OBJECT, "scene.yaml", "camera");
}

static void scenes_that_make_no_sense_are_refused_with_their_place(void)
{
    refuses("image: {background: 0.1}\n" CAMERA LIGHT OBJECT "environment: {color: 1}\n",
            "scene.yaml:5:14: ", "background");
    refuses(CAMERA LIGHT OBJECT "without: [moonshine]\n", "scene.yaml:4:11: ", "moonshine");
    refuses(CAMERA LIGHT OBJECT "without: [colour]\n", "scene.yaml:4:11: ", "colour");
    refuses(CAMERA LIGHT "objects: [{shape: quad, index: 0.5}]\n", "scene.yaml:3:32: ", "0.5");
    refuses(CAMERA LIGHT OBJECT "bounces: 17\n", "scene.yaml:4:10: ", "17");
    refuses("camera: {position_mm: [1, 2, 3], at_mm: [1, 2, 3]}\n" LIGHT OBJECT,
            "scene.yaml:1:9: ", "same point");
    refuses("camera: {position_mm: [0, 0, 9], at_mm: [0, 0, 0]}\n" LIGHT OBJECT,
            "scene.yaml:1:9: ", "up");
    refuses(CAMERA "lights:\n  - {kind: point, position_mm: [0, 0, 0]}\n" OBJECT,
            "scene.yaml:3:5: ", "same point");
    refuses(CAMERA "lights:\n  - {kind: projector, position_mm: [0, 0, 9]}\n" OBJECT,
            "scene.yaml:3:5: ", "texture");
    refuses(CAMERA
            "lights: [{kind: spot, position_mm: [0, 0, 9], texture: {pattern: grid}}]\n" OBJECT,
            "scene.yaml:2:56: ", "projector");
    refuses(CAMERA "lights:\n  - kind: projector\n    position_mm: [0, 0, 9]\n"
                   "    texture: {pattern: grid, image: a.png}\n" OBJECT,
            "scene.yaml:5:14: ", "leave one out");
    refuses(CAMERA LIGHT "objects:\n  - {shape: mesh}\n", "scene.yaml:4:5: ", "file");
    refuses(CAMERA LIGHT "objects: [{shape: quad, file: a.ply}]\n", "scene.yaml:3:11: ", "mesh");
    refuses(CAMERA LIGHT "objects: []\n", "scene.yaml:3:1: ", "no objects");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(documented_example_is_read);
    RUN_TEST(shipped_scenes_are_read);
    RUN_TEST(defaults_fill_what_is_left_out);
    RUN_TEST(unknown_keys_are_refused_with_their_place);
    RUN_TEST(wrong_values_are_refused_with_their_place);
    RUN_TEST(scenes_that_make_no_sense_are_refused_with_their_place);
    return UNITY_END();
}
