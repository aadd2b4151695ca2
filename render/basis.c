/* Singular value decomposition of the kernels, and how fast the basis varies with distance. */
#include "render/basis.h"

#include "render/appearance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PARTS_A_VECTOR = 5, VECTORS_MAXIMUM = 3, SWEEPS = 30, DIRECTIONS = 48 };

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
    return 16 * (size_t)basis->vectors;
}

int basis_part(const struct basis *basis, bool per_term, int lane)
{
    int part = per_term ? lane / 4 : lane / 3;
    bool used = per_term ? lane % 4 < 3 : lane % 16 < 3 * PARTS_A_VECTOR;
    if (!per_term) {
        part = lane / 16 * PARTS_A_VECTOR + lane % 16 / 3;
    }
    return used && part < basis->parts ? part : -1;
}

/* Where basis kernel `part` of colour c has its lane. */
static size_t lane_of(size_t part, size_t c)
{
    return part / PARTS_A_VECTOR * 16 + part % PARTS_A_VECTOR * 3 + c;
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
    double *squares;                          /* of the offset, [side_square] */
    double *gram, *vectors, *weights;         /* of one colour */
    double values[3][3 * PARTS_A_VECTOR + 1]; /* energy left after so many parts */
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
    for (size_t i = 0; i < 3 * PARTS_A_VECTOR + 1; i++) {
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
    size_t lanes = lanes_of(basis), lane = lane_of(part, c), n = svd->clusters;
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

static size_t step_at(const struct basis *basis, double r)
{
    double step = fmax(floor(r * BASIS_STEPS_A_POINT), 0);
    return (size_t)fmin(step, basis->steps - 1);
}

static void raise_to(float *value, double to)
{
    *value = fmaxf(*value, (float)to);
}

/* What the basis leaves of entry k of the kernels of one cluster. */
static double left_at(const struct basis *basis, const struct appearance *appearance, size_t a,
                      size_t c, size_t k, size_t entries)
{
    size_t lanes = lanes_of(basis);
    double sum = appearance->kernels[(a * entries + k) * 4 + c];
    for (size_t p = 0; p < (size_t)basis->parts; p++) {
        sum -= (double)basis->share[a * lanes + lane_of(p, c)] *
               basis->table[k * lanes + lane_of(p, c)];
    }
    return fabs(sum);
}

static void fill_rest(struct basis *basis, const struct appearance *appearance, size_t a, size_t c)
{
    size_t side = (size_t)appearance->window + 2;
    size_t entries = (size_t)basis->columns * side * side;
    float *rest = &basis->rest[a * 3 + c];
    for (size_t k = 0; k < entries; k++) {
        raise_to(rest, left_at(basis, appearance, a, c, k, entries));
    }
    for (size_t k = 0; *rest > 0 && k < entries; k++) {
        size_t column = k % side, row = k / side % side;
        double x = (double)column - half_side(side), y = (double)row - half_side(side);
        raise_to(&basis->left[step_at(basis, hypot(x, y) - 1.5)],
                 left_at(basis, appearance, a, c, k, entries) / (double)*rest);
    }
}

/* How the kernel in one lane varies, noted at the least offset at which it does. */
static void fill_profile(struct basis *basis, const float *table, size_t side, size_t lane,
                         size_t part)
{
    size_t lanes = lanes_of(basis), parts = (size_t)basis->parts;
    double middle = half_side(side);
    for (size_t y = 0; y < side; y++) {
        for (size_t x = 0; x < side; x++) {
            const float *g = table + (y * side + x) * lanes + lane;
            double here = *g, left = x > 0 ? *(g - lanes) : 0, up = y > 0 ? *(g - side * lanes) : 0;
            double right = x + 1 < side ? g[lanes] : 0, down = y + 1 < side ? g[side * lanes] : 0;
            double across = x + 1 < side && y + 1 < side ? g[(side + 1) * lanes] : 0;
            double r = hypot((double)x - middle, (double)y - middle);
            size_t near = step_at(basis, r - 1.5);
            double slope = hypot(fmax(fabs(right - here), fabs(across - down)),
                                 fmax(fabs(down - here), fabs(across - right)));
            double bend = fabs(right - 2 * here + left) + fabs(down - 2 * here + up) +
                          2 * fabs(across - right - down + here);
            raise_to(&basis->slope[near * parts + part], slope);
            raise_to(&basis->bend[near * parts + part], bend);
            raise_to(&basis->size[near * parts + part], fabs(here));
        }
    }
}

/* How much the kernel in one lane differs with direction: along circles half a surface point apart, a tenth added for
 * what lies between the directions tried. */
static void fill_swing(struct basis *basis, const float *table, size_t side, size_t lane,
                       size_t part)
{
    size_t lanes = lanes_of(basis), parts = (size_t)basis->parts;
    double middle = half_side(side), last = (double)(side - 1);
    for (int step = 0; step < basis->steps; step++) {
        double low = HUGE_VAL, high = -HUGE_VAL, r = (double)step / BASIS_STEPS_A_POINT;
        for (int k = 0; k < DIRECTIONS; k++) {
            double angle = 2 * acos(-1.0) * (k + 0.5) / DIRECTIONS, value = 0;
            double u = middle + r * cos(angle), v = middle + r * sin(angle);
            if (u > 0 && u < last && v > 0 && v < last) {
                double x = floor(u), y = floor(v), fx = u - x, fy = v - y;
                const float *g = table + ((size_t)y * side + (size_t)x) * lanes + lane;
                value = (1 - fy) * ((1 - fx) * g[0] + fx * g[lanes]) +
                        fy * ((1 - fx) * g[side * lanes] + fx * g[(side + 1) * lanes]);
            }
            low = fmin(low, value);
            high = fmax(high, value);
        }
        raise_to(&basis->swing[(size_t)step * parts + part], 1.1 * (high - low));
        raise_to(&basis->swing[(size_t)(step > 0 ? step - 1 : 0) * parts + part],
                 1.1 * (high - low));
    }
}

/* From what is at a distance to what is there or farther. */
static void fill_profiles(struct basis *basis, const struct appearance *appearance)
{
    size_t side = (size_t)appearance->window + 2, parts = (size_t)basis->parts;
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    for (size_t b = 0; b < (size_t)basis->columns; b++) {
        for (int lane = 0; lane < 16 * basis->vectors; lane++) {
            int part = basis_part(basis, per_term, lane);
            if (part >= 0) {
                const float *table = basis->table + b * side * side * lanes_of(basis);
                fill_profile(basis, table, side, (size_t)lane, (size_t)part);
                fill_swing(basis, table, side, (size_t)lane, (size_t)part);
            }
        }
    }
    for (size_t step = (size_t)basis->steps - 1; step-- > 0;) {
        for (size_t p = 0; p < parts; p++) {
            raise_to(&basis->slope[step * parts + p], basis->slope[(step + 1) * parts + p]);
            raise_to(&basis->bend[step * parts + p], basis->bend[(step + 1) * parts + p]);
            raise_to(&basis->swing[step * parts + p], basis->swing[(step + 1) * parts + p]);
            raise_to(&basis->size[step * parts + p], basis->size[(step + 1) * parts + p]);
        }
        raise_to(&basis->left[step], basis->left[step + 1]);
    }
}

static void fill_top_h(struct basis *basis, const struct appearance *appearance)
{
    size_t texels = (size_t)appearance->width * (size_t)appearance->height;
    size_t terms = (size_t)appearance->terms, planes = (size_t)appearance->factor_channels;
    size_t lanes = lanes_of(basis);
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    for (size_t t = 0; t < terms; t++) {
        float top[3] = {0};
        for (size_t i = 0; i < texels * 3; i++) {
            size_t plane = planes == 1 ? 0 : i % 3;
            raise_to(&top[i % 3], appearance->h[(i / 3 * planes + plane) * terms + t]);
        }
        for (size_t c = 0; c < 3; c++) {
            for (size_t p = 0; !per_term && p < (size_t)basis->parts; p++) {
                basis->top_h[t * lanes + lane_of(p, c)] = top[c];
            }
            if (per_term) {
                basis->top_h[t * 4 + c] = top[c];
            }
        }
    }
}

static int allocate_basis(struct basis *basis, const struct appearance *appearance,
                          struct nacre_error *error)
{
    size_t side = (size_t)appearance->window + 2, lanes = lanes_of(basis);
    size_t clusters = (size_t)appearance->clusters;
    /* The corners of the window, and beyond. */
    basis->steps = (int)ceil((appearance->window / 2.0 + 2) * 1.4142136) * BASIS_STEPS_A_POINT + 1;
    size_t profile = (size_t)basis->steps * (size_t)basis->parts;
    basis->table =
        aligned_alloc(64, (size_t)basis->columns * side * side * lanes * sizeof *basis->table);
    basis->share = calloc(clusters * lanes, sizeof *basis->share);
    basis->rest = calloc(clusters * 3, sizeof *basis->rest);
    basis->top_h = calloc((size_t)basis->rows * lanes, sizeof *basis->top_h);
    basis->slope = calloc(profile, sizeof *basis->slope);
    basis->bend = calloc(profile, sizeof *basis->bend);
    basis->swing = calloc(profile, sizeof *basis->swing);
    basis->size = calloc(profile, sizeof *basis->size);
    basis->left = calloc((size_t)basis->steps, sizeof *basis->left);
    if (!basis->table || !basis->share || !basis->rest || !basis->top_h || !basis->slope ||
        !basis->bend || !basis->swing || !basis->size || !basis->left) {
        return nacre_fail_memory(error, "the material's kernels");
    }
    memset(basis->table, 0, (size_t)basis->columns * side * side * lanes * sizeof *basis->table);
    return NACRE_OK;
}

static int make_per_term(struct basis *basis, const struct appearance *appearance,
                         struct nacre_error *error)
{
    size_t side = (size_t)appearance->window + 2, terms = (size_t)appearance->terms;
    *basis = (struct basis){
        .vectors = appearance->terms / 4, .rows = 1, .parts = appearance->terms, .columns = 1};
    if (allocate_basis(basis, appearance, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    memcpy(basis->table, appearance->kernels, side * side * terms * 4 * sizeof *basis->table);
    return NACRE_OK;
}

static int make_from_clusters(struct basis *basis, const struct appearance *appearance,
                              struct nacre_error *error)
{
    struct svd svd;
    if (svd_make(&svd, appearance, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    int vectors = 1, clusters = appearance->clusters;
    while (vectors < VECTORS_MAXIMUM &&
           fmax(svd.values[0][vectors * PARTS_A_VECTOR],
                fmax(svd.values[1][vectors * PARTS_A_VECTOR],
                     svd.values[2][vectors * PARTS_A_VECTOR])) > rest_wanted) {
        vectors++;
    }
    int parts = vectors * PARTS_A_VECTOR;
    *basis = (struct basis){.vectors = vectors,
                            .rows = appearance->terms,
                            .parts = parts < clusters ? parts : clusters,
                            .columns = appearance->layout == NACRE_KERNEL_PAIR ? clusters : 1};
    int status = allocate_basis(basis, appearance, error);
    for (size_t p = 0; status == NACRE_OK && p < (size_t)basis->parts * 3; p++) {
        fill_part(basis, appearance, &svd, p / 3, p % 3);
    }
    for (size_t a = 0; status == NACRE_OK && a < (size_t)clusters * 3; a++) {
        fill_rest(basis, appearance, a / 3, a % 3);
    }
    svd_finish(&svd);
    return status;
}

int basis_make(struct basis *basis, const struct appearance *appearance, struct nacre_error *error)
{
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    int status = per_term ? make_per_term(basis, appearance, error)
                          : make_from_clusters(basis, appearance, error);
    if (status != NACRE_OK) {
        basis_finish(basis);
        return status;
    }
    fill_top_h(basis, appearance);
    fill_profiles(basis, appearance);
    return NACRE_OK;
}

void basis_finish(struct basis *basis)
{
    free(basis->table);
    free(basis->share);
    free(basis->rest);
    free(basis->top_h);
    free(basis->slope);
    free(basis->bend);
    free(basis->swing);
    free(basis->size);
    free(basis->left);
    *basis = (struct basis){0};
}
