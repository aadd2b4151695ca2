/* Choosing the shape of planes and kernels.
 *
 * All shapes are fitted to the same piece of the scan with as many terms as take equal bytes of the whole, and the least
 * objective is chosen. Terms that a shape has no bytes for are 0 and stay so: all fits run the same compiled kernels. */
#include "factor/shape.h"

#include "factor/attempt.h"
#include "factor/terms.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Rows and columns of the piece at most, and iterations on it: until one lowers the objective by less than a share. */
enum { SIDE = 40, LEAST_ITERATIONS = 5, MOST_ITERATIONS = 24 };
#define SLOW 0.04

/* What is not the default must have an objective of this share or less: a twentieth off the error. */
#define BETTER 0.9

/* What all fits share. */
struct trials {
    const struct responses *piece;
    struct factor_options options; /* reciprocity as found by the first */
    const struct opencl *opencl;
    struct progress *progress;
    struct factor_prepared prepared; /* of the piece */
    int terms;                       /* of the kernels that are compiled */
    int sides;                       /* 1: H = F */
};

/* One fit on its way. */
struct trial {
    struct terms_data data;
    struct attempt attempt;
    double objective;
};

static size_t points_of(const struct responses *r)
{
    return (size_t)r->width * (size_t)r->height;
}

double shape_bytes(const struct responses *r, const struct factor_options *o,
                   const struct shape *shape, int sides)
{
    double bits = o->bits == FACTOR_BITS_AUTO ? FACTOR_BITS_LEAST : o->bits > 0 ? o->bits : 16;
    double planes = (shape->separate ? r->channels : 1) * sides * (double)points_of(r) * bits / 8;
    double numbers = shape->full ? (double)r->window * r->window : terms_radii(r->window);
    return planes + 4 * numbers * r->channels;
}

/* Terms of one shape in the bytes of so many of another: rounded down, so none where not even one fits. */
static int equal_terms(const struct responses *r, const struct factor_options *o,
                       const struct shape *from, const struct shape *to, int sides)
{
    double terms = from->terms * shape_bytes(r, o, from, sides) / shape_bytes(r, o, to, sides);
    return (int)floor(terms);
}

/* Sum of squared distances of features from their mean, of the measured points in a square: how much there is to tell apart.
 * index: [height][width], of a point's features, or SIZE_MAX. */
static double spread_of(const struct responses *r, const struct features *f, const size_t *index,
                        int x0, int y0, int width, int height, double *mean)
{
    double squares = 0, of_mean = 0;
    size_t count = 0;
    memset(mean, 0, f->length * sizeof *mean);
    for (int i = 0; i < width * height; i++) {
        size_t at = index[(size_t)(y0 + i / width) * (size_t)r->width + (size_t)(x0 + i % width)];
        for (size_t j = 0; at != SIZE_MAX && j < f->length; j++) {
            double value = (double)f->values[at * f->length + j];
            mean[j] += value;
            squares += value * value;
        }
        count += at != SIZE_MAX;
    }
    for (size_t j = 0; j < f->length; j++) {
        of_mean += mean[j] * mean[j];
    }
    return count ? squares - of_mean / (double)count : -1;
}

/* Where the piece is that has most to tell apart. */
static int place_piece(const struct responses *r, const struct features *f, int width, int height,
                       int *x, int *y, struct nacre_error *error)
{
    size_t *index = malloc(points_of(r) * sizeof *index);
    double *mean = malloc((f->length + 1) * sizeof *mean), most = -2;
    int status = NACRE_OK;
    if (!index || !mean) {
        status = nacre_fail_memory(error, "a piece of the scan");
        goto out;
    }
    memset(index, 0xff, points_of(r) * sizeof *index);
    for (size_t i = 0; i < f->count; i++) {
        index[f->points[i]] = i;
    }
    int across = (r->width - width + SIDE / 2 - 1) / (SIDE / 2);
    int down = (r->height - height + SIDE / 2 - 1) / (SIDE / 2);
    for (int i = 0; i < (across + 1) * (down + 1); i++) {
        int left = across ? i % (across + 1) * (r->width - width) / across : 0;
        int top = down ? i / (across + 1) * (r->height - height) / down : 0;
        double spread = spread_of(r, f, index, left, top, width, height, mean);
        if (spread > most) {
            most = spread;
            *x = left;
            *y = top;
        }
    }
out:
    free(index);
    free(mean);
    return status;
}

static int cut_piece(const struct responses *r, const struct features *f, struct responses *piece,
                     struct nacre_error *error)
{
    const struct nacre_scan_info info = {.width = r->width < SIDE ? r->width : SIDE,
                                         .height = r->height < SIDE ? r->height : SIDE,
                                         .window = r->window,
                                         .channels = r->channels,
                                         .pixel = r->half ? NACRE_HALF : NACRE_FLOAT,
                                         .pitch_mm = 1};
    size_t area = (size_t)r->window * (size_t)r->window;
    float *response = malloc(area * (size_t)r->channels * sizeof *response);
    int x0 = 0, y0 = 0;
    int status = response ? place_piece(r, f, info.width, info.height, &x0, &y0, error)
                          : nacre_fail_memory(error, "a piece of the scan");
    if (status == NACRE_OK) {
        status = responses_begin(piece, &info, r->lanes, r->half, error);
    }
    for (int i = 0; i < info.width * info.height && status == NACRE_OK; i++) {
        int x = i % info.width, y = i / info.width;
        if (r->measured[(size_t)(y0 + y) * (size_t)r->width + (size_t)(x0 + x)]) {
            responses_read(r, x0 + x, y0 + y, response);
            responses_put(piece, x, y, response);
        }
    }
    if (status == NACRE_OK) {
        responses_scale(piece);
    }
    free(response);
    return status;
}

static void trial_finish(struct trial *t)
{
    attempt_finish(&t->attempt);
    terms_data_finish(&t->data);
    *t = (struct trial){0};
}

/* Terms from `live` on become 0. */
static int kill_terms(struct trial *t, int live, struct nacre_error *error)
{
    struct factors *f = &t->attempt.factors;
    size_t plane = (size_t)f->width * (size_t)f->height;
    size_t first = (size_t)live * plane, count = (size_t)f->terms * plane - first;
    int status = factors_read(f, t->attempt.method, error);
    for (int c = 0; c < f->channels && count > 0; c++) {
        float *sides[] = {f->f[c], f->h[c]};
        for (int side = 0; side < 2; side++) {
            if (sides[side]) {
                memset(sides[side] + first, 0, count * sizeof *sides[side]);
            }
        }
    }
    return status == NACRE_OK ? factors_write(f, t->attempt.method, error) : status;
}

/* Without planes to start from: those of the kinds of points. */
static int trial_begin(struct trials *all, const struct shape *shape, struct trial *t,
                       struct nacre_error *error)
{
    const struct factor_options *o = &all->options;
    const struct terms_options how = {
        .reciprocity = o->reciprocity,
        .weight = o->weight == FACTOR_WEIGHT_KERNEL ? TERMS_WEIGHT_KERNEL : TERMS_WEIGHT_RESPONSE,
        .full = shape->full,
        .separate = shape->separate};
    *t = (struct trial){.objective = INFINITY};
    int status = terms_data_begin(&t->data, all->piece, &how, o->epsilon, error);
    if (status == NACRE_OK) {
        all->options.reciprocity = t->data.options.reciprocity;
        all->sides = t->data.copy_count;
        status = attempt_begin(&t->attempt, all->piece, &all->prepared, &t->data, o, all->terms, 1,
                               error);
    }
    /* Kinds of points are as many as terms are not 0. */
    struct attempt fewer = {0};
    if (status == NACRE_OK && shape->terms < all->terms) {
        status =
            attempt_begin(&fewer, all->piece, &all->prepared, &t->data, o, shape->terms, 1, error);
        if (status == NACRE_OK) {
            memcpy(t->attempt.kinds, fewer.kinds, points_of(all->piece) * sizeof *fewer.kinds);
        }
        attempt_finish(&fewer);
    }
    if (status == NACRE_OK) {
        status = terms_new(all->opencl, &t->attempt.problem, &t->attempt.method, error);
    }
    return status == NACRE_OK && shape->terms < all->terms ? kill_terms(t, shape->terms, error)
                                                           : status;
}

static int trial_run(struct trials *all, struct trial *t, struct nacre_error *error)
{
    double before = INFINITY, objective = INFINITY;
    int status = NACRE_OK;
    for (int i = 0; i < MOST_ITERATIONS && status == NACRE_OK; i++) {
        before = objective;
        status = progress_step(all->progress, i, MOST_ITERATIONS, "comparing shapes", error);
        if (status == NACRE_OK) {
            status = attempt_advance(&t->attempt, true, &objective, error);
        }
        if (i >= LEAST_ITERATIONS && objective >= (1 - SLOW) * before) {
            break;
        }
    }
    return status == NACRE_OK ? attempt_advance(&t->attempt, false, &t->objective, error) : status;
}

static int try_shape(struct trials *all, const struct shape *shape, struct trial *t,
                     struct nacre_error *error)
{
    int status = trial_begin(all, shape, t, error);
    return status == NACRE_OK ? trial_run(all, t, error) : status;
}

/* What full kernels would make of the planes of a fit with radial ones, at no byte. */
static int find_promise(struct trials *all, const struct shape *shape, struct trial *radial,
                        double *objective, struct nacre_error *error)
{
    struct shape full = {true, shape->separate, shape->terms};
    struct trial t;
    int status = trial_begin(all, &full, &t, error);
    if (status == NACRE_OK) {
        status = factors_read(&radial->attempt.factors, radial->attempt.method, error);
    }
    if (status == NACRE_OK) {
        status = factors_write(&radial->attempt.factors, t.attempt.method, error);
    }
    if (status == NACRE_OK) {
        status = attempt_advance(&t.attempt, false, objective, error);
    }
    trial_finish(&t);
    return status;
}

/* How the errors of two fits, roots of their objectives, compare, in per cent. */
static double percent(double objective, double than)
{
    return than > 0 ? 100 * sqrt(objective / than) : 100;
}

static int choose_kernels(struct trials *all, const struct responses *r, struct shape *shape,
                          struct trial *best, struct nacre_error *error)
{
    const struct listener *to = &all->options.listener;
    double promise = 0;
    struct shape full = {true, shape->separate, 0};
    struct trial t = {0};
    int status = find_promise(all, shape, best, &promise, error);
    if (status == NACRE_OK && !(promise < BETTER * best->objective)) {
        tell(to, "kernels",
             "radial: full ones would leave %.3g %% of the error, at %.2g times the bytes",
             percent(promise, best->objective),
             shape_bytes(r, &all->options, &full, all->sides) /
                 shape_bytes(r, &all->options, shape, all->sides));
        return NACRE_OK;
    }
    full.terms = equal_terms(r, &all->options, shape, &full, all->sides);
    if (status == NACRE_OK && full.terms == 0) {
        tell(to, "kernels", "radial: the bytes of %d terms are too few for one with full kernels",
             shape->terms);
        return NACRE_OK;
    }
    if (status == NACRE_OK) {
        status = try_shape(all, &full, &t, error);
    }
    if (status == NACRE_OK) {
        bool wins = t.objective < BETTER * best->objective;
        tell(to, "kernels",
             "%s: in equal bytes %d terms with full kernels leave %.3g %% of the error of "
             "%d with radial ones",
             wins ? "full" : "radial", full.terms, percent(t.objective, best->objective),
             shape->terms);
        if (wins) {
            struct trial lost = *best;
            *best = t;
            t = lost;
            *shape = full;
        }
    }
    trial_finish(&t);
    return status;
}

/* Planes of each channel's own are a special case of shared ones, as many times the terms of which each channel's kernels
 * are 0 but in its own: they can be better only if kernels make up so much of the bytes that there are more of them. */
static bool could_be_separate(const struct responses *r, const struct shape *separate,
                              const struct shape *shared)
{
    return r->channels * separate->terms > shared->terms;
}

static int choose_planes(struct trials *all, const struct responses *r, struct shape *shape,
                         struct trial *best, struct nacre_error *error)
{
    const struct listener *to = &all->options.listener;
    struct shape separate = {shape->full, true, 0};
    struct trial t = {0};
    int status = NACRE_OK;
    separate.terms = equal_terms(r, &all->options, shape, &separate, all->sides);
    if (!could_be_separate(r, &separate, shape)) {
        tell(
            to, "planes",
            "shared: in equal bytes %d terms take the place of %d of each channel's own, which are "
            "a special case of %d",
            shape->terms, separate.terms, r->channels * separate.terms);
        return NACRE_OK;
    }
    status = try_shape(all, &separate, &t, error);
    if (status == NACRE_OK) {
        bool wins = t.objective < BETTER * best->objective;
        tell(to, "planes",
             "%s: in equal bytes %d terms of each channel's own leave %.3g %% of the error of "
             "%d shared ones",
             wins ? "of each channel" : "shared", separate.terms,
             percent(t.objective, best->objective), shape->terms);
        *shape = wins ? separate : *shape;
    }
    trial_finish(&t);
    return status;
}

int shape_choose(const struct responses *r, const struct features *f,
                 const struct factor_options *o, const struct opencl *opencl, int terms,
                 struct progress *progress, struct shape *shape, struct nacre_error *error)
{
    struct responses piece = {0};
    struct trials all = {.piece = r,
                         .options = *o,
                         .opencl = opencl,
                         .progress = progress,
                         .terms = terms,
                         .sides = 1};
    struct trial best = {0};
    bool wants_planes = o->planes == FACTOR_PLANES_AUTO && r->channels > 1;
    int status = NACRE_OK;
    *shape = (struct shape){o->kernels == FACTOR_KERNELS_FULL,
                            o->planes == FACTOR_PLANES_SEPARATE && r->channels > 1, terms};
    if (o->kernels != FACTOR_KERNELS_AUTO && !wants_planes) {
        return NACRE_OK;
    }
    if (r->width > SIDE || r->height > SIDE) {
        status = cut_piece(r, f, &piece, error);
        all.piece = &piece;
    }
    if (status == NACRE_OK) {
        status = features_new(all.piece, &all.prepared.features, error);
    }
    if (status == NACRE_OK) {
        status = try_shape(&all, shape, &best, error);
    }
    if (status == NACRE_OK && o->kernels == FACTOR_KERNELS_AUTO) {
        status = choose_kernels(&all, r, shape, &best, error);
    }
    if (status == NACRE_OK && wants_planes) {
        status = choose_planes(&all, r, shape, &best, error);
    }
    trial_finish(&best);
    factor_prepared_finish(&all.prepared);
    responses_finish(&piece);
    return status;
}
