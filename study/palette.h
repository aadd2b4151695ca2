/* Colours for maps and plots. */
#ifndef STUDY_PALETTE_H
#define STUDY_PALETTE_H

#include <stddef.h>

/* An sRGB colour, 0 to 1. */
struct colour {
    float r, g, b;
};

/* A scale that is as readable in grey and for the colour-blind: dark violet for 0, over red, to light yellow for 1.
 * What lies outside is clipped; NaN is a light grey. */
struct colour palette_heat(double value);

/* One of `count` colours that are told apart easily, for groups. */
struct colour palette_group(size_t index, size_t count);

/* Write it as "#rrggbb" and the final zero. */
void palette_format(struct colour colour, char text[8]);

/* The linear values that a PNG encoder turns back into this colour. */
void palette_linear(struct colour colour, float rgb[3]);

#endif
