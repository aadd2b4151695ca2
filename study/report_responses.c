/* The report's responses: measured beside factored, as pictures and as cuts through the centre. */
#include "factor/window.h"
#include "nacre/evaluate.h"
#include "study/palette.h"
#include "study/plot.h"
#include "study/report_parts.h"

#include <math.h>
#include <stdlib.h>

/* Decades of the pictures' logarithmic scale. */
enum { DECADES = 5 };

/* Of the cuts' lines and dots, where there are three channels. */
static const char channel_colours[][8] = {"#c43c4e", "#2a8a57", "#2c6cb0"};

/* One point's two responses. */
struct pair {
    float *measured, *factored; /* [channels][K][K] */
};

/* The mean over the channels of entry i; NaN where none is measured. */
static double entry_mean(const struct nacre_material *m, const float *response, size_t i)
{
    size_t size = (size_t)m->window * (size_t)m->window;
    double sum = 0;
    int count = 0;
    for (int c = 0; c < m->channels; c++) {
        float value = response[(size_t)c * size + i];
        if (!isnan(value)) {
            sum += (double)value;
            count++;
        }
    }
    return count ? sum / count : NAN;
}

static bool inside(const struct nacre_material *m, const struct report_point *point, size_t i)
{
    int window = m->window;
    int x = point->x + (int)i % window - window / 2;
    int y = point->y + (int)i / window - window / 2;
    return x >= 0 && y >= 0 && x < m->width && y < m->height;
}

/* One response on a logarithmic scale below `top`; entries outside the sample stay white. */
static int write_picture(const struct report *report, const struct report_point *point,
                         const float *response, double top, struct nacre_error *error)
{
    const struct nacre_material *m = &report->material;
    static const struct colour white = {1, 1, 1};
    struct picture picture = {0};
    size_t size = (size_t)m->window * (size_t)m->window;
    int status = picture_allocate(&picture, m->window, m->window, error);
    for (size_t i = 0; status == NACRE_OK && i < size; i++) {
        double value = entry_mean(m, response, i);
        double place = value > 0 ? 1 + log10(value / top) / DECADES : 0;
        palette_linear(!inside(m, point, i) ? white : palette_heat(isnan(value) ? value : place),
                       picture.rgb + 3 * i);
    }
    (void)fputs("<img class=\"pixels\" alt=\"response on a logarithmic scale\" src=\"",
                report->page);
    if (status == NACRE_OK) {
        status = page_picture(report->page, &picture, error);
    }
    (void)fputs("\">", report->page);
    picture_finish(&picture);
    return status;
}

/* The row through the centre, each channel: dots measured, lines factored. */
static int write_cut(const struct report *report, const struct report_point *point,
                     const struct pair *pair, struct nacre_error *error)
{
    const struct nacre_material *m = &report->material;
    size_t window = (size_t)m->window;
    struct plot_series series[6];
    size_t count = 0;
    double top = 0;
    double *values = calloc(7 * window, sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "a plot");
    }
    int radius = m->window / 2;
    for (int u = 0; u < m->window; u++) {
        values[u] = (u - radius) * m->pitch_mm;
    }
    for (size_t c = 0; c < (size_t)m->channels; c++) {
        for (int factored = 1; factored >= 0; factored--) {
            const float *response = factored ? pair->factored : pair->measured;
            double *y = values + (1 + count) * window;
            for (size_t u = 0; u < window; u++) {
                size_t i = window * (window / 2) + u;
                float value = response[c * window * window + i];
                y[u] = inside(m, point, i) ? (double)value : NAN;
                top = y[u] > top ? y[u] : top;
            }
            series[count] =
                (struct plot_series){.x = values, .y = y, .count = window, .dots = !factored};
            (void)snprintf(series[count].colour, sizeof series[count].colour, "%s",
                           m->channels == 1 ? "#1a5e8c" : channel_colours[c]);
            count++;
        }
    }
    struct plot plot = {.title = "Cut along x: dots measured, lines factored",
                        .x_label = "distance from the lit point, mm",
                        .y_label = "R_d",
                        .y_log = true,
                        .y_floor = top * pow(10, -DECADES - 1),
                        .width = 380,
                        .height = 240,
                        .series = series,
                        .series_count = count};
    plot_write(report->page, &plot);
    free(values);
    return NACRE_OK;
}

static void write_percent(FILE *page, double value)
{
    if (isnan(value)) {
        (void)fputs("none", page);
    } else {
        (void)fprintf(page, "%.2f %%", 100 * value);
    }
}

static int write_point(const struct report *report, size_t index, const struct pair *pair,
                       struct nacre_error *error)
{
    FILE *page = report->page;
    const struct nacre_material *m = &report->material;
    const struct report_point *point = &report->points[index];
    size_t size = (size_t)m->window * (size_t)m->window;
    size_t at = (size_t)point->y * (size_t)m->width + (size_t)point->x;
    double top = 0;
    int status = nacre_scan_read(report->scan, point->x, point->y, pair->measured, error);
    if (status != NACRE_OK) {
        return status;
    }
    const struct window_cut cut = {.width = m->width,
                                   .height = m->height,
                                   .channels = m->channels,
                                   .from = nacre_scan_info(report->scan)->window,
                                   .to = m->window};
    (void)window_cut(&cut, point->x, point->y, pair->measured, pair->measured);
    nacre_material_response(m, point->x, point->y, pair->factored);
    for (size_t i = 0; i < size; i++) {
        top = fmax(top, fmax(entry_mean(m, pair->measured, i), entry_mean(m, pair->factored, i)));
    }
    (void)fprintf(page, "<div class=\"point\">\n<h3><b>%c</b>(%d, %d) <span>%s: ",
                  (char)('A' + (int)index), point->x, point->y, point->why);
    write_percent(page, (double)report->errors.map[at]);
    (void)fputs("; without the centre ", page);
    write_percent(page, (double)report->errors.map_without_centre[at]);
    (void)fputs("</span></h3>\n<div>", page);
    status = write_picture(report, point, pair->measured, top, error);
    (void)fputs("<p class=\"muted\">measured</p></div>\n<div>", page);
    if (status == NACRE_OK) {
        status = write_picture(report, point, pair->factored, top, error);
    }
    (void)fputs("<p class=\"muted\">factored</p></div>\n<div>", page);
    if (status == NACRE_OK) {
        status = write_cut(report, point, pair, error);
    }
    (void)fputs("</div>\n</div>\n", page);
    return status;
}

static void write_scale(FILE *page)
{
    enum { STEPS = 60, WIDTH = 320 };
    (void)fprintf(page,
                  "<svg viewBox=\"0 0 %d 34\" role=\"img\" aria-label=\"logarithmic colour scale\" "
                  "style=\"max-width:26rem;margin:1rem 0 0\">",
                  WIDTH);
    for (int i = 0; i < STEPS; i++) {
        char colour[8];
        palette_format(palette_heat((i + 0.5) / STEPS), colour);
        (void)fprintf(page,
                      "<rect x=\"%.2f\" width=\"%.2f\" height=\"12\" fill=\"%s\" "
                      "shape-rendering=\"crispEdges\"/>",
                      i * WIDTH / (double)STEPS, WIDTH / (double)STEPS + 0.4, colour);
    }
    for (int i = 0; i <= DECADES; i++) {
        const char *anchor = i == 0 ? "start" : i == DECADES ? "end" : "middle";
        (void)fprintf(page, "<text x=\"%d\" y=\"29\" text-anchor=\"%s\">", i * WIDTH / DECADES,
                      anchor);
        if (i == DECADES) {
            (void)fputs("max</text>", page);
        } else {
            (void)fprintf(page, "10<tspan dy=\"-4\" font-size=\"8\">−%d</tspan></text>",
                          DECADES - i);
        }
    }
    (void)fputs(
        "</svg>\n<figcaption>Share of the greatest entry of the pair. White lies beyond the "
        "sample, grey was not measured.</figcaption>\n",
        page);
}

/* Which colour of the cuts is which channel. */
static void write_legend(FILE *page, const struct nacre_material *m)
{
    static const char *const names[] = {"red", "green", "blue"};
    (void)fputs("<div class=\"legend\">", page);
    for (int c = 0; c < m->channels && m->channels == 3; c++) {
        (void)fprintf(page, "<span><i style=\"background:%s\"></i>%s</span>", channel_colours[c],
                      names[c]);
    }
    (void)fputs("</div>\n", page);
}

int report_write_responses(struct report *report, struct nacre_error *error)
{
    FILE *page = report->page;
    size_t size = nacre_scan_response_size(nacre_scan_info(report->scan));
    struct pair pair = {.measured = calloc(size, sizeof(float)),
                        .factored = calloc(size, sizeof(float))};
    int status = NACRE_OK;
    (void)fputs("<h2>Responses, measured and factored</h2>\n<p>What leaves around one lit surface "
                "point, on a logarithmic scale that a pair shares; the mean of the channels. The "
                "points stand at fixed places in the order of their errors; none is picked for its "
                "looks.</p>\n<figure class=\"long\">\n",
                page);
    for (size_t i = 0; i < report->point_count && status == NACRE_OK; i++) {
        if (!pair.measured || !pair.factored) {
            status = nacre_fail_memory(error, "responses");
            break;
        }
        status = write_point(report, i, &pair, error);
    }
    if (report->point_count > 0) {
        write_scale(page);
        write_legend(page, &report->material);
    } else {
        (void)fputs("<p>Fewer than six surface points have been measured.</p>\n", page);
    }
    (void)fputs("</figure>\n", page);
    free(pair.measured);
    free(pair.factored);
    return status;
}
