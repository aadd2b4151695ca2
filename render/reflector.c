/* Looking up what a lit surface sends out where a ray met it. */
#include "render/reflector.h"

bool reflector_shines(const struct reflector *reflector, const struct world_hit *hit,
                      struct vec3 direction, double radiosity[3])
{
    const struct mesh *mesh = reflector->mesh;
    const uint32_t *corners = mesh->triangles[hit->triangle];
    const double weights[3] = {1 - hit->b1 - hit->b2, hit->b1, hit->b2};
    radiosity[0] = radiosity[1] = radiosity[2] = 0;
    if (!reflector->radiosity ||
        vec3_dot(mesh_triangle_cross(mesh, hit->triangle), direction) >= 0) {
        return false;
    }
    for (int k = 0; k < 3; k++) {
        for (int c = 0; c < 3; c++) {
            radiosity[c] += weights[k] * reflector->radiosity[corners[k]][c];
        }
    }
    return true;
}

void reflector_reflectance(const struct reflector *reflector, const struct world_hit *hit,
                           double reflectance[3])
{
    const struct mapping *mapping = reflector->mapping;
    if (!reflector->albedo) {
        for (int c = 0; c < 3; c++) {
            reflectance[c] = reflector->color[c];
        }
        return;
    }
    struct mapped chart = mapping_inside(mapping, reflector->mesh, hit->triangle, hit->b1, hit->b2);
    size_t column = (size_t)mapping_wrap((int64_t)floor(chart.x), mapping->width, mapping->mirror);
    size_t row = (size_t)mapping_wrap((int64_t)floor(chart.y), mapping->height, mapping->mirror);
    const float *texel = reflector->albedo + (row * (size_t)mapping->width + column) * 3;
    for (int c = 0; c < 3; c++) {
        reflectance[c] = texel[c];
    }
}
