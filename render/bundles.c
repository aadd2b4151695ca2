/* Sorting points along a curve that fills space, and their boxes. */
#include "render/bundles.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { CURVE_BITS = 12, DIGIT = 1 << CURVE_BITS };

struct bundle_box bundles_box(const float *positions, size_t stride, const uint32_t *order,
                              size_t count)
{
    struct bundle_box box = {{HUGE_VALF, HUGE_VALF, HUGE_VALF},
                             {-HUGE_VALF, -HUGE_VALF, -HUGE_VALF}};
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            float value = positions[(order ? order[i] : i) * stride + (size_t)k];
            box.low[k] = value < box.low[k] ? value : box.low[k];
            box.high[k] = value > box.high[k] ? value : box.high[k];
        }
    }
    return box;
}

double bundles_gap(const struct bundle_box *a, const struct bundle_box *b)
{
    double square = 0;
    for (int k = 0; k < 3; k++) {
        double away = fmax(
            fmax((double)a->low[k] - (double)b->high[k], (double)b->low[k] - (double)a->high[k]),
            0);
        square += away * away;
    }
    return sqrt(square);
}

struct on_curve {
    uint64_t key;
    uint32_t index;
};

/* Two zeros between the bits. */
static uint64_t spread(uint64_t v)
{
    v = (v | v << 16) & UINT64_C(0x0000ff0000ff);
    v = (v | v << 8) & UINT64_C(0x00f00f00f00f);
    v = (v | v << 4) & UINT64_C(0x0c30c30c30c3);
    return (v | v << 2) & UINT64_C(0x249249249249);
}

/* Hilbert's curve by Skilling's method (AIP Conference Proceedings 707, 381, 2004): unlike Morton's, it never jumps, so
 * that runs stay compact wherever they begin. */
static uint64_t hilbert(const uint32_t place[3])
{
    uint32_t x[3] = {place[0], place[1], place[2]}, turned = 0;
    for (uint32_t bit = DIGIT / 2; bit > 1; bit /= 2) {
        for (int k = 0; k < 3; k++) {
            uint32_t set = 0 - (uint32_t)((x[k] & bit) != 0), below = bit - 1;
            uint32_t swapped = (x[0] ^ x[k]) & below & ~set;
            x[0] ^= swapped | (below & set);
            x[k] ^= swapped;
        }
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    for (uint32_t bit = DIGIT / 2; bit > 1; bit /= 2) {
        turned ^= (bit - 1) & (0 - (uint32_t)((x[2] & bit) != 0));
    }
    return spread(x[0] ^ turned) << 2 | spread(x[1] ^ turned) << 1 | spread(x[2] ^ turned);
}

static void place_on_curve(const float *positions, size_t stride, const uint32_t *order,
                           size_t count, struct on_curve *out)
{
    struct bundle_box box = bundles_box(positions, stride, order, count);
    float extent = 0;
    for (int k = 0; k < 3; k++) {
        extent = fmaxf(extent, box.high[k] - box.low[k]);
    }
    float scale = extent > 0 ? (float)(DIGIT - 1) / extent : 0;
    for (size_t i = 0; i < count; i++) {
        const float *p = positions + (size_t)order[i] * stride;
        uint32_t place[3];
        for (int k = 0; k < 3; k++) {
            place[k] = (uint32_t)((p[k] - box.low[k]) * scale);
        }
        out[i].key = hilbert(place);
        out[i].index = order[i];
    }
}

int bundles_order(const float *positions, size_t stride, uint32_t *order, size_t count)
{
    struct on_curve *list = malloc((2 * count + 1) * sizeof *list), *from = list,
                    *to = list + count;
    uint32_t *starts = malloc((DIGIT + 1) * sizeof *starts);
    if (!list || !starts) {
        free(list);
        free(starts);
        return -1;
    }
    place_on_curve(positions, stride, order, count, from);
    for (int shift = 0; shift < 3 * CURVE_BITS; shift += CURVE_BITS) {
        memset(starts, 0, (DIGIT + 1) * sizeof *starts);
        for (size_t i = 0; i < count; i++) {
            starts[(from[i].key >> shift & (DIGIT - 1)) + 1]++;
        }
        for (size_t i = 0; i < DIGIT; i++) {
            starts[i + 1] += starts[i];
        }
        for (size_t i = 0; i < count; i++) {
            to[starts[from[i].key >> shift & (DIGIT - 1)]++] = from[i];
        }
        struct on_curve *swapped = from;
        from = to;
        to = swapped;
    }
    for (size_t i = 0; i < count; i++) {
        order[i] = from[i].index;
    }
    free(list);
    free(starts);
    return 0;
}
