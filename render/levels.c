/* Choosing rings and cutting kernels. */
#include "render/levels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Errors of pairs have either sign, and light around a place cancels most of them: about this share of the sum of their
 * bounds is seen, by bench_render. gather.c measures what it is. */
static const double seen_of_points = 0.1, seen_of_squares = 0.075;

/* Surface points may take up so much of the tolerance. */
static const double share_of_points = 0.6;

/* Larger squares set in no farther out than this share of the half window: there they would save little, and blur its edge.
 * And squares set in from so many surface points on. */
static const double farthest_begin = 0.5, nearest_squares = 3;

/* 0 up to `from`, 1 from `to` on, twice differentiable. */
static double rise(double r, double from, double to)
{
    double t = fmin(fmax((r - from) / (to - from), 0), 1);
    return t * t * t * (10 + t * (6 * t - 15));
}

static double window(struct ring ring, double r)
{
    double value = ring.begin > 0 ? rise(r, LEVELS_RISE * ring.begin, ring.begin) : 1;
    return isfinite(ring.end) ? value - rise(r, LEVELS_RISE * ring.end, ring.end) : value;
}

static double offset_of(size_t place, int side)
{
    int x = (int)(place % (size_t)side) - side / 2, y = (int)(place / (size_t)side) - side / 2;
    return hypot(x, y);
}

/* The bound of what summing up by pieces of `size` points from `begin` to `end` changes, over all light. */
static double bound_of(const struct basis *basis, double size, double begin, double end)
{
    double sum = 0;
    for (int step = 0; step < basis->steps; step++) {
        double above = fmin(fmax(step + 0.5 - 0.7 * begin, 0), 1);
        double below = fmin(fmax(0.7 * end + 0.5 - step, 0), 1);
        sum += fmax(above + below - 1, 0) * basis->bend[step];
    }
    return size * size / 8 * sum;
}

/* Whether squares that set in at `begin` are the last ones, by the number of sizes before them. */
static bool are_last(int before, double begin, double half)
{
    return before + 1 == LEVELS_MAXIMUM || 2 * begin >= farthest_begin * half;
}

static double estimate_squares(const struct basis *basis, double first, double half)
{
    double sum = 0, size = 2;
    for (int i = 0; i < LEVELS_MAXIMUM; i++) {
        bool last = are_last(i, first, half);
        sum += bound_of(basis, size, first, last ? HUGE_VAL : 2 * first);
        if (last) {
            break;
        }
        first *= 2;
        size *= 2;
    }
    return seen_of_squares * sum;
}

/* The near part of the kernels. */
static int cut_kernels(struct levels *levels, const struct appearance *appearance,
                       struct nacre_error *error)
{
    size_t full = (size_t)appearance->window + 2;
    int half = appearance->window / 2 + 1;
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    double reach = levels->merges ? levels->points.end : levels->samples.end;
    levels->near_side = (int)full;
    levels->near = appearance->kernels;
    if (!isfinite(reach) && !per_term) { /* per term: aligned */
        return NACRE_OK;
    }
    half = (int)fmin(half, ceil(fmin(reach, half)) + 2);
    levels->near_side = 2 * half + 1;
    size_t side = (size_t)levels->near_side, skip = full / 2 - (size_t)half;
    size_t kernels = (size_t)(per_term ? 1 : appearance->kernel_count);
    size_t entry = per_term ? (size_t)appearance->terms * 4 : 4, row = side * entry;
    levels->near_owned =
        aligned_alloc(64, (kernels * side * row * sizeof *levels->near + 63) / 64 * 64);
    if (!levels->near_owned) {
        return nacre_fail_memory(error, "the material's kernels");
    }
    levels->near = levels->near_owned;
    for (size_t i = 0; i < kernels * side; i++) {
        size_t from = (i / side * full + i % side + skip) * full + skip;
        memcpy(levels->near_owned + i * row, appearance->kernels + from * entry,
               row * sizeof(float));
    }
    return NACRE_OK;
}

/* Second differences over `step` places, of entries of `entry` floats: their sum, times scale, added to `to`. Beyond the
 * window a kernel is taken to go on level: its edge is none that summing up moves light across. */
static void add_bends(const float *from, size_t side, size_t entry, size_t step, double scale,
                      float *to)
{
    float factor = (float)(scale / (double)(step * step));
    for (size_t i = 0; i < side * side; i++) {
        size_t x = i % side, y = i / side;
        if (x < 1 || y < 1 || x + 1 >= side || y + 1 >= side) {
            continue;
        }
        const float *here = from + i * entry;
        const float *around[4] = {x > step ? here - step * entry : here,
                                  x + step + 1 < side ? here + step * entry : here,
                                  y > step ? here - step * side * entry : here,
                                  y + step + 1 < side ? here + step * side * entry : here};
        for (size_t k = 0; k < entry; k++) {
            to[i * entry + k] +=
                factor * (around[0][k] + around[1][k] + around[2][k] + around[3][k] - 4 * here[k]);
        }
    }
}

static int bend_points(struct levels *levels, const struct appearance *appearance,
                       struct nacre_error *error)
{
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    size_t side = (size_t)levels->near_side;
    size_t kernels = (size_t)(per_term ? 1 : appearance->kernel_count);
    size_t entry = per_term ? (size_t)appearance->terms * 4 : 4, size = side * side * entry;
    size_t bytes = (kernels * size * sizeof *levels->bends + 63) / 64 * 64;
    levels->bends = aligned_alloc(64, bytes);
    if (!levels->bends) {
        return nacre_fail_memory(error, "the material's kernels");
    }
    memset(levels->bends, 0, bytes);
    for (size_t j = 0; j < kernels; j++) {
        add_bends(levels->near + j * size, side, entry, 1, 0.5, levels->bends + j * size);
    }
    return NACRE_OK;
}

/* A ring of the basis kernels for squares of 2^(index + 1) points. The nearer rings' windows are exact where kernels are
 * read between surface points, this one's is read between them itself: to second order the difference is taken away. */
static int cut_basis(struct levels *levels, const struct appearance *appearance, int index,
                     struct ring ring, struct nacre_error *error)
{
    const struct basis *basis = &appearance->basis;
    struct level *level = &levels->squares[index];
    size_t side = (size_t)appearance->window + 2, entry = (size_t)basis->parts * 4;
    size_t step = (size_t)1 << index, size = side * side * entry;
    double variance = 0;
    for (int i = 0; i <= index; i++) {
        double square = (double)((size_t)4 << 2 * i);
        /* Of the interpolation down to the vertices, and of light handed up. */
        variance += square / 4 + square / 6;
    }
    float *cut = malloc(size * sizeof *cut), *bend = malloc(size * sizeof *bend);
    *level = (struct level){.inner = fmax(LEVELS_RISE * ring.begin - 0.5 - (double)step, 0),
                            .outer = isfinite(ring.end) ? ring.end + 0.5 + (double)step : HUGE_VAL};
    level->table = aligned_alloc(64, ((size_t)basis->columns * size * sizeof *cut + 63) / 64 * 64);
    bool made = cut && bend && level->table;
    for (size_t b = 0; made && b < (size_t)basis->columns; b++) {
        const float *from = basis->table + b * size;
        float *to = level->table + b * size;
        memset(bend, 0, size * sizeof *bend);
        if (index == 0) {
            add_bends(from, side, entry, 1, 1.0 / 12, bend);
        }
        for (size_t place = 0; place < side * side; place++) {
            float value = (float)window(ring, offset_of(place, (int)side));
            for (size_t i = place * entry; i < (place + 1) * entry; i++) {
                cut[i] = value * from[i];
                to[i] = cut[i] + value * bend[i];
            }
        }
        if (index == 0) {
            add_bends(cut, side, entry, 1, -1.0 / 12, to);
        }
        add_bends(cut, side, entry, step, -variance / 2, to);
    }
    free(cut);
    free(bend);
    return made ? NACRE_OK : nacre_fail_memory(error, "the material's kernels");
}

/* The smallest radius from which on squares may be used. */
static double choose_squares(const struct levels *levels, const struct basis *basis, double half,
                             double tolerance)
{
    double first = nearest_squares, allowed = tolerance - levels->estimate;
    while (first < half && !(estimate_squares(basis, first, half) <= allowed)) {
        first *= 1.05;
    }
    return first < half ? first : HUGE_VAL;
}

int levels_make(struct levels *levels, const struct appearance *appearance, double tolerance,
                struct nacre_error *error)
{
    const struct basis *basis = &appearance->basis;
    double half = appearance->window / 2 + 1, first = 0; /* NOLINT: K is odd */
    *levels = (struct levels){0};
    while (first < half &&
           !(seen_of_points * bound_of(basis, 1, first, HUGE_VAL) <= share_of_points * tolerance)) {
        first = fmax(1.2 * first, 1);
    }
    levels->merges = tolerance > 0 && first < half;
    double merge = levels->merges ? first : HUGE_VAL, squares = HUGE_VAL;
    if (levels->merges) {
        levels->estimate = seen_of_points * bound_of(basis, 1, first, HUGE_VAL);
        squares = choose_squares(levels, basis, half, tolerance);
    }
    levels->samples = (struct ring){0, merge};
    levels->points = (struct ring){merge, squares};
    int status = cut_kernels(levels, appearance, error);
    if (status == NACRE_OK && levels->merges) {
        status = bend_points(levels, appearance, error);
    }
    levels->estimate += isfinite(squares) ? estimate_squares(basis, squares, half) : 0;
    for (int i = 0; status == NACRE_OK && i < LEVELS_MAXIMUM && isfinite(squares); i++) {
        bool last = are_last(i, squares, half);
        status = cut_basis(levels, appearance, i,
                           (struct ring){squares, last ? HUGE_VAL : 2 * squares}, error);
        levels->count++;
        squares = last ? HUGE_VAL : 2 * squares;
    }
    if (status != NACRE_OK) {
        levels_finish(levels);
    }
    return status;
}

bool levels_equal(const struct levels *a, const struct levels *b)
{
    return !(a->points.begin < b->points.begin || a->points.begin > b->points.begin ||
             a->points.end < b->points.end || a->points.end > b->points.end);
}

void levels_finish(struct levels *levels)
{
    free(levels->near_owned);
    free(levels->bends);
    for (int i = 0; i < LEVELS_MAXIMUM; i++) {
        free(levels->squares[i].table);
    }
    *levels = (struct levels){0};
}
