/* Shadow rays spread over the lights. */
#include "render/irradiance.h"

#include "render/random.h"

/* What decides about a ray. */
enum shadow { SHADOW_TRACE, SHADOW_NEVER };

struct tally {
    double irradiance[3];
    int cast, blocked;
};

/* Add samples begin to end - 1 of a light's `count`. */
static void add_samples(const struct world *world, const struct light *light, struct vec3 point,
                        struct vec3 normal, const double shift[2], uint64_t number, int begin,
                        int end, int count, enum shadow shadow, struct tally *tally)
{
    for (int k = begin; k < end; k++) {
        /* Roberts' R2 sequence: every run of it covers the light evenly. */
        double u[2] = {shift[0] + (double)(number + (uint64_t)k) * 0.7548776662466927,
                       shift[1] + (double)(number + (uint64_t)k) * 0.5698402909980532};
        u[0] -= floor(u[0]);
        u[1] -= floor(u[1]);
        struct light_arrival arrival = light_arrive(light, point, normal, u);
        const double *light_here = arrival.irradiance;
        if (fmax(light_here[0], fmax(light_here[1], light_here[2])) <= 0) {
            continue;
        }
        if (shadow == SHADOW_TRACE) {
            tally->cast++;
            if (world_blocked(world, point, normal, arrival.from)) {
                tally->blocked++;
                continue;
            }
        }
        for (int c = 0; c < 3; c++) {
            tally->irradiance[c] += light_here[c] / count;
        }
    }
}

uint64_t irradiance_at(const struct world *world, const struct light *lights, size_t light_count,
                       struct vec3 point, struct vec3 normal, int rays, uint64_t seed,
                       uint64_t stream, double out[3])
{
    struct tally tally = {0};
    for (size_t l = 0; l < light_count; l++) {
        int count = lights[l].kind == LIGHT_AREA ? rays : 1;
        double shift[2] = {random_uniform(seed, l, 0), random_uniform(seed, l, 1)};
        add_samples(world, &lights[l], point, normal, shift, stream * (uint64_t)count, 0, count,
                    count, SHADOW_TRACE, &tally);
    }
    for (int c = 0; c < 3; c++) {
        out[c] = tally.irradiance[c];
    }
    return (uint64_t)tally.cast;
}

uint64_t irradiance_penumbra(const struct world *world, const struct light *light,
                             struct vec3 point, struct vec3 normal, int rays, uint64_t seed,
                             uint64_t stream, double out[3])
{
    const int first = (rays + 3) / 4;
    double shift[2] = {random_uniform(seed, stream, 0), random_uniform(seed, stream, 1)};
    struct tally tally = {0};
    add_samples(world, light, point, normal, shift, 0, 0, first, rays, SHADOW_TRACE, &tally);
    bool dark = tally.cast > 0 && tally.blocked == tally.cast;
    enum shadow rest = tally.blocked == 0 ? SHADOW_NEVER : SHADOW_TRACE;
    if (!dark) {
        add_samples(world, light, point, normal, shift, 0, first, rays, rays, rest, &tally);
    }
    for (int c = 0; c < 3; c++) {
        out[c] = tally.irradiance[c];
    }
    return (uint64_t)tally.cast;
}
