/* Colours for maps and plots. */
#include "study/palette.h"

#include <math.h>
#include <stdio.h>

static struct colour mix(struct colour a, struct colour b, float share)
{
    return (struct colour){a.r + (b.r - a.r) * share, a.g + (b.g - a.g) * share,
                           a.b + (b.b - a.b) * share};
}

struct colour palette_heat(double value)
{
    /* Lightness rises evenly from stop to stop. */
    static const struct colour stops[] = {
        {0.02f, 0.02f, 0.09f}, {0.18f, 0.06f, 0.38f}, {0.40f, 0.10f, 0.47f}, {0.62f, 0.16f, 0.42f},
        {0.82f, 0.27f, 0.29f}, {0.94f, 0.46f, 0.17f}, {0.98f, 0.69f, 0.20f}, {0.98f, 0.93f, 0.60f},
    };
    enum { LAST = sizeof stops / sizeof stops[0] - 1 };
    if (isnan(value)) {
        return (struct colour){0.85f, 0.85f, 0.85f};
    }
    double place = fmin(fmax(value, 0), 1) * LAST;
    int stop = place < LAST ? (int)place : LAST - 1;
    return mix(stops[stop], stops[stop + 1], (float)(place - stop));
}

/* A hue in turns, with the saturation and lightness of the fixed colours below. */
static struct colour from_hue(double hue)
{
    double part[3];
    for (int i = 0; i < 3; i++) {
        part[i] = 0.45 + 0.32 * cos(2 * M_PI * (hue - i / 3.0));
    }
    return (struct colour){(float)part[0], (float)part[1], (float)part[2]};
}

struct colour palette_group(size_t index, size_t count)
{
    static const struct colour few[] = {
        {0.10f, 0.37f, 0.55f}, {0.85f, 0.42f, 0.12f}, {0.16f, 0.55f, 0.36f}, {0.70f, 0.17f, 0.30f},
        {0.48f, 0.36f, 0.66f}, {0.80f, 0.63f, 0.12f}, {0.25f, 0.62f, 0.70f}, {0.45f, 0.33f, 0.24f},
    };
    enum { FEW = sizeof few / sizeof few[0] };
    if (count <= FEW) {
        return few[index % FEW];
    }
    return from_hue(
        fmod((double)index * 0.6180339887498949, 1)); /* golden section: far neighbours */
}

void palette_format(struct colour colour, char text[8])
{
    (void)snprintf(text, 8, "#%02x%02x%02x", (unsigned)lrintf(colour.r * 255) & 255u,
                   (unsigned)lrintf(colour.g * 255) & 255u,
                   (unsigned)lrintf(colour.b * 255) & 255u);
}

static float linear(float value)
{
    return value <= 0.04045f ? value / 12.92f : powf((value + 0.055f) / 1.055f, 2.4f);
}

void palette_linear(struct colour colour, float rgb[3])
{
    rgb[0] = linear(colour.r);
    rgb[1] = linear(colour.g);
    rgb[2] = linear(colour.b);
}
