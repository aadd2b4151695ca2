/* The projector's colour wheel: the overlap of exposures and segments. */
#include "rig/virtual/wheel.h"

#include <math.h>

void wheel_init(const struct virtual_wheel *settings, double wheel_hz, struct wheel *wheel)
{
    double means[3] = {0};
    double end = 0;
    *wheel = (struct wheel){.period_ns = 1e9 / wheel_hz,
                            .phase = settings->phase_deg / 360,
                            .count = (int)settings->segment_count};
    for (int i = 0; i < wheel->count; i++) {
        const struct virtual_segment *segment = &settings->segments[i];
        end += segment->angle_deg / 360;
        wheel->ends[i] = i + 1 < wheel->count ? end : 1;
        for (int c = 0; c < 3; c++) {
            means[c] += segment->color[c] * segment->angle_deg / 360;
        }
    }
    for (int i = 0; i < wheel->count; i++) {
        for (int c = 0; c < 3; c++) {
            wheel->light[i][c] = settings->segments[i].color[c] / means[c];
        }
    }
}

/* The light of a channel from the wheel's beginning to a part of its first turn. */
static double light_until(const struct wheel *wheel, double part, int channel)
{
    double sum = 0;
    double begin = 0;
    for (int i = 0; i < wheel->count && begin < part; i++) {
        sum += wheel->light[i][channel] * (fmin(wheel->ends[i], part) - begin);
        begin = wheel->ends[i];
    }
    return sum;
}

bool wheel_gains(const struct wheel *wheel, int64_t begin_ns, int64_t exposure_ns, double gains[3])
{
    static const double EXACT_NS = 1;
    double turns = (double)exposure_ns / wheel->period_ns;
    bool whole = turns > 0.5 && fabs(turns - rint(turns)) * wheel->period_ns <= EXACT_NS;
    double begin = (double)begin_ns / wheel->period_ns + wheel->phase;
    begin -= floor(begin);
    for (int c = 0; c < 3 && !whole; c++) {
        double end = begin + turns;
        double light =
            floor(end) + light_until(wheel, end - floor(end), c) - light_until(wheel, begin, c);
        gains[c] = light / turns;
    }
    return !whole;
}
