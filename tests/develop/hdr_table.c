/* Prints what each way of weighting exposures makes of light that is known: a table of docs/accuracy.md. */
#include "made.h"
#include "rig/develop/hdr.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* The exposures of the demo station: 1/30, 4/30, 1/2 and 2 s of 10 bits. */
enum { PIXELS = 200000, EXPOSURES = 4, BITS = 10, LIMIT = (1 << BITS) - 2 };

static const struct noise_model noise = {32, 0.7, 15};
static const double turns[EXPOSURES] = {1, 4, 15, 60};
static struct exposure exposures[EXPOSURES];
static struct pattern_frames frames = {
    .width = PIXELS / 4, .height = 4, .bits = BITS, .count = EXPOSURES, .exposures = exposures};

/* All pixels see the same light, in raw units a second, each with its own noise. */
static void expose(double light)
{
    struct made_random random = {(uint64_t)(light * 1000) + 1};
    for (int e = 0; e < EXPOSURES; e++) {
        for (int i = 0; i < PIXELS; i++) {
            double electrons = made_poisson(&random, light * turns[e] / 30 * noise.electrons);
            double value = electrons / noise.electrons + noise.pedestal +
                           noise.read_noise * made_normal(&random);
            exposures[e].raw[i] = (uint16_t)fmin(fmax(floor(value + 0.5), 0), (1 << BITS) - 1);
        }
    }
}

/* Weights by the noise of the sample itself; samples below saturation count. */
static double weigh_by_samples(int pixel)
{
    double above = 0;
    double below = 0;
    for (int e = 0; e < EXPOSURES; e++) {
        double seconds = turns[e] / 30;
        double value = exposures[e].raw[pixel] - noise.pedestal;
        double variance =
            noise.read_noise * noise.read_noise + 1.0 / 12 + fmax(value, 0) / noise.electrons;
        double weight = exposures[e].raw[pixel] < LIMIT ? seconds * seconds / variance : 0;
        above += weight * value / seconds;
        below += weight;
    }
    return below > 0 ? above / below : NAN;
}

/* The longest exposure whose sample is below saturation, alone. */
static double take_longest(int pixel)
{
    for (int e = EXPOSURES - 1; e >= 0; e--) {
        if (exposures[e].raw[pixel] < LIMIT) {
            return (exposures[e].raw[pixel] - noise.pedestal) * 30 / turns[e];
        }
    }
    return NAN;
}

static void print_bias(const double *sums, double light, int way)
{
    double mean = sums[2 * way] / PIXELS;
    double deviation = sqrt(fmax(sums[2 * way + 1] / PIXELS - mean * mean, 0));
    (void)printf(" %+.3f %% (%.3f) |", 100 * (mean / light - 1),
                 100 * deviation / sqrt(PIXELS) / light);
}

int main(void)
{
    float *radiance = malloc(PIXELS * sizeof *radiance);
    bool ready = radiance != NULL;
    for (int e = 0; e < EXPOSURES; e++) {
        exposures[e].exposure_ns = llround(turns[e] * 1e9 / 30);
        exposures[e].raw = calloc(PIXELS, sizeof *exposures[e].raw);
        ready = ready && exposures[e].raw;
    }
    (void)printf("| light | as developed | weights by each sample | longest unsaturated sample |\n"
                 "| --- | --- | --- | --- |\n");
    /* From the end of the shortest exposure's range down to 1 : 10,000, with the ends of two others. */
    const double brightest = 0.95 * (LIMIT - noise.pedestal) * 30;
    const double lights[] = {brightest,       0.263 * brightest, brightest / 10, 0.0702 * brightest,
                             brightest / 100, brightest / 1000,  brightest / 1e4};
    for (size_t k = 0; ready && k < sizeof lights / sizeof *lights; k++) {
        double sums[6] = {0};
        expose(lights[k]);
        (void)hdr_merge(&frames, &noise, radiance, NULL);
        for (int i = 0; i < PIXELS; i++) {
            const double values[3] = {(double)radiance[i], weigh_by_samples(i), take_longest(i)};
            for (int way = 0; way < 3; way++) {
                sums[2 * way] += values[way];
                sums[2 * way + 1] += values[way] * values[way];
            }
        }
        (void)printf("| 1 : %.3g |", brightest / lights[k]);
        for (int way = 0; way < 3; way++) {
            print_bias(sums, lights[k], way);
        }
        (void)printf("\n");
    }
    for (int e = 0; e < EXPOSURES; e++) {
        free(exposures[e].raw);
    }
    free(radiance);
    return ready ? EXIT_SUCCESS : EXIT_FAILURE;
}
