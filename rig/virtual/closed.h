/* Responses of a homogeneous slab in closed form: the diffusion equation solved on paper.
 *
 * Light that enters evenly along a wave cos(k x) of the surface has fluences of the form u e^-qz + v e^qz + w e^-sz below
 * it; a response is the sum over waves. That is the multipole's whole series of images with the partial-current
 * condition itself in place of an extrapolated boundary, and has no voxels. docs/transport.md says more. */
#ifndef RIG_VIRTUAL_CLOSED_H
#define RIG_VIRTUAL_CLOSED_H

#include "nacre/error.h"

/* Infinite to the sides; one channel. Scattering is reduced. */
struct closed_slab {
    double scattering_per_mm, absorption_per_mm;
    double index; /* of refraction */
    double thickness_mm;
    double pitch_mm; /* a side of the square surface points */
};

enum closed_quantity {
    CLOSED_RADIANCE, /* R_d: pi times the radiance that leaves along the normal */
    CLOSED_EXITANCE, /* flux through the surface of light that was scattered */
};

/* How far light goes: the slowest mode of the slab between its extrapolated boundaries. */
double closed_decay_mm(const struct closed_slab *slab);

/* How many wave numbers closed_response sums over in x, and in y. */
double closed_waves(const struct closed_slab *slab, int window);

/* The K x K response of a surface point. */
int closed_response(const struct closed_slab *slab, enum closed_quantity quantity, int window,
                    float *response, struct nacre_error *error);

#endif
