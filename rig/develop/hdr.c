/* Merging the raw exposures of a pattern into one radiance per pixel. */
#include "rig/develop/hdr.h"

#include <math.h>
#include <string.h>

enum {
    BLOCK = 512, /* pixels merged at a time, so that all sums stay in the first-level cache */
    PASSES =
        4, /* the weights vary slowly with the estimate: the third correction is far below the noise */
};

/* Standard deviations that an exposure must stay below saturation to be used. */
static const float headroom = 4;

/* One exposure's share in a pass over a block. */
struct term {
    const uint16_t *raw;
    float seconds;
    bool
        shortest; /* used wherever its sample is below saturation: nothing shorter is left to ask */
};

/* Built for AVX2 as well where the compiler can; the same operations in the same order give the same bits. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) &&                             \
    !defined(__SANITIZE_ADDRESS__)
#define FOR_WIDE_VECTORS __attribute__((noinline, target_clones("avx2", "default")))
#else
#define FOR_WIDE_VECTORS
#endif

FOR_WIDE_VECTORS
static void add_term(const struct term *term, const struct noise_model *noise, int bits, bool first,
                     size_t count, const float *estimate, float *numerator, float *denominator)
{
    float pedestal = (float)noise->pedestal;
    float seconds = term->seconds;
    float square = seconds * seconds;
    float floor_variance = (float)(noise->read_noise * noise->read_noise + 1.0 / 12);
    float shot = noise->electrons > 0 ? seconds / (float)noise->electrons : 0;
    int limit = (1 << bits) - 2; /* as hdr_is_saturated */
    float range = (float)limit - pedestal;
    bool any = first || term->shortest;
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        float light = estimate[i] > 0 ? estimate[i] : 0;
        float variance = floor_variance + shot * light;
        float room = range - light * seconds;
        bool safe = any | ((room > 0) & (room * room >= headroom * headroom * variance));
        float weight = safe & (term->raw[i] < limit) ? square / variance : 0;
        numerator[i] += weight * (((float)term->raw[i] - pedestal) / seconds);
        denominator[i] += weight;
    }
}

static void merge_block(const struct pattern_frames *frames, const struct noise_model *noise,
                        size_t shortest, size_t begin, size_t count, float *radiance,
                        float *variance)
{
    float numerator[BLOCK];
    float denominator[BLOCK];
    memset(radiance, 0, count * sizeof *radiance);
    for (int pass = 0; pass < PASSES; pass++) {
        memset(numerator, 0, sizeof numerator);
        memset(denominator, 0, sizeof denominator);
        for (size_t e = 0; e < frames->count; e++) {
            struct term term = {frames->exposures[e].raw + begin,
                                (float)((double)frames->exposures[e].exposure_ns * 1e-9),
                                e == shortest};
            add_term(&term, noise, frames->bits, pass == 0, count, radiance, numerator,
                     denominator);
        }
        for (size_t i = 0; i < count; i++) {
            radiance[i] = denominator[i] > 0 ? numerator[i] / denominator[i] : NAN;
        }
    }
    if (variance) {
        for (size_t i = 0; i < count; i++) {
            variance[i] = denominator[i] > 0 ? 1 / denominator[i] : NAN;
        }
    }
}

size_t hdr_merge(const struct pattern_frames *frames, const struct noise_model *noise,
                 float *radiance, float *variance)
{
    size_t pixels = (size_t)frames->width * (size_t)frames->height;
    size_t shortest = 0;
    size_t saturated = 0;
    for (size_t e = 1; e < frames->count; e++) {
        if (frames->exposures[e].exposure_ns < frames->exposures[shortest].exposure_ns) {
            shortest = e;
        }
    }
    for (size_t begin = 0; begin < pixels; begin += BLOCK) {
        size_t count = pixels - begin < BLOCK ? pixels - begin : BLOCK;
        merge_block(frames, noise, shortest, begin, count, radiance + begin,
                    variance ? variance + begin : NULL);
    }
    for (size_t i = 0; i < pixels; i++) {
        saturated += isnan(radiance[i]) ? 1 : 0;
    }
    return saturated;
}
