/* Noise and quantisation of the virtual camera's sensor. */
#include "rig/virtual/sensor.h"

#include <math.h>
#include <stdbool.h>

/* Above this mean a Poisson variate is taken as normal: its skewness is 0.14 there and falls. */
static const double POISSON_MEAN = 50;

/* Pixels that a thread takes at a time, and from how many on there is more than one thread: below, waking them costs
 * more than it saves while frames are being compressed. */
enum { BLOCK = 8192, MANY = 1 << 18 };

/* SplitMix64 (Steele, Lea and Flood 2014). */
uint64_t sensor_key(uint64_t key, uint64_t value)
{
    uint64_t z = key + 0x9e3779b97f4a7c15u * (value + 1);
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* Wichura, Algorithm AS 241 (1988), PPND7, good to 1.2e-7; without its third branch, which 32-bit uniforms never reach. */
double sensor_normal(double p)
{
    double q = p - 0.5;
    if (fabs(q) <= 0.425) {
        double r = 0.180625 - q * q;
        return q * (((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179) /
               (((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1);
    }
    double r = sqrt(-log(q < 0 ? p : 1 - p)) - 1.6;
    double value = (((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777) /
                   ((0.12021132975 * r + 0.73700164250) * r + 1);
    return q < 0 ? -value : value;
}

double sensor_poisson(double mean, double p)
{
    double term = exp(-mean);
    double sum = term;
    double count = 0;
    /* The terms die out, so that rounding of the sum cannot hold the loop. */
    while (p > sum && (term > 0x1p-60 || count < mean)) {
        count += 1;
        term *= mean / count;
        sum += term;
    }
    return count;
}

static inline double probability(uint32_t bits)
{
    return (bits + 0.5) * 0x1p-32;
}

static inline uint16_t quantise(double value, double top)
{
    value = value < 0 ? 0 : value > top ? top : value;
    return (uint16_t)(value + 0.5);
}

/* The loop over pixels; `shot`, `read` and `dark` are constants where it is used, so each copy tests nothing that the
 * sensor does not have. */
static inline __attribute__((always_inline)) void expose(const struct sensor_exposure *exposure,
                                                         size_t first, size_t end, uint16_t *raw,
                                                         bool shot, bool read, bool dark)
{
    double top = (1 << exposure->camera->bits) - 1;
    double electrons = exposure->camera->electrons;
    double read_noise = exposure->camera->read_noise;
    for (size_t i = first; i < end; i++) {
        double value = exposure->signal[i] * exposure->seconds;
        if (dark) {
            value += exposure->dark;
        }
        if (shot || read) {
            uint64_t bits = sensor_key(exposure->key, i);
            double p = probability((uint32_t)(bits >> 32));
            if (shot && value * electrons <= POISSON_MEAN) {
                value = sensor_poisson(value * electrons, probability((uint32_t)bits)) / electrons;
                value += read ? read_noise * sensor_normal(p) : 0;
            } else {
                double variance =
                    (shot ? value / electrons : 0) + (read ? read_noise * read_noise : 0);
                value += sqrt(variance) * sensor_normal(p);
            }
        }
        raw[i] = quantise(value + exposure->camera->pedestal, top);
    }
}

typedef void expose_loop(const struct sensor_exposure *, size_t, size_t, uint16_t *);

#define EXPOSE(name, shot, read, dark)                                                             \
    static void name(const struct sensor_exposure *exposure, size_t first, size_t end,             \
                     uint16_t *raw)                                                                \
    {                                                                                              \
        expose(exposure, first, end, raw, shot, read, dark);                                       \
    }

EXPOSE(expose_exactly, false, false, false)
EXPOSE(expose_read, false, true, false)
EXPOSE(expose_shot, true, false, false)
EXPOSE(expose_shot_read, true, true, false)
EXPOSE(expose_dark, false, false, true)
EXPOSE(expose_read_dark, false, true, true)
EXPOSE(expose_shot_dark, true, false, true)
EXPOSE(expose_shot_read_dark, true, true, true)

static expose_loop *find_loop(const struct sensor_exposure *exposure)
{
    static expose_loop *const loops[2][2][2] = {
        {{expose_exactly, expose_read}, {expose_shot, expose_shot_read}},
        {{expose_dark, expose_read_dark}, {expose_shot_dark, expose_shot_read_dark}}};
    return loops[exposure->dark > 0][exposure->camera->electrons > 0]
                [exposure->camera->read_noise > 0];
}

void sensor_expose(const struct sensor_exposure *exposure, size_t count, uint16_t *raw)
{
    expose_loop *loop = find_loop(exposure);
#pragma omp parallel for schedule(dynamic) if (count >= MANY)
    for (size_t first = 0; first < count; first += BLOCK) {
        loop(exposure, first, first + BLOCK < count ? first + BLOCK : count, raw);
    }
}

void sensor_expose_one(const struct sensor_exposure *exposure, size_t pixel, uint16_t *raw)
{
    find_loop(exposure)(exposure, pixel, pixel + 1, raw);
}
