/* Counting what convolving takes. */
#include "render/convolve_cost.h"

#include <math.h>
#include <stdlib.h>

/* Nanoseconds of a processor that has eight floats to an instruction, at 3 GHz (bench_convolve): a point transformed one
 * way; a sample's light handed to a node in one plane; a plane read by a receiver; and a receiver or a sample put into its
 * place, whatever the planes. */
static const double point_ns = 12, node_ns = 0.5, read_ns = 7, place_ns = 500;

void convolve_leave_out(struct convolve_patches *patches, size_t receivers,
                        const struct mapping *mapping, const struct appearance *appearance,
                        struct convolve_planes planes, int fine)
{
    for (size_t i = 0; i < patches->count; i++) {
        struct convolve_patch *patch = &patches->list[i];
        struct convolve_plan plan;
        convolve_plan(&plan, patch, mapping, appearance, planes, fine);
        patch->receivers = isfinite(plan.points) ? patch->receivers : 0;
    }
    for (size_t i = 0; i < receivers; i++) {
        if (patches->of[i] >= 0 && patches->list[patches->of[i]].receivers == 0) {
            patches->of[i] = -1;
            patches->misfit[i] = HUGE_VALF;
        }
    }
}

double convolve_cost_ns(const struct convolve_patches *patches, size_t receivers,
                        const struct mapping *mapping, const struct appearance *appearance,
                        struct convolve_planes planes, int fine, double samples)
{
    double ns =
        ((double)receivers + samples) * place_ns + samples * 4 * fine * fine * planes.in * node_ns;
    for (size_t i = 0; i < patches->count; i++) {
        const struct convolve_patch *patch = &patches->list[i];
        struct convolve_plan plan;
        if (patch->receivers > 0) {
            convolve_plan(&plan, patch, mapping, appearance, planes, fine);
            double kernels = (double)plan.x.size * plan.y.size * planes.out;
            ns += (plan.points + kernels) * point_ns +
                  (double)patch->receivers * planes.out * read_ns;
        }
    }
    return ns;
}

/* Convolving must promise this share less: it may be off too far, and then was in vain. */
static const double margin = 0.8;

/* A few vertices here and there are no reason to take two ways. */
enum { LEAST_SHARE = 16 };

static int compare_floats(const void *a, const void *b)
{
    float one = *(const float *)a, two = *(const float *)b;
    return (one > two) - (one < two);
}

struct convolve_served convolve_serve(const struct convolve_patches *patches, size_t receivers,
                                      double most)
{
    struct convolve_served served = {.limit = -1};
    float *sorted = malloc((receivers + 1) * sizeof *sorted);
    double sum = 0, all = (double)receivers;
    for (size_t i = 0; sorted && i < receivers; i++) {
        sorted[i] = patches->misfit[i];
    }
    if (sorted) {
        qsort(sorted, receivers, sizeof *sorted, compare_floats);
    }
    for (size_t i = 0; sorted && i < receivers; i++) {
        sum += (double)sorted[i] * sorted[i];
        if (!(sum <= most * most * all)) {
            break;
        }
        /* All of one cell have the same misfit, and are served together. */
        if (i + 1 == receivers || sorted[i + 1] > sorted[i]) {
            served = (struct convolve_served){i + 1, sorted[i], sqrt(sum / all)};
        }
    }
    free(sorted);
    return served;
}

double convolve_both_ns(size_t served, size_t receivers, double convolve_ns, double plain_ns,
                        double summed_ns)
{
    double rest = 1 - (double)served / (double)receivers;
    return convolve_ns + (rest > 0 ? fmin(rest * plain_ns, summed_ns) : 0);
}

bool convolve_worthwhile(size_t served, size_t receivers)
{
    return served * LEAST_SHARE > receivers;
}

bool convolve_pays(size_t served, size_t receivers, double both_ns, double gather_ns)
{
    return convolve_worthwhile(served, receivers) && both_ns < margin * gather_ns;
}
