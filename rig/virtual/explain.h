/* What the light transport simulates of a sample, what it leaves out, why, and at what cost. */
#ifndef RIG_VIRTUAL_EXPLAIN_H
#define RIG_VIRTUAL_EXPLAIN_H

#include "base/effect.h"
#include "nacre/error.h"
#include "rig/virtual/sample.h"
#include "rig/virtual/solver.h"
#include "rig/virtual/transport.h"

#include <stdbool.h>
#include <stddef.h>

/* What diffusion on the transport's voxels takes for responses of K x K, on one core. */
double explain_diffusion_seconds(const struct transport *transport, int window);

/* The effects of a sample whose responses are computed by the chosen solver, and the solvers themselves; *effects is heap
 * memory. */
int explain_effects(const struct sample *sample, const struct transport *transport,
                    const struct solver_choice *choice, struct effect **effects, size_t *count,
                    struct nacre_error *error);

#endif
