/* The virtual camera's lens: distortion, and the places of the scene that a pixel gathers light from. */
#ifndef RIG_VIRTUAL_LENS_H
#define RIG_VIRTUAL_LENS_H

#include <stdbool.h>

enum { LENS_SHARP = 64, LENS_DEFOCUSED = 256 };

/* Places evenly over a pixel's square, or over that square spread by a circle of confusion, from the pixel's corner. */
struct lens_places {
    int count;
    double u[LENS_DEFOCUSED], v[LENS_DEFOCUSED];
};

void lens_places_sharp(struct lens_places *places);
void lens_places_defocused(double diameter_px, struct lens_places *places);

/* Whether Brown's r (1 + k1 r^2 + k2 r^4) grows as far as `reach`, which some r up to twice that comes to. The frame's
 * corners are at 1; a defocused lens gathers light from beyond them. */
bool lens_distortion_is_sound(const double k[2], double reach);

/* Where a pixel's place (u, v) would be without distortion, in a frame of width x height. */
void lens_straighten(const double k[2], int width, int height, double *u, double *v);

#endif
