/* Fitting the reciprocal forms in double precision. */
#include "bilinear.h"

#include "quantise.h"

#include "../timing.h"

#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Distances are summed in so many parts, whatever the threads, and so many points at a time. */
enum { PARTS = 16, PIECE = 512 };

static size_t points_of(const struct bilinear *f)
{
    return (size_t)f->width * (size_t)f->height;
}

/* What one evaluation is made of. */
struct task {
    const struct bilinear *fit;
    const struct entries *entries;
};

/* Where the sums of one part go: gradient and diagonal of all numbers, each or both NULL. */
struct sums {
    double value;
    double *gradient, *diagonal;
};

static int place_of(const struct bilinear *f, int dx, int dy)
{
    int half = f->window / 2;
    return f->place[(dy + half) * f->window + dx + half];
}

/* Number of kernel n of a channel at a place, among all numbers. */
static size_t kernel_at(const struct bilinear *f, int channel, int id, int place)
{
    return (size_t)f->form.terms * points_of(f) +
           ((size_t)channel * (size_t)f->kernels + (size_t)id) * (size_t)f->places + (size_t)place;
}

/* s of x_i from `first` to `end`. */
static void find_sums(const struct bilinear *f, const double *x, int channel, int place,
                      ptrdiff_t shift, size_t first, size_t end, double *restrict sum)
{
    size_t points = points_of(f), count = end - first;
    memset(sum, 0, count * sizeof *sum);
    for (int n = 0; n < f->count; n++) {
        double k = x[kernel_at(f, channel, f->id[n], place)];
        const double *ua = x + (size_t)f->a[n] * points + first;
        const double *ub = x + (size_t)f->b[n] * points + first + shift;
#pragma omp simd
        for (size_t i = 0; i < count; i++) {
            sum[i] += k * ua[i] * ub[i];
        }
    }
}

/* Half the sum of squares; s becomes the weighted error by s, and `square` the curvature by s. At the centre c takes what is
 * missing. */
static double weigh(bool squared, bool centre, const double *restrict target,
                    const double *restrict weight, size_t count, double *restrict sum,
                    double *restrict square)
{
    double value = 0;
#pragma omp simd reduction(+ : value)
    for (size_t i = 0; i < count; i++) {
        double s = sum[i], slope = squared ? 2 * s : 1;
        double miss = (squared ? s * s : s) - target[i];
        double w = centre && miss < 0 ? 0 : weight[i];
        value += w * miss * miss / 2;
        sum[i] = w * miss * slope;
        square[i] = w * slope * slope;
    }
    return value;
}

/* What one product adds to the gradient: d_a and d_b may be the same plane. Returns the kernel's part. */
static double add_gradient(double k, const double *error, const double *ua, const double *ub,
                           size_t count, double *da, double *db)
{
    double total = 0;
#pragma omp simd reduction(+ : total)
    for (size_t i = 0; i < count; i++) {
        double by = error[i] * ub[i];
        da[i] += k * by;
        total += by * ua[i];
    }
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        db[i] += k * error[i] * ua[i];
    }
    return total;
}

static double add_diagonal(double k, const double *square, const double *ua, const double *ub,
                           size_t count, double *da, double *db)
{
    double total = 0;
    for (size_t i = 0; i < count; i++) {
        double a = ua[i] * ua[i], b = ub[i] * ub[i];
        da[i] += square[i] * k * k * b;
        db[i] += square[i] * k * k * a;
        total += square[i] * a * b;
    }
    return total;
}

/* One distance, a piece of the plane after the other. */
static void sum_distance(const struct task *task, const double *x, int c, int d, struct sums *sums)
{
    const struct bilinear *f = task->fit;
    const struct entries *e = task->entries;
    struct span span = entries_span(e, c, d);
    size_t points = points_of(f);
    int place = place_of(f, e->dx[d], e->dy[d]);
    double error[PIECE], square[PIECE];
    for (size_t first = span.first; first < span.end; first += PIECE) {
        size_t end = first + PIECE < span.end ? first + PIECE : span.end, count = end - first;
        find_sums(f, x, c, place, span.shift, first, end, error);
        sums->value += weigh(f->form.squared, span.shift == 0, e->targets + span.start + first,
                             e->weights + span.start + first, count, error, square);
        for (int n = 0; n < f->count; n++) {
            size_t number = kernel_at(f, c, f->id[n], place);
            size_t a = (size_t)f->a[n] * points + first;
            size_t b = (size_t)((ptrdiff_t)((size_t)f->b[n] * points + first) + span.shift);
            if (sums->gradient) {
                sums->gradient[number] += add_gradient(x[number], error, x + a, x + b, count,
                                                       sums->gradient + a, sums->gradient + b);
            }
            if (sums->diagonal) {
                sums->diagonal[number] += add_diagonal(x[number], square, x + a, x + b, count,
                                                       sums->diagonal + a, sums->diagonal + b);
            }
        }
    }
}

/* The distances of one part, all channels. */
static void sum_part(const struct task *task, const double *x, int part, struct sums *sums)
{
    int count = task->entries->count;
    for (int n = part; n < task->fit->channels * count; n += PARTS) {
        sum_distance(task, x, n / count, n % count, sums);
    }
}

static double evaluate(void *data, const double *x, double *gradient, double *diagonal)
{
    const struct task *task = data;
    size_t count = task->fit->numbers;
    struct sums parts[PARTS] = {{0}};
    double value = task->entries->rest;
#pragma omp parallel for schedule(dynamic)
    for (int part = 0; part < PARTS; part++) {
        parts[part].gradient = gradient ? allocate(count * sizeof(double)) : NULL;
        parts[part].diagonal = diagonal ? allocate(count * sizeof(double)) : NULL;
        sum_part(task, x, part, &parts[part]);
    }
    for (size_t i = 0; i < count; i++) {
        double g = 0, d = 0;
        for (int part = 0; part < PARTS; part++) {
            g += gradient ? parts[part].gradient[i] : 0;
            d += diagonal ? parts[part].diagonal[i] : 0;
        }
        if (gradient) {
            gradient[i] = g;
        }
        if (diagonal) {
            diagonal[i] = d;
        }
    }
    for (int part = 0; part < PARTS; part++) {
        value += parts[part].value;
        free(parts[part].gradient);
        free(parts[part].diagonal);
    }
    return value;
}

/* Which number of a kernel holds at each distance. Rings hold all distances of one length; without them, one of each two
 * distances d and -d has a number, as the entries are folded. */
static void choose_places(struct bilinear *f)
{
    int half = f->window / 2, lengths = 2 * half * half + 1;
    int *ring = allocate((size_t)lengths * sizeof *ring);
    f->place = allocate((size_t)(f->window * f->window) * sizeof *f->place);
    for (int length = 0; length < lengths; length++) {
        bool exists = false;
        for (int dx = 0; dx * dx <= length && dx <= half; dx++) {
            int dy = (int)lround(sqrt(length - dx * dx));
            exists = exists || (dy <= half && dx * dx + dy * dy == length);
        }
        ring[length] = exists ? f->places++ : 0;
    }
    f->places = f->form.radial ? f->places : (f->window * f->window + 1) / 2;
    for (int i = 0; i < f->window * f->window; i++) {
        int dx = i % f->window - half, dy = i / f->window - half;
        int later = i < f->window * f->window / 2 ? f->window * f->window - 1 - i : i;
        f->place[i] = f->form.radial ? ring[dx * dx + dy * dy] : later - f->window * f->window / 2;
    }
    free(ring);
}

/* The products. With rings k_ab = k_ba; without, both have kernels of their own. */
static void choose_products(struct bilinear *f)
{
    int terms = f->form.terms, size = terms * terms;
    f->a = allocate((size_t)size * sizeof *f->a);
    f->b = allocate((size_t)size * sizeof *f->b);
    f->id = allocate((size_t)size * sizeof *f->id);
    for (int a = 0; a < terms; a++) {
        for (int b = 0; b < terms; b++) {
            if (a != b && !f->form.pairs) {
                continue;
            }
            int id = f->kernels;
            for (int n = 0; n < f->count && f->form.radial; n++) {
                id = f->a[n] == b && f->b[n] == a ? f->id[n] : id;
            }
            f->kernels += id == f->kernels;
            f->a[f->count] = a;
            f->b[f->count] = b;
            f->id[f->count++] = id;
        }
    }
}

/* Where the fit starts: kernels as the mean response, of ever shorter reach, planes of any values about 1. */
static void start(const struct entries *e, uint64_t seed, struct bilinear *f)
{
    size_t points = points_of(f);
    size_t places = (size_t)f->channels * (size_t)f->places;
    double *mean = allocate(places * sizeof *mean), *count = allocate(places * sizeof *count);
    for (int n = 0; n < f->channels * e->count; n++) {
        int c = n / e->count, d = n % e->count;
        struct span span = entries_span(e, c, d);
        size_t place = (size_t)c * (size_t)f->places + (size_t)place_of(f, e->dx[d], e->dy[d]);
        for (size_t i = span.start + span.first; i < span.start + span.end; i++) {
            mean[place] += e->weights[i] > 0 ? e->targets[i] : 0;
            count[place] += e->weights[i] > 0;
        }
    }
    for (size_t i = 0; i < (size_t)f->form.terms * points; i++) {
        f->planes[i] = 0.5 + random_uniform(seed, i);
    }
    for (int i = 0; i < f->window * f->window * f->channels * f->count; i++) {
        int n = i % f->count, c = i / f->count % f->channels, at = i / f->count / f->channels;
        int half = f->window / 2, place = f->place[at], dx = at % f->window - half;
        int dy = at / f->window - half;
        double r = hypot(dx, dy);
        double g = fmax(0, mean[c * f->places + place] / fmax(1, count[c * f->places + place]));
        double reach = half * pow(0.6, f->a[n]);
        double share = f->a[n] == f->b[n] ? 1 : f->form.squared ? 0.05 : 0.1;
        double *k = &f->planes[kernel_at(f, c, f->id[n], place)];
        *k = (f->form.squared ? sqrt(g) : g) * share / f->form.terms *
             exp(-r / (f->form.squared ? 2 * reach : reach));
    }
    free(mean);
    free(count);
}

/* What the sums leave of the centre, which is the first distance. */
static void find_centre(const struct entries *e, struct bilinear *f)
{
    size_t points = points_of(f);
    f->centre = allocate((size_t)f->channels * points * sizeof *f->centre);
    for (int c = 0; c < f->channels; c++) {
        double *centre = f->centre + (size_t)c * points;
        size_t start = entries_span(e, c, 0).start;
        find_sums(f, f->planes, c, place_of(f, 0, 0), 0, 0, points, centre);
        for (size_t i = 0; i < points; i++) {
            double s = f->form.squared ? centre[i] * centre[i] : centre[i];
            centre[i] = fmax(0, e->targets[start + i] - s);
        }
    }
}

void bilinear_fit(const struct entries *e, struct bilinear_form form, uint64_t seed,
                  const struct minimise_limits *limits, struct bilinear *f)
{
    *f = (struct bilinear){.form = form,
                           .width = e->width,
                           .height = e->height,
                           .channels = e->channels,
                           .window = e->window};
    choose_places(f);
    choose_products(f);
    f->numbers = kernel_at(f, f->channels, 0, 0);
    f->planes = allocate(f->numbers * sizeof *f->planes);
    f->kernel = f->planes + (size_t)form.terms * points_of(f);
    start(e, seed, f);
    struct task task = {f, e};
    struct function function = {f->numbers, form.squared, &task, evaluate};
    f->objective = minimise(&function, limits, f->planes, &f->iterations);
    find_centre(e, f);
}

/* Kernels hold for the later of d and -d: the earlier goes back from x_o. */
static void predict_distance(const struct bilinear *f, int c, int d, double *sum, float *responses)
{
    size_t area = (size_t)f->window * (size_t)f->window, points = points_of(f);
    int half = f->window / 2, dx = d % f->window - half, dy = d / f->window - half;
    ptrdiff_t shift = (ptrdiff_t)dy * f->width + dx;
    bool back = d < (int)area / 2;
    size_t apart = (size_t)(back ? -shift : shift);
    if (apart < points) {
        find_sums(f, f->planes, c, f->place[d], (ptrdiff_t)apart, 0, points - apart,
                  sum + (back ? apart : 0));
    }
    for (size_t i = 0; i < points; i++) {
        int xo = (int)(i % (size_t)f->width) + dx, yo = (int)(i / (size_t)f->width) + dy;
        bool inside = xo >= 0 && yo >= 0 && xo < f->width && yo < f->height;
        double value = !inside ? 0 : f->form.squared ? sum[i] * sum[i] : sum[i];
        value += shift == 0 ? f->centre[(size_t)c * points + i] : 0;
        responses[(i * (size_t)f->channels + (size_t)c) * area + (size_t)d] = (float)value;
    }
}

void bilinear_predict(const struct bilinear *f, float *responses)
{
    int area = f->window * f->window;
    double *sum = allocate(points_of(f) * sizeof *sum);
    for (int n = 0; n < f->channels * area; n++) {
        predict_distance(f, n / area, n % area, sum, responses);
    }
    free(sum);
}

void bilinear_quantise(struct bilinear *f, int bits)
{
    for (int t = 0; t < f->form.terms; t++) {
        double *plane = f->planes + (size_t)t * points_of(f);
        if (f->form.squared) {
            quantise_evenly(plane, points_of(f), bits);
        } else {
            quantise_root(plane, points_of(f), bits);
        }
    }
    for (int c = 0; c < f->channels; c++) {
        quantise_logarithm(f->centre + (size_t)c * points_of(f), points_of(f), bits);
    }
    quantise_half(f->kernel, f->numbers - (size_t)f->form.terms * points_of(f));
}

size_t bilinear_bytes(const struct bilinear *f, int bits)
{
    size_t planes = (size_t)(f->form.terms + f->channels) * points_of(f);
    return (planes * (size_t)bits + 7) / 8 +
           2 * (size_t)(f->channels * f->kernels) * (size_t)f->places;
}

void bilinear_finish(struct bilinear *f)
{
    free(f->a);
    free(f->b);
    free(f->id);
    free(f->place);
    free(f->planes);
    free(f->centre);
    *f = (struct bilinear){0};
}
