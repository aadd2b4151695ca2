/* Samples made in memory, for tests of the light transport. */
#ifndef TESTS_VIRTUAL_SLAB_H
#define TESTS_VIRTUAL_SLAB_H

#include "rig/virtual/sample.h"

/* A homogeneous slab of one grey medium with isotropic scattering. Owns nothing: do not finish it. The materials are
 * `material`, which must outlive the sample. */
struct sample slab_make(struct sample_material *material, double scattering_per_mm,
                        double absorption_per_mm, double index);

/* Three materials in wandering bands, cells and a layer, a different one in each channel, with index 1.4. */
struct slab {
    struct sample sample;
    struct sample_material materials[3];
    struct sample_inclusion inclusions[3];
};
void slab_make_mixed(struct slab *slab);

#endif
