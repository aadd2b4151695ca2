/* The report's maps: albedo with the places of the shown responses, and the relative error. */
#include "study/palette.h"
#include "study/plot.h"
#include "study/report_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Begin a map of the sample's size in its own coordinates: one unit a surface point. */
static int begin_map(const struct report *report, const struct picture *picture, const char *what,
                     struct nacre_error *error)
{
    FILE *page = report->page;
    (void)fprintf(page,
                  "<svg viewBox=\"0 0 %d %d\" style=\"overflow:visible\" role=\"img\" "
                  "aria-label=\"%s\"><image class=\"pixels\" width=\"%d\" height=\"%d\" "
                  "preserveAspectRatio=\"none\" href=\"",
                  picture->width, picture->height, what, picture->width, picture->height);
    int status = page_picture(page, picture, error);
    (void)fputs("\"/>", page);
    return status;
}

static int albedo_picture(const struct nacre_material *m, struct picture *picture,
                          struct nacre_error *error)
{
    size_t size = (size_t)m->width * (size_t)m->height;
    int status = picture_allocate(picture, m->width, m->height, error);
    for (size_t i = 0; status == NACRE_OK && i < size; i++) {
        for (size_t c = 0; c < 3; c++) {
            picture->rgb[3 * i + c] = m->albedo[(m->channels == 1 ? 0 : c) * size + i];
        }
    }
    return status;
}

/* A ring and a letter at each point, and around the median a dashed square of the window's size. */
static void write_marks(const struct report *report)
{
    FILE *page = report->page;
    const struct nacre_material *m = &report->material;
    double unit = fmax(m->width, m->height) / 100.0;
    for (size_t i = 0; i < report->point_count; i++) {
        double x = report->points[i].x + 0.5;
        double y = report->points[i].y + 0.5;
        /* the letter stands to the right, or to the left where there is no room */
        double side = x < m->width - 8 * unit ? 1 : -1;
        (void)fprintf(page,
                      "<circle cx=\"%.2f\" cy=\"%.2f\" r=\"%.2f\" fill=\"none\" stroke=\"#fff\" "
                      "stroke-width=\"%.2f\"/>"
                      "<circle cx=\"%.2f\" cy=\"%.2f\" r=\"%.2f\" fill=\"none\" stroke=\"#111\" "
                      "stroke-width=\"%.2f\"/>"
                      "<text x=\"%.2f\" y=\"%.2f\" text-anchor=\"middle\" "
                      "style=\"font-size:%.2fpx;font-weight:700;fill:#111;stroke:#fff;"
                      "stroke-width:%.2f;paint-order:stroke\">%c</text>",
                      x, y, 1.5 * unit, 1.3 * unit, x, y, 1.5 * unit, 0.6 * unit,
                      x + side * 4 * unit,
                      fmin(fmax(y + 1.8 * unit, 5 * unit), m->height - 0.8 * unit), 5.2 * unit,
                      1.1 * unit, (char)('A' + (int)i));
    }
    if (report->point_count > REPORT_MEDIAN) {
        const struct report_point *median = &report->points[REPORT_MEDIAN];
        double left = median->x - (m->window - 1) / 2.0;
        double top = median->y - (m->window - 1) / 2.0;
        /* a drawing of its own, which cuts off what is beyond the sample */
        (void)fprintf(page, "<svg width=\"%d\" height=\"%d\">", m->width, m->height);
        for (int pass = 0; pass < 2; pass++) {
            (void)fprintf(page,
                          "<rect x=\"%.2f\" y=\"%.2f\" width=\"%d\" height=\"%d\" fill=\"none\" "
                          "stroke=\"%s\" stroke-width=\"%.2f\"%s/>",
                          left, top, m->window, m->window, pass ? "#111" : "#fff",
                          (pass ? 0.5 : 0.9) * unit, pass ? " stroke-dasharray=\"2 1.6\"" : "");
        }
        (void)fputs("</svg>", page);
    }
}

static int write_albedo(const struct report *report, struct nacre_error *error)
{
    struct picture picture = {0};
    int status = albedo_picture(&report->material, &picture, error);
    (void)fputs("<figure>\n", report->page);
    if (status == NACRE_OK) {
        status = begin_map(report, &picture, "albedo of the sample", error);
    }
    write_marks(report);
    (void)fputs(
        "</svg>\n<figcaption>Albedo: the sum of each measured response, as sRGB. A to F are "
        "the responses shown below; the dashed square is the window of C.</figcaption>\n"
        "</figure>\n",
        report->page);
    picture_finish(&picture);
    return status;
}

static int compare_numbers(const void *a, const void *b)
{
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The error that all but one in a hundred points stay below: where the map's scale ends, so that a few outliers do not
 * leave it dark. */
static double scale_end(const struct error_report *errors, struct nacre_error *error, int *status)
{
    double *sorted = calloc(errors->points + 1, sizeof *sorted);
    size_t count = 0;
    double end = 0;
    if (!sorted) {
        *status = nacre_fail_memory(error, "the error map");
        return 0;
    }
    for (size_t i = 0; i < errors->points; i++) {
        if (!isnan(errors->map[i])) {
            sorted[count++] = (double)errors->map[i];
        }
    }
    if (count > 0) {
        qsort(sorted, count, sizeof *sorted, compare_numbers);
        end = sorted[(count - 1) * 99 / 100];
    }
    free(sorted);
    return end > 0 ? end : 1e-6;
}

static void write_colour_bar(FILE *page, double end, double maximum)
{
    enum { STEPS = 64, WIDTH = 320 };
    (void)fprintf(page,
                  "<svg viewBox=\"0 0 %d 34\" role=\"img\" aria-label=\"colour scale\" "
                  "style=\"margin-top:.5rem\">",
                  WIDTH);
    for (int i = 0; i < STEPS; i++) {
        char colour[8];
        palette_format(palette_heat((i + 0.5) / STEPS), colour);
        (void)fprintf(page,
                      "<rect x=\"%d\" width=\"%.1f\" height=\"12\" fill=\"%s\" "
                      "shape-rendering=\"crispEdges\"/>",
                      i * WIDTH / STEPS, WIDTH / (double)STEPS + 0.4, colour);
    }
    for (int i = 0; i <= 4; i++) {
        const char *anchor = i == 0 ? "start" : i == 4 ? "end" : "middle";
        (void)fprintf(page, "<text x=\"%d\" y=\"27\" text-anchor=\"%s\">%s%.2g %%</text>",
                      i * WIDTH / 4, anchor, i == 4 && maximum > end ? "≥ " : "", 25.0 * i * end);
    }
    (void)fputs("</svg>\n", page);
}

static int write_error_map(const struct report *report, double end, struct nacre_error *error)
{
    FILE *page = report->page;
    const struct error_report *errors = &report->errors;
    struct picture picture = {0};
    int status = picture_allocate(&picture, report->material.width, report->material.height, error);
    for (size_t i = 0; status == NACRE_OK && i < errors->points; i++) {
        palette_linear(palette_heat((double)errors->map[i] / end), picture.rgb + 3 * i);
    }
    (void)fputs("<figure>\n", page);
    if (status == NACRE_OK) {
        status = begin_map(report, &picture, "relative error of each surface point", error);
    }
    (void)fputs("</svg>\n", page);
    write_colour_bar(page, end, errors->whole.maximum);
    (void)fputs("<figcaption>Relative error of each surface point: ||measured − factored|| / "
                "||measured|| over its window, all channels.",
                page);
    if (errors->not_measured + errors->dark > 0) {
        (void)fprintf(page, " Grey: %zu not measured, %zu measured as exactly 0.",
                      errors->not_measured, errors->dark);
    }
    (void)fputs("</figcaption>\n</figure>\n", page);
    picture_finish(&picture);
    return status;
}

static void write_histogram(const struct report *report, double end)
{
    enum { BINS = 40 };
    double counts[BINS] = {0};
    size_t beyond = 0;
    const struct error_report *errors = &report->errors;
    for (size_t i = 0; i < errors->points; i++) {
        double place = (double)errors->map[i] / end * BINS;
        if (place < BINS) {
            counts[(int)place]++;
        } else if (!isnan(place)) {
            beyond++;
        }
    }
    struct plot plot = {.title = "How many points have which error",
                        .x_label = "relative error, %",
                        .y_label = "surface points",
                        .width = 420,
                        .height = 190};
    (void)fputs("<figure style=\"margin-top:1.1rem;max-width:34rem\">\n", report->page);
    plot_histogram(report->page, &plot, counts, BINS, 100 * end, "#1a5e8c");
    if (beyond > 0) {
        (void)fprintf(report->page,
                      "<figcaption>%zu points beyond the right end, up to %.3g %%.</figcaption>\n",
                      beyond, 100 * errors->whole.maximum);
    }
    (void)fputs("</figure>\n", report->page);
}

int report_write_maps(struct report *report, struct nacre_error *error)
{
    int status = NACRE_OK;
    double end = scale_end(&report->errors, error, &status);
    if (status != NACRE_OK) {
        return status;
    }
    (void)fputs("<h2>Sample and error</h2>\n<div class=\"three\">\n", report->page);
    status = report_write_photograph(report, error);
    if (status == NACRE_OK) {
        status = write_albedo(report, error);
    }
    if (status == NACRE_OK) {
        status = write_error_map(report, end, error);
    }
    (void)fputs("</div>\n", report->page);
    if (status == NACRE_OK && report->errors.whole.points > 0) {
        write_histogram(report, end);
    }
    return status;
}
