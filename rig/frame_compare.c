/* Comparing two frames of the same pattern. */
#include "rig/frame_compare.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* Pixels of the same colour lie two apart. */
enum { STEP = 2, TERMS = 4 };

/* A frame is looked at in so many parts each way. */
enum { PARTS = 3 };

/* Correlation over more pixels finds no better shift. */
static const double correlated_pixels = 60000;

/* A deviation of the sums of squares that noise alone does not reach in practice. */
static const double sigmas = 5;

double frame_saturation(const uint16_t *raw, size_t pixels, int full_scale)
{
    size_t count = 0;
    for (size_t i = 0; i < pixels; i++) {
        count += raw[i] >= full_scale;
    }
    return pixels ? (double)count / (double)pixels : 0;
}

/* Below this a frame has too little contrast for its derivatives to be of use. */
static const double least_gain = 0.3;

/* A frame that is fitted and the one that it is fitted by. */
struct fit {
    const uint16_t *from, *to;
    int width, height, full_scale;
    int x, y; /* `to` is fitted by `from` moved by so much */
};

/* Whether both pixels say something. */
static bool counts(const struct fit *fit, size_t from, size_t to)
{
    return fit->from[from] < fit->full_scale || fit->to[to] < fit->full_scale;
}

/* The part of `to` that lies a step inside the moved `from`. */
struct range {
    int left, right, top, bottom;
};

static struct range overlap(const struct fit *fit)
{
    return (struct range){
        STEP + (fit->x > 0 ? fit->x : 0), fit->width - STEP + (fit->x < 0 ? fit->x : 0),
        STEP + (fit->y > 0 ? fit->y : 0), fit->height - STEP + (fit->y < 0 ? fit->y : 0)};
}

static size_t place(const struct fit *fit, int x, int y)
{
    return (size_t)y * (size_t)fit->width + (size_t)x;
}

/* Sums over pixels of 1, a, b, aa, ab, bb. */
struct sums {
    double n, a, b, aa, ab, bb;
};

static struct sums sum_pairs(const struct fit *fit, struct range r, int stride)
{
    struct sums s = {0};
    for (int y = r.top; y < r.bottom; y += stride) {
        for (int x = r.left; x < r.right; x += stride) {
            size_t to = place(fit, x, y);
            size_t from = place(fit, x - fit->x, y - fit->y);
            if (counts(fit, from, to)) {
                double a = fit->from[from];
                double b = fit->to[to];
                s.n++;
                s.a += a;
                s.b += b;
                s.aa += a * a;
                s.ab += a * b;
                s.bb += b * b;
            }
        }
    }
    return s;
}

/* Mean square deviation of `from`. */
static double spread(const struct sums *s)
{
    return (s->aa - s->a * s->a / s->n) / s->n;
}

static double correlation(const struct sums *s)
{
    double a = s->aa - s->a * s->a / s->n;
    double b = s->bb - s->b * s->b / s->n;
    return s->n > 0 && a > 0 && b > 0 ? (s->ab - s->a * s->b / s->n) / sqrt(a * b) : 0;
}

/* Dots repeat: of shifts that correlate nearly as well the smaller one is meant. */
static const double per_pixel = 0.02 / FRAME_SHIFT_MAX;

/* Whole periods of the Bayer pattern that the picture moved by. An odd stride meets all colours. */
static void find_shift(struct fit *fit)
{
    double pixels = (double)fit->width * fit->height;
    int stride = 1 + 2 * (int)(sqrt(pixels / correlated_pixels) / 2);
    double best = -1;
    struct fit tried = *fit;
    for (int y = -FRAME_SHIFT_MAX; y <= FRAME_SHIFT_MAX; y += STEP) {
        for (int x = -FRAME_SHIFT_MAX; x <= FRAME_SHIFT_MAX; x += STEP) {
            tried.x = x;
            tried.y = y;
            struct sums s = sum_pairs(&tried, overlap(&tried), stride);
            /* A small overlap fits by chance. */
            bool enough = 2 * s.n * stride * stride >= pixels;
            double fits = enough ? correlation(&s) - per_pixel * hypot(x, y) : -1;
            if (fits > best) {
                best = fits;
                fit->x = x;
                fit->y = y;
            }
        }
    }
}

/* Solve the symmetric m x = v, in place; a term that nothing tells about is left out (0). */
static void solve(double m[TERMS][TERMS], double v[TERMS], double x[TERMS])
{
    bool used[TERMS] = {false};
    double least[TERMS]; /* below this a diagonal element is rounding */
    for (int i = 0; i < TERMS; i++) {
        least[i] = m[i][i] * 1e-10;
    }
    memset(x, 0, TERMS * sizeof *x);
    for (int i = 0; i < TERMS; i++) {
        int pivot = -1;
        for (int k = 0; k < TERMS; k++) {
            if (!used[k] && m[k][k] > least[k] && (pivot < 0 || m[k][k] > m[pivot][pivot])) {
                pivot = k;
            }
        }
        if (pivot < 0) {
            break;
        }
        used[pivot] = true;
        for (int k = 0; k < TERMS; k++) {
            double factor = m[k][pivot] / m[pivot][pivot];
            for (int c = 0; c < TERMS && k != pivot; c++) {
                m[k][c] -= factor * m[pivot][c];
            }
            v[k] -= k != pivot ? factor * v[pivot] : 0;
        }
    }
    for (int i = 0; i < TERMS; i++) {
        x[i] = used[i] ? v[i] / m[i][i] : 0;
    }
}

/* The derivative of a frame by steps of `stride`, which is one along x and a row along y. */
static double slope(const uint16_t *raw, size_t stride)
{
    return ((double)*(raw + STEP * stride) - *(raw - STEP * stride)) / (2. * STEP);
}

/* 1, value and derivatives along x and y of `from`, where it comes to lie. The mean of both frames' derivatives, brought to
 * the same contrast by `gain`, is right to the second order of a shift. */
static void terms_at(const struct fit *fit, double mean, double gain, size_t from, size_t to,
                     double t[TERMS])
{
    size_t row = (size_t)fit->width;
    t[0] = 1;
    t[1] = fit->from[from] - mean;
    t[2] = slope(fit->from + from, 1);
    t[3] = slope(fit->from + from, row);
    if (gain > 0) {
        t[2] = (t[2] + slope(fit->to + to, 1) / gain) / 2;
        t[3] = (t[3] + slope(fit->to + to, row) / gain) / 2;
    }
}

/* Least squares of `to` by the terms; the squared residual is summed in a second pass. */
static double fit_terms(const struct fit *fit, struct range r, const struct sums *s,
                        double x[TERMS])
{
    double m[TERMS][TERMS] = {{0}};
    double v[TERMS] = {0};
    double t[TERMS];
    double residual = 0;
    double means[2] = {s->a / s->n, s->b / s->n};
    double about = sqrt((s->bb / s->n - means[1] * means[1]) / spread(s));
    double gain = about > least_gain ? about : 0;
    for (int pass = 0; pass < 2; pass++) {
        for (int py = r.top; py < r.bottom; py++) {
            for (int px = r.left; px < r.right; px++) {
                size_t to = place(fit, px, py);
                size_t from = place(fit, px - fit->x, py - fit->y);
                if (!counts(fit, from, to)) {
                    continue;
                }
                double value = fit->to[to] - means[1];
                terms_at(fit, means[0], gain, from, to, t);
                double left = value - x[0] * t[0] - x[1] * t[1] - x[2] * t[2] - x[3] * t[3];
                residual += pass == 1 ? left * left : 0;
                for (int i = 0; i < TERMS && pass == 0; i++) {
                    v[i] += t[i] * value;
                    for (int k = 0; k < TERMS; k++) {
                        m[i][k] += t[i] * t[k];
                    }
                }
            }
        }
        if (pass == 0) {
            solve(m, v, x);
        }
    }
    return residual;
}

/* Mean square of one frame's noise, from two of the same. */
static double noise_of(const struct frame_pair *pair)
{
    size_t pixels = (size_t)pair->width * (size_t)pair->height;
    double sum = 0;
    double squares = 0;
    for (size_t i = 0; i < pixels; i++) {
        double difference = (double)pair->now[i] - pair->again[i];
        sum += difference;
        squares += difference * difference;
    }
    double mean = sum / (double)pixels; /* the lamp's flicker is no noise of pixels */
    return (squares / (double)pixels - mean * mean) / 2;
}

static double variance(const uint16_t *raw, size_t pixels)
{
    double sum = 0;
    double squares = 0;
    for (size_t i = 0; i < pixels; i++) {
        sum += raw[i];
        squares += (double)raw[i] * raw[i];
    }
    double mean = sum / (double)pixels;
    return squares / (double)pixels - mean * mean;
}

/* The largest shift of the parts of the frame: it may have turned. Parts without dots tell nothing. */
static double find_worst_shift(const struct fit *fit, const struct range *all, double contrast)
{
    double worst = 0;
    for (int i = 0; i < PARTS * PARTS; i++) {
        int column = i % PARTS;
        int row = i / PARTS;
        struct range r = {all->left + (all->right - all->left) * column / PARTS,
                          all->left + (all->right - all->left) * (column + 1) / PARTS,
                          all->top + (all->bottom - all->top) * row / PARTS,
                          all->top + (all->bottom - all->top) * (row + 1) / PARTS};
        double x[TERMS] = {0};
        struct sums s = sum_pairs(fit, r, 1);
        if (s.n < 16 || spread(&s) < contrast / 4) {
            continue;
        }
        (void)fit_terms(fit, r, &s, x);
        if (x[1] > least_gain) {
            worst = fmax(worst, hypot(fit->x - x[2] / x[1], fit->y - x[3] / x[1]));
        }
    }
    return worst;
}

struct frame_difference frame_compare(const struct frame_pair *pair)
{
    size_t pixels = (size_t)pair->width * (size_t)pair->height;
    struct frame_difference found = {.gain = 1, .doubt = INFINITY};
    bool swapped = variance(pair->now, pixels) > variance(pair->before, pixels);
    struct fit fit = {.from = swapped ? pair->now : pair->before,
                      .to = swapped ? pair->before : pair->now,
                      .width = pair->width,
                      .height = pair->height,
                      .full_scale = pair->full_scale};
    double x[TERMS] = {0};
    double noise = noise_of(pair);
    find_shift(&fit);
    struct range r = overlap(&fit);
    struct sums s = sum_pairs(&fit, r, 1);
    if (s.n < 16) {
        found.saturated = 1;
        return found;
    }
    double all = (double)(r.right - r.left) * (r.bottom - r.top);
    found.saturated = 1 - s.n / all;
    double contrast = spread(&s) - noise;
    /* By how much a mean square of noise over so many pixels is wrong at most. */
    double unsure = noise * sigmas * sqrt(2 / s.n);
    if (contrast <= unsure || contrast <= 0) {
        return found;
    }
    double residual = fit_terms(&fit, r, &s, x) / s.n;
    double gain = x[1];
    /* The noise of the frame before is not known: it follows the light, as shot noise does, or is the same. */
    double share = fabs(gain) > 1 ? gain * gain : fabs(gain);
    double rest = residual - noise * (1 + share);
    double moved_x = gain != 0 ? -x[2] / gain : 0;
    double moved_y = gain != 0 ? -x[3] / gain : 0;
    found.contrast = sqrt(contrast);
    found.rest = rest > 0 ? sqrt(rest / contrast) : 0;
    found.doubt = sqrt(unsure * (1 + share) / contrast);
    found.gain = !swapped ? gain : gain > 0 ? 1 / gain : INFINITY;
    found.right_px = (fit.x + moved_x) * (swapped ? -1 : 1);
    found.down_px = (fit.y + moved_y) * (swapped ? -1 : 1);
    found.worst_px = find_worst_shift(&fit, &r, contrast);
    return found;
}
