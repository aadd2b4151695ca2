/* Choosing rings and cutting kernels. */
#include "render/levels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A ring sets in between this share of a radius and all of it. */
static const double rise_share = 0.45;

/* Errors of pairs have either sign, and light around a place cancels most of them: what is seen is this share of the
 * sum of their bounds (tests/bench/bench_render). */
static const double seen_share = 0.005;

/* 0 up to `from`, 1 from `to` on, twice differentiable. */
static double rise(double r, double from, double to)
{
    double t = fmin(fmax((r - from) / (to - from), 0), 1);
    return t * t * t * (10 + t * (6 * t - 15));
}

/* Where a ring sets in, and where the next one takes over: HUGE_VAL for none. */
struct ring {
    double begin, end;
};

static double window(struct ring ring, double r)
{
    double value = ring.begin > 0 ? rise(r, rise_share * ring.begin, ring.begin) : 1;
    return isfinite(ring.end) ? value * (1 - rise(r, rise_share * ring.end, ring.end)) : value;
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
        double r = step;
        sum += r > 0.7 * begin && r <= 0.7 * end ? basis->bend[step] : 0;
    }
    return size * size / 8 * sum;
}

static double estimate_squares(const struct basis *basis, double first)
{
    double sum = 0, size = 2;
    for (int i = 0; i < LEVELS_MAXIMUM; i++) {
        double end = i + 1 < LEVELS_MAXIMUM ? 2 * first : HUGE_VAL;
        sum += bound_of(basis, size, first, end);
        first *= 2;
        size *= 2;
    }
    return seen_share * sum;
}

static void free_level(struct level *level)
{
    free(level->owned);
    *level = (struct level){0};
}

/* Cut a ring out of kernels of one sample, or of a surface point's light. */
static int cut_kernels(struct level *level, const struct appearance *appearance, struct ring ring,
                       struct nacre_error *error)
{
    size_t full = (size_t)appearance->window + 2;
    int half = appearance->window / 2 + 1;
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    *level = (struct level){.outer = HUGE_VAL, .side = (int)full, .table = appearance->kernels};
    if (!(ring.begin > 0) && !isfinite(ring.end) && !per_term) { /* per term: aligned */
        return NACRE_OK;
    }
    if (isfinite(ring.end)) {
        half = (int)fmin(half, ceil(ring.end) + 1);
        level->outer = ring.end + 2.5;
    }
    level->inner = fmax(rise_share * ring.begin - 2.5, 0);
    level->side = 2 * half + 1;
    size_t side = (size_t)level->side, skip = full / 2 - (size_t)half;
    size_t kernels = (size_t)(per_term ? 1 : appearance->kernel_count);
    size_t entry = per_term ? (size_t)appearance->terms * 4 : 4;
    level->owned =
        aligned_alloc(64, (kernels * side * side * entry * sizeof *level->owned + 63) / 64 * 64);
    if (!level->owned) {
        return nacre_fail_memory(error, "the material's kernels");
    }
    level->table = level->owned;
    for (size_t i = 0; i < kernels * side * side; i++) {
        size_t kernel = i / (side * side), place = i % (side * side);
        size_t row = place / side + skip, column = place % side + skip;
        const float *from = appearance->kernels + ((kernel * full + row) * full + column) * entry;
        double value = window(ring, offset_of(place, level->side));
        for (size_t k = 0; k < entry; k++) {
            level->owned[i * entry + k] = (float)(value * from[k]);
        }
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
            to[i * entry + k] += factor * (around[0][k] + around[1][k] + around[2][k] +
                                           around[3][k] - 4 * here[k]);
        }
    }
}

static int bend_points(struct levels *levels, const struct appearance *appearance,
                       struct nacre_error *error)
{
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM;
    size_t side = (size_t)levels->points.side;
    size_t kernels = (size_t)(per_term ? 1 : appearance->kernel_count);
    size_t entry = per_term ? (size_t)appearance->terms * 4 : 4, size = side * side * entry;
    size_t bytes = (kernels * size * sizeof *levels->bends + 63) / 64 * 64;
    levels->bends = aligned_alloc(64, bytes);
    if (!levels->bends) {
        return nacre_fail_memory(error, "the material's kernels");
    }
    memset(levels->bends, 0, bytes);
    for (size_t j = 0; j < kernels; j++) {
        add_bends(levels->points.table + j * size, side, entry, 1, 0.5, levels->bends + j * size);
    }
    return NACRE_OK;
}

/* A ring of the basis kernels for squares of 2^(index + 1) points. */
static int cut_basis(struct levels *levels, const struct appearance *appearance, int index,
                     struct ring ring, struct nacre_error *error)
{
    const struct basis *basis = &appearance->basis;
    struct level *level = &levels->squares[index];
    size_t side = (size_t)appearance->window + 2, entry = (size_t)basis->parts * 4;
    size_t step = (size_t)1 << index, size = side * side * entry;
    double square = (double)(4 * step * step), variance = 0;
    for (double s = square; s > 3; s /= 4) {
        variance += s / 4; /* of the interpolation from this level down to the vertices */
    }
    variance -= square / 12; /* of light spread over the square */
    float *cut = malloc(size * sizeof *cut);
    *level =
        (struct level){.inner = fmax(rise_share * ring.begin - 1.5 - 1.5 * (double)step, 0),
                       .outer = isfinite(ring.end) ? ring.end + 1.5 + 1.5 * (double)step : HUGE_VAL,
                       .side = (int)side};
    level->table = level->owned =
        aligned_alloc(64, ((size_t)basis->columns * size * sizeof *cut + 63) / 64 * 64);
    if (!cut || !level->owned) {
        free(cut);
        return nacre_fail_memory(error, "the material's kernels");
    }
    for (size_t b = 0; b < (size_t)basis->columns; b++) {
        float *to = level->owned + b * size;
        for (size_t i = 0; i < size; i++) {
            double value = window(ring, offset_of(i / entry, (int)side));
            to[i] = cut[i] = (float)(value * basis->table[b * size + i]);
        }
        add_bends(cut, side, entry, step, -variance / 2, to);
    }
    free(cut);
    return NACRE_OK;
}

/* The smallest radius from which on squares may be used. */
static double choose_squares(const struct levels *levels, const struct basis *basis, double half,
                             double tolerance)
{
    double first = 4.5, allowed = tolerance - levels->estimate;
    while (first < half && !(estimate_squares(basis, first) <= allowed)) {
        first *= 1.2;
    }
    return first < half ? first : HUGE_VAL;
}

int levels_make(struct levels *levels, const struct appearance *appearance, double tolerance,
                struct nacre_error *error)
{
    const struct basis *basis = &appearance->basis;
    double half = appearance->window / 2 + 1, first = 1.5; /* NOLINT: K is odd */
    *levels = (struct levels){0};
    while (first < half && !(seen_share * bound_of(basis, 1, first, HUGE_VAL) <= tolerance / 2)) {
        first *= 1.2;
    }
    levels->merges = tolerance > 0 && first < half;
    double merge = levels->merges ? first : HUGE_VAL, squares = HUGE_VAL;
    if (levels->merges) {
        levels->estimate = seen_share * bound_of(basis, 1, first, HUGE_VAL);
        squares = choose_squares(levels, basis, half, tolerance);
    }
    int status = cut_kernels(&levels->samples, appearance, (struct ring){0, merge}, error);
    if (status == NACRE_OK && levels->merges) {
        status = cut_kernels(&levels->points, appearance, (struct ring){merge, squares}, error);
        if (status == NACRE_OK) {
            status = bend_points(levels, appearance, error);
        }
    }
    levels->estimate += isfinite(squares) ? estimate_squares(basis, squares) : 0;
    for (int i = 0; status == NACRE_OK && i < LEVELS_MAXIMUM && squares < 1.2 * half; i++) {
        bool last = i + 1 == LEVELS_MAXIMUM || 2 * squares >= 1.2 * half;
        status = cut_basis(levels, appearance, i,
                           (struct ring){squares, last ? HUGE_VAL : 2 * squares}, error);
        levels->count++;
        squares *= 2;
    }
    if (status != NACRE_OK) {
        levels_finish(levels);
    }
    return status;
}

void levels_finish(struct levels *levels)
{
    free_level(&levels->samples);
    free_level(&levels->points);
    free(levels->bends);
    for (int i = 0; i < LEVELS_MAXIMUM; i++) {
        free_level(&levels->squares[i]);
    }
    *levels = (struct levels){0};
}
