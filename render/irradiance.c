/* Stratified shadow rays. */
#include "render/irradiance.h"

#include "render/random.h"

uint64_t irradiance_at(const struct world *world, const struct light *lights, size_t light_count,
                       struct vec3 point, struct vec3 normal, int rays, uint64_t seed,
                       uint64_t stream, double out[3])
{
    uint64_t cast = 0;
    out[0] = out[1] = out[2] = 0;
    for (size_t l = 0; l < light_count; l++) {
        int side = lights[l].kind == LIGHT_AREA ? (int)ceil(sqrt(rays)) : 1;
        for (int k = 0; k < side * side; k++) {
            uint64_t index = (l * (uint64_t)side * (uint64_t)side + (uint64_t)k) * 2;
            double jitter[2] = {random_uniform(seed, stream, index),
                                random_uniform(seed, stream, index + 1)};
            double u[2] = {(k % side + jitter[0]) / side,
                           ((k - k % side) / side + jitter[1]) / side};
            struct light_arrival arrival = light_arrive(&lights[l], point, normal, u);
            double most =
                fmax(arrival.irradiance[0], fmax(arrival.irradiance[1], arrival.irradiance[2]));
            if (most <= 0) {
                continue;
            }
            cast++;
            if (!world_blocked(world, point, normal, arrival.from)) {
                for (int c = 0; c < 3; c++) {
                    out[c] += arrival.irradiance[c] / (side * side);
                }
            }
        }
    }
    return cast;
}
