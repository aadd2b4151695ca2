/* Light transport by Monte Carlo: paths through a sample in OpenCL, the reference for the other solvers.
 *
 * Radiative transfer with the phase function of Henyey and Greenstein, Fresnel reflection at the slab's top and bottom,
 * and materials looked up voxel by voxel; light that leaves through the sides is lost. docs/transport.md says more. */
#ifndef RIG_VIRTUAL_MONTECARLO_H
#define RIG_VIRTUAL_MONTECARLO_H

#include "nacre/error.h"
#include "rig/virtual/sample.h"

#include <stddef.h>
#include <stdint.h>

struct montecarlo; /* a sample on an OpenCL device */

/* What is tallied at each surface point. */
enum montecarlo_estimator {
    MONTECARLO_RADIANCE, /* R_d: pi times the radiance that leaves along the normal */
    MONTECARLO_EXITANCE, /* flux through the surface: what leaves at all */
};

/* Parts of the light of a beam, means of all paths. What the surface reflects from outside is in none. */
struct montecarlo_totals {
    double up, down, aside, absorbed;
    double camera; /* sum of R_d over the slab's whole top; 0 for MONTECARLO_EXITANCE */
};

struct montecarlo_request {
    enum montecarlo_estimator estimator;
    int channel;
    int window;             /* K */
    const int (*points)[2]; /* that are lit one by one */
    size_t count;
    uint64_t paths; /* for each point, at least; they are rounded up */
    uint32_t seed;
};

/* Put a sample onto a device (see opencl_open for the selector). */
int montecarlo_new(const struct sample *sample, const char *device, struct montecarlo **montecarlo,
                   struct nacre_error *error);
void montecarlo_free(struct montecarlo *montecarlo); /* NULL is allowed */

/* Trace. responses and deviations hold [count][K][K] means and their standard errors, totals [count]; the latter two may
 * be NULL. The same bits for the same request, whatever the number of threads. */
int montecarlo_trace(struct montecarlo *montecarlo, const struct montecarlo_request *request,
                     float *responses, float *deviations, struct montecarlo_totals *totals,
                     struct nacre_error *error);

#endif
