/* What every verb does with bad input: one message that names the object, the right exit status, nothing on standard
 * output, no file left or altered. */
#include "tests/cmd/made.h"
#include "tests/cmd/mounts.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

enum { FAILED = 1, WRONG_USAGE = 2, PATHS = 32 };

/* The inputs of all cases. */
static char *inputs;
static bool can_mount;

/* Of one case: its folder, and the paths it made up. */
static char *folder;
static char *mounted; /* a disk mounted in it, or NULL */
static char *paths[PATHS];
static size_t path_count;

static char *keep(char *path)
{
    TEST_ASSERT_TRUE_MESSAGE(path_count < PATHS, "raise PATHS");
    return paths[path_count++] = path;
}

static char *input(const char *name)
{
    return keep(path_join(inputs, name));
}

/* The one file that may be left, and then must: what was developed before a failure, for --resume. NULL: none. */
static const char *work_left;

static char *output(const char *name)
{
    return keep(path_join(folder, name));
}

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    work_left = NULL;
    if (mounted) {
        mounts_remove(mounted);
        mounted = NULL;
    }
    for (; path_count; path_count--) {
        free(paths[path_count - 1]);
    }
    folder_remove(folder);
    folder = NULL;
}

static int count_lines(const char *text)
{
    int lines = 0;
    for (; *text; text++) {
        lines += *text == '\n';
    }
    return lines;
}

/* The program with these arguments must end with `status` and a message that holds `named`, and leave the case's
 * folder as it is, but for `work_left`. Behind wrong usage a second line names --help. */
static void refuses_under(const struct circumstances *around, int status, const char *named,
                          const char *const *arguments)
{
    char *before = folder_describe(folder);
    struct spawned run = spawn(arguments, around);
    int removed = work_left ? unlink(work_left) : 0;
    char *after = folder_describe(folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(status, run.status, run.errors);
    TEST_ASSERT_EQUAL_INT_MESSAGE(status == WRONG_USAGE ? 2 : 1, count_lines(run.errors),
                                  run.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.errors, named), run.errors);
    TEST_ASSERT_EQUAL_STRING("", run.output);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, removed, work_left);
    TEST_ASSERT_EQUAL_STRING(before, after);
    spawned_finish(&run);
    free(before);
    free(after);
}

#define REFUSES_UNDER(around, status, named, ...)                                                  \
    refuses_under(around, status, named, (const char *const[]){NACRE, __VA_ARGS__, NULL})
#define REFUSES(status, named, ...) REFUSES_UNDER(NULL, status, named, __VA_ARGS__)

/* Scans and materials. */

static void every_reader_refuses_the_scan(const char *name)
{
    REFUSES(FAILED, name, "factor", input(name), "-o", output("out.exr"));
    REFUSES(FAILED, name, "error", input(name), input("material.exr"));
    REFUSES(FAILED, name, "report", input(name), input("material.exr"), "-o", output("out.html"));
}

static void a_missing_scan_is_refused(void)
{
    every_reader_refuses_the_scan("absent.exr");
}

static void a_scan_that_is_no_exr_is_refused(void)
{
    every_reader_refuses_the_scan("text.exr");
}

static void a_scan_without_tiles_is_refused(void)
{
    every_reader_refuses_the_scan("untiled.exr");
}

static void a_scan_of_unknown_format_is_refused(void)
{
    every_reader_refuses_the_scan("scan-format-9.exr");
}

static void a_scan_with_other_channels_is_refused(void)
{
    every_reader_refuses_the_scan("scan-channels.exr");
}

static void a_scan_cut_in_its_header_is_refused(void)
{
    every_reader_refuses_the_scan("scan-cut-header.exr");
}

static void a_scan_cut_in_the_middle_is_refused(void)
{
    every_reader_refuses_the_scan("scan-cut-middle.exr");
}

static void a_scan_that_lacks_its_last_bytes_is_refused(void)
{
    every_reader_refuses_the_scan("scan-cut-end.exr");
}

static void report_and_render_refuse_the_material(const char *name)
{
    char *scene = output("scene.yaml");
    stations_write_scene(scene, input(name));
    REFUSES(FAILED, name, "report", input("scan.exr"), input(name), "-o", output("out.html"));
    REFUSES(FAILED, name, "render", scene, "-o", output("out.png"));
}

static void every_reader_refuses_the_material(const char *name)
{
    REFUSES(FAILED, name, "error", input("scan.exr"), input(name));
    report_and_render_refuse_the_material(name);
}

static void a_missing_material_is_refused(void)
{
    every_reader_refuses_the_material("absent.exr");
}

/* `error` compares two scans as well, but not a material's errors in a map, nor by reciprocal pairs. */
static void a_material_that_is_a_scan_is_refused(void)
{
    REFUSES(FAILED, "made.exr", "error", input("scan.exr"), input("made.exr"), "--cross");
    REFUSES(FAILED, "made.exr", "error", input("scan.exr"), input("made.exr"), "--map",
            output("map.exr"));
    report_and_render_refuse_the_material("made.exr");
}

static void a_material_of_unknown_format_is_refused(void)
{
    every_reader_refuses_the_material("material-format-9.exr");
}

static void a_material_without_its_factors_is_refused(void)
{
    every_reader_refuses_the_material("material-channels.exr");
}

static void a_material_cut_in_the_middle_is_refused(void)
{
    every_reader_refuses_the_material("material-cut-middle.exr");
}

static void a_missing_picture_is_refused_by_the_report(void)
{
    REFUSES(FAILED, "absent.png", "report", input("scan.exr"), input("material.exr"),
            input("absent.png"), "-o", output("out.html"));
    REFUSES(FAILED, "text.exr", "report", input("scan.exr"), input("material.exr"),
            input("text.exr"), "-o", output("out.html"));
}

static void a_material_of_another_size_than_the_scan_is_refused(void)
{
    REFUSES(FAILED, "small.exr", "error", input("small.exr"), input("material.exr"));
}

/* Settings files. */

static void missing_settings_files_are_refused(void)
{
    REFUSES(FAILED, "absent.yaml", "scan", output("session"), "--station", input("absent.yaml"));
    REFUSES(FAILED, "absent.yaml", "scan", output("session"), "--station", input("station.yaml"),
            "--plan", input("absent.yaml"));
    REFUSES(FAILED, "absent.yaml", "simulate", input("absent.yaml"), "-o", output("out.exr"));
    REFUSES(FAILED, "absent.yaml", "render", input("absent.yaml"), "-o", output("out.png"));
    REFUSES(FAILED, "absent.yaml", "bake", "--scene", input("absent.yaml"), "-o",
            output("out.ply"));
}

/* The place of the unknown key is told as FILE:LINE:COLUMN. */
static void unknown_keys_are_refused_with_their_place(void)
{
    const char *const names[] = {"station.yaml", "plan.yaml", "sample.yaml", "scene.yaml"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        size_t size = 0;
        char *good = (char *)file_read(input(names[i]), &size);
        char *text = NULL;
        TEST_ASSERT_TRUE(asprintf(&text, "colour_of_moon: 3\n%s", good) > 0);
        text_write(output(names[i]), text);
        free(good);
        free(text);
    }
    REFUSES(FAILED, "station.yaml:1:1: ", "scan", output("session"), "--station",
            output("station.yaml"));
    REFUSES(FAILED, "plan.yaml:1:1: ", "scan", output("session"), "--station",
            input("station.yaml"), "--plan", output("plan.yaml"));
    REFUSES(FAILED, "sample.yaml:1:1: ", "simulate", output("sample.yaml"), "-o",
            output("out.exr"));
    REFUSES(FAILED, "scene.yaml:1:1: ", "render", output("scene.yaml"), "-o", output("out.png"));
}

/* Sessions. */

static void a_session_that_is_none_is_refused(void)
{
    REFUSES(FAILED, "absent", "develop", input("absent"), "-o", output("out.exr"));
    REFUSES(FAILED, folder, "develop", folder, "-o", output("out.exr"));
    REFUSES(FAILED, "scan.exr", "develop", input("scan.exr"), "-o", output("out.exr"));
    REFUSES(FAILED, "scan.exr", "scan", output("session"), "--station", input("station.yaml"),
            "--calibration", input("scan.exr"));
}

static void a_session_that_exists_is_not_overwritten(void)
{
    char *before = folder_describe(input("session"));
    REFUSES(FAILED, "--resume", "scan", input("session"), "--station", input("station.yaml"));
    char *after = folder_describe(input("session"));
    TEST_ASSERT_EQUAL_STRING(before, after);
    free(before);
    free(after);
}

/* The frame is cut for as long as develop runs. */
static void a_frame_cut_in_the_middle_is_refused(void)
{
    char *frame = input("session/frames/000007.exr");
    char *whole = input("whole-frame");
    TEST_ASSERT_EQUAL_INT(0, rename(frame, whole));
    made_truncate(whole, frame, 0.5);
    work_left = output("out.exr.work"); /* of grids 0 to 6 */
    REFUSES(FAILED, "000007.exr", "develop", input("session"), "-o", output("out.exr"));
    TEST_ASSERT_EQUAL_INT(0, rename(whole, frame));
}

/* Options. */

static void numbers_out_of_range_are_wrong_usage(void)
{
    const char *scan = input("scan.exr");
    const char *out = output("out.exr");
    REFUSES(FAILED, "--terms", "factor", scan, "-o", out, "--terms", "0");
    REFUSES(FAILED, "--clusters", "factor", scan, "-o", out, "--clusters", "0");
    REFUSES(FAILED, "--terms", "factor", scan, "-o", out, "--terms", "-3");
    REFUSES(WRONG_USAGE, "--clusters", "factor", scan, "-o", out, "--clusters", "many");
}

/* The scan of the station has 20 x 16 = 320 points. */
static void more_clusters_than_points_are_refused(void)
{
    REFUSES(FAILED, "320", "factor", input("small.exr"), "-o", output("out.exr"), "--clusters",
            "321");
}

static void arguments_left_out_are_wrong_usage(void)
{
    REFUSES(WRONG_USAGE, "SESSION", "scan");
    REFUSES(WRONG_USAGE, "--station", "scan", output("session"));
    REFUSES(WRONG_USAGE, "--station", "scan", output("session"), "--dry-run");
    REFUSES(WRONG_USAGE, "-o SCAN", "simulate", input("sample.yaml"));
    REFUSES(WRONG_USAGE, "SCAN", "factor");
    REFUSES(WRONG_USAGE, "--output", "factor", input("scan.exr"));
    REFUSES(WRONG_USAGE, "--output", "develop", input("session"));
    REFUSES(WRONG_USAGE, "--output", "render", input("scene.yaml"));
    REFUSES(WRONG_USAGE, "--samples", "render", input("scene.yaml"), "-o", output("out.png"),
            "--error", "1%", "--samples", "3");
    REFUSES(WRONG_USAGE, "--photons", "render", input("scene.yaml"), "-o", output("out.png"),
            "--within", "9", "--photons", "1000");
    REFUSES(WRONG_USAGE, "--within", "render", input("scene.yaml"), "-o", output("out.png"),
            "--error", "0");
    REFUSES(WRONG_USAGE, "--scene", "bake", "-o", output("out.ply"));
    REFUSES(WRONG_USAGE, "--output", "report", input("scan.exr"), input("material.exr"));
    REFUSES(WRONG_USAGE, "MATERIAL", "report", input("scan.exr"), "-o", output("out.html"));
    REFUSES(WRONG_USAGE, "MATERIAL", "error", input("scan.exr"));
}

static void unknown_verbs_and_options_are_wrong_usage(void)
{
    REFUSES(WRONG_USAGE, "factor", "facter", input("scan.exr"));
    REFUSES(WRONG_USAGE, "--terms", "factor", input("scan.exr"), "-o", output("out.exr"), "--term5",
            "3");
}

static void options_that_do_not_go_together_are_wrong_usage(void)
{
    REFUSES(WRONG_USAGE, "--plan", "scan", input("session"), "--resume", "--plan",
            input("plan.yaml"));
    REFUSES(WRONG_USAGE, "--calibration", "scan", input("session"), "--resume", "--calibration",
            input("session"));
    REFUSES(WRONG_USAGE, "--pov", "render", input("scene.yaml"), "-o", output("out.png"),
            "--preview", "--pov", output("pov"));
    REFUSES(WRONG_USAGE, "--povray-shadows", "render", input("scene.yaml"), "-o", output("out.png"),
            "--turntable", "2", "--povray-shadows");
    REFUSES(WRONG_USAGE, "--json", "simulate", input("sample.yaml"), "--explain", "--json", "-o",
            output("out.exr"));
}

/* Each would destroy what it is made of. */
static void what_is_read_is_not_overwritten(void)
{
    static const char *const names[] = {"scan.exr", "material.exr", "sample.yaml"};
    char *kept[3];
    for (int i = 0; i < 3; i++) {
        kept[i] = input(names[i]);
    }
    char *before = folder_describe(inputs);
    REFUSES(WRONG_USAGE, "scan.exr is to be read", "factor", kept[0], "-o", kept[0]);
    REFUSES(WRONG_USAGE, "scan.exr is to be read", "report", kept[0], kept[1], "-o", kept[0]);
    REFUSES(WRONG_USAGE, "material.exr is to be read", "report", kept[0], kept[1], "-o", kept[1]);
    REFUSES(WRONG_USAGE, "scan.exr is to be read", "error", kept[0], kept[1], "--map", kept[0]);
    REFUSES(WRONG_USAGE, "sample.yaml is to be read", "simulate", kept[2], "-o", kept[2]);
    char *scene = output("own.yaml");
    stations_write_scene(scene, kept[1]); /* the scene names what is read */
    REFUSES(WRONG_USAGE, "material.exr is to be read", "render", scene, "-o", kept[1]);
    REFUSES(WRONG_USAGE, "material.exr is to be read", "bake", "--scene", scene, "-o", kept[1]);
    char *after = folder_describe(inputs);
    TEST_ASSERT_EQUAL_STRING(before, after);
    free(before);
    free(after);
}

static void an_unknown_device_is_refused(void)
{
    REFUSES(FAILED, "no such thing", "factor", input("scan.exr"), "-o", output("out.exr"),
            "--device", "no such thing");
}

/* Outputs. `below` is a path in the case's folder where nothing can be written. */
static void every_writer_refuses_the_output(const struct circumstances *around, const char *below)
{
    char *exr = keep(path_join(below, "out.exr"));
    char *html = keep(path_join(below, "out.html"));
    char *png = keep(path_join(below, "out.png"));
    char *session = keep(path_join(below, "session"));
    REFUSES_UNDER(around, FAILED, session, "scan", session, "--station", input("station.yaml"));
    REFUSES_UNDER(around, FAILED, exr, "develop", input("session"), "-o", exr);
    REFUSES_UNDER(around, FAILED, exr, "simulate", input("sample.yaml"), "-o", exr, "--window",
                  "11");
    REFUSES_UNDER(around, FAILED, exr, "factor", input("scan.exr"), "-o", exr, "--iterations", "1");
    REFUSES_UNDER(around, FAILED, exr, "error", input("scan.exr"), input("material.exr"), "--map",
                  exr);
    REFUSES_UNDER(around, FAILED, png, "render", input("scene.yaml"), "-o", png);
    REFUSES_UNDER(around, FAILED, exr, "render", input("scene.yaml"), "-o", exr);
    REFUSES_UNDER(around, FAILED, exr, "bake", "--scene", input("scene.yaml"), "-o", exr);
    REFUSES_UNDER(around, FAILED, html, "report", input("scan.exr"), input("material.exr"), "-o",
                  html);
}

static void an_output_folder_that_does_not_exist_is_refused(void)
{
    every_writer_refuses_the_output(NULL, output("absent"));
}

static void an_output_folder_that_cannot_be_written_is_refused(void)
{
    char *below = output("locked");
    TEST_ASSERT_EQUAL_INT(0, mkdir(below, 0755));
    if (can_mount) {
        TEST_ASSERT_TRUE(mounts_disk(below, 65536));
        mounted = below;
        TEST_ASSERT_TRUE(mounts_make_read_only(below));
    } else {
        TEST_ASSERT_EQUAL_INT(0, chmod(below, 0555)); /* root, whom this does not stop, can mount */
    }
    every_writer_refuses_the_output(NULL, below);
}

static void an_output_that_is_a_folder_is_refused(void)
{
    char *below = output("taken");
    const char *const names[] = {"out.exr", "out.png", "out.html"};
    TEST_ASSERT_EQUAL_INT(0, mkdir(below, 0755));
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        TEST_ASSERT_EQUAL_INT(0, mkdir(keep(path_join(below, names[i])), 0755));
    }
    REFUSES(FAILED, "out.exr", "factor", input("scan.exr"), "-o",
            keep(path_join(below, "out.exr")));
    REFUSES(FAILED, "out.png", "render", input("scene.yaml"), "-o",
            keep(path_join(below, "out.png")));
    REFUSES(FAILED, "out.html", "report", input("scan.exr"), input("material.exr"), "-o",
            keep(path_join(below, "out.html")));
}

/* Write until the disk holds no more. */
static void fill(const char *path)
{
    static const char block[512];
    int file = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    TEST_ASSERT_TRUE(file >= 0);
    while (write(file, block, sizeof block) > 0) {
    }
    TEST_ASSERT_EQUAL_INT(ENOSPC, errno);
    (void)close(file);
}

/* The large files find no room in the middle, the small pictures from the beginning. Where no disk can be mounted, a
 * limit on the sizes of files has the same effect, but on the files of OpenCL's compiler and POV-Ray too. What stood
 * there before stays as it was. */
static void a_full_disk_leaves_what_was_there(void)
{
    const char *const names[] = {"out.exr", "out.png", "out.html"};
    const struct circumstances limited = {.file_limit = 4096};
    char *below = output("full");
    TEST_ASSERT_EQUAL_INT(0, mkdir(below, 0755));
    if (can_mount) {
        TEST_ASSERT_TRUE(mounts_disk(below, 8 * 4096));
        mounted = below;
    }
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        text_write(keep(path_join(below, names[i])), "precious");
    }
    const struct circumstances *around = can_mount ? NULL : &limited;
    char *exr = keep(path_join(below, "out.exr"));
    char *html = keep(path_join(below, "out.html"));
    /* A mounted disk holds the first grids. */
    work_left = can_mount ? keep(path_join(below, "out.exr.work")) : NULL;
    REFUSES_UNDER(around, FAILED, exr, "develop", input("session"), "-o", exr);
    work_left = NULL;
    REFUSES_UNDER(around, FAILED, exr, "simulate", input("sample.yaml"), "-o", exr, "--window",
                  "11");
    REFUSES_UNDER(around, FAILED, html, "report", input("scan.exr"), input("material.exr"), "-o",
                  html);
    if (can_mount) {
        char *png = keep(path_join(below, "out.png"));
        /* A material with a kernel per term would fit. */
        REFUSES(FAILED, exr, "factor", input("scan.exr"), "-o", exr, "--iterations", "1", "--model",
                "clusters");
        REFUSES(FAILED, "MiB free", "scan", keep(path_join(below, "session")), "--station",
                input("station.yaml"));
        fill(keep(path_join(below, "filler")));
        REFUSES(FAILED, png, "render", input("scene.yaml"), "-o", png);
        REFUSES(FAILED, exr, "render", input("scene.yaml"), "-o", exr);
    }
}

/* Inputs of all cases. */

#define RUN(...) spawn_or_abort((const char *const[]){NACRE, __VA_ARGS__, NULL})

static void make_inputs(void)
{
    made_scan_write(input("scan.exr"));
    stations_write(inputs);
    stations_write_scene(input("scene.yaml"), input("material.exr"));
    RUN("factor", input("scan.exr"), "-o", input("material.exr"), "--terms", "2", "--clusters", "2",
        "--iterations", "3");
    RUN("scan", input("session"), "--station", input("station.yaml"));
    RUN("develop", input("session"), "-o", input("small.exr"));
}

static void make_damaged_inputs(void)
{
    const char *scan = input("scan.exr");
    const char *material = input("material.exr");
    text_write(input("text.exr"), "This is no picture.\n");
    made_untiled_write(input("untiled.exr"));
    made_patch(scan, input("scan-format-9.exr"), "scan 1", "scan 9", 6);
    /* The list of channels: its type's name, its size, its first channel's name. */
    made_patch(scan, input("scan-channels.exr"), "chlist\0\x37\0\0\0B", "chlist\0\x37\0\0\0A", 12);
    made_truncate(scan, input("scan-cut-header.exr"), 0.001);
    made_truncate(scan, input("scan-cut-middle.exr"), 0.5);
    made_truncate(scan, input("scan-cut-end.exr"), 0.9999);
    made_scan_write(input("made.exr"));
    made_patch(material, input("material-format-9.exr"), "material 1", "material 9", 10);
    made_patch(material, input("material-channels.exr"), "t01.R", "t01.Q", 5);
    made_truncate(material, input("material-cut-middle.exr"), 0.5);
}

int main(void)
{
    can_mount = mounts_enter();
    inputs = folder_make();
    make_inputs();
    make_damaged_inputs();
    for (; path_count; path_count--) {
        free(paths[path_count - 1]);
    }
    UNITY_BEGIN();
    RUN_TEST(a_missing_scan_is_refused);
    RUN_TEST(a_scan_that_is_no_exr_is_refused);
    RUN_TEST(a_scan_without_tiles_is_refused);
    RUN_TEST(a_scan_of_unknown_format_is_refused);
    RUN_TEST(a_scan_with_other_channels_is_refused);
    RUN_TEST(a_scan_cut_in_its_header_is_refused);
    RUN_TEST(a_scan_cut_in_the_middle_is_refused);
    RUN_TEST(a_scan_that_lacks_its_last_bytes_is_refused);
    RUN_TEST(a_missing_material_is_refused);
    RUN_TEST(a_material_that_is_a_scan_is_refused);
    RUN_TEST(a_material_of_unknown_format_is_refused);
    RUN_TEST(a_material_without_its_factors_is_refused);
    RUN_TEST(a_material_cut_in_the_middle_is_refused);
    RUN_TEST(a_missing_picture_is_refused_by_the_report);
    RUN_TEST(a_material_of_another_size_than_the_scan_is_refused);
    RUN_TEST(missing_settings_files_are_refused);
    RUN_TEST(unknown_keys_are_refused_with_their_place);
    RUN_TEST(a_session_that_is_none_is_refused);
    RUN_TEST(a_session_that_exists_is_not_overwritten);
    RUN_TEST(a_frame_cut_in_the_middle_is_refused);
    RUN_TEST(numbers_out_of_range_are_wrong_usage);
    RUN_TEST(more_clusters_than_points_are_refused);
    RUN_TEST(arguments_left_out_are_wrong_usage);
    RUN_TEST(unknown_verbs_and_options_are_wrong_usage);
    RUN_TEST(options_that_do_not_go_together_are_wrong_usage);
    RUN_TEST(what_is_read_is_not_overwritten);
    RUN_TEST(an_unknown_device_is_refused);
    RUN_TEST(an_output_folder_that_does_not_exist_is_refused);
    RUN_TEST(an_output_folder_that_cannot_be_written_is_refused);
    RUN_TEST(an_output_that_is_a_folder_is_refused);
    RUN_TEST(a_full_disk_leaves_what_was_there);
    folder_remove(inputs);
    return UNITY_END();
}
