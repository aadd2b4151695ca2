/* The responses of a grid pattern's lit points, cut out of its picture of the surface. */
#include "rig/develop/extract.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

static void add_entry(struct extract_sums *sums, float value, bool whole, int ring)
{
    sums->entries++;
    if (isnan(value)) {
        sums->missing++;
        return;
    }
    if (ring == 0) {
        sums->centre += (double)value;
    }
    if (whole) {
        sums->rings[ring < EXTRACT_RINGS ? ring : EXTRACT_RINGS - 1] += (double)value;
    }
}

void extract_window(const struct nacre_scan_info *info, const float *reflected, int x, int y,
                    float *response)
{
    int half = info->window / 2;
    for (int c = 0; c < info->channels; c++) {
        for (int v = y - half; v <= y + half; v++) {
            for (int u = x - half; u <= x + half; u++) {
                bool inside = u >= 0 && v >= 0 && u < info->width && v < info->height;
                size_t at = ((size_t)c * (size_t)info->height + (size_t)v) * (size_t)info->width +
                            (size_t)u;
                *response++ = inside ? reflected[at] : 0;
            }
        }
    }
}

void extract_add(const struct nacre_scan_info *info, int x, int y, const float *response,
                 struct extract_sums *sums)
{
    int half = info->window / 2;
    bool whole = x >= half && y >= half && x + half < info->width && y + half < info->height;
    sums->responses++;
    for (int c = 0; c < info->channels; c++) {
        for (int v = y - half; v <= y + half; v++) {
            for (int u = x - half; u <= x + half; u++, response++) {
                if (u >= 0 && v >= 0 && u < info->width && v < info->height) {
                    int across = abs(u - x);
                    int down = abs(v - y);
                    add_entry(sums, *response, whole, across > down ? across : down);
                }
            }
        }
    }
}

static double total(const struct extract_sums *sums)
{
    double sum = 0;
    for (int ring = 0; ring < EXTRACT_RINGS; ring++) {
        sum += sums->rings[ring];
    }
    return sum;
}

double extract_overlap(const struct extract_sums *sums, int window)
{
    int outer = window / 2 < EXTRACT_RINGS ? window / 2 : EXTRACT_RINGS - 1;
    int middle = (outer + 1) / 2;
    double whole = total(sums);
    if (!(whole > 0)) {
        return NAN;
    }
    if (outer <= middle || !(sums->rings[outer] > 0)) {
        return outer > middle ? 0 : 1;
    }
    double rate = pow(sums->rings[outer] / sums->rings[middle], 1.0 / (outer - middle));
    double outside = sums->rings[outer] * rate / (1 - rate);
    return rate < 1 ? outside / (whole + outside) : 1;
}

double extract_rim_share(const struct extract_sums *sums, int window)
{
    int outer = window / 2 < EXTRACT_RINGS ? window / 2 : EXTRACT_RINGS - 1;
    double whole = total(sums);
    return whole > 0 ? sums->rings[outer] / whole : NAN;
}
