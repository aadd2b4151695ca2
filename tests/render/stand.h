/* A surface with a material on it, ready for light, for tests of the renderer. */
#ifndef TESTS_RENDER_STAND_H
#define TESTS_RENDER_STAND_H

#include "nacre/material.h"
#include "render/gather.h"

struct stand {
    struct appearance appearance;
    struct mesh mesh;
    struct mapping mapping;
    struct light_samples samples;
    float (*radiosity)[3];
};

/* The OpenCL device of all tests of the program; opened at the first call. */
const struct opencl *stand_opencl(void);

/* Lay a material on a mesh, which the stand takes over, as the scene's settings say. */
struct stand stand_make(const struct nacre_material *material, struct mesh mesh,
                        const struct scene_material *settings);
void stand_finish(struct stand *stand);

/* A level mesh in z = 0 with a vertex on the centre of each of columns x rows surface points of `point_mm`, vertex
 * y * columns + x; texture coordinates put (x, y) on the material's surface point (x, y), as planar mapping does. */
struct mesh stand_grid(int columns, int rows, double point_mm);

/* One sample on the surface at vertex `vertex`, or anywhere in a triangle, of irradiance 1 over one surface point. */
void stand_add_sample(struct stand *stand, size_t triangle, double b1, double b2);
void stand_add_sample_at(struct stand *stand, size_t vertex);

/* Evenly lit: `density` samples to a surface point, of irradiance 1. */
void stand_light_evenly(struct stand *stand, double density);

/* The smooth part into stand->radiosity, which is cleared first: gather_run, also where summing up or convolving is not
 * sooner, or its reference. */
struct gather_counts stand_gather(struct stand *stand, double tolerance);
struct gather_counts stand_gather_summed(struct stand *stand, double tolerance);
struct gather_counts stand_gather_convolved(struct stand *stand, double tolerance);
void stand_gather_reference(struct stand *stand);

/* A material of one kernel, exp(-r / reach) scaled to the sum `albedo`, and F = H = 1. */
struct nacre_material stand_even_material(int size, int window, double reach, double albedo);

#endif
