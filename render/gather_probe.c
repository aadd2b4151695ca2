/* Drawing groups of vertices and comparing them. */
#include "render/gather_probe.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

enum { LANES = REACH_LANES, CANDIDATES = 512, SAMPLES = 2048 };

/* The ratio may be above that of what was drawn by this many of its standard errors. */
static const double standard_errors = 3;

/* Whether entry k of the bundles' order begins a vertex, which belongs to the bundle that its first receiver is in; not
 * so where the last bundle is filled up. */
static bool begins(const struct receivers *receivers, const struct reach_bundles *bundles, size_t k)
{
    uint32_t i = bundles->order[k];
    return k < receivers->count && (i == 0 || receivers->vertices[i] != receivers->vertices[i - 1]);
}

static double square_of(const float a[3])
{
    double sum = 0;
    for (int c = 0; c < 3; c++) {
        sum += (double)a[c] * a[c];
    }
    return sum;
}

/* Light that falls around a group, by some of the samples. */
static double light_around(const struct gather_stock *stock, size_t group)
{
    const struct source_set *samples = &stock->samples;
    size_t every = samples->count / SAMPLES + 1;
    const float *at = stock->receivers.list[stock->stages[0].bundles.order[group * LANES]].position;
    double reach = stock->gather->appearance->window / 4 + 1; /* NOLINT: a rough width */
    float scale = (float)(1 / (reach * stock->gather->mapping->point_mm)), sum = 0;
    for (size_t i = 0; i < samples->count; i += every) {
        const struct source *from = &samples->list[i];
        float x = (from->position[0] - at[0]) * scale, y = (from->position[1] - at[1]) * scale;
        float z = (from->position[2] - at[2]) * scale, share = 1 + x * x + y * y + z * z;
        sum += (from->flux[0] + from->flux[1] + from->flux[2]) / (share * share * share);
    }
    return sum;
}

/* Evenly spaced places along the chances of the groups, or of so many of them. */
static int draw(struct gather_probe *probe, size_t count)
{
    size_t candidates = count < CANDIDATES ? count : CANDIDATES, drawn = 0;
    double *squares = calloc(candidates + 1, sizeof *squares), power = 0, sum = 0;
    if (!squares) {
        return -1;
    }
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < candidates; i++) {
        double light = light_around(probe->stock, i * count / candidates);
        squares[i] = light * light;
    }
    for (size_t i = 0; i < candidates; i++) {
        power += squares[i];
    }
    for (size_t i = 0; i < candidates && drawn < probe->draws; i++) {
        double even = 1 / (double)candidates;
        double chance = power > 0 ? (squares[i] / power + even) / 2 : even;
        sum += chance;
        while (drawn < probe->draws && ((double)drawn + 0.5) / (double)probe->draws < sum) {
            probe->groups[drawn] = i * count / candidates;
            probe->chances[drawn++] = chance;
        }
    }
    probe->draws = drawn;
    free(squares);
    return 0;
}

/* The receivers of a group's vertices, by 16; returns how many bundles they fill. */
static size_t fill(const struct receivers *receivers, const struct reach_bundles *bundles,
                   size_t group, uint32_t *order)
{
    size_t count = 0;
    for (size_t k = group * LANES; k < (group + 1) * LANES; k++) {
        size_t i = bundles->order[k];
        uint32_t vertex = receivers->vertices[i];
        for (; begins(receivers, bundles, k) && i < receivers->count &&
               receivers->vertices[i] == vertex;
             i++) {
            if (order) {
                order[count] = (uint32_t)i;
            }
            count++;
        }
    }
    size_t padded = (count + LANES - 1) / LANES * LANES;
    for (; order && count < padded; count++) {
        order[count] = order[count - 1];
    }
    return padded / LANES;
}

static int fill_bundles(struct gather_probe *probe)
{
    const struct receivers *receivers = &probe->stock->receivers;
    const struct reach_bundles *bundles = &probe->stock->stages[0].bundles;
    struct reach_bundles *own = &probe->bundles;
    size_t total = 0, stride = sizeof *receivers->list / sizeof(float);
    for (size_t i = 0; i < probe->draws; i++) {
        bool again = i > 0 && probe->groups[i] == probe->groups[i - 1];
        total += again ? 0 : fill(receivers, bundles, probe->groups[i], NULL);
    }
    own->order = calloc(total * LANES + 1, sizeof *own->order);
    own->boxes = calloc(total + 1, sizeof *own->boxes);
    if (!own->order || !own->boxes) {
        return -1;
    }
    for (size_t i = 0; i < probe->draws; i++) {
        bool again = i > 0 && probe->groups[i] == probe->groups[i - 1];
        own->count +=
            again ? 0 : fill(receivers, bundles, probe->groups[i], own->order + own->count * LANES);
    }
    for (size_t i = 0; i < own->count; i++) {
        own->boxes[i] =
            bundles_box(receivers->list[0].position, stride, own->order + i * LANES, LANES);
    }
    return 0;
}

int gather_probe_make(struct gather_probe *probe, const struct gather_stock *stock,
                      struct nacre_error *error)
{
    *probe = (struct gather_probe){.stock = stock,
                                   .draws = GATHER_PROBES,
                                   .groups = calloc(GATHER_PROBES, sizeof *probe->groups),
                                   .chances = calloc(GATHER_PROBES, sizeof *probe->chances)};
    if (!probe->groups || !probe->chances || draw(probe, stock->stages[0].bundles.count) != 0 ||
        fill_bundles(probe) != 0) {
        gather_probe_finish(probe);
        return nacre_fail_memory(error, "the check on the gathered light");
    }
    return NACRE_OK;
}

void gather_probe_finish(struct gather_probe *probe)
{
    free(probe->groups);
    free(probe->chances);
    reach_bundles_finish(&probe->bundles);
    *probe = (struct gather_probe){0};
}

/* Squares of one group over its chance: of what is off and of what should be. */
struct squares {
    double off, exact;
};

static struct squares compare(const struct gather_probe *probe, size_t draw, float (*light)[3],
                              float (*exact)[3])
{
    const struct receivers *receivers = &probe->stock->receivers;
    const struct reach_bundles *bundles = &probe->stock->stages[0].bundles;
    struct squares sum = {0};
    for (size_t k = probe->groups[draw] * LANES; k < (probe->groups[draw] + 1) * LANES; k++) {
        if (!begins(receivers, bundles, k)) {
            continue;
        }
        const float *one = light[receivers->vertices[bundles->order[k]]];
        const float *two = exact[receivers->vertices[bundles->order[k]]];
        const float difference[3] = {one[0] - two[0], one[1] - two[1], one[2] - two[2]};
        sum.off += square_of(difference) / probe->chances[draw];
        sum.exact += square_of(two) / probe->chances[draw];
    }
    return sum;
}

double gather_probe_error(const struct gather_probe *probe, float (*light)[3], float (*exact)[3])
{
    double off = 0, all = 0, scatter = 0, count = (double)probe->draws;
    for (size_t i = 0; i < probe->draws; i++) {
        struct squares squares = compare(probe, i, light, exact);
        off += squares.off;
        all += squares.exact;
    }
    if (!(all > 0) || probe->draws < 2) {
        return HUGE_VAL;
    }
    for (size_t i = 0; i < probe->draws; i++) {
        struct squares squares = compare(probe, i, light, exact);
        double rest = squares.off - off / all * squares.exact;
        scatter += rest * rest;
    }
    return sqrt((off + standard_errors * sqrt(scatter * count / (count - 1))) / all);
}
