/* What a smooth boundary to air does to light that crosses it. */
#ifndef RIG_VIRTUAL_FRESNEL_H
#define RIG_VIRTUAL_FRESNEL_H

/* The part of unpolarised light that is reflected inside a medium of refractive index `index` (relative to what is
 * outside) whose direction makes an angle of cosine `cosine` with the normal. */
double fresnel_inside(double index, double cosine);

/* The part that crosses along the normal, the same in both directions. */
double fresnel_through_normal(double index);

/* Internal reflection as the diffusion boundary condition phi = 2 A J wants it (Haskell et al. 1994, Contini et al.
 * 1997): A = (1 + 3 int R m^2 dm) / (1 - 2 int R m dm), m the cosine from 0 to 1; 1 for a matched boundary. */
double fresnel_boundary_a(double index);

#endif
