/* Building the diffusion equation's matrix from a medium. */
#include "rig/virtual/diffusion.h"

#include "rig/virtual/fresnel.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* How much of the fill-in that the incomplete factor drops is added to its diagonal: 1 would keep row sums (and be
 * fastest on smooth problems), a little less is safer at jumps of the coefficients. */
static const double MODIFIED = 0.97;

/* One channel's matrix before scaling: arrays framed like the system's. */
struct assembly {
    const struct medium *medium;
    const float *scattering, *absorption; /* of the channel */
    const struct diffusion *diffusion;
    double *diagonal, *left, *back,
        *above;        /* the diagonal, and minus the entries to the neighbours */
    double *factor;    /* E, the incomplete factor's diagonal */
    float known_index; /* the index whose boundary parameter known_a is */
    double known_a;
};

/* Half a voxel's resistance to the flux, times area: half its length over the diffusion coefficient. */
static double half_resistance(const struct assembly *assembly, int x, int y, int z, double length)
{
    size_t cell = medium_cell(assembly->medium, x, y, z);
    return 1.5 * length * ((double)assembly->scattering[cell] + assembly->absorption[cell]);
}

/* Conductance from a voxel through a face that belongs to the slab's outside: phi = 2 A J there. */
static double outward(struct assembly *assembly, int x, int y, int z, double length, double area)
{
    float index = assembly->medium->index[medium_cell(assembly->medium, x, y, z)];
    if (index != assembly->known_index) {
        assembly->known_index = index;
        assembly->known_a = fresnel_boundary_a((double)index);
    }
    return area / (2 * assembly->known_a + half_resistance(assembly, x, y, z, length));
}

/* Join voxel (x, y, z) with the one before it along an axis, or with the outside where there is none. */
static double join(const struct assembly *assembly, int x, int y, int z, const int step[3],
                   double length, double length_before, double area)
{
    return area / (half_resistance(assembly, x, y, z, length) +
                   half_resistance(assembly, x - step[0], y - step[1], z - step[2], length_before));
}

static void assemble_voxel(struct assembly *assembly, int x, int y, int z)
{
    static const int steps[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const struct medium *medium = assembly->medium;
    const struct diffusion *diffusion = assembly->diffusion;
    const double *edges = medium->edges_mm;
    double side = medium->cell_mm;
    double height = edges[z + 1] - edges[z];
    double lengths[3] = {side, side, height};
    double areas[3] = {side * height, side * height, side * side};
    const int places[3] = {x, y, z};
    const int counts[3] = {medium->nx, medium->ny, medium->nz};
    double *const joins[3] = {assembly->left, assembly->back, assembly->above};
    size_t cell = diffusion_cell(diffusion, x, y, z);
    assembly->diagonal[cell] +=
        side * side * height * (double)assembly->absorption[medium_cell(medium, x, y, z)];
    for (int axis = 0; axis < 3; axis++) {
        const int *step = steps[axis];
        if (places[axis] > 0) {
            size_t before = diffusion_cell(diffusion, x - step[0], y - step[1], z - step[2]);
            double length_before = axis == 2 ? edges[z] - edges[z - 1] : side;
            double conductance =
                join(assembly, x, y, z, step, lengths[axis], length_before, areas[axis]);
            joins[axis][cell] = conductance;
            assembly->diagonal[cell] += conductance;
            assembly->diagonal[before] += conductance;
        } else {
            assembly->diagonal[cell] += outward(assembly, x, y, z, lengths[axis], areas[axis]);
        }
        if (places[axis] == counts[axis] - 1) {
            assembly->diagonal[cell] += outward(assembly, x, y, z, lengths[axis], areas[axis]);
        }
    }
}

/* The incomplete factor's diagonal, voxel after voxel in storage order (Gustafsson 1978). */
static void factor_voxel(const struct assembly *assembly, size_t cell, size_t column, size_t row)
{
    const size_t before[3] = {cell - column, cell - row, cell - 1};
    const double *const joins[3] = {assembly->left, assembly->back, assembly->above};
    double value = assembly->diagonal[cell];
    for (int axis = 0; axis < 3; axis++) {
        double join_here = joins[axis][cell];
        if (join_here > 0) {
            size_t other = before[axis];
            double onward = assembly->left[other + column] + assembly->back[other + row] +
                            assembly->above[other + 1] - join_here;
            value -= join_here * (join_here + MODIFIED * onward) / assembly->factor[other];
        }
    }
    assembly->factor[cell] = value;
}

/* Light of the beam that is first scattered in each voxel of a column, for a beam of 1 on each mm^2, and with it the
 * weight by which the voxel's fluence leaves along the normal: the same, as both ways are weakened alike. */
static void fill_sources(const struct assembly *assembly, int x, int y, int channel)
{
    const struct medium *medium = assembly->medium;
    const struct diffusion *diffusion = assembly->diffusion;
    double index = medium->index[medium_cell(medium, x, y, 0)];
    /* R_d = (T^2 / n^2) / 4 sum of weight phi over a point's columns, divided by their number. */
    double weight =
        fresnel_through_normal(index) * medium->cell_mm / (2 * index * medium->subdivide);
    double left = 1;
    for (int z = 0; z < medium->nz; z++) {
        size_t cell = medium_cell(medium, x, y, z);
        double scattering = assembly->scattering[cell];
        double extinction = scattering + assembly->absorption[cell];
        double lost = -left * expm1(-extinction * (medium->edges_mm[z + 1] - medium->edges_mm[z]));
        size_t place = diffusion_cell(diffusion, x, y, z);
        diffusion->source[place][channel] =
            (float)(weight * scattering / extinction * lost * diffusion->scale[place][channel]);
        left -= lost;
    }
}

static void scale_voxel(const struct assembly *assembly, size_t cell, size_t column, size_t row,
                        int channel)
{
    const struct diffusion *diffusion = assembly->diffusion;
    const double *factor = assembly->factor;
    double scale = 1 / sqrt(factor[cell]);
    diffusion->scale[cell][channel] = (float)scale;
    diffusion->rest[cell][channel] = (float)(assembly->diagonal[cell] * scale * scale - 2);
    if (assembly->left[cell] > 0) {
        diffusion->to_left[cell][channel] =
            (float)(assembly->left[cell] * scale / sqrt(factor[cell - column]));
    }
    if (assembly->back[cell] > 0) {
        diffusion->to_back[cell][channel] =
            (float)(assembly->back[cell] * scale / sqrt(factor[cell - row]));
    }
    if (assembly->above[cell] > 0) {
        diffusion->to_above[cell][channel] =
            (float)(assembly->above[cell] * scale / sqrt(factor[cell - 1]));
    }
}

static void fill_channel(struct assembly *assembly, int channel)
{
    const struct medium *medium = assembly->medium;
    size_t column = (size_t)medium->nz;
    size_t row = ((size_t)medium->nx + 2) * column;
    assembly->scattering = medium->scattering + (size_t)channel * medium_cells(medium);
    assembly->absorption = medium->absorption + (size_t)channel * medium_cells(medium);
    for (int y = 0; y < medium->ny; y++) {
        for (int x = 0; x < medium->nx; x++) {
            for (int z = 0; z < medium->nz; z++) {
                assemble_voxel(assembly, x, y, z);
            }
        }
    }
    for (int y = 0; y < medium->ny; y++) {
        for (int x = 0; x < medium->nx; x++) {
            for (int z = 0; z < medium->nz; z++) {
                factor_voxel(assembly, diffusion_cell(assembly->diffusion, x, y, z), column, row);
            }
        }
    }
    for (int y = 0; y < medium->ny; y++) {
        for (int x = 0; x < medium->nx; x++) {
            for (int z = 0; z < medium->nz; z++) {
                size_t cell = diffusion_cell(assembly->diffusion, x, y, z);
                scale_voxel(assembly, cell, column, row, channel);
            }
            fill_sources(assembly, x, y, channel);
        }
    }
}

int diffusion_new(const struct medium *medium, struct diffusion **diffusion,
                  struct nacre_error *error)
{
    enum { SYSTEM_ARRAYS = 6, ASSEMBLY_ARRAYS = 5 };
    int status = NACRE_OK;
    double *memory = NULL;
    size_t cells = ((size_t)medium->nx + 2) * ((size_t)medium->ny + 2) * (size_t)medium->nz;
    struct diffusion *made = calloc(1, sizeof *made);
    if (made) {
        made->memory = aligned_alloc(64, SYSTEM_ARRAYS * 64 * ((cells * sizeof(float4) + 63) / 64));
        memory = calloc(cells, ASSEMBLY_ARRAYS * sizeof *memory);
    }
    if (!made || !made->memory || !memory) {
        status = nacre_fail_memory(error, "the light transport's matrix");
        goto out;
    }
    made->nx = medium->nx;
    made->ny = medium->ny;
    made->nz = medium->nz;
    float4 *arrays = made->memory;
    memset(arrays, 0, SYSTEM_ARRAYS * cells * sizeof *arrays);
    made->to_left = arrays;
    made->to_back = arrays + cells;
    made->to_above = arrays + 2 * cells;
    made->rest = arrays + 3 * cells;
    made->source = arrays + 4 * cells;
    made->scale = arrays + 5 * cells;
    struct assembly assembly = {.medium = medium,
                                .diffusion = made,
                                .diagonal = memory,
                                .left = memory + cells,
                                .back = memory + 2 * cells,
                                .above = memory + 3 * cells,
                                .factor = memory + 4 * cells};
    for (int channel = 0; channel < MEDIUM_CHANNELS; channel++) {
        memset(memory, 0, ASSEMBLY_ARRAYS * cells * sizeof *memory);
        fill_channel(&assembly, channel);
    }
out:
    free(memory);
    if (status) {
        diffusion_free(made);
        made = NULL;
    }
    *diffusion = made;
    return status;
}

void diffusion_free(struct diffusion *diffusion)
{
    if (diffusion) {
        free(diffusion->memory);
        free(diffusion);
    }
}
