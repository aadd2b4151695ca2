/* The projector's lamp: random values at regular times and smooth steps between them, integrated exactly. */
#include "rig/virtual/lamp.h"

#include "rig/virtual/sensor.h"

#include <math.h>

enum { KEY_DRIFT = 0x6c616d70, KEY_FLICKER };

/* The normal variate that belongs to a moment. */
static double value_at(uint64_t key, double moment)
{
    uint64_t bits = sensor_key(key, (uint64_t)(int64_t)moment);
    return sensor_normal(((double)(bits >> 32) + 0.5) * 0x1p-32);
}

/* The integral over u from 0 to t of the step 3 u^2 - 2 u^3. */
static double step_integral(double t)
{
    return t * t * t * (1 - 0.5 * t);
}

/* The mean from `begin` to `end`, counted in moments. */
static double mean(uint64_t key, double begin, double end)
{
    double sum = 0;
    for (int64_t i = (int64_t)floor(begin); (double)i < end; i++) {
        double moment = (double)i;
        double from = fmax(begin - moment, 0);
        double to = fmin(end - moment, 1);
        double before = value_at(key, moment);
        double rise = value_at(key, moment + 1) - before;
        sum += before * (to - from) + rise * (step_integral(to) - step_integral(from));
    }
    return sum / (end - begin);
}

static uint64_t key_of(int seed, int what)
{
    return sensor_key((uint64_t)seed, (uint64_t)what);
}

double lamp_drift(const struct virtual_lamp *lamp, int seed, int64_t begin_ns, int64_t end_ns)
{
    double moments_a_ns = 1e-9 / (3600 * lamp->drift_hours);
    return lamp->drift * mean(key_of(seed, KEY_DRIFT), (double)begin_ns * moments_a_ns,
                              (double)end_ns * moments_a_ns);
}

double lamp_flicker(const struct virtual_lamp *lamp, int seed, int64_t begin_ns, int64_t end_ns)
{
    double moments_a_ns = 1e-9 * lamp->flicker_hz;
    return lamp->flicker * mean(key_of(seed, KEY_FLICKER), (double)begin_ns * moments_a_ns,
                                (double)end_ns * moments_a_ns);
}
