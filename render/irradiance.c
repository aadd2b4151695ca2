/* Shadow rays spread over the lights, and rays spread over what a point sees. */
#include "render/irradiance.h"

#include "render/effects.h"
#include "render/fresnel.h"
#include "render/random.h"

struct light_tally {
    double irradiance[3];
    int cast, blocked,
        entered; /* samples that were traced, were stopped, and were weighed by their angle */
};

/* Number k of Roberts' R2 sequence, every run of which covers the unit square evenly. */
static void square_point(const double shift[2], uint64_t k, double u[2])
{
    u[0] = shift[0] + (double)k * 0.7548776662466927;
    u[1] = shift[1] + (double)k * 0.5698402909980532;
    u[0] -= floor(u[0]);
    u[1] -= floor(u[1]);
}

/* What is inlined must not depend on which of the ways exist. */
#define WAY __attribute__((noinline, flatten))

static double transmitted(const struct lit_point *point, struct vec3 towards)
{
    return fresnel_transmitted(point->index, vec3_dot(vec3_unit(towards), point->normal));
}

/* Samples of a light: numbers from `first` on, each of the share `share`. */
struct light_run {
    const double *shift;
    uint64_t first;
    int count;
    double share;
};

/* One body for all; `shadows` and `enters` are constant where it is used, so that nothing is asked for each ray. */
__attribute__((always_inline)) static inline void
add_samples(const struct world *world, const struct light *light, const struct lit_point *point,
            const struct light_run *run, const bool shadows, const bool enters,
            struct light_tally *tally)
{
    for (int k = 0; k < run->count; k++) {
        double u[2];
        square_point(run->shift, run->first + (uint64_t)k, u);
        struct light_arrival arrival = light_arrive(light, point->position, point->normal, u);
        const double *light_here = arrival.irradiance;
        if (fmax(light_here[0], fmax(light_here[1], light_here[2])) <= 0) {
            continue;
        }
        if (shadows) {
            tally->cast++;
            if (world_blocked(world, point->position, point->normal, arrival.from)) {
                tally->blocked++;
                continue;
            }
        }
        double share = run->share;
        if (enters) {
            tally->entered++;
            share *= transmitted(point, vec3_subtract(arrival.from, point->position));
        }
        for (int c = 0; c < 3; c++) {
            tally->irradiance[c] += light_here[c] * share;
        }
    }
}

static void count_work(const struct light *light, int drawn, const struct light_tally *tally,
                       struct light_work *work)
{
    work->shadow_rays += (uint64_t)tally->cast;
    work->lookups[light->lookup] += (uint64_t)drawn;
    work->transmittances += (uint64_t)tally->entered;
}

__attribute__((always_inline)) static inline void add_lights(const struct lighting *lighting,
                                                             const struct lit_point *point,
                                                             const bool shadows, const bool enters,
                                                             double out[3], struct light_work *work)
{
    out[0] = out[1] = out[2] = 0;
    for (size_t l = 0; l < lighting->light_count; l++) {
        const struct light *light = &lighting->lights[l];
        int count = light->soft ? lighting->rays : 1;
        double shift[2] = {random_uniform(lighting->seed, l, 0),
                           random_uniform(lighting->seed, l, 1)};
        struct light_run run = {shift, point->stream * (uint64_t)count, count, 1.0 / count};
        struct light_tally tally = {0};
        add_samples(lighting->world, light, point, &run, shadows, enters, &tally);
        count_work(light, count, &tally, work);
        for (int c = 0; c < 3; c++) {
            out[c] += tally.irradiance[c];
        }
    }
}

WAY static void find_traced(const struct lighting *lighting, const struct lit_point *point,
                            double out[3], struct light_work *work)
{
    add_lights(lighting, point, true, false, out, work);
}

WAY static void find_untraced(const struct lighting *lighting, const struct lit_point *point,
                              double out[3], struct light_work *work)
{
    add_lights(lighting, point, false, false, out, work);
}

WAY static void find_traced_entering(const struct lighting *lighting, const struct lit_point *point,
                                     double out[3], struct light_work *work)
{
    add_lights(lighting, point, true, true, out, work);
}

WAY static void find_untraced_entering(const struct lighting *lighting,
                                       const struct lit_point *point, double out[3],
                                       struct light_work *work)
{
    add_lights(lighting, point, false, true, out, work);
}

static irradiance_way *choose(bool traced, double index)
{
    bool shadows = RENDER_EFFECTS_BUILT(RENDER_SHADOWS) && traced;
    if (RENDER_EFFECTS_BUILT(RENDER_FRESNEL) && index != 1) {
        return shadows ? find_traced_entering : find_untraced_entering;
    }
    return shadows ? find_traced : find_untraced;
}

/* The same for rays that look for other surfaces. */
__attribute__((always_inline)) static inline void add_surfaces(const struct lighting *lighting,
                                                               const struct lit_point *point,
                                                               const bool enters, double out[3],
                                                               struct light_work *work)
{
    double shift[2] = {random_uniform(lighting->seed, UINT64_MAX, 0),
                       random_uniform(lighting->seed, UINT64_MAX, 1)};
    double share = 1.0 / lighting->rays;
    for (int k = 0; k < lighting->rays; k++) {
        double u[2], radiosity[3], entering = share;
        struct world_hit hit;
        square_point(shift, point->stream * (uint64_t)lighting->rays + (uint64_t)k, u);
        struct vec3 direction = vec3_by_cosine(point->normal, u);
        if (!world_look(lighting->world, point->position, point->normal, direction, &hit) ||
            !reflector_shines(&lighting->reflectors[hit.object], &hit, direction, radiosity)) {
            continue;
        }
        if (enters) {
            entering *= transmitted(point, direction);
            work->transmittances++;
        }
        for (int c = 0; c < 3; c++) {
            out[c] += radiosity[c] * entering;
        }
    }
    work->bounce_rays += (uint64_t)lighting->rays;
}

WAY static void find_with_surfaces(const struct lighting *lighting, const struct lit_point *point,
                                   double out[3], struct light_work *work)
{
    choose(lighting->shadows, 1)(lighting, point, out, work);
    add_surfaces(lighting, point, false, out, work);
}

WAY static void find_with_surfaces_entering(const struct lighting *lighting,
                                            const struct lit_point *point, double out[3],
                                            struct light_work *work)
{
    choose(lighting->shadows, point->index)(lighting, point, out, work);
    add_surfaces(lighting, point, true, out, work);
}

irradiance_way *irradiance_choose(const struct lighting *lighting, double index)
{
    if (!(RENDER_EFFECTS_BUILT(RENDER_BOUNCES) && lighting->reflectors)) {
        return choose(lighting->shadows, index);
    }
    return RENDER_EFFECTS_BUILT(RENDER_FRESNEL) && index != 1 ? find_with_surfaces_entering
                                                              : find_with_surfaces;
}

/* For a light whose shadow is not known beforehand. */
typedef void run_way(const struct lighting *lighting, const struct light *light,
                     const struct lit_point *point, const struct light_run *run,
                     struct light_tally *tally);

WAY static void run_traced(const struct lighting *lighting, const struct light *light,
                           const struct lit_point *point, const struct light_run *run,
                           struct light_tally *tally)
{
    add_samples(lighting->world, light, point, run, true, false, tally);
}

WAY static void run_untraced(const struct lighting *lighting, const struct light *light,
                             const struct lit_point *point, const struct light_run *run,
                             struct light_tally *tally)
{
    add_samples(lighting->world, light, point, run, false, false, tally);
}

/* So many rays decide at least: fewer miss what is left of a light near a shadow's core. */
enum { DECIDING_RAYS = 36 };

void irradiance_penumbra(const struct lighting *lighting, const struct light *light,
                         const struct lit_point *point, double out[3], struct light_work *work)
{
    const int most = lighting->rays, quarter = (most + 3) / 4;
    const int first = quarter > DECIDING_RAYS ? quarter
                      : most < DECIDING_RAYS  ? most
                                              : DECIDING_RAYS;
    const int rest = most - first;
    /* The same places of the light for all points: where a shadow ends is off by a little everywhere, not ragged. */
    double shift[2] = {random_uniform(lighting->seed, 0, 0), random_uniform(lighting->seed, 0, 1)};
    double share = 1.0 / lighting->rays;
    struct light_tally tally = {0};
    struct light_run run = {shift, 0, first, share};
    bool shadows = RENDER_EFFECTS_BUILT(RENDER_SHADOWS) && lighting->shadows;
    run_way *way = shadows ? run_traced : run_untraced;
    way(lighting, light, point, &run, &tally);
    bool dark = tally.cast > 0 && tally.blocked == tally.cast;
    bool penumbra = tally.blocked > 0;
    if (!dark) {
        run = (struct light_run){shift, (uint64_t)first, rest, share};
        (penumbra ? way : run_untraced)(lighting, light, point, &run, &tally);
    }
    count_work(light, dark ? first : lighting->rays, &tally, work);
    for (int c = 0; c < 3; c++) {
        out[c] = tally.irradiance[c];
    }
}

void light_work_add(struct light_work *sum, const struct light_work *more)
{
    sum->shadow_rays += more->shadow_rays;
    for (int k = 0; k < LIGHT_LOOKUPS; k++) {
        sum->lookups[k] += more->lookups[k];
    }
    sum->bounce_rays += more->bounce_rays;
    sum->photons += more->photons;
    sum->transmittances += more->transmittances;
}
