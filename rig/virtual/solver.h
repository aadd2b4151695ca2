/* Which solver a sample calls for, and scans by the solvers other than diffusion on voxels (transport.h). */
#ifndef RIG_VIRTUAL_SOLVER_H
#define RIG_VIRTUAL_SOLVER_H

#include "base/progress.h"
#include "nacre/error.h"
#include "rig/virtual/sample.h"

#include <stdint.h>

enum solver { SOLVER_CLOSED, SOLVER_DIFFUSION, SOLVER_MONTECARLO, SOLVERS };

/* Each solver: what it would take, and why it is not taken ("" for the one that is). Errors are relative ones of a
 * response's norm, as expected. */
struct solver_option {
    double error;
    double seconds; /* on one core, without what a sample costs by itself */
    char reason[160];
};

struct solver_choice {
    enum solver solver;
    int subdivide;  /* voxels along a surface point, for diffusion */
    uint64_t paths; /* of light a point and channel, for Monte Carlo */
    struct solver_option options[SOLVERS];
};

const char *solver_name(enum solver solver);

/* Choose the cheapest solver whose expected error is at most `tolerance`; 0 accepts any. diffusion_seconds is what
 * diffusion takes on the voxels that it would have without a tolerance, `subdivide` along a point; where the file does
 * not set them it may take more. Fails where no solver is good enough. */
int solver_choose(const struct sample *sample, int window, double tolerance,
                  double diffusion_seconds, int subdivide, struct solver_choice *choice,
                  struct nacre_error *error);

/* The scan of a homogeneous sample in closed form. */
int solver_write_closed(const struct sample *sample, int window, const char *path,
                        struct progress *progress, struct nacre_error *error);

/* The scan by Monte Carlo; *deviation is the mean relative standard error of the responses' norms. */
int solver_write_montecarlo(const struct sample *sample, const struct solver_choice *choice,
                            int window, uint32_t seed, const char *path, struct progress *progress,
                            double *deviation, struct nacre_error *error);

#endif
