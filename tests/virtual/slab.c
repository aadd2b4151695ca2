/* Samples made in memory. */
#include "slab.h"

struct sample slab_make(struct sample_material *material, double scattering_per_mm,
                        double absorption_per_mm, double index)
{
    *material = (struct sample_material){.index = index};
    for (int c = 0; c < 3; c++) {
        material->scattering_per_mm[c] = scattering_per_mm;
        material->absorption_per_mm[c] = absorption_per_mm;
    }
    return (struct sample){.materials = material, .material_count = 1};
}

void slab_make_mixed(struct slab *slab)
{
    *slab = (struct slab){
        .materials = {{.scattering_per_mm = {2.0, 1.5, 1.0},
                       .absorption_per_mm = {0.02, 0.1, 0.5},
                       .anisotropy = {0.2, 0, -0.1},
                       .index = 1.4},
                      {.scattering_per_mm = {3.0, 2.0, 2.5},
                       .absorption_per_mm = {0.4, 0.03, 0.2},
                       .index = 1.4},
                      {.scattering_per_mm = {0.5, 0.3, 0.2},
                       .absorption_per_mm = {1.0, 2.0, 2.5},
                       .index = 1.4}},
        .inclusions = {{.material_index = 1,
                        .depth_mm = {0, 1e6},
                        .wander_mm = 0.7,
                        .wander_size_mm = 2,
                        .seed = 4,
                        .bands = {.angle_deg = 30, .period_mm = 1.6, .fraction = 0.5, .line = 1}},
                       {.material_index = 2,
                        .depth_mm = {0, 1e6},
                        .seed = 9,
                        .cells = {.size_mm = 1, .fraction = 0.2, .line = 1}},
                       {.material_index = 0, .depth_mm = {1.5, 1e6}}}};
    slab->sample = (struct sample){.width = 5,
                                   .height = 4,
                                   .pitch_mm = 0.5,
                                   .thickness_mm = 2.5,
                                   .margin_points = 1,
                                   .materials = slab->materials,
                                   .material_count = 3,
                                   .inclusions = slab->inclusions,
                                   .inclusion_count = 3};
}
