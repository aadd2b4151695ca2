/* Laying a sample on voxels. */
#include "rig/virtual/medium.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

enum {
    SAMPLES_ACROSS = 4, /* places looked at in a voxel, along x and along y */
    SAMPLES_DOWN = 2,   /* and along z */
    MAX_SUBDIVIDE = 4,
    MAX_DEPTH_CELLS = 256,
};

static const double MAX_CELLS = 64e6; /* 64 million voxels take 8 GiB in the solver */

/* The first depth cell is this part of the shortest mean free path, and each is at most this much thicker than the one
 * above: docs/transport.md shows the error that they leave. */
static const double FIRST_CELL = 0.4;
static const double GROWTH = 1.35;

/* The thickness of `count` cells that begin with `first` and grow by `ratio`. */
static double graded_sum(double first, double ratio, int count)
{
    return fabs(ratio - 1) < 1e-9 ? first * count : first * (pow(ratio, count) - 1) / (ratio - 1);
}

static int choose_depth_cells(double thickness_mm, double first_mm)
{
    int count = 1;
    while (count < MAX_DEPTH_CELLS && graded_sum(first_mm, GROWTH, count) < thickness_mm) {
        count++;
    }
    return count;
}

/* Edges of `count` cells that fill the thickness, the first of first_mm, growing evenly; equal cells where even these
 * are thinner than first_mm. */
static void grade_depth(double thickness_mm, double first_mm, int count, double *edges_mm)
{
    double low = 1;
    double high = 1e3;
    double first = fmin(first_mm, thickness_mm / count);
    for (int i = 0; i < 100; i++) {
        double middle = 0.5 * (low + high);
        if (graded_sum(first, middle, count) < thickness_mm) {
            low = middle;
        } else {
            high = middle;
        }
    }
    for (int z = 0; z <= count; z++) {
        edges_mm[z] = graded_sum(first, low, z);
    }
    edges_mm[count] = thickness_mm;
}

static int choose_subdivide(const struct sample *sample, double path_mm)
{
    if (sample->voxels.subdivide > 0) {
        return sample->voxels.subdivide;
    }
    double wanted = ceil(sample->pitch_mm / (2 * path_mm) - 1e-9);
    return wanted < 1 ? 1 : wanted > MAX_SUBDIVIDE ? MAX_SUBDIVIDE : (int)wanted;
}

static int choose_depth(const struct sample *sample, double path_mm)
{
    return sample->voxels.depth_cells > 0
               ? sample->voxels.depth_cells
               : choose_depth_cells(sample->thickness_mm, FIRST_CELL * path_mm);
}

double medium_expected_cells(const struct sample *sample)
{
    double path_mm = sample_shortest_path_mm(sample);
    double side = choose_subdivide(sample, path_mm);
    return (sample->width + 2.0 * sample->margin_points) * side *
           (sample->height + 2.0 * sample->margin_points) * side * choose_depth(sample, path_mm);
}

static int lay_out(const struct sample *sample, struct medium *medium, struct nacre_error *error)
{
    double path_mm = sample_shortest_path_mm(sample);
    medium->width = sample->width;
    medium->height = sample->height;
    medium->margin = sample->margin_points;
    medium->subdivide = choose_subdivide(sample, path_mm);
    medium->cell_mm = sample->pitch_mm / medium->subdivide;
    medium->nz = choose_depth(sample, path_mm);
    double nx = ((double)sample->width + 2.0 * sample->margin_points) * medium->subdivide;
    double ny = ((double)sample->height + 2.0 * sample->margin_points) * medium->subdivide;
    if (nx * ny * medium->nz > MAX_CELLS) {
        return nacre_fail(error,
                          "the slab needs %.0f x %.0f x %d voxels, more than %.0f million; make it "
                          "smaller, or set voxels: subdivide and depth_cells",
                          nx, ny, medium->nz, MAX_CELLS * 1e-6);
    }
    if (nx * ny * medium->nz < 1) {
        return nacre_fail(error, "the sample has no surface points");
    }
    medium->nx = (int)nx;
    medium->ny = (int)ny;
    medium->edges_mm = calloc((size_t)medium->nz + 1, sizeof *medium->edges_mm);
    if (!medium->edges_mm) {
        return nacre_fail_memory(error, "the depth cells");
    }
    grade_depth(sample->thickness_mm, FIRST_CELL * path_mm, medium->nz, medium->edges_mm);
    return NACRE_OK;
}

/* Average the materials found in voxel (x, y, z); `painted` notes the inclusions met. */
static void fill_voxel(const struct sample *sample, struct medium *medium, int x, int y, int z,
                       unsigned char *painted)
{
    double scattering[MEDIUM_CHANNELS] = {0};
    double absorption[MEDIUM_CHANNELS] = {0};
    double index = 0;
    double share = 1.0 / (SAMPLES_ACROSS * SAMPLES_ACROSS * SAMPLES_DOWN);
    double top = medium->edges_mm[z];
    double height = medium->edges_mm[z + 1] - top;
    double margin_mm = medium->margin * sample->pitch_mm;
    double left = sample->corner_mm[0] - margin_mm;
    double back = sample->corner_mm[1] - margin_mm;
    for (int i = 0; i < SAMPLES_ACROSS * SAMPLES_ACROSS * SAMPLES_DOWN; i++) {
        int layer = i / (SAMPLES_ACROSS * SAMPLES_ACROSS);
        double u = (i % SAMPLES_ACROSS + 0.5) / SAMPLES_ACROSS;
        double v = (i / SAMPLES_ACROSS % SAMPLES_ACROSS + 0.5) / SAMPLES_ACROSS;
        double w = (layer + 0.5) / SAMPLES_DOWN;
        double place[3] = {(x + u) * medium->cell_mm + left, (y + v) * medium->cell_mm + back,
                           top + w * height};
        size_t inclusion = sample_inclusion_at(sample, place);
        const struct sample_material *material = &sample->materials[sample->base_index];
        if (inclusion < sample->inclusion_count) {
            material = &sample->materials[sample->inclusions[inclusion].material_index];
#pragma omp atomic write
            painted[inclusion] = 1;
        }
        for (int c = 0; c < MEDIUM_CHANNELS; c++) {
            scattering[c] += share * material->scattering_per_mm[c] * (1 - material->anisotropy[c]);
            absorption[c] += share * material->absorption_per_mm[c];
        }
        index += share * material->index;
    }
    size_t cell = medium_cell(medium, x, y, z);
    for (size_t c = 0; c < MEDIUM_CHANNELS; c++) {
        medium->scattering[c * medium_cells(medium) + cell] = (float)scattering[c];
        medium->absorption[c * medium_cells(medium) + cell] = (float)absorption[c];
    }
    medium->index[cell] = (float)index;
}

/* Every inclusion must be seen somewhere. */
static int check_painted(const struct sample *sample, const unsigned char *painted,
                         struct nacre_error *error)
{
    for (size_t i = 0; i < sample->inclusion_count; i++) {
        if (!painted[i]) {
            return nacre_fail(error,
                              "line %d of the sample file: the %s of %s paints nothing: it lies "
                              "outside the slab, under inclusions that follow, or is finer than a "
                              "quarter of a voxel; move it, enlarge it or take it out",
                              sample->inclusions[i].line, sample_shape_name(&sample->inclusions[i]),
                              sample->materials[sample->inclusions[i].material_index].name);
        }
    }
    return NACRE_OK;
}

int medium_new(const struct sample *sample, struct medium **medium, struct nacre_error *error)
{
    unsigned char *painted = calloc(sample->inclusion_count + 1, 1);
    struct medium *made = calloc(1, sizeof *made);
    int status = NACRE_OK;
    if (!made || !painted) {
        status = nacre_fail_memory(error, "the voxels");
        goto out;
    }
    status = lay_out(sample, made, error);
    if (status) {
        goto out;
    }
    /* NOLINTNEXTLINE(clang-analyzer-optin.portability.UnixAPI): lay_out refuses a slab without voxels */
    made->scattering = calloc(medium_cells(made), MEDIUM_CHANNELS * sizeof *made->scattering);
    made->absorption = calloc(medium_cells(made), MEDIUM_CHANNELS * sizeof *made->absorption);
    made->index = calloc(medium_cells(made), sizeof *made->index);
    if (!made->scattering || !made->absorption || !made->index) {
        status = nacre_fail_memory(error, "the voxels");
        goto out;
    }
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < made->ny; y++) {
        for (int x = 0; x < made->nx; x++) {
            for (int z = 0; z < made->nz; z++) {
                fill_voxel(sample, made, x, y, z, painted);
            }
        }
    }
    status = check_painted(sample, painted, error);
out:
    free(painted);
    if (status) {
        medium_free(made);
        made = NULL;
    }
    *medium = made;
    return status;
}

void medium_free(struct medium *medium)
{
    if (medium) {
        free(medium->edges_mm);
        free(medium->scattering);
        free(medium->absorption);
        free(medium->index);
        free(medium);
    }
}
