/* Building the diffusion equation's matrix from a medium. */
#include "rig/virtual/diffusion.h"

#include "rig/virtual/fresnel.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* One channel's matrix as it is built. */
struct assembly {
    const struct medium *medium;
    const float *scattering, *absorption; /* of the channel */
    const struct diffusion *diffusion;
    int channel;
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
    float4 *const joins[3] = {diffusion->left, diffusion->back, diffusion->above};
    size_t cell = diffusion_cell(diffusion, x, y, z);
    double loss = side * side * height * (double)assembly->absorption[medium_cell(medium, x, y, z)];
    for (int axis = 0; axis < 3; axis++) {
        if (places[axis] > 0) {
            double length_before = axis == 2 ? edges[z] - edges[z - 1] : side;
            joins[axis][cell][assembly->channel] = (float)join(
                assembly, x, y, z, steps[axis], lengths[axis], length_before, areas[axis]);
        } else {
            loss += outward(assembly, x, y, z, lengths[axis], areas[axis]);
        }
        if (places[axis] == counts[axis] - 1) {
            loss += outward(assembly, x, y, z, lengths[axis], areas[axis]);
        }
    }
    diffusion->loss[cell][assembly->channel] = (float)loss;
}

/* Light of the beam that is first scattered in each voxel of a column, for a beam of 1 on each mm^2, and with it the
 * weight by which the voxel's fluence leaves along the normal: the same, as both ways are weakened alike. */
static void fill_sources(const struct assembly *assembly, int x, int y)
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
        diffusion->source[place][assembly->channel] =
            (float)(weight * scattering / extinction * lost);
        left -= lost;
    }
}

static void fill_channel(struct assembly *assembly)
{
    const struct medium *medium = assembly->medium;
    for (int y = 0; y < medium->ny; y++) {
        for (int x = 0; x < medium->nx; x++) {
            for (int z = 0; z < medium->nz; z++) {
                assemble_voxel(assembly, x, y, z);
            }
            fill_sources(assembly, x, y);
        }
    }
}

int diffusion_new(const struct medium *medium, struct diffusion **diffusion,
                  struct nacre_error *error)
{
    enum { ARRAYS = 5 };
    int status = NACRE_OK;
    size_t cells = ((size_t)medium->nx + 2) * ((size_t)medium->ny + 2) * (size_t)medium->nz;
    struct diffusion *made = calloc(1, sizeof *made);
    if (made) {
        made->memory = aligned_alloc(64, ARRAYS * 64 * ((cells * sizeof(float4) + 63) / 64));
    }
    if (!made || !made->memory) {
        status = nacre_fail_memory(error, "the light transport's matrix");
        goto out;
    }
    made->nx = medium->nx;
    made->ny = medium->ny;
    made->nz = medium->nz;
    float4 *arrays = made->memory;
    memset(arrays, 0, ARRAYS * cells * sizeof *arrays);
    made->left = arrays;
    made->back = arrays + cells;
    made->above = arrays + 2 * cells;
    made->loss = arrays + 3 * cells;
    made->source = arrays + 4 * cells;
    for (int channel = 0; channel < MEDIUM_CHANNELS; channel++) {
        struct assembly assembly = {
            .medium = medium,
            .diffusion = made,
            .channel = channel,
            .scattering = medium->scattering + (size_t)channel * medium_cells(medium),
            .absorption = medium->absorption + (size_t)channel * medium_cells(medium)};
        fill_channel(&assembly);
    }
out:
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
