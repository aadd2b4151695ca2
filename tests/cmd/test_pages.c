/* The pages of tradeoff and report as a browser shows them, on a screen, on a phone and printed. Without Chromium it is
 * skipped, and says so. */
#include "base/picture.h"
#include "tests/cmd/made.h"
#include "tests/cmd/spawn.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

enum { SKIPPED = 77, HEIGHT = 1400 };

static const char *browser;
static char *folder, *study, *report;

void setUp(void)
{
}

void tearDown(void)
{
}

static const char *find_browser(void)
{
    static const char *const places[] = {"/usr/bin/chromium", "/usr/bin/chromium-browser",
                                         "/usr/bin/google-chrome"};
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        if (access(places[i], X_OK) == 0) {
            return places[i];
        }
    }
    return NULL;
}

static void browse(const char *page, const char *option, const char *size)
{
    char *profile = NULL, *address = NULL;
    if (asprintf(&profile, "--user-data-dir=%s/profile", folder) < 0 ||
        asprintf(&address, "file://%s", page) < 0) {
        abort();
    }
    const char *const arguments[] = {browser,
                                     "--headless",
                                     "--no-sandbox",
                                     "--disable-gpu",
                                     "--disable-dev-shm-usage",
                                     "--hide-scrollbars",
                                     profile,
                                     size,
                                     option,
                                     address,
                                     NULL};
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    spawned_finish(&run);
    free(profile);
    free(address);
}

static bool is_background(const float *rgb, const float *background)
{
    return fabsf(rgb[0] - background[0]) + fabsf(rgb[1] - background[1]) +
               fabsf(rgb[2] - background[2]) <
           0.02F;
}

/* The screenshot has things on it, and none of them reaches the right edge, where they would be cut off: the page's margin
 * there is 17 pixels or more, of which 8 are looked at. */
static void expect_readable(const char *page, int width)
{
    struct nacre_error error = {""};
    struct picture picture = {0};
    char *shot = path_join(folder, "shot.png"), *option = NULL, *size = NULL;
    size_t marked = 0;
    if (asprintf(&option, "--screenshot=%s", shot) < 0 ||
        asprintf(&size, "--window-size=%d,%d", width, HEIGHT) < 0) {
        abort();
    }
    browse(page, option, size);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_read(shot, &picture, &error), error.text);
    TEST_ASSERT_EQUAL_INT(width, picture.width);
    TEST_ASSERT_EQUAL_INT(HEIGHT, picture.height);
    const float *background = picture.rgb;
    for (int y = 0; y < picture.height; y++) {
        for (int x = 0; x < picture.width; x++) {
            const float *rgb = picture.rgb + 3 * ((size_t)y * (size_t)width + (size_t)x);
            bool marks = !is_background(rgb, background);
            marked += marks;
            TEST_ASSERT_FALSE_MESSAGE(marks && x >= width - 8, "something is cut off");
        }
    }
    /* Figures and text cover a good part of the first screen. */
    TEST_ASSERT_TRUE((double)marked > 0.05 * width * HEIGHT);
    picture_finish(&picture);
    free(shot);
    free(option);
    free(size);
}

static void the_study_can_be_read_on_a_screen_and_on_a_phone(void)
{
    expect_readable(study, 1100);
    expect_readable(study, 500);
}

static void the_report_can_be_read_on_a_screen_and_on_a_phone(void)
{
    expect_readable(report, 1100);
    expect_readable(report, 500);
}

static void both_can_be_printed(void)
{
    const char *const pages[] = {study, report};
    for (int i = 0; i < 2; i++) {
        char *print = path_join(folder, "page.pdf"), *option = NULL;
        size_t size = 0;
        if (asprintf(&option, "--print-to-pdf=%s", print) < 0) {
            abort();
        }
        browse(pages[i], option, "--window-size=1100,1400");
        char *bytes = (char *)file_read(print, &size);
        TEST_ASSERT_NOT_NULL(bytes);
        TEST_ASSERT_TRUE(size > 10000 && strncmp(bytes, "%PDF", 4) == 0);
        TEST_ASSERT_EQUAL_INT(0, unlink(print));
        free(bytes);
        free(print);
        free(option);
    }
}

static void make_pages(void)
{
    char *scan = path_join(folder, "scan.exr"), *material = path_join(folder, "m.exr");
    study = path_join(folder, "study/tradeoff.html");
    report = path_join(folder, "report.html");
    char *to = path_join(folder, "study");
    made_scan_write(scan);
    spawn_or_abort(
        (const char *const[]){NACRE, "tradeoff", scan, "-o", to, "--budget", "3s", NULL});
    spawn_or_abort(
        (const char *const[]){NACRE, "factor", scan, "-o", material, "-t", "2", "-k", "2", NULL});
    spawn_or_abort((const char *const[]){NACRE, "report", scan, material, "-o", report, NULL});
    free(scan);
    free(material);
    free(to);
}

int main(void)
{
    browser = find_browser();
    if (!browser) {
        (void)fprintf(stderr, "skipped: there is no Chromium to show pages; install chromium\n");
        return SKIPPED;
    }
    folder = folder_make();
    make_pages();
    UNITY_BEGIN();
    RUN_TEST(the_study_can_be_read_on_a_screen_and_on_a_phone);
    RUN_TEST(the_report_can_be_read_on_a_screen_and_on_a_phone);
    RUN_TEST(both_can_be_printed);
    free(study);
    free(report);
    folder_remove(folder);
    return UNITY_END();
}
