/* Tests of reading and writing YAML settings by a schema. */
#include "base/number.h"
#include "base/settings.h"
#include "tests/files.h"
#include "unity.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char *folder;

/* Every test has an empty folder. */
void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

struct layer {
    double softness;
    char *name;
    double colour[3];
    int line;
};

struct optics {
    double focal_mm;
    int blades;
    char *glass; /* required, but only where `optics` is given */
};

struct sample {
    int width;
    double pitch_mm;
    char *title;
    char *texture;
    int medium;
    bool glossy;
    double white[3];
    struct optics optics;
    struct layer *layers;
    size_t layer_count;
    double *exposures;
    size_t exposure_count;
    char **without;
    size_t without_count;
    int subdivide; /* 0, which may not be typed: chosen */
    double thickness_mm;
    double gains[3];
    int line, medium_line;
};

static const struct settings_field layer_fields[] = {{.key = "softness",
                                                      .kind = SETTINGS_REAL,
                                                      .offset = offsetof(struct layer, softness),
                                                      .minimum = 0,
                                                      .maximum = 1,
                                                      .fallback = "0.3"},
                                                     {.key = "name",
                                                      .kind = SETTINGS_STRING,
                                                      .offset = offsetof(struct layer, name),
                                                      .required = true},
                                                     {.key = "colour",
                                                      .kind = SETTINGS_REALS,
                                                      .count = 3,
                                                      .offset = offsetof(struct layer, colour),
                                                      .fallback = "[0.1, 0.2, 0.3]"},
                                                     {0}};
static const struct settings_schema layer_schema = {.what = "layer",
                                                    .size = sizeof(struct layer),
                                                    .fields = layer_fields,
                                                    .line_offset = offsetof(struct layer, line)};

static const struct settings_field optics_fields[] = {{.key = "focal_mm",
                                                       .kind = SETTINGS_REAL,
                                                       .offset = offsetof(struct optics, focal_mm),
                                                       .fallback = "50"},
                                                      {.key = "blades",
                                                       .kind = SETTINGS_INT,
                                                       .offset = offsetof(struct optics, blades),
                                                       .fallback = "7"},
                                                      {.key = "glass",
                                                       .kind = SETTINGS_STRING,
                                                       .offset = offsetof(struct optics, glass),
                                                       .required = true},
                                                      {0}};
static const struct settings_schema optics_schema = {
    .what = "optics", .size = sizeof(struct optics), .fields = optics_fields};

static const char *const media[] = {"marble", "wax", "jade", NULL};

static const struct settings_field sample_fields[] = {
    {.key = "width",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct sample, width),
     .minimum = 1,
     .maximum = 99,
     .required = true,
     .sentence = "width in surface points"},
    {.key = "pitch_mm",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct sample, pitch_mm),
     .minimum = 1e-6,
     .maximum = INFINITY,
     .fallback = "0.5",
     .sentence = "distance of surface points, mm"},
    {.key = "title", .kind = SETTINGS_STRING, .offset = offsetof(struct sample, title)},
    {.key = "texture",
     .kind = SETTINGS_PATH,
     .offset = offsetof(struct sample, texture),
     .fallback = "default.png"},
    {.key = "medium",
     .kind = SETTINGS_CHOICE,
     .words = media,
     .offset = offsetof(struct sample, medium),
     .fallback = "wax",
     .line_offset = offsetof(struct sample, medium_line)},
    {.key = "glossy", .kind = SETTINGS_BOOL, .offset = offsetof(struct sample, glossy)},
    {.key = "white",
     .kind = SETTINGS_REALS,
     .count = 3,
     .offset = offsetof(struct sample, white),
     .fallback = "0.9",
     .minimum = 0.1,
     .maximum = 1},
    {.key = "optics",
     .kind = SETTINGS_STRUCT,
     .schema = &optics_schema,
     .offset = offsetof(struct sample, optics)},
    {.key = "layers",
     .kind = SETTINGS_LIST,
     .schema = &layer_schema,
     .offset = offsetof(struct sample, layers),
     .length_offset = offsetof(struct sample, layer_count)},
    {.key = "exposures",
     .kind = SETTINGS_NUMBERS,
     .offset = offsetof(struct sample, exposures),
     .length_offset = offsetof(struct sample, exposure_count),
     .minimum = 0,
     .maximum = INFINITY,
     .fallback = "[1, 4]"},
    {.key = "without",
     .kind = SETTINGS_STRINGS,
     .offset = offsetof(struct sample, without),
     .length_offset = offsetof(struct sample, without_count)},
    {.key = "subdivide",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct sample, subdivide),
     .minimum = 1,
     .maximum = 16},
    {.key = "thickness_mm",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct sample, thickness_mm),
     .minimum = 0.1,
     .maximum = INFINITY},
    {.key = "gains",
     .kind = SETTINGS_REALS,
     .count = 3,
     .offset = offsetof(struct sample, gains),
     .minimum = 1,
     .maximum = 2},
    {0}};
static const struct settings_schema sample_schema = {.what = "sample file",
                                                     .size = sizeof(struct sample),
                                                     .fields = sample_fields,
                                                     .line_offset = offsetof(struct sample, line)};

static int parse(const char *text, struct sample *sample, struct nacre_error *error)
{
    return settings_parse("s.yaml", "/samples", text, strlen(text), &sample_schema, sample, error);
}

/* The text is refused with exactly this message, and the struct is left zeroed. */
static void expect_refusal(const char *text, const char *message)
{
    static const struct sample zeroed;
    struct sample sample;
    struct nacre_error error = {""};
    memset(&sample, 0xee, sizeof sample);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_FAILED, parse(text, &sample, &error), text);
    TEST_ASSERT_EQUAL_STRING(message, error.text);
    TEST_ASSERT_EQUAL_MEMORY(&zeroed, &sample, sizeof sample);
}

static void reading_fills_in_defaults_also_in_structs_that_are_left_out(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse("width: 3", &sample, &error), error.text);
    TEST_ASSERT_EQUAL_INT(3, sample.width);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, sample.pitch_mm);
    TEST_ASSERT_NULL(sample.title);
    TEST_ASSERT_EQUAL_STRING("/samples/default.png", sample.texture);
    TEST_ASSERT_EQUAL_INT(1, sample.medium);
    TEST_ASSERT_EQUAL_DOUBLE(0.9, sample.white[2]);
    TEST_ASSERT_EQUAL_DOUBLE(50, sample.optics.focal_mm);
    TEST_ASSERT_EQUAL_INT(7, sample.optics.blades);
    TEST_ASSERT_EQUAL_UINT(0, sample.layer_count);
    TEST_ASSERT_EQUAL_UINT(2, sample.exposure_count);
    TEST_ASSERT_EQUAL_DOUBLE(4, sample.exposures[1]);
    TEST_ASSERT_EQUAL_UINT(0, sample.without_count);
    TEST_ASSERT_EQUAL_INT(1, sample.line);
    TEST_ASSERT_EQUAL_INT(0, sample.medium_line);
    settings_finish(&sample_schema, &sample);
    TEST_ASSERT_NULL(sample.texture);
}

static const char full[] = "# all there is\n"
                           "width: 12\n"
                           "pitch_mm: 2.5e-1\n"
                           "title: 'it''s'\n"
                           "texture: maps/veins.png\n"
                           "medium: jade\n"
                           "glossy: yes\n"
                           "white: [0.5, 0.6, 0.7]\n"
                           "optics: {focal_mm: 35, glass: flint}\n"
                           "layers:\n"
                           "  - name: top\n"
                           "    softness: 0.25\n"
                           "  - {name: '7', colour: 0.5}\n"
                           "exposures: [0.5, 1, 1e3]\n"
                           "without: [noise, \"flare\"]\n"
                           "subdivide: 4\n"
                           "gains: [1, 1.5, 2]\n";

static void reading_takes_every_kind_of_value(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(full, &sample, &error), error.text);
    TEST_ASSERT_EQUAL_INT(12, sample.width);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, sample.pitch_mm);
    TEST_ASSERT_EQUAL_STRING("it's", sample.title);
    TEST_ASSERT_EQUAL_STRING("/samples/maps/veins.png", sample.texture);
    TEST_ASSERT_EQUAL_INT(2, sample.medium);
    TEST_ASSERT_EQUAL_INT(6, sample.medium_line);
    TEST_ASSERT_TRUE(sample.glossy);
    TEST_ASSERT_EQUAL_DOUBLE(0.6, sample.white[1]);
    TEST_ASSERT_EQUAL_DOUBLE(35, sample.optics.focal_mm);
    TEST_ASSERT_EQUAL_INT(7, sample.optics.blades);
    TEST_ASSERT_EQUAL_UINT(2, sample.layer_count);
    TEST_ASSERT_EQUAL_STRING("top", sample.layers[0].name);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, sample.layers[0].softness);
    TEST_ASSERT_EQUAL_DOUBLE(0.2, sample.layers[0].colour[1]);
    TEST_ASSERT_EQUAL_INT(11, sample.layers[0].line);
    TEST_ASSERT_EQUAL_STRING("7", sample.layers[1].name);
    TEST_ASSERT_EQUAL_DOUBLE(0.3, sample.layers[1].softness);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, sample.layers[1].colour[2]);
    TEST_ASSERT_EQUAL_INT(13, sample.layers[1].line);
    TEST_ASSERT_EQUAL_UINT(3, sample.exposure_count);
    TEST_ASSERT_EQUAL_DOUBLE(1000, sample.exposures[2]);
    TEST_ASSERT_EQUAL_UINT(2, sample.without_count);
    TEST_ASSERT_EQUAL_STRING("flare", sample.without[1]);
    settings_finish(&sample_schema, &sample);
}

static void an_absolute_path_and_empty_lists_are_taken_as_they_are(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    const char *text = "width: 3\ntexture: /maps/a b.png\nexposures: []\nlayers: []\ntitle: ''\n";
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(text, &sample, &error), error.text);
    TEST_ASSERT_EQUAL_STRING("/maps/a b.png", sample.texture);
    TEST_ASSERT_EQUAL_UINT(0, sample.exposure_count);
    TEST_ASSERT_EQUAL_UINT(0, sample.layer_count);
    TEST_ASSERT_EQUAL_STRING("", sample.title);
    settings_finish(&sample_schema, &sample);
}

static void unknown_keys_are_refused_where_they_stand_and_the_nearest_is_named(void)
{
    expect_refusal("width: 3\nlayers:\n  - name: a\n    softnes: 1\n",
                   "s.yaml:4:5: unknown key 'softnes', perhaps 'softness'; known here: softness, "
                   "name, colour");
    expect_refusal("width: 3\noptics:\n  zoom: 1\n",
                   "s.yaml:3:3: unknown key 'zoom'; known here: focal_mm, blades, glass");
    expect_refusal("width: 3\n<<: {}\n",
                   "s.yaml:2:1: unknown key '<<'; known here: width, pitch_mm, title, texture, "
                   "medium, glossy, white, optics, layers, exposures, without, subdivide, "
                   "thickness_mm, gains");
    expect_refusal(
        "width: 3\n\"gloss\\0y\": 1\n",
        "s.yaml:2:1: unknown key 'gloss', perhaps 'glossy'; known here: width, pitch_mm, "
        "title, texture, medium, glossy, white, optics, layers, exposures, without, subdivide, "
        "thickness_mm, gains");
    expect_refusal("? [a]\n: 1\n", "s.yaml:1:3: a key must be a plain word");
}

static void keys_given_twice_or_missing_are_refused(void)
{
    expect_refusal("width: 3\ntitle: a\nwidth: 4\n",
                   "s.yaml:3:1: 'width' is given twice; first in line 1");
    expect_refusal("title: a\n",
                   "s.yaml:1:1: the sample file lacks the key 'width' (width in surface points)");
    expect_refusal("width: 3\nlayers:\n  - softness: 1\n",
                   "s.yaml:3:5: 'layers' lacks the key 'name'");
    expect_refusal("width: 3\noptics: {blades: 5}\n", "s.yaml:2:9: 'optics' lacks the key 'glass'");
}

static void numbers_outside_their_range_are_refused_with_the_range(void)
{
    expect_refusal("width: 0\n",
                   "s.yaml:1:8: width: 0 is out of range: 1 to 99 (width in surface points)");
    expect_refusal("width: 100\n",
                   "s.yaml:1:8: width: 100 is out of range: 1 to 99 (width in surface points)");
    expect_refusal("width: 99999999999999999999\n",
                   "s.yaml:1:8: width: 99999999999999999999 is out of range: 1 to 99 (width in "
                   "surface points)");
    expect_refusal("width: 3\npitch_mm: 0\n", "s.yaml:2:11: pitch_mm: 0 is out of range: at least "
                                              "1e-06 (distance of surface points, mm)");
    expect_refusal("width: 3\npitch_mm: 1e999\n",
                   "s.yaml:2:11: pitch_mm: 1e999 is out of range: at "
                   "least 1e-06 (distance of surface points, mm)");
    expect_refusal("width: 3\nwhite: [0.5, 2, 0.5]\n",
                   "s.yaml:2:14: white: 2 is out of range: 0.1 to 1");
    expect_refusal("width: 3\nexposures: [1, -1]\n",
                   "s.yaml:2:16: exposures: -1 is out of range: at least 0");
    expect_refusal("width: 3\noptics: {glass: a, blades: 9999999999}\n",
                   "s.yaml:2:28: blades: 9999999999 is out of range: -2147483648 to 2147483647");
}

static void values_of_the_wrong_kind_are_refused(void)
{
    expect_refusal("width: 3.5\n", "s.yaml:1:8: width: '3.5' is not a whole number");
    expect_refusal("width: '3'\n", "s.yaml:1:8: width: '3' is not a whole number");
    expect_refusal("width: 0x10\n", "s.yaml:1:8: width: '0x10' is not a whole number");
    expect_refusal("width: [3]\n", "s.yaml:1:8: 'width' is a sequence, not a whole number");
    expect_refusal("width: {a: 3}\n", "s.yaml:1:8: 'width' is a mapping, not a whole number");
    expect_refusal("width: 3\npitch_mm: wide\n", "s.yaml:2:11: pitch_mm: 'wide' is not a number");
    expect_refusal("width: 3\npitch_mm: .nan\n", "s.yaml:2:11: pitch_mm: '.nan' is not a number");
    expect_refusal("width: 3\npitch_mm: nan\n", "s.yaml:2:11: pitch_mm: 'nan' is not a number");
    expect_refusal("width: 3\nglossy: 1\n", "s.yaml:2:9: glossy: '1' is not true or false");
    expect_refusal("width: 3\ntitle: [a]\n", "s.yaml:2:8: 'title' is a sequence, not a text");
    expect_refusal("width: 3\ntexture: ''\n", "s.yaml:2:10: texture: the path is empty");
    expect_refusal("width: 3\nmedium: wex\n", "s.yaml:2:9: medium: 'wex' is not one of its words, "
                                              "perhaps 'wax'; they are: marble, wax, jade");
    expect_refusal("width: 3\nwhite: [1, 1]\n",
                   "s.yaml:2:8: 'white' takes a sequence of 3 numbers, or one number for all");
    expect_refusal("width: 3\nlayers: {name: a}\n",
                   "s.yaml:2:9: 'layers' takes a sequence of mappings, each after a dash");
    expect_refusal("width: 3\nlayers: [a]\n", "s.yaml:2:10: 'layers' takes 'key: value' lines; "
                                              "known here: softness, name, colour");
    expect_refusal("width: 3\noptics: 5\n", "s.yaml:2:9: 'optics' takes 'key: value' lines; known "
                                            "here: focal_mm, blades, glass");
    expect_refusal("width: 3\nexposures: 5\n",
                   "s.yaml:2:12: 'exposures' takes a sequence of numbers");
    expect_refusal("width: 3\nwithout: noise\n",
                   "s.yaml:2:10: 'without' takes a sequence of texts");
    expect_refusal("width: 3\nwithout: [a, [b]]\n",
                   "s.yaml:2:14: 'without' is a sequence, not a text");
    expect_refusal("- width: 3\n",
                   "s.yaml:1:1: the sample file takes 'key: value' lines; known here: "
                   "width, pitch_mm, title, texture, medium, glossy, white, optics, "
                   "layers, exposures, without, subdivide, thickness_mm, gains");
}

static void keys_without_a_value_are_refused(void)
{
    expect_refusal("width:\n",
                   "s.yaml:1:7: 'width' has no value; it takes a whole number, or leave "
                   "the key out");
    expect_refusal("width: 3\ntitle: ~\n",
                   "s.yaml:2:8: 'title' has no value; it takes a text, or leave the key out");
    expect_refusal("width: 3\ntitle: \"a\\0b\"\n",
                   "s.yaml:2:8: the value of 'title' holds a character of code 0");
}

static void yaml_that_no_settings_need_is_refused(void)
{
    expect_refusal("width: &w 3\n",
                   "s.yaml:1:8: anchors and aliases ('w') are not read here; write "
                   "the value out");
    expect_refusal("width: *w\n",
                   "s.yaml:1:8: anchors and aliases ('w') are not read here; write the "
                   "value out");
    expect_refusal("width: !!int 3\n", "s.yaml:1:8: tags ('tag:yaml.org,2002:int') are not read "
                                       "here; leave it out");
    expect_refusal("width: 3\n---\nwidth: 4\n",
                   "s.yaml:2:1: a second document begins; one file holds one");
    expect_refusal("", "s.yaml: empty, but should be a sample file");
    expect_refusal("# nothing\n", "s.yaml: empty, but should be a sample file");
}

static void text_that_is_no_yaml_is_refused_with_its_place(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    static const char *const bad[] = {"width: [1,",
                                      "\twidth: 3",
                                      "width: 'open",
                                      "{",
                                      "width: 3\n  a",
                                      "width: 3\n]",
                                      "%YAML 9.9\n---\nwidth: 3",
                                      "\xff\xfe\x01"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_FAILED, parse(bad[i], &sample, &error), bad[i]);
        TEST_ASSERT_EQUAL_STRING_LEN("s.yaml:", error.text, 7);
    }
    static const char binary[] = "\x7f"
                                 "ELF\0\1\2";
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_parse("s.yaml", "/", binary, sizeof binary,
                                                       &sample_schema, &sample, &error));
    TEST_ASSERT_EQUAL_STRING_LEN("s.yaml: not a YAML file: byte ", error.text, 30);
}

static void deep_nesting_is_refused(void)
{
    char text[64 + 20000] = "width: 3\nlayers: ";
    memset(text + strlen(text), '[', 20000);
    expect_refusal(text, "s.yaml:2:40: nested more than 32 levels deep");
}

static char *repeat(const char *head, const char *item, size_t count)
{
    char *text = malloc(strlen(head) + strlen(item) * count + 1);
    TEST_ASSERT_NOT_NULL(text);
    char *end = stpcpy(text, head);
    for (size_t i = 0; i < count; i++) {
        end = stpcpy(end, item);
    }
    return text;
}

static void a_text_of_very_many_values_is_refused_before_it_takes_memory(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    char *text = repeat("width: 3\nlayers:\n", "- {}\n", 1 << 19);
    int result = parse(text, &sample, &error);
    free(text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, result);
    TEST_ASSERT_NOT_NULL(strstr(error.text, "more than 262144 keys and values"));
}

static void a_failure_after_lists_were_read_leaves_nothing_held(void)
{
    /* The sanitizers' run finds what is not freed. */
    char text[sizeof full + 32];
    (void)snprintf(text, sizeof text, "%s%s", full, "zoom: 1\n");
    struct sample sample;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, parse(text, &sample, &error));
    TEST_ASSERT_NULL(sample.layers);
    settings_finish(&sample_schema, &sample); /* of a zeroed struct */
}

static void every_cut_of_a_good_file_reads_or_fails_but_holds_nothing(void)
{
    for (size_t size = 0; size < sizeof full; size++) {
        struct sample sample;
        struct nacre_error error = {""};
        int result =
            settings_parse("s.yaml", "/samples", full, size, &sample_schema, &sample, &error);
        TEST_ASSERT_TRUE(result == NACRE_OK || strlen(error.text) > 8);
        settings_finish(&sample_schema, &sample);
    }
}

static void a_default_that_its_own_field_refuses_is_an_error(void)
{
    static const struct settings_field fields[] = {
        {.key = "width", .kind = SETTINGS_INT, .minimum = 1, .maximum = 2, .fallback = "3"}, {0}};
    static const struct settings_schema schema = {
        .what = "x", .size = sizeof(int), .fields = fields};
    int value = 0;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          settings_parse("s.yaml", "/", "{}", 2, &schema, &value, &error));
    TEST_ASSERT_EQUAL_STRING("the default of 'width': s.yaml:1:1: width: 3 is out of range: 1 to 2",
                             error.text);
}

static void write_text(const char *name, const char *text, char *path, size_t size)
{
    (void)snprintf(path, size, "%s/%s", folder, name);
    text_write(path, text);
}

static void files_that_cannot_be_read_are_named_with_the_reason(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    char path[PATH_MAX + 16], expected[PATH_MAX + 128];
    (void)snprintf(path, sizeof path, "%s/none.yaml", folder);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_read(path, &sample_schema, &sample, &error));
    (void)snprintf(expected, sizeof expected, "%s: cannot be read: No such file or directory",
                   path);
    TEST_ASSERT_EQUAL_STRING(expected, error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_read(folder, &sample_schema, &sample, &error));
    (void)snprintf(expected, sizeof expected, "%s: cannot be read: Is a directory", folder);
    TEST_ASSERT_EQUAL_STRING(expected, error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          settings_read("/dev/null", &sample_schema, &sample, &error));
    TEST_ASSERT_EQUAL_STRING("/dev/null: empty, but should be a sample file", error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          settings_read("/dev/zero", &sample_schema, &sample, &error));
    TEST_ASSERT_EQUAL_STRING("/dev/zero: larger than 16 MiB, which no settings are", error.text);
}

static void a_relative_path_is_taken_from_the_files_own_folder(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    char path[PATH_MAX + 16], expected[PATH_MAX + 32], before[PATH_MAX];
    TEST_ASSERT_NOT_NULL(realpath(folder, before)); /* TMPDIR may be a link */
    (void)snprintf(expected, sizeof expected, "%s/maps/a.png", before);
    write_text("s.yaml", "width: 3\ntexture: maps/a.png\n", path, sizeof path);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, settings_read(path, &sample_schema, &sample, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_STRING(expected, sample.texture);
    settings_finish(&sample_schema, &sample);
    TEST_ASSERT_NOT_NULL(getcwd(before, sizeof before));
    TEST_ASSERT_EQUAL_INT(0, chdir(folder));
    int result = settings_read("s.yaml", &sample_schema, &sample, &error);
    TEST_ASSERT_EQUAL_INT(0, chdir(before));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, result, error.text);
    TEST_ASSERT_EQUAL_STRING(expected, sample.texture);
    settings_finish(&sample_schema, &sample);
}

static void what_is_written_reads_back_the_same(void)
{
    struct sample sample, again;
    struct nacre_error error = {""};
    char path[PATH_MAX + 16], where[64];
    (void)snprintf(path, sizeof path, "%s/w.yaml", folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(full, &sample, &error), error.text);
    sample.pitch_mm = 0.1 + 0.2; /* 17 digits */
    sample.white[0] = nextafter(0.5, 1);
    sample.exposures[0] = 5e-324;
    sample.exposures[1] = 1.7976931348623157e308;
    sample.exposures[2] = 123456789012345680.0;
    free(sample.title);
    sample.title = strdup(" : # \"quoted\" \\ 'and' \t\n\x01\x7f \xc3\xa4 - ~ ");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, settings_write(path, &sample_schema, &sample, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, settings_read(path, &sample_schema, &again, &error),
                                  error.text);
    TEST_ASSERT_TRUE_MESSAGE(settings_same(&sample_schema, &sample, &again, where, sizeof where),
                             where);
    settings_finish(&sample_schema, &sample);
    settings_finish(&sample_schema, &again);
}

static void a_struct_that_was_left_out_is_not_written_without_what_it_requires(void)
{
    struct sample sample, again;
    struct nacre_error error = {""};
    char path[PATH_MAX + 16], where[64];
    (void)snprintf(path, sizeof path, "%s/w.yaml", folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse("width: 3", &sample, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, settings_write(path, &sample_schema, &sample, &error),
                                  error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, settings_read(path, &sample_schema, &again, &error),
                                  error.text);
    TEST_ASSERT_TRUE_MESSAGE(settings_same(&sample_schema, &sample, &again, where, sizeof where),
                             where);
    settings_finish(&sample_schema, &again);
    sample.optics.blades = 5; /* now it says something, and lacks its glass */
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_write(path, &sample_schema, &sample, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "'optics' lacks the key 'glass'"));
    settings_finish(&sample_schema, &sample);
}

static void structs_that_differ_are_told_apart_by_the_key(void)
{
    struct sample a, b;
    struct nacre_error error = {""};
    char where[64];
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(full, &a, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(full, &b, &error), error.text);
    TEST_ASSERT_TRUE(settings_same(&sample_schema, &a, &b, where, sizeof where));
    b.layers[1].colour[2] = 0.75;
    TEST_ASSERT_FALSE(settings_same(&sample_schema, &a, &b, where, sizeof where));
    TEST_ASSERT_EQUAL_STRING("layers.colour", where);
    b.optics.blades = 3;
    TEST_ASSERT_FALSE(settings_same(&sample_schema, &a, &b, where, sizeof where));
    TEST_ASSERT_EQUAL_STRING("optics.blades", where);
    b.without[1][0] = 'F';
    b.optics.blades = a.optics.blades;
    b.layers[1].colour[2] = a.layers[1].colour[2];
    TEST_ASSERT_FALSE(settings_same(&sample_schema, &a, &b, where, sizeof where));
    TEST_ASSERT_EQUAL_STRING("without", where);
    settings_finish(&sample_schema, &a);
    settings_finish(&sample_schema, &b);
}

static void what_could_not_be_read_back_is_not_written(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    char path[PATH_MAX + 16];
    struct stat status;
    (void)snprintf(path, sizeof path, "%s/w.yaml", folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse(full, &sample, &error), error.text);
    sample.width = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_write(path, &sample_schema, &sample, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "width: 0 is out of range"));
    sample.width = 3;
    sample.pitch_mm = NAN;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_write(path, &sample_schema, &sample, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "'pitch_mm' is not finite"));
    sample.pitch_mm = 1;
    sample.medium = 3;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_write(path, &sample_schema, &sample, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "'medium' has no word of index 3"));
    sample.medium = 0;
    sample.title[0] = '\xff'; /* no UTF-8 */
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_write(path, &sample_schema, &sample, &error));
    TEST_ASSERT_EQUAL_INT(-1, stat(path, &status));
    settings_finish(&sample_schema, &sample);
}

static void writing_into_a_folder_that_is_not_there_fails(void)
{
    struct sample sample;
    struct nacre_error error = {""};
    char path[PATH_MAX + 16];
    (void)snprintf(path, sizeof path, "%s/none/w.yaml", folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, parse("width: 3", &sample, &error), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, settings_write(path, &sample_schema, &sample, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "none"));
    settings_finish(&sample_schema, &sample);
}

static void numbers_are_formatted_as_short_as_they_read_back(void)
{
    static const struct {
        double value;
        const char *text;
    } cases[] = {{0, "0"},
                 {-0.0, "-0"},
                 {512, "512"},
                 {1e6, "1000000"},
                 {0.1, "0.1"},
                 {1e-7, "1e-07"},
                 {1e300, "1e+300"},
                 {1.0 / 3, "0.3333333333333333"},
                 {0.1 + 0.2, "0.30000000000000004"}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char text[32];
        double back = 1;
        number_format(cases[i].value, text, sizeof text);
        TEST_ASSERT_EQUAL_STRING(cases[i].text, text);
        TEST_ASSERT_EQUAL_INT(NUMBER_OK, number_parse(text, &back));
        TEST_ASSERT_EQUAL_MEMORY(&cases[i].value, &back, sizeof back);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(reading_fills_in_defaults_also_in_structs_that_are_left_out);
    RUN_TEST(reading_takes_every_kind_of_value);
    RUN_TEST(an_absolute_path_and_empty_lists_are_taken_as_they_are);
    RUN_TEST(unknown_keys_are_refused_where_they_stand_and_the_nearest_is_named);
    RUN_TEST(keys_given_twice_or_missing_are_refused);
    RUN_TEST(numbers_outside_their_range_are_refused_with_the_range);
    RUN_TEST(values_of_the_wrong_kind_are_refused);
    RUN_TEST(keys_without_a_value_are_refused);
    RUN_TEST(yaml_that_no_settings_need_is_refused);
    RUN_TEST(text_that_is_no_yaml_is_refused_with_its_place);
    RUN_TEST(deep_nesting_is_refused);
    RUN_TEST(a_text_of_very_many_values_is_refused_before_it_takes_memory);
    RUN_TEST(a_failure_after_lists_were_read_leaves_nothing_held);
    RUN_TEST(every_cut_of_a_good_file_reads_or_fails_but_holds_nothing);
    RUN_TEST(a_default_that_its_own_field_refuses_is_an_error);
    RUN_TEST(files_that_cannot_be_read_are_named_with_the_reason);
    RUN_TEST(a_relative_path_is_taken_from_the_files_own_folder);
    RUN_TEST(what_is_written_reads_back_the_same);
    RUN_TEST(a_struct_that_was_left_out_is_not_written_without_what_it_requires);
    RUN_TEST(structs_that_differ_are_told_apart_by_the_key);
    RUN_TEST(what_could_not_be_read_back_is_not_written);
    RUN_TEST(writing_into_a_folder_that_is_not_there_fails);
    RUN_TEST(numbers_are_formatted_as_short_as_they_read_back);
    return UNITY_END();
}
