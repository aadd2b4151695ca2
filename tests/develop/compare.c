/* How far a scan developed from a made session is from the exact responses. */
#include "compare.h"

#include "nacre/scan.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>

/* Sums over the points. */
struct sums {
    struct comparison means;
    double far_squares;
    size_t far_count;
    int points;
};

static void add_point(const struct made_station *station, const struct nacre_scan_info *info, int x,
                      int y, const float *response, struct sums *sums)
{
    int window = info->window;
    double off = 0;
    double all = 0;
    double sum = 0;
    double exact_sum = 0;
    for (int k = 0; k < info->channels * window * window; k++) {
        int across = k % window - window / 2;
        int down = k / window % window - window / 2;
        int xo = x + across;
        int yo = y + down;
        if (xo < 0 || yo < 0 || xo >= info->width || yo >= info->height || isnan(response[k])) {
            continue;
        }
        double exact = made_transfer(station, k / window / window, x, y, xo, yo);
        off += (response[k] - exact) * (response[k] - exact);
        all += exact * exact;
        sum += (double)response[k];
        exact_sum += exact;
        if (abs(across) == window / 2 && abs(down) == window / 2) {
            sums->far_squares += (double)response[k] * (double)response[k];
            sums->far_count++;
        }
    }
    sums->means.missing += isnan(response[window * window / 2]) ? 1 : 0;
    if (all > 0) {
        sums->means.error += sqrt(off / all);
        sums->means.bias += sum / exact_sum - 1;
        sums->points++;
    }
}

struct comparison made_compare(const struct made_station *station, const char *scan_path)
{
    struct nacre_scan *scan = NULL;
    struct nacre_error error = {""};
    struct sums sums = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_open(scan_path, &scan, &error), error.text);
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    TEST_ASSERT_EQUAL_INT(station->width, info->width);
    TEST_ASSERT_EQUAL_INT(station->height, info->height);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, info->pitch_mm);
    float *response = malloc(nacre_scan_response_size(info) * sizeof *response);
    for (int i = 0; i < info->width * info->height; i++) {
        int x = i % info->width;
        int y = i / info->width;
        TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_scan_read(scan, x, y, response, &error));
        add_point(station, info, x, y, response, &sums);
    }
    free(response);
    nacre_scan_close(scan);
    sums.means.error /= sums.points;
    sums.means.bias /= sums.points;
    sums.means.far_rms = sqrt(sums.far_squares / (double)sums.far_count);
    return sums.means;
}
