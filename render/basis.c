/* Singular value decomposition of the kernels. */
#include "render/basis.h"

#include "render/appearance.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { PARTS_MAXIMUM = 15, SWEEPS = 30 };

/* The basis may leave this share of the kernels' root mean square, before more of it is taken. Entries count by their
 * distance from the middle, as it serves light from afar and there is more of that. */
static const double rest_wanted = 0.05;

/* The window's middle; side is odd. */
static double half_side(size_t side)
{
    return ((double)side - 1) / 2;
}

static size_t lanes_of(const struct basis *basis)
{
    return 4 * (size_t)basis->parts;
}

/* Eigenvectors (columns of v) and eigenvalues (the diagonal of a) of a symmetric matrix, by Jacobi's rotations. */
static void diagonalise(double *a, double *v, size_t n)
{
    for (size_t i = 0; i < n * n; i++) {
        v[i] = i % (n + 1) == 0;
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double off = 0, diagonal = 0;
        for (size_t i = 0; i < n * n; i++) {
            *(i % (n + 1) == 0 ? &diagonal : &off) += a[i] * a[i];
        }
        if (off <= 1e-20 * diagonal) {
            return;
        }
        for (size_t p = 0; p + 1 < n; p++) {
            for (size_t q = p + 1; q < n; q++) {
                double apq = a[p * n + q];
                if (apq * apq <= 1e-30 * fabs(a[p * n + p] * a[q * n + q])) {
                    continue;
                }
                double theta = (a[q * n + q] - a[p * n + p]) / (2 * apq);
                double t = copysign(1, theta) / (fabs(theta) + sqrt(theta * theta + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (size_t k = 0; k < n; k++) {
                    double x = a[k * n + p], y = a[k * n + q];
                    a[k * n + p] = c * x - s * y;
                    a[k * n + q] = s * x + c * y;
                    x = v[k * n + p];
                    y = v[k * n + q];
                    v[k * n + p] = c * x - s * y;
                    v[k * n + q] = s * x + c * y;
                }
                for (size_t k = 0; k < n; k++) {
                    double x = a[p * n + k], y = a[q * n + k];
                    a[p * n + k] = c * x - s * y;
                    a[q * n + k] = s * x + c * y;
                }
            }
        }
    }
}

/* How much each cluster's kernel counts: the square of what its surface points reflect of it. */
static void weigh(const struct appearance *appearance, size_t c, double *weights)
{
    size_t texels = (size_t)appearance->width * (size_t)appearance->height;
    size_t terms = (size_t)appearance->terms, mixed = (size_t)appearance->mixed;
    size_t planes = (size_t)appearance->factor_channels, plane = planes == 1 ? 0 : c;
    for (size_t i = 0; i < texels; i++) {
        const float *f = appearance->f + (i * planes + plane) * terms;
        const float *h = appearance->h + (i * planes + plane) * terms;
        double sum = 0;
        for (size_t t = 0; t < terms; t++) {
            sum += (double)f[t] * h[t];
        }
        for (size_t a = 0; a < mixed; a++) {
            double part = sum * appearance->weights[i * mixed + a];
            weights[appearance->ids[i * mixed + a]] += part * part;
        }
    }
    for (size_t j = 0; j < (size_t)appearance->clusters; j++) {
        weights[j] = sqrt(weights[j]) + 1e-30;
    }
}

/* Kernels of cluster a, those of all columns behind each other, are kernel[a * entries ..], four floats an entry. */
struct svd {
    size_t clusters, entries, side_square;
    double *squares;                     /* of the offset, [side_square] */
    double *gram, *vectors, *weights;    /* of one colour */
    double values[3][PARTS_MAXIMUM + 1]; /* energy left after so many parts */
    double *all_vectors[3], *all_weights[3];
    size_t *order[3];
};

static void sum_gram(const struct appearance *appearance, const struct svd *svd, size_t c)
{
    size_t n = svd->clusters;
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t i = 0; i < n; i++) {
        for (size_t j = i; j < n; j++) {
            const float *a = appearance->kernels + i * svd->entries * 4 + c;
            const float *b = appearance->kernels + j * svd->entries * 4 + c;
            double sum = 0;
            for (size_t k = 0; k < svd->entries; k++) {
                sum += (double)a[k * 4] * b[k * 4] * svd->squares[k % svd->side_square];
            }
            svd->gram[i * n + j] = svd->gram[j * n + i] = sum * svd->weights[i] * svd->weights[j];
        }
    }
}

/* Order the eigenvectors by what they hold and note what is left after the first few. */
static void rank_parts(struct svd *svd, size_t c)
{
    size_t n = svd->clusters;
    double total = 0;
    for (size_t i = 0; i < n; i++) {
        svd->order[c][i] = i;
        total += fmax(svd->gram[i * (n + 1)], 0);
    }
    double left = total;
    for (size_t i = 0; i < PARTS_MAXIMUM + 1; i++) {
        svd->values[c][i] = total > 0 && i < n ? sqrt(fmax(left, 0) / total) : 0;
        if (i >= n) {
            continue;
        }
        size_t best = i;
        for (size_t j = i + 1; j < n; j++) {
            size_t a = svd->order[c][j], b = svd->order[c][best];
            best = svd->gram[a * (n + 1)] > svd->gram[b * (n + 1)] ? j : best;
        }
        size_t swapped = svd->order[c][i];
        svd->order[c][i] = svd->order[c][best];
        svd->order[c][best] = swapped;
        left -= fmax(svd->gram[svd->order[c][i] * (n + 1)], 0);
    }
}

static void svd_finish(struct svd *svd)
{
    free(svd->gram);
    free(svd->squares);
    for (int c = 0; c < 3; c++) {
        free(svd->all_vectors[c]);
        free(svd->all_weights[c]);
        free(svd->order[c]);
    }
}

static int svd_make(struct svd *svd, const struct appearance *appearance, struct nacre_error *error)
{
    size_t n = (size_t)appearance->clusters, side = (size_t)appearance->window + 2;
    size_t columns = appearance->layout == NACRE_KERNEL_PAIR ? n : 1;
    *svd =
        (struct svd){.clusters = n, .entries = columns * side * side, .side_square = side * side};
    svd->gram = calloc(n * n, sizeof *svd->gram);
    svd->squares = calloc(side * side, sizeof *svd->squares);
    for (size_t k = 0; svd->squares && k < side * side; k++) {
        double x = (double)(k % side) - half_side(side);
        double y = (double)(k - k % side) / (double)side - half_side(side);
        svd->squares[k] = x * x + y * y;
    }
    for (size_t c = 0; c < 3; c++) {
        svd->all_vectors[c] = calloc(n * n, sizeof *svd->vectors);
        svd->all_weights[c] = calloc(n, sizeof *svd->weights);
        svd->order[c] = calloc(n, sizeof *svd->order[c]);
        if (!svd->gram || !svd->squares || !svd->all_vectors[c] || !svd->all_weights[c] ||
            !svd->order[c]) {
            svd_finish(svd);
            return nacre_fail_memory(error, "the material's kernels");
        }
        svd->vectors = svd->all_vectors[c];
        svd->weights = svd->all_weights[c];
        weigh(appearance, c, svd->weights);
        sum_gram(appearance, svd, c);
        diagonalise(svd->gram, svd->vectors, n);
        rank_parts(svd, c);
    }
    return NACRE_OK;
}

/* basis_r = sum_a v(a, r) weight(a) g_a, U(a, r) = v(a, r) / weight(a): orthonormal v, so all parts give g back. */
static void fill_part(struct basis *basis, const struct appearance *appearance,
                      const struct svd *svd, size_t part, size_t c)
{
    size_t lanes = lanes_of(basis), lane = part * 4 + c, n = svd->clusters;
    const double *v = svd->all_vectors[c] + svd->order[c][part];
    const double *weights = svd->all_weights[c];
    double scale = 0;
    for (size_t k = 0; k < svd->entries; k++) {
        double sum = 0;
        for (size_t a = 0; a < n; a++) {
            sum += v[a * n] * weights[a] * appearance->kernels[(a * svd->entries + k) * 4 + c];
        }
        basis->table[k * lanes + lane] = (float)sum;
        scale = fmax(scale, fabs(sum));
    }
    for (size_t a = 0; a < n; a++) { /* numbers near 1 where they are looked up */
        basis->share[a * lanes + lane] = (float)(scale > 0 ? v[a * n] / weights[a] * scale : 0);
    }
    for (size_t k = 0; scale > 0 && k < svd->entries; k++) {
        basis->table[k * lanes + lane] = (float)(basis->table[k * lanes + lane] / scale);
    }
}

static int allocate_basis(struct basis *basis, const struct appearance *appearance,
                          struct nacre_error *error)
{
    size_t side = (size_t)appearance->window + 2, lanes = lanes_of(basis);
    basis->table = calloc((size_t)basis->columns * side * side * lanes, sizeof *basis->table);
    basis->share = calloc((size_t)appearance->clusters * lanes, sizeof *basis->share);
    return basis->table && basis->share ? NACRE_OK
                                        : nacre_fail_memory(error, "the material's kernels");
}

static int make_per_term(struct basis *basis, const struct appearance *appearance,
                         struct nacre_error *error)
{
    size_t side = (size_t)appearance->window + 2;
    *basis = (struct basis){.parts = appearance->terms, .columns = 1};
    size_t size = side * side * lanes_of(basis) * sizeof *basis->table;
    basis->table = malloc(size);
    if (!basis->table) {
        return nacre_fail_memory(error, "the material's kernels");
    }
    memcpy(basis->table, appearance->kernels, size);
    return NACRE_OK;
}

static int make_from_clusters(struct basis *basis, const struct appearance *appearance,
                              struct nacre_error *error)
{
    struct svd svd;
    if (svd_make(&svd, appearance, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    int parts = 1, clusters = appearance->clusters;
    int most = clusters < PARTS_MAXIMUM ? clusters : PARTS_MAXIMUM;
    while (parts < most && fmax(svd.values[0][parts],
                                fmax(svd.values[1][parts], svd.values[2][parts])) > rest_wanted) {
        parts++;
    }
    *basis = (struct basis){.parts = parts,
                            .columns = appearance->layout == NACRE_KERNEL_PAIR ? clusters : 1};
    int status = allocate_basis(basis, appearance, error);
    for (size_t p = 0; status == NACRE_OK && p < (size_t)basis->parts * 3; p++) {
        fill_part(basis, appearance, &svd, p / 3, p % 3);
    }
    svd_finish(&svd);
    return status;
}

/* Second differences of the kernels by distance, their sizes over the sum of all kernels. */
static int fill_bend(struct basis *basis, const struct appearance *appearance,
                     struct nacre_error *error)
{
    size_t side = (size_t)appearance->window + 2;
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    size_t entry = per_term ? (size_t)appearance->terms * 4 : 4;
    size_t kernels = (size_t)(per_term ? 1 : appearance->kernel_count);
    double total = 0;
    basis->steps = (int)side + 1; /* beyond the corners */
    basis->bend = calloc((size_t)basis->steps, sizeof *basis->bend);
    if (!basis->bend) {
        return nacre_fail_memory(error, "the material's kernels");
    }
    for (size_t i = 0; i < kernels * side * side * entry; i++) {
        size_t place = i / entry % (side * side), x = place % side, y = place / side;
        if (x == 0 || y == 0 || x + 1 == side || y + 1 == side) {
            continue;
        }
        const float *g = appearance->kernels + i;
        double across = (double)g[entry] - 2 * (double)g[0] + (double)*(g - entry);
        double down = (double)g[side * entry] - 2 * (double)g[0] + (double)*(g - side * entry);
        double r = hypot((double)x - half_side(side), (double)y - half_side(side));
        basis->bend[(size_t)fmin(r, basis->steps - 1)] += fabs(across) + fabs(down);
        total += fabs((double)g[0]);
    }
    for (int step = 0; step < basis->steps; step++) {
        basis->bend[step] /= total > 0 ? total : 1;
    }
    return NACRE_OK;
}

int basis_make(struct basis *basis, const struct appearance *appearance, struct nacre_error *error)
{
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    int status = per_term ? make_per_term(basis, appearance, error)
                          : make_from_clusters(basis, appearance, error);
    if (status == NACRE_OK) {
        status = fill_bend(basis, appearance, error);
    }
    if (status != NACRE_OK) {
        basis_finish(basis);
    }
    return status;
}

void basis_finish(struct basis *basis)
{
    free(basis->table);
    free(basis->share);
    free(basis->bend);
    *basis = (struct basis){0};
}
