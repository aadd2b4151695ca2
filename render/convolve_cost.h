/* What convolving takes, by counts, and which receivers it is to serve. */
#ifndef RENDER_CONVOLVE_COST_H
#define RENDER_CONVOLVE_COST_H

#include "render/convolve_patches.h"
#include "render/convolve_plan.h"

/* Leave patches that cannot be cut, on a lattice of `fine` nodes to a surface point and in the memory that there may be for
 * so many planes, to the gather. Whom convolution serves is to be found afterwards. */
void convolve_leave_out(struct convolve_patches *patches, size_t receivers,
                        const struct mapping *mapping, const struct appearance *appearance,
                        struct convolve_planes planes, int fine);

/* Estimated nanoseconds of one processor for all patches; HUGE_VAL where one cannot be cut. */
double convolve_cost_ns(const struct convolve_patches *patches, size_t receivers,
                        const struct mapping *mapping, const struct appearance *appearance,
                        struct convolve_planes planes, int fine, double samples);

/* Receivers that are served: those of a misfit up to the limit. */
struct convolve_served {
    size_t count;
    float limit;   /* -1 where there are none */
    double misfit; /* root mean square over all receivers, where others count as 0 */
};

/* As many as there are with a misfit of at most `most` all in all. */
struct convolve_served convolve_serve(const struct convolve_patches *patches, size_t receivers,
                                      double most);

/* What convolving for those served takes together with gathering for the others, plainly or summed up. */
double convolve_both_ns(size_t served, size_t receivers, double convolve_ns, double plain_ns,
                        double summed_ns);

/* Whether those are enough to take two ways, and that is enough less than what the gather takes alone. */
bool convolve_worthwhile(size_t served, size_t receivers);
bool convolve_pays(size_t served, size_t receivers, double both_ns, double gather_ns);

#endif
