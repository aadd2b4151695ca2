/* Light transport in a described sample: the linear operator from irradiance to radiosity, and its responses. */
#ifndef RIG_VIRTUAL_TRANSPORT_H
#define RIG_VIRTUAL_TRANSPORT_H

#include "base/opencl.h"
#include "base/progress.h"
#include "nacre/error.h"

struct sample;    /* rig/virtual/sample.h: what a sample file describes */
struct transport; /* a sample made ready for solving */

/* Prepare the sample's width x height surface points for three channels. Keeps neither argument. */
int transport_new(const struct sample *sample, const struct opencl *opencl,
                  struct transport **transport, struct nacre_error *error);
void transport_free(struct transport *transport); /* NULL is allowed */

/* pi times the radiance that leaves each surface point towards the camera, averaged over the point:
 * radiosity[3][height][width], under irradiance[3][height][width] that is uniform within each point. Linear and
 * deterministic. */
int transport_apply(struct transport *transport, const float *irradiance, float *radiosity,
                    struct nacre_error *error);

/* Write the exact responses of all points with a K x K window as a scan (see nacre/scan.h). */
int transport_write_scan(struct transport *transport, int window, const char *path,
                         struct progress *progress, struct nacre_error *error);

#endif
