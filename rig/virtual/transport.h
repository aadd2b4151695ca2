/* Light transport in a described sample: the linear operator from irradiance to radiosity, and its responses. */
#ifndef RIG_VIRTUAL_TRANSPORT_H
#define RIG_VIRTUAL_TRANSPORT_H

#include "base/progress.h"
#include "nacre/error.h"

struct sample;    /* rig/virtual/sample.h: what a sample file describes */
struct transport; /* a sample made ready for solving */

/* Prepare the sample's width x height surface points for three channels. Keeps nothing of the sample. */
int transport_new(const struct sample *sample, struct transport **transport,
                  struct nacre_error *error);
void transport_free(struct transport *transport); /* NULL is allowed */

/* pi times the radiance that leaves each surface point towards the camera, averaged over the point:
 * radiosity[3][height][width], under irradiance[3][height][width] that is uniform within each point. Linear and
 * deterministic. */
int transport_apply(struct transport *transport, const float *irradiance, float *radiosity,
                    struct nacre_error *error);

/* Write the exact responses of all points with a K x K window as a scan (see nacre/scan.h). */
int transport_write_scan(struct transport *transport, int window, const char *path,
                         struct progress *progress, struct nacre_error *error);

/* What the solver works on, and what the last scan was like. */
struct transport_facts {
    int width, height; /* surface points */
    double pitch_mm;
    int voxels[3];            /* along x, y and z, the margin included */
    int subdivide;            /* voxels along a surface point */
    double cell_mm;           /* side of a voxel */
    double first_mm, last_mm; /* height of the top and the bottom voxel */
    int reach_points[3];      /* transport_reach of the last scan's window */
    double outside_mean,
        outside_max; /* part of a response's light that left beyond its window, all channels */
};

/* How many points beyond a K x K window transport_write_scan solves for, so that what is cut off there changes no entry
 * by more than some millionths of the response's sum. */
int transport_reach(const struct transport *transport, int window, int channel);

struct transport_facts transport_facts(const struct transport *transport);

#endif
