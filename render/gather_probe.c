/* Drawing groups of vertices and comparing them. */
#include "render/gather_probe.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

enum { LANES = REACH_LANES };

/* The mean may be above what was drawn by this many of its standard errors. */
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

static double power_of(const struct receivers *receivers, const struct reach_bundles *bundles,
                       size_t group, float (*light)[3])
{
    double sum = 0;
    for (size_t k = group * LANES; k < (group + 1) * LANES; k++) {
        if (begins(receivers, bundles, k)) {
            sum += square_of(light[receivers->vertices[bundles->order[k]]]);
        }
    }
    return sum;
}

/* Evenly spaced places along all groups' chances. */
static void draw(struct gather_probe *probe, const double *powers, size_t count)
{
    double even = 1 / (double)count, sum = 0;
    size_t drawn = 0;
    for (size_t i = 0; i < count && drawn < probe->draws; i++) {
        double chance = probe->power > 0 ? (powers[i] / probe->power + even) / 2 : even;
        sum += chance;
        while (drawn < probe->draws && ((double)drawn + 0.5) / (double)probe->draws < sum) {
            probe->groups[drawn] = i;
            probe->chances[drawn++] = chance;
        }
    }
    probe->draws = drawn;
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

static int fill_bundles(struct gather_probe *probe, const struct receivers *receivers,
                        const struct reach_bundles *bundles)
{
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

int gather_probe_make(struct gather_probe *probe, const struct receivers *receivers,
                      const struct reach_bundles *bundles, float (*light)[3],
                      struct nacre_error *error)
{
    double *powers = calloc(bundles->count + 1, sizeof *powers);
    *probe = (struct gather_probe){.draws = GATHER_PROBES,
                                   .groups = calloc(GATHER_PROBES, sizeof *probe->groups),
                                   .chances = calloc(GATHER_PROBES, sizeof *probe->chances)};
    int status = powers && probe->groups && probe->chances ? 0 : -1;
    for (size_t i = 0; status == 0 && i < bundles->count; i++) {
        powers[i] = power_of(receivers, bundles, i, light);
        probe->power += powers[i];
    }
    if (status == 0) {
        draw(probe, powers, bundles->count);
        status = fill_bundles(probe, receivers, bundles);
    }
    free(powers);
    if (status != 0) {
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

double gather_probe_error(const struct gather_probe *probe, const struct receivers *receivers,
                          const struct reach_bundles *bundles, float (*light)[3], float (*exact)[3])
{
    double sum = 0, squares = 0, count = (double)probe->draws;
    for (size_t i = 0; i < probe->draws; i++) {
        double off = 0;
        for (size_t k = probe->groups[i] * LANES; k < (probe->groups[i] + 1) * LANES; k++) {
            uint32_t vertex = receivers->vertices[bundles->order[k]];
            const float difference[3] = {light[vertex][0] - exact[vertex][0],
                                         light[vertex][1] - exact[vertex][1],
                                         light[vertex][2] - exact[vertex][2]};
            off += begins(receivers, bundles, k) ? square_of(difference) : 0;
        }
        sum += off / probe->chances[i];
        squares += off / probe->chances[i] * off / probe->chances[i];
    }
    double mean = sum / count, variance = fmax(squares / count - mean * mean, 0) / (count - 1);
    double most = mean + standard_errors * sqrt(variance);
    return most > 0 ? sqrt(most / probe->power)
                    : 0; /* infinite where only the exact light is not 0 */
}
