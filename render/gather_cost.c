/* Counting pairs ahead: how many samples lie how far from the receivers. */
#include "render/gather_cost.h"

#include "render/gather_probe.h"

#include <math.h>
#include <stdlib.h>

/* Nanoseconds of a processor that has eight floats to an instruction, at 3 GHz (bench_render): a pair of a receiver and a
 * sample or a surface point, for each of the F H products; for each basis kernel and product of a post and a square; and
 * what summing up takes for a sample, a surface point of the mesh and a receiver, whatever the pairs. */
static const double pair_ns = 7, product_ns = 0.6, square_ns = 0.65, sample_ns = 700,
                    point_ns = 900, receiver_ns = 600;

/* Summing up must promise to take this share less: its pairs are estimated, and it may have to be done again. */
static const double margin = 0.8;

enum { PLACES = 32, SAMPLES = 16000, STEPS = 4096 /* of the histogram */ };

struct profile {
    double step,
        pairs[STEPS + 1]; /* samples nearer than i steps (surface points), of one receiver */
};

static void profile_make(struct profile *profile, const struct gather_stock *stock, double reach,
                         double point_mm)
{
    const struct receivers *receivers = &stock->receivers;
    const struct reach_bundles *bundles = &stock->stages[0].bundles;
    const struct source_set *samples = &stock->samples;
    size_t every = samples->count / SAMPLES + 1, places = 0;
    float at[PLACES][3];
    *profile = (struct profile){.step = reach / STEPS};
    for (; places < PLACES && places < receivers->count; places++) {
        size_t k = (size_t)(((double)places + 0.5) / PLACES * (double)receivers->count);
        for (int c = 0; c < 3; c++) {
            at[places][c] = receivers->list[bundles->order[k]].position[c];
        }
    }
    float scale = (float)(1 / (point_mm * profile->step)), most = (float)STEPS / scale;
    for (size_t i = 0; i < samples->count; i += every) {
        const float *p = samples->list[i].position;
        for (size_t j = 0; j < places; j++) {
            float x = p[0] - at[j][0], y = p[1] - at[j][1], z = p[2] - at[j][2];
            float square = x * x + y * y + z * z;
            if (square < most * most) {
                profile->pairs[(size_t)fminf(sqrtf(square) * scale, STEPS - 1) + 1] += 1;
            }
        }
    }
    for (size_t i = 1; i <= STEPS; i++) {
        profile->pairs[i] = profile->pairs[i - 1] +
                            profile->pairs[i] * (double)every / (double)(places > 0 ? places : 1);
    }
}

static double pairs_within(const struct profile *profile, double r)
{
    return profile->pairs[(size_t)fmin(r / profile->step, STEPS)];
}

/* Squares of a level are as far apart as the posts that take them in. */
static double cost_of_squares(const struct levels *levels, double points, double reach)
{
    double sum = 0;
    for (int i = 0; i < levels->count; i++) {
        const struct level *level = &levels->squares[i];
        double size = (double)(2 << i), outer = fmin(level->outer, reach), inner = level->inner;
        double pairs = 3.1416 * fmax(outer * outer - inner * inner, 0) / (size * size);
        sum += points / (size * size) * pairs;
    }
    return sum;
}

/* What there is to gather: receivers, samples and surface points, and of one receiver the samples within the window, those
 * that are taken by themselves, and those that are merged. */
struct amounts {
    double receivers, samples, points, all, near, around;
};

static struct gather_cost cost_of_amounts(const struct appearance *a, const struct levels *levels,
                                          double reach, const struct amounts *n)
{
    double products = a->terms, per_pair = pair_ns + product_ns * products;
    double merged = fmin(1, n->points / (n->samples + 1));
    double parts = a->layout == NACRE_KERNEL_PER_TERM ? 1 : a->basis.parts;
    double probes = fmin(1, GATHER_PROBES * 16 / n->receivers);
    struct gather_cost cost = {.plain = n->receivers * n->all * per_pair};
    cost.summed = n->receivers * ((n->near + merged * n->around) * per_pair + receiver_ns) +
                  cost_of_squares(levels, n->points, reach) * parts * products * square_ns +
                  n->samples * sample_ns + n->points * point_ns + probes * cost.plain;
    cost.summed = levels->merges ? cost.summed / margin : HUGE_VAL;
    return cost;
}

/* Of a circle as large as the window, in surface points. */
static double reach_of(const struct appearance *a)
{
    return 1.128 * (a->window / 2 + 1); /* NOLINT(bugprone-integer-division): K is odd */
}

struct gather_cost gather_cost_ahead(const struct appearance *appearance,
                                     const struct levels *levels, double vertices, double samples,
                                     double points)
{
    double reach = reach_of(appearance), density = 3.1416 * samples / fmax(points, 1);
    double near = fmin(levels->samples.end, reach), end = fmin(levels->points.end, reach);
    double begin = fmin(LEVELS_RISE * levels->points.begin, end);
    const struct amounts amounts = {fmax(vertices, 1),
                                    samples,
                                    points,
                                    density * reach * reach,
                                    density * near * near,
                                    density * (end * end - begin * begin)};
    return cost_of_amounts(appearance, levels, reach, &amounts);
}

struct gather_cost gather_cost_of(const struct gather_stock *stock, const struct levels *levels)
{
    const struct gather *gather = stock->gather;
    const struct source_set *samples = &stock->samples;
    double point = gather->mapping->point_mm, reach = reach_of(gather->appearance);
    struct profile *profile = malloc(sizeof *profile);
    if (!profile) {
        return (struct gather_cost){0, HUGE_VAL};
    }
    profile_make(profile, stock, reach, point);
    const struct amounts amounts = {(double)stock->receivers.count,
                                    (double)samples->count,
                                    mesh_area_mm2(gather->mesh) / (point * point),
                                    pairs_within(profile, reach),
                                    pairs_within(profile, levels->samples.end),
                                    pairs_within(profile, fmin(levels->points.end, reach)) -
                                        pairs_within(profile, LEVELS_RISE * levels->points.begin)};
    free(profile);
    return cost_of_amounts(gather->appearance, levels, reach, &amounts);
}
