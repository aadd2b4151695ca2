/* Developing a whole made session. */
#include "made.h"
#include "nacre/scan.h"
#include "rig/develop/develop.h"
#include "unity.h"

#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static struct made_station station;
static char *folder, *session_path;
static const struct develop_options usual = {BLACK_SUBTRACT, 0.99, DEMOSAIC_FIT, NACRE_FLOAT};

void setUp(void)
{
}

void tearDown(void)
{
}

static char *in_folder(const char *name)
{
    char *path = NULL;
    TEST_ASSERT_TRUE(asprintf(&path, "%s/%s", folder, name) > 0);
    return path;
}

static struct develop_report develop(const struct develop_options *options, const char *output)
{
    struct develop_report report;
    struct nacre_error error = {""};
    char *path = in_folder(output);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, develop_session(session_path, options, path, NULL, &report, &error), error.text);
    free(path);
    return report;
}

/* Mean over the points of ||developed - exact|| / ||exact|| of their windows. */
static double scan_error(const char *name)
{
    struct nacre_scan *scan = NULL;
    struct nacre_error error = {""};
    char *path = in_folder(name);
    double sum = 0;
    int points = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_open(path, &scan, &error), error.text);
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    int window = info->window;
    float *response = malloc(nacre_scan_response_size(info) * sizeof *response);
    for (int y = 0; y < info->height; y++) {
        for (int x = 0; x < info->width; x++) {
            double off = 0;
            double all = 0;
            TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_read(scan, x, y, response, &error));
            for (int i = 0; i < 3 * window * window; i++) {
                int xo = x + i % window - window / 2;
                int yo = y + i / window % window - window / 2;
                if (xo >= 0 && yo >= 0 && xo < info->width && yo < info->height &&
                    !isnan(response[i])) {
                    double exact = made_transfer(&station, i / window / window, x, y, xo, yo);
                    off += (response[i] - exact) * (response[i] - exact);
                    all += exact * exact;
                }
            }
            if (all > 0) {
                sum += sqrt(off / all);
                points++;
            }
        }
    }
    free(response);
    nacre_scan_close(scan);
    free(path);
    return sum / points;
}

static void compare_ways(void)
{
    for (int black = 0; black < 2; black++) {
        for (int demosaic = 0; demosaic < 3; demosaic++) {
            struct develop_options options = usual;
            options.black = (enum black_mode)black;
            options.demosaic = (enum demosaic)demosaic;
            struct develop_report r = develop(&options, "scan.exr");
            printf("%s %s: error %.5f rms %.4f noise %.3g overlap %.3g rim %.3g total %.2f grids "
                   "%.2f lin %.2g dead %zu %zu %zu black %g noise %g\n",
                   black_mode_names[black], demosaic_names[demosaic], scan_error("scan.exr"),
                   r.align.rms_px, r.noise, r.overlap, r.rim_share, r.total_seconds, r.grid_seconds,
                   r.linearity.deviation, r.linearity.dead, r.linearity.nonlinear,
                   r.linearity.noisy, r.black_level, r.frame_noise);
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    folder = made_folder();
    station = made_station_usual();
    if (getenv("N")) {
        int n = atoi(getenv("N"));
        if (n > 0)
            station.electrons = 0;
        if (n > 1)
            station.read_noise = 0;
        if (n > 2)
            station.bits = 16, station.gain[0] *= 60, station.gain[1] *= 60, station.gain[2] *= 60;
        if (n > 3)
            station.reach = 0.5;
    }
    session_path = made_session(&station, folder, made_plan_text);
    RUN_TEST(compare_ways);
    free(session_path);
    made_folder_remove(folder);
    return UNITY_END();
}
