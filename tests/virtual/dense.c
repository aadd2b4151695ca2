/* Light transport by a dense Cholesky factor, written from docs/transport.md and from no code of rig/virtual. */
#include "dense.h"

#include <math.h>
#include <stdlib.h>

static double scattering(const struct medium *m, int channel, size_t cell)
{
    return m->scattering[(size_t)channel * medium_cells(m) + cell];
}

static double absorption(const struct medium *m, int channel, size_t cell)
{
    return m->absorption[(size_t)channel * medium_cells(m) + cell];
}

static double diffusivity(const struct medium *m, int channel, size_t cell)
{
    return 1 / (3 * (scattering(m, channel, cell) + absorption(m, channel, cell)));
}

static double reflectance(double index, double cosine)
{
    double sine2 = index * index * (1 - cosine * cosine);
    if (sine2 >= 1) {
        return 1;
    }
    double refracted = sqrt(1 - sine2);
    double s = (index * cosine - refracted) / (index * cosine + refracted);
    double p = (index * refracted - cosine) / (index * refracted + cosine);
    return (s * s + p * p) / 2;
}

double dense_boundary_a(double index)
{
    enum { STEPS = 200000 };
    double flux = 0;
    double current = 0;
    for (int i = 0; i <= STEPS; i++) {
        double cosine = (double)i / STEPS;
        double weight = (i == 0 || i == STEPS ? 1 : i % 2 ? 4 : 2) / (3.0 * STEPS);
        flux += weight * 2 * cosine * reflectance(index, cosine);
        current += weight * 3 * cosine * cosine * reflectance(index, cosine);
    }
    return (1 + current) / (1 - flux);
}

/* Outward conductance of a face of voxel `cell`, the flux for a fluence of 1, with boundary parameter a. */
static double through_outside(const struct medium *m, int channel, size_t cell, double a,
                              double length, double area)
{
    return area / (2 * a + length / (2 * diffusivity(m, channel, cell)));
}

/* Call with every face of every voxel once; `other` is the voxel beyond it, or -1 and `where` t, b or s. */
typedef void (*face_visitor)(void *context, size_t cell, long other, double conductance,
                             char where);

static void visit_faces(const struct medium *m, int channel, face_visitor visit, void *context)
{
    static const int directions[6][3] = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                         {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
    double a = dense_boundary_a(m->index[0]); /* the tests' media have one index */
    for (int i = 0; i < m->nx * m->ny * m->nz; i++) {
        int z = i % m->nz;
        int x = i / m->nz % m->nx;
        int y = i / m->nz / m->nx;
        for (int d = 0; d < 6; d++) {
            int to[3] = {x + directions[d][0], y + directions[d][1], z + directions[d][2]};
            double height = m->edges_mm[z + 1] - m->edges_mm[z];
            double length = d < 4 ? m->cell_mm : height;
            double area = d < 4 ? m->cell_mm * height : m->cell_mm * m->cell_mm;
            if (to[0] < 0 || to[0] >= m->nx || to[1] < 0 || to[1] >= m->ny || to[2] < 0 ||
                to[2] >= m->nz) {
                visit(context, (size_t)i, -1,
                      through_outside(m, channel, (size_t)i, a, length, area),
                      d < 4    ? 's'
                      : d == 4 ? 'b'
                               : 't');
                continue;
            }
            size_t other = medium_cell(m, to[0], to[1], to[2]);
            double beyond = d < 4 ? m->cell_mm : m->edges_mm[to[2] + 1] - m->edges_mm[to[2]];
            /* The harmonic mean of the diffusion coefficients, weighted by the halves. */
            double mean = (length + beyond) / (length / diffusivity(m, channel, (size_t)i) +
                                               beyond / diffusivity(m, channel, other));
            visit(context, (size_t)i, (long)other, area * mean / (0.5 * (length + beyond)), 'i');
        }
    }
}

struct matrix {
    size_t n;
    double *entries;
};

static void add_face(void *context, size_t cell, long other, double conductance, char where)
{
    struct matrix *matrix = context;
    (void)where;
    matrix->entries[cell * matrix->n + cell] += conductance;
    if (other >= 0) {
        matrix->entries[cell * matrix->n + (size_t)other] -= conductance;
    }
}

static double volume(const struct medium *m, size_t cell)
{
    size_t z = cell % (size_t)m->nz;
    return m->cell_mm * m->cell_mm * (m->edges_mm[z + 1] - m->edges_mm[z]);
}

static void factor(struct matrix *a)
{
    size_t n = a->n;
    for (size_t j = 0; j < n; j++) {
        for (size_t i = j; i < n; i++) {
            double sum = a->entries[i * n + j];
            for (size_t k = 0; k < j; k++) {
                sum -= a->entries[i * n + k] * a->entries[j * n + k];
            }
            a->entries[i * n + j] = i == j ? sqrt(sum) : sum / a->entries[j * n + j];
        }
    }
}

static void solve(const struct matrix *a, double *b)
{
    size_t n = a->n;
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < i; k++) {
            b[i] -= a->entries[i * n + k] * b[k];
        }
        b[i] /= a->entries[i * n + i];
    }
    for (size_t i = n; i-- > 0;) {
        for (size_t k = i + 1; k < n; k++) {
            b[i] -= a->entries[k * n + i] * b[k];
        }
        b[i] /= a->entries[i * n + i];
    }
}

static double through(double index)
{
    return 1 - reflectance(index, 1);
}

void dense_beam(const struct medium *m, int channel, int x, int y, double *power)
{
    double depth = 0; /* optical */
    double entered = through(m->index[medium_cell(m, x, y, 0)]) * m->cell_mm * m->cell_mm;
    for (int z = 0; z < m->nz; z++) {
        size_t cell = medium_cell(m, x, y, z);
        double extinction = scattering(m, channel, cell) + absorption(m, channel, cell);
        double next = depth + extinction * (m->edges_mm[z + 1] - m->edges_mm[z]);
        power[z] = entered * scattering(m, channel, cell) / extinction * (exp(-depth) - exp(-next));
        depth = next;
    }
}

/* pi times the radiance along the normal above slab column (x, y) due to the fluence, and due to light of the beam of
 * 1 W/mm^2 on the same column that was scattered once. */
static double leaving(const struct medium *m, int channel, int x, int y, const double *phi,
                      double *once)
{
    double depth = 0;
    double sum = 0;
    double index = m->index[medium_cell(m, x, y, 0)];
    *once = 0;
    for (int z = 0; z < m->nz; z++) {
        size_t cell = medium_cell(m, x, y, z);
        double extinction = scattering(m, channel, cell) + absorption(m, channel, cell);
        double next = depth + extinction * (m->edges_mm[z + 1] - m->edges_mm[z]);
        double albedo = scattering(m, channel, cell) / extinction;
        sum += albedo * phi[cell] / 4 * (exp(-depth) - exp(-next));
        *once += through(index) * albedo / 8 * (exp(-2 * depth) - exp(-2 * next));
        depth = next;
    }
    *once *= through(index) / (index * index);
    return sum * through(index) / (index * index);
}

double *dense_responses(const struct medium *m, int channel)
{
    struct matrix matrix = {.n = medium_cells(m)};
    int side = m->subdivide;
    int columns = side * side;
    size_t points = (size_t)m->width * (size_t)m->height;
    double *responses = calloc(points * points, sizeof *responses);
    double *phi = calloc(matrix.n, sizeof *phi);
    matrix.entries = calloc(matrix.n * matrix.n, sizeof *matrix.entries);
    if (!responses || !phi || !matrix.entries) {
        abort();
    }
    visit_faces(m, channel, add_face, &matrix);
    for (size_t i = 0; i < matrix.n; i++) {
        matrix.entries[i * matrix.n + i] += absorption(m, channel, i) * volume(m, i);
    }
    factor(&matrix);
    for (size_t in = 0; in < points; in++) {
        for (size_t i = 0; i < matrix.n; i++) {
            phi[i] = 0;
        }
        for (int j = 0; j < columns; j++) {
            int x = ((int)in % m->width + m->margin) * side + j % side;
            int y = ((int)in / m->width + m->margin) * side + j / side;
            dense_beam(m, channel, x, y, phi + medium_cell(m, x, y, 0));
        }
        solve(&matrix, phi);
        for (size_t out = 0; out < points; out++) {
            for (int j = 0; j < columns; j++) {
                double once = 0;
                int x = ((int)out % m->width + m->margin) * side + j % side;
                int y = ((int)out / m->width + m->margin) * side + j / side;
                double diffuse = leaving(m, channel, x, y, phi, &once);
                responses[in * points + out] += (diffuse + (in == out ? once : 0)) / columns;
            }
        }
    }
    free(phi);
    free(matrix.entries);
    return responses;
}

struct outflow {
    const double *phi;
    struct dense_losses losses;
};

static void add_outflow(void *context, size_t cell, long other, double conductance, char where)
{
    struct outflow *outflow = context;
    double flux = conductance * outflow->phi[cell];
    (void)other;
    outflow->losses.top += where == 't' ? flux : 0;
    outflow->losses.bottom += where == 'b' ? flux : 0;
    outflow->losses.sides += where == 's' ? flux : 0;
}

struct dense_losses dense_losses(const struct medium *m, int channel, const double *phi)
{
    struct outflow outflow = {.phi = phi};
    visit_faces(m, channel, add_outflow, &outflow);
    for (size_t i = 0; i < medium_cells(m); i++) {
        outflow.losses.absorbed += absorption(m, channel, i) * volume(m, i) * phi[i];
    }
    return outflow.losses;
}
