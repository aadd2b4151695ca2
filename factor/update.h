/* The paper's multiplicative updates on an OpenCL device: the method "mu". */
#ifndef FACTOR_UPDATE_H
#define FACTOR_UPDATE_H

#include "factor/method.h"

#include "base/opencl.h"

#include <stdbool.h>

/* The register tile of the kernels; see update.cl. */
struct update_tile {
    int rows, steps, group;
};

/* The tiles to choose from: those that fit the registers of so many lanes. Returns how many, at most TUNE_TILES. */
size_t update_tiles(int lanes, const struct update_tile **tiles);

/* The tile that suits so many lanes and terms on the devices that were measured. */
struct update_tile update_tile_default(int lanes, int terms);

/* The tile for a problem: what a trial on this device found (tune.h), else the default. */
struct update_tile update_tile_choose(const struct opencl *opencl, const struct problem *problem);

/* Compile the kernels, place the problem on the device and start from random factors. `tile` may be NULL: chosen. The
 * method keeps `opencl`, which must outlive it. */
int update_new(const struct opencl *opencl, const struct problem *problem,
               const struct update_tile *tile, struct method **method, struct nacre_error *error);

/* Wait until all that was asked of the device is done. */
int update_wait(struct method *method, struct nacre_error *error);

/* One half of a step, for tests and benchmarks: F alone or H alone. */
int update_half_step(struct method *method, int channel, bool of_h, struct nacre_error *error);

/* Smallest value a factor takes inside the sample, in scaled units; conductors write it as 0. */
#define UPDATE_FLOOR 1e-18F

#endif
