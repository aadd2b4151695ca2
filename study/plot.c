/* Line plots and histograms as inline SVG. */
#include "study/plot.h"

#include "study/page.h"
#include "study/plot_labels.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { LEFT = 60, RIGHT = 12, TOP = 26, BOTTOM = 40, TICK_LIMIT = 32 };

/* One axis: the range of the data and where it lies in the picture. */
struct axis {
    bool logarithmic;
    double least, greatest;
    double from, to; /* in pixels */
};

static bool shown(const struct axis *axis, double value)
{
    return isfinite(value) && (!axis->logarithmic || value > 0);
}

static void widen(struct axis *axis, double value)
{
    if (shown(axis, value)) {
        axis->least = fmin(axis->least, value);
        axis->greatest = fmax(axis->greatest, value);
    }
}

static double place(const struct axis *axis, double value)
{
    double share = axis->logarithmic
                       ? (log(value) - log(axis->least)) / (log(axis->greatest) - log(axis->least))
                       : (value - axis->least) / (axis->greatest - axis->least);
    return axis->from + share * (axis->to - axis->from);
}

/* Give a range without width some, and a share of it as margin at both ends. */
static void settle(struct axis *axis, double margin_share)
{
    if (axis->logarithmic) {
        if (axis->greatest < axis->least * 1.2) {
            axis->least /= 1.25;
            axis->greatest *= 1.25;
        }
        double factor = exp(margin_share * (log(axis->greatest) - log(axis->least)));
        axis->least = fmax(axis->least / factor, DBL_MIN);
        axis->greatest = fmin(axis->greatest * factor, DBL_MAX);
        return;
    }
    if (!(axis->greatest > axis->least)) {
        double margin = axis->least != 0 ? fabs(axis->least) / 2 : 1;
        axis->least -= margin;
        axis->greatest += margin;
    }
    double margin = margin_share * (axis->greatest - axis->least);
    axis->least -= margin;
    axis->greatest += margin;
}

/* The step of 1, 2 or 5 times a power of ten that gives about `wanted` of them. */
static double nice_step(double range, int wanted)
{
    double rough = range / wanted;
    double power = pow(10, floor(log10(rough)));
    double digit = rough / power;
    return power * (digit < 1.5 ? 1 : digit < 3.5 ? 2 : digit < 7.5 ? 5 : 10);
}

/* Multiples of a round step within the axis. */
static size_t find_even_ticks(const struct axis *axis, int wanted, double ticks[TICK_LIMIT])
{
    double step = nice_step(axis->greatest - axis->least, wanted);
    double first = ceil(axis->least / step - 1e-9);
    size_t count = 0;
    while (count < TICK_LIMIT && (first + (double)count) * step <= axis->greatest + 1e-9 * step) {
        ticks[count] = (first + (double)count) * step;
        count++;
    }
    return count;
}

/* Powers of ten; over few decades rounder and rounder numbers between them. */
static size_t find_decade_ticks(const struct axis *axis, int wanted, double ticks[TICK_LIMIT])
{
    static const struct {
        double decades; /* that the axis has at most */
        double digits[10];
    } steps[] = {{0.8, {1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8}},
                 {1.3, {1, 2, 3, 5, 7}},
                 {2, {1, 2, 5}},
                 {INFINITY, {1}}};
    double decades = log10(axis->greatest) - log10(axis->least);
    int stride = (int)ceil(fmax(decades / wanted, 1));
    int first = (int)floor(log10(axis->least) / stride) * stride;
    size_t count = 0, step = 0;
    while (decades >= steps[step].decades) {
        step++;
    }
    for (int power = first; power <= log10(axis->greatest) + 1e-9; power += stride) {
        for (int d = 0; d < 10 && steps[step].digits[d] > 0 && count < TICK_LIMIT; d++) {
            double tick = steps[step].digits[d] * pow(10, power);
            if (tick >= axis->least * (1 - 1e-9) && tick <= axis->greatest * (1 + 1e-9)) {
                ticks[count++] = tick;
            }
        }
    }
    return count;
}

static size_t find_ticks(const struct axis *axis, int wanted, double ticks[TICK_LIMIT])
{
    size_t count = axis->logarithmic ? find_decade_ticks(axis, wanted, ticks) : 0;
    return count >= 2 ? count : find_even_ticks(axis, wanted, ticks);
}

static void write_number(FILE *page, double value, bool logarithmic)
{
    if (value == 0 || (fabs(value) < 1e-12 && !logarithmic)) {
        (void)putc('0', page);
    } else if (logarithmic && (value < 0.999e-2 || value > 1.001e3)) {
        double exponent = floor(log10(value) + 1e-9);
        double digit = round(10 * value / pow(10, exponent)) / 10;
        if (digit != 1) {
            (void)fprintf(page, "%g·", digit);
        }
        (void)fprintf(page, "10<tspan dy=\"-4\" font-size=\"8\">%s%.0f</tspan>",
                      exponent < 0 ? "−" : "", fabs(exponent));
    } else {
        (void)fprintf(page, "%s%.6g", value < 0 ? "−" : "", fabs(value));
    }
}

static void write_frame(FILE *page, const struct plot *plot, const struct axis *x,
                        const struct axis *y)
{
    double ticks[TICK_LIMIT];
    size_t count = find_ticks(y, 6, ticks);
    for (size_t i = 0; i < count; i++) {
        double at = place(y, ticks[i]);
        (void)fprintf(page,
                      "<path d=\"M%d %.1fH%d\" stroke=\"#e6e3dd\"/>"
                      "<text x=\"%d\" y=\"%.1f\" text-anchor=\"end\">",
                      LEFT, at, plot->width - RIGHT, LEFT - 6, at + 4);
        write_number(page, ticks[i], plot->y_log);
        (void)fputs("</text>", page);
    }
    count = find_ticks(x, 6, ticks);
    for (size_t i = 0; i < count; i++) {
        double at = place(x, ticks[i]);
        (void)fprintf(page,
                      "<path d=\"M%.1f %dv4\" stroke=\"#8a929c\"/>"
                      "<text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">",
                      at, plot->height - BOTTOM, at, plot->height - BOTTOM + 16);
        write_number(page, ticks[i], plot->x_log);
        (void)fputs("</text>", page);
    }
    (void)fprintf(page, "<path d=\"M%d %dH%d\" stroke=\"#8a929c\"/>", LEFT, plot->height - BOTTOM,
                  plot->width - RIGHT);
    (void)fprintf(page, "<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">",
                  (LEFT + plot->width - RIGHT) / 2, plot->height - 6);
    page_text(page, plot->x_label);
    (void)fprintf(page,
                  "</text><text transform=\"translate(11 %d) rotate(-90)\" text-anchor=\"middle\">",
                  (TOP + plot->height - BOTTOM) / 2);
    page_text(page, plot->y_label);
    (void)fputs("</text>", page);
}

static void begin(FILE *page, const struct plot *plot)
{
    (void)fprintf(page, "<svg viewBox=\"0 0 %d %d\" role=\"img\" aria-label=\"", plot->width,
                  plot->height);
    page_text(page, plot->title);
    (void)fprintf(page, "\"><text class=\"name\" x=\"%d\" y=\"15\">", LEFT);
    page_text(page, plot->title);
    (void)fputs("</text>", page);
}

static double radius_of(const struct plot_series *series)
{
    return series->radius > 0 ? series->radius : 2;
}

static bool is_visible(const struct plot_series *series, size_t i, const struct axis *x,
                       const struct axis *y)
{
    return shown(x, series->x[i]) && shown(y, series->y[i]) && series->y[i] >= y->least;
}

/* Where each label of a series has room, with a line to its dot where that is not beside it. */
static void write_labels(FILE *page, const struct plot_series *series, const struct axis *x,
                         const struct axis *y, struct plot_labels *labels)
{
    for (size_t i = 0; series->labels && i < series->count; i++) {
        struct plot_label label;
        if (!is_visible(series, i, x, y)) {
            continue;
        }
        double across = place(x, series->x[i]), down = place(y, series->y[i]);
        if (!plot_labels_place(labels, across, down, radius_of(series), strlen(series->labels[i]),
                               &label)) {
            continue;
        }
        if (label.far) {
            (void)fprintf(page, "<path d=\"M%.1f %.1fL%.1f %.1f\" stroke=\"#8a929c\"/>", across,
                          down, label.x + (label.x < across ? label.width : 0), label.y - 4);
        }
        (void)fprintf(page, "<text class=\"label\" x=\"%.1f\" y=\"%.1f\">", label.x, label.y);
        page_text(page, series->labels[i]);
        (void)fputs("</text>", page);
    }
}

/* Labels keep away from all dots that have one. */
static void write_all_labels(FILE *page, const struct plot *plot, const struct axis *x,
                             const struct axis *y)
{
    struct plot_labels labels = {
        .left = LEFT, .right = plot->width, .top = TOP - 8, .bottom = plot->height - BOTTOM};
    for (size_t s = 0; s < plot->series_count; s++) {
        const struct plot_series *series = &plot->series[s];
        for (size_t i = 0; series->labels && i < series->count; i++) {
            if (is_visible(series, i, x, y)) {
                plot_labels_avoid(&labels, place(x, series->x[i]), place(y, series->y[i]),
                                  radius_of(series));
            }
        }
    }
    for (size_t s = 0; s < plot->series_count; s++) {
        write_labels(page, &plot->series[s], x, y, &labels);
    }
}

static void write_series(FILE *page, const struct plot_series *series, const struct axis *x,
                         const struct axis *y)
{
    bool drawing = false;
    if (!series->dots) {
        (void)fprintf(page,
                      "<path fill=\"none\" stroke=\"%s\" stroke-width=\"1.6\" "
                      "stroke-linejoin=\"round\" d=\"",
                      series->colour);
    }
    for (size_t i = 0; i < series->count; i++) {
        bool visible = is_visible(series, i, x, y);
        if (visible && series->dots) {
            (void)fprintf(page, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%g\" fill=\"%s\"/>",
                          place(x, series->x[i]), place(y, series->y[i]), radius_of(series),
                          series->colour);
        } else if (visible) {
            (void)fprintf(page, "%c%.1f %.1f", drawing ? 'L' : 'M', place(x, series->x[i]),
                          place(y, series->y[i]));
        }
        drawing = visible;
    }
    if (!series->dots) {
        (void)fputs("\"/>", page);
    }
}

void plot_write(FILE *page, const struct plot *plot)
{
    struct axis x = {.logarithmic = plot->x_log,
                     .least = DBL_MAX,
                     .greatest = -DBL_MAX,
                     .from = LEFT,
                     .to = plot->width - RIGHT};
    struct axis y = {.logarithmic = plot->y_log,
                     .least = DBL_MAX,
                     .greatest = -DBL_MAX,
                     .from = plot->height - BOTTOM,
                     .to = TOP};
    for (size_t s = 0; s < plot->series_count; s++) {
        const struct plot_series *series = &plot->series[s];
        for (size_t i = 0; i < series->count; i++) {
            if (shown(&x, series->x[i]) && shown(&y, series->y[i])) {
                widen(&x, series->x[i]);
                widen(&y, series->y[i]);
            }
        }
    }
    begin(page, plot);
    if (x.least > x.greatest) {
        (void)fprintf(page, "<text x=\"%d\" y=\"%d\">no data</text></svg>\n", LEFT,
                      plot->height / 2);
        return;
    }
    y.least = plot->y_from_zero ? fmin(y.least, 0) : y.least;
    y.least = plot->y_floor > 0 ? fmin(fmax(y.least, plot->y_floor), y.greatest) : y.least;
    settle(&x, plot->margin);
    settle(&y, plot->margin);
    write_frame(page, plot, &x, &y);
    for (size_t s = 0; s < plot->series_count; s++) {
        write_series(page, &plot->series[s], &x, &y);
    }
    write_all_labels(page, plot, &x, &y);
    (void)fputs("</svg>\n", page);
}

void plot_histogram(FILE *page, const struct plot *plot, const double *counts, size_t count,
                    double x_maximum, const char *colour)
{
    struct axis x = {.greatest = x_maximum, .from = LEFT, .to = plot->width - RIGHT};
    struct axis y = {.from = plot->height - BOTTOM, .to = TOP};
    for (size_t i = 0; i < count; i++) {
        widen(&y, counts[i]);
    }
    settle(&x, 0);
    settle(&y, 0);
    begin(page, plot);
    write_frame(page, plot, &x, &y);
    for (size_t i = 0; i < count; i++) {
        double left = place(&x, x_maximum * (double)i / (double)count);
        double right = place(&x, x_maximum * (double)(i + 1) / (double)count);
        double top = place(&y, counts[i]);
        if (counts[i] > 0) {
            (void)fprintf(
                page, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"%s\"/>",
                left + 0.5, top, fmax(right - left - 1, 0.5), plot->height - BOTTOM - top, colour);
        }
    }
    (void)fputs("</svg>\n", page);
}
