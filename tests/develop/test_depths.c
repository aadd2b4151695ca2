/* Every depth and every order of colours through the whole chain. */
#include "compare.h"
#include "made.h"
#include "rig/develop/develop.h"
#include "tests/files.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const char plan_text[] = "seed: 5\nblack_frames: 10\nwhite_frames: 3\ndot_spacing: 6\n"
                                "dot_shift: 3\ndot_size: 2\ngrid_spacing: 7\nwindow: 7\n"
                                "exposure_turns: [1, 4, 16, 64]\n";

void setUp(void)
{
}

void tearDown(void)
{
}

/* 16 x 13 points seen by 84 x 74 pixels; sensor and light as the usual station's, at `bits` bits. */
static struct made_station station_of(int bits, enum bayer bayer)
{
    struct made_station station = made_station_usual();
    double scale = pow(2, bits - 10);
    station.width = 16;
    station.height = 13;
    station.camera_width = 84;
    station.camera_height = 74;
    station.reach = 0.55;
    station.bits = bits;
    station.bayer = bayer;
    station.pedestal *= scale;
    station.read_noise *= scale;
    station.electrons /= scale;
    for (int c = 0; c < 3; c++) {
        station.gain[c] *= scale;
    }
    if (bayer == BAYER_MONO) {
        station.white[1] = station.white[0]; /* the one colour of the made sensor is red */
    }
    return station;
}

static void develop(int bits, enum bayer bayer, enum demosaic demosaic, double limit)
{
    struct made_station station = station_of(bits, bayer);
    struct develop_options options = {.black = BLACK_SUBTRACT,
                                      .confidence = 0.99,
                                      .demosaic = demosaic,
                                      .store = NACRE_FLOAT,
                                      .flat = FLAT_PAPER};
    struct develop_report report;
    struct nacre_error error = {""};
    char name[64];
    char *folder = folder_make();
    char *path = made_session(&station, folder, plan_text);
    char *scan = NULL;
    TEST_ASSERT_TRUE(asprintf(&scan, "%s/scan.exr", folder) > 0);
    (void)snprintf(name, sizeof name, "%d bits, %s", bits, bayer_names[bayer]);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, develop_session(path, &options, scan, NULL, &report, &error), error.text);
    struct comparison found = made_compare(&station, scan);
    TEST_ASSERT_EQUAL_INT_MESSAGE(bayer == BAYER_MONO ? 1 : 3, report.channels, name);
    TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(limit, 0, found.error, name);
    TEST_ASSERT_EQUAL_UINT_MESSAGE(0, found.missing, name);
    TEST_ASSERT_EQUAL_UINT_MESSAGE(0, report.linearity.dead + report.linearity.nonlinear, name);
    TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(0.05, 0, report.align.rms_px, name);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, report.warnings.count, name);
    free(scan);
    free(path);
    folder_remove(folder);
}

static void every_depth_gives_the_responses(void)
{
    /* The same photo-electrons at every depth: 0.9 % of shot noise and 0.8 % of the made camera's sampling (see
     * test_develop.c), twice their sum. 8 bits quantise to a quarter of the 10 bits' read noise of 1.2: the quantum's
     * 0.29 beside 0.3 adds a fifth to noise that is not the largest. */
    for (int bits = 8; bits <= 16; bits += 2) {
        develop(bits, BAYER_RGGB, DEMOSAIC_FIT, 0.024);
    }
}

static void every_order_of_colours_gives_the_responses(void)
{
    for (int bayer = BAYER_BGGR; bayer <= BAYER_MONO; bayer++) {
        develop(bayer == BAYER_MONO ? 16 : 12, (enum bayer)bayer, DEMOSAIC_FIT, 0.024);
    }
}

static void every_order_of_colours_is_demosaiced(void)
{
    /* The means blur steep responses over straddling pixels (test_develop.c); a wrong order gives errors of the colours'
     * differences, 0.42 : 0.28, and of the filters', 3 : 2. */
    for (int bayer = BAYER_RGGB; bayer <= BAYER_GBRG; bayer++) {
        develop(10, (enum bayer)bayer, DEMOSAIC_MALVAR, 0.22);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(every_depth_gives_the_responses);
    RUN_TEST(every_order_of_colours_gives_the_responses);
    RUN_TEST(every_order_of_colours_is_demosaiced);
    return UNITY_END();
}
