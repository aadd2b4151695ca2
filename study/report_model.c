/* The report's view of the model: how the fit converged, its kernels and where each cluster lies. */
#include "study/palette.h"
#include "study/plot.h"
#include "study/report_parts.h"

#include <math.h>
#include <stdlib.h>

/* One curve of the history. */
static void write_history(FILE *page, const char *title, const char *x_label, const char *y_label,
                          const double *x, const double *y, size_t count)
{
    struct plot_series series = {
        .x = x, .y = y, .count = count, .colour = "#1a5e8c", .dots = count == 1};
    struct plot plot = {.title = title,
                        .x_label = x_label,
                        .y_label = y_label,
                        .y_log = true,
                        .width = 420,
                        .height = 260,
                        .series = &series,
                        .series_count = 1};
    (void)fputs("<figure>\n", page);
    plot_write(page, &plot);
    (void)fputs("</figure>\n", page);
}

/* The iteration of a value of the history: of a thinned one the last is known. */
static double iteration_of(const struct nacre_material *m, size_t i)
{
    double back = (double)(m->history_count - 1 - i) * (double)m->history_every;
    return m->history_every > 1 ? (double)m->iterations - back : (double)i + 1;
}

/* The error of a few points, when it was looked at: values[3][history_count] are overwritten. */
static void write_error_history(FILE *page, const struct nacre_material *m, double *values)
{
    double *iterations = values, *seconds = values + m->history_count;
    double *errors = values + 2 * m->history_count;
    size_t count = 0;
    for (size_t i = 0; m->history_error && i < m->history_count; i++) {
        if (!isnan(m->history_error[i])) {
            iterations[count] = iteration_of(m, i);
            seconds[count] = (double)m->history_seconds[i];
            errors[count++] = 100 * (double)m->history_error[i];
        }
    }
    if (count > 0) {
        write_history(page, "Error over iterations", "iterations", "mean error, %", iterations,
                      errors, count);
        write_history(page, "Error over time", "seconds", "mean error, %", seconds, errors, count);
    }
}

int report_write_convergence(struct report *report, struct nacre_error *error)
{
    const struct nacre_material *m = &report->material;
    FILE *page = report->page;
    size_t count = m->history_count;
    (void)fputs("<h2>Convergence</h2>\n", page);
    if (count == 0) {
        (void)fputs("<p>The material carries no history of its factorization.</p>\n", page);
        return NACRE_OK;
    }
    double *values = calloc(3 * count, sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "the history");
    }
    double *iterations = values, *seconds = values + count, *objective = values + 2 * count;
    for (size_t i = 0; i < count; i++) {
        iterations[i] = iteration_of(m, i);
        seconds[i] = (double)m->history_seconds[i];
        objective[i] = (double)m->history_objective[i];
    }
    (void)fputs("<p>The objective, the weighted error that the updates bring down, after each "
                "iteration, and the mean relative error of up to 256 points where it was looked at."
                "</p>\n<div class=\"two\">\n",
                page);
    write_history(page, "Objective over iterations", "iterations", "objective", iterations,
                  objective, count);
    write_history(page, "Objective over time", "seconds", "objective", seconds, objective, count);
    write_error_history(page, m, values); /* which are drawn already */
    (void)fputs("</div>\n", page);
    free(values);
    return NACRE_OK;
}

/* The kernels shown: one a cluster (of pairs, both ends in the cluster) or one a term. */
static int shown_count(const struct nacre_material *m)
{
    return m->layout == NACRE_KERNEL_PER_TERM ? m->terms : m->clusters;
}

static int shown_kernel(const struct nacre_material *m, int index)
{
    return m->layout == NACRE_KERNEL_PAIR ? index * m->clusters + index : index;
}

/* The mean of kernel j over each ring of one pitch's width, relative to its greatest ring. */
static void find_falloff(const struct nacre_material *m, int j, int channel, double *falloff)
{
    int radius = m->window / 2;
    size_t size = (size_t)m->window * (size_t)m->window;
    const float *kernel = m->kernels + ((size_t)j * (size_t)m->channels + (size_t)channel) * size;
    double greatest = 0;
    for (int ring = 0; ring <= radius; ring++) {
        double sum = 0;
        int count = 0;
        for (size_t i = 0; i < size; i++) {
            int dx = (int)i % m->window - radius;
            int dy = (int)i / m->window - radius;
            if (lround(hypot(dx, dy)) == ring) {
                sum += (double)kernel[i];
                count++;
            }
        }
        falloff[ring] = sum / count; /* every ring up to the radius holds (ring, 0) at least */
        greatest = fmax(greatest, falloff[ring]);
    }
    for (int ring = 0; ring <= radius && greatest > 0; ring++) {
        falloff[ring] /= greatest;
    }
}

static int write_falloffs(const struct report *report, int channel, struct nacre_error *error)
{
    const struct nacre_material *m = &report->material;
    static const char *const titles[] = {"Red", "Green", "Blue"};
    size_t count = (size_t)shown_count(m);
    size_t rings = (size_t)m->window / 2 + 1;
    double *values = calloc((count + 1) * rings, sizeof *values);
    struct plot_series *series = calloc(count, sizeof *series);
    if (!values || !series) {
        free(values);
        free(series);
        return nacre_fail_memory(error, "the kernels' plots");
    }
    for (size_t ring = 0; ring < rings; ring++) {
        values[ring] = (double)ring * m->pitch_mm;
    }
    for (size_t j = 0; j < count; j++) {
        double *falloff = values + (j + 1) * rings;
        find_falloff(m, shown_kernel(m, (int)j), channel, falloff);
        series[j] = (struct plot_series){.x = values, .y = falloff, .count = rings};
        palette_format(palette_group(j, count), series[j].colour);
    }
    struct plot plot = {.title = m->channels == 1 ? "Fall-off" : titles[channel],
                        .x_label = "distance, mm",
                        .y_label = "g relative to its maximum",
                        .y_log = true,
                        .y_floor = 1e-7,
                        .width = m->mixed > 0 ? 380 : 300,
                        .height = m->mixed > 0 ? 400 : 240,
                        .series = series,
                        .series_count = count};
    (void)fputs("<figure>\n", report->page);
    plot_write(report->page, &plot);
    (void)fputs("</figure>\n", report->page);
    free(values);
    free(series);
    return NACRE_OK;
}

/* Each surface point in the colours of its clusters, mixed by their weights. */
static int cluster_picture(const struct nacre_material *m, struct picture *picture,
                           struct nacre_error *error)
{
    size_t size = (size_t)m->width * (size_t)m->height;
    int status = picture_allocate(picture, m->width, m->height, error);
    for (size_t i = 0; status == NACRE_OK && i < size; i++) {
        for (int k = 0; k < m->mixed; k++) {
            float rgb[3];
            size_t at = (size_t)k * size + i;
            palette_linear(palette_group(m->ids[at], (size_t)m->clusters), rgb);
            for (int c = 0; c < 3; c++) {
                picture->rgb[3 * i + (size_t)c] += m->weights[at] * rgb[c];
            }
        }
    }
    return status;
}

/* How many points have each cluster as their heaviest. */
static void write_legend(const struct report *report, struct nacre_error *error, int *status)
{
    enum { LIMIT = 16 };
    const struct nacre_material *m = &report->material;
    size_t size = (size_t)m->width * (size_t)m->height;
    size_t *counts = calloc((size_t)m->clusters, sizeof *counts);
    if (!counts) {
        *status = nacre_fail_memory(error, "the clusters' legend");
        return;
    }
    for (size_t i = 0; i < size; i++) {
        size_t heaviest = i;
        for (int k = 1; k < m->mixed; k++) {
            size_t at = (size_t)k * size + i;
            heaviest = m->weights[at] > m->weights[heaviest] ? at : heaviest;
        }
        counts[m->ids[heaviest]]++;
    }
    (void)fputs("<div class=\"legend\">", report->page);
    for (int j = 0; j < m->clusters && j < LIMIT; j++) {
        char colour[8];
        palette_format(palette_group((size_t)j, (size_t)m->clusters), colour);
        (void)fprintf(report->page, "<span><i style=\"background:%s\"></i>%d: %.3g %%</span>",
                      colour, j, 100.0 * (double)counts[j] / (double)size);
    }
    if (m->clusters > LIMIT) {
        (void)fprintf(report->page, "<span>and %d more</span>", m->clusters - LIMIT);
    }
    (void)fputs("</div>\n", report->page);
    free(counts);
}

static int write_cluster_map(const struct report *report, struct nacre_error *error)
{
    struct picture picture = {0};
    int status = cluster_picture(&report->material, &picture, error);
    (void)fputs("<figure>\n<img class=\"pixels\" alt=\"map of the clusters\" src=\"", report->page);
    if (status == NACRE_OK) {
        status = page_picture(report->page, &picture, error);
    }
    (void)fputs("\">\n", report->page);
    if (status == NACRE_OK) {
        write_legend(report, error, &status);
    }
    (void)fputs("<figcaption>Cluster of each surface point, and their shares of the sample."
                "</figcaption>\n</figure>\n",
                report->page);
    picture_finish(&picture);
    return status;
}

int report_write_kernels(struct report *report, struct nacre_error *error)
{
    const struct nacre_material *m = &report->material;
    FILE *page = report->page;
    bool clustered = m->mixed > 0;
    int status = NACRE_OK;
    (void)fprintf(
        page,
        "<h2>Kernels</h2>\n<p>The homogeneous part of the model: how light falls off with "
        "the distance from where it enters, the mean over all directions, one line a %s."
        "%s</p>\n<div class=\"%s\">\n",
        clustered ? "cluster" : "term, in the colour of its number below",
        m->layout == NACRE_KERNEL_PAIR ? " Of the pairs, those with both ends in one "
                                         "cluster."
                                       : "",
        m->channels == 1 ? "two"
        : clustered      ? "two"
                         : "three");
    if (clustered) {
        status = write_cluster_map(report, error);
    }
    for (int c = 0; c < m->channels && status == NACRE_OK; c++) {
        status = write_falloffs(report, c, error);
    }
    (void)fputs("</div>\n", page);
    return status;
}
