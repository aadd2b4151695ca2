/* The choice between convolution and the gather, from a surface and a number of samples alone. */
#include "render/convolve_ahead.h"

#include <math.h>

int convolve_ahead(struct convolve_ahead *ahead, const struct mesh *mesh,
                   const struct mapping *mapping, const struct appearance *appearance,
                   bool same_side, double tolerance, double samples, struct gather_cost cost,
                   struct nacre_error *error)
{
    /* Whether colours share transforms hangs on the light. */
    const struct convolve_planes planes = {3 * appearance->kernel_count,
                                           3 * appearance->kernel_count};
    struct receivers receivers = {0};
    struct convolve_patches patches = {0};
    *ahead = (struct convolve_ahead){.ns = fmin(cost.plain, cost.summed)};
    if (appearance->layout != NACRE_KERNEL_PER_TERM) {
        return NACRE_OK;
    }
    int status = receivers_make(&receivers, mesh, mapping, appearance, error);
    if (status == NACRE_OK) {
        status = convolve_patches_make(&patches, mesh, mapping, appearance, &receivers, same_side,
                                       error);
    }
    if (status == NACRE_OK) {
        convolve_leave_out(&patches, receivers.count, mapping, appearance, planes, 1);
        double ns =
            convolve_cost_ns(&patches, receivers.count, mapping, appearance, planes, 1, samples);
        struct convolve_served served = convolve_serve(&patches, receivers.count, tolerance);
        double both = convolve_both_ns(served.count, receivers.count, ns, cost.plain, cost.summed);
        ahead->fits = (double)served.count;
        ahead->chosen = convolve_pays(served.count, receivers.count, both, ahead->ns);
        ahead->ns = ahead->chosen ? both : ahead->ns;
    }
    convolve_patches_finish(&patches);
    receivers_finish(&receivers);
    return status;
}
