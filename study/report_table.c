/* The report's numbers: the row of the paper's Table 1, how the material was made, and further pictures. */
#include "study/report_parts.h"

#include "factor/words.h"

#include <sys/stat.h>

double report_file_bytes(const struct report *report)
{
    struct stat status;
    return stat(report->request->material, &status) == 0 ? (double)status.st_size : 0;
}

/* A size as people write it, with three digits. */
static void write_size(FILE *page, double bytes)
{
    if (bytes < 1024 * 1024) {
        (void)fprintf(page, "%.3g KiB", bytes / 1024);
    } else if (bytes < 1024.0 * 1024 * 1024) {
        (void)fprintf(page, "%.*f MiB", bytes < 100 * 1024.0 * 1024 ? 2 : 0, bytes / (1024 * 1024));
    } else {
        (void)fprintf(page, "%.2f GiB", bytes / (1024.0 * 1024 * 1024));
    }
}

static void write_range(FILE *page, const struct error_range *range)
{
    if (range->points == 0) {
        (void)fputs("none", page);
    } else {
        (void)fprintf(page, "%.3f / %.3f / %.3f", range->minimum, range->mean, range->maximum);
    }
}

static void write_energy(FILE *page, const struct error_range *range)
{
    if (range->points == 0) {
        (void)fputs("none", page);
    } else {
        (void)fprintf(page, "%.3g", range->energy_mean);
    }
}

static void write_row(const struct report *report)
{
    FILE *page = report->page;
    const struct nacre_material *m = &report->material;
    double before = error_measured_bytes(m);
    double after = (double)nacre_material_size(m);
    (void)fputs("<div class=\"scroll\"><table>\n<tr><th>Sample material</th><th>Physical size, "
                "cm²</th><th>Resolution, points</th><th>Kernel size, points</th><th>Terms</th>"
                "<th>Clusters</th><th>Original data</th><th>Factored data</th><th>Ratio</th>"
                "<th>Relative error min / avg / max</th></tr>\n<tr><td>",
                page);
    page_text(page, report_base_name(report->request->material));
    (void)fprintf(page, "</td><td>%.3g × %.3g</td><td>%d × %d</td><td>%d × %d</td><td>%d</td><td>",
                  m->width * m->pitch_mm / 10, m->height * m->pitch_mm / 10, m->width, m->height,
                  m->window, m->window, m->terms);
    if (m->layout == NACRE_KERNEL_PER_TERM) {
        (void)fputs("none", page);
    } else {
        (void)fprintf(page, "%d", m->clusters);
    }
    (void)fputs("</td><td>", page);
    write_size(page, before);
    (void)fputs("</td><td>", page);
    write_size(page, after);
    (void)fprintf(page, "</td><td>%s</td><td>", ratio_words(before, after).text);
    write_range(page, &report->errors.whole);
    (void)fputs("</td></tr>\n</table></div>\n", page);
}

static void write_fact(FILE *page, const char *name)
{
    (void)fprintf(page, "<tr><th>%s</th><td>", name);
}

static void write_facts(const struct report *report)
{
    static const char *const layouts[] = {"one per cluster", "one per pair of clusters",
                                          "one per term"};
    FILE *page = report->page;
    const struct nacre_material *m = &report->material;
    const struct error_report *errors = &report->errors;
    (void)fputs("<div class=\"scroll\" style=\"margin-top:1rem\"><table>\n", page);
    write_fact(page, "Relative error without the entries x_i = x_o, min / avg / max");
    write_range(page, &errors->without_centre);
    (void)fputs("</td></tr>\n", page);
    write_fact(page, "Energy ratio (the error's square), mean");
    write_energy(page, &errors->whole);
    (void)fputs("; without the centre ", page);
    write_energy(page, &errors->without_centre);
    (void)fputs("</td></tr>\n", page);
    write_fact(page, "Surface points compared");
    (void)fprintf(page, "%zu of %zu; %zu not measured, %zu measured as exactly 0</td></tr>\n",
                  errors->whole.points, errors->points, errors->not_measured, errors->dark);
    write_fact(page, "Method");
    page_text(page, m->method[0] ? m->method : "not told");
    (void)fprintf(page, ", %d iterations, seed %d, ε = %.3g of each kernel's maximum</td></tr>\n",
                  m->iterations, m->seed, m->epsilon);
    write_fact(page, "Kernels");
    (void)fprintf(page, "%s</td></tr>\n", layouts[m->layout]);
    write_fact(page, "Stored as");
    (void)fprintf(page, "%s%s", m->pixel == NACRE_HALF ? "HALF" : "FLOAT",
                  m->h ? "" : ", one factor for both ends");
    if (m->bits > 0) {
        (void)fprintf(page, ", planes of %d bits", m->bits);
    }
    (void)fputs("; the file itself has ", page);
    write_size(page, report_file_bytes(report));
    (void)fprintf(page, "</td></tr>\n");
    write_fact(page, "Distance between surface points");
    (void)fprintf(page, "%.4g mm</td></tr>\n</table></div>\n", m->pitch_mm);
}

int report_write_table(struct report *report, struct nacre_error *error)
{
    (void)error;
    (void)fputs("<h2>In numbers</h2>\n<p>The row of Table 1 in Peers, vom Berge, Matusik, "
                "Ramamoorthi, Lawrence, Rusinkiewicz and Dutré, <cite>A compact factored "
                "representation of heterogeneous subsurface scattering</cite>, 2006. Original data "
                "count 4 bytes a number, factored data every number at its stored width.</p>\n",
                report->page);
    write_row(report);
    write_facts(report);
    return NACRE_OK;
}

int report_write_pictures(struct report *report, struct nacre_error *error)
{
    FILE *page = report->page;
    const struct report_request *request = report->request;
    int status = NACRE_OK;
    if (request->picture_count == 0) {
        return NACRE_OK;
    }
    (void)fputs("<h2>Pictures</h2>\n<div class=\"two\">\n", page);
    for (size_t i = 0; i < request->picture_count && status == NACRE_OK; i++) {
        struct picture picture = {0};
        const char *name = report_base_name(request->pictures[i]);
        status = picture_read(request->pictures[i], &picture, error);
        (void)fputs("<figure>\n<img alt=\"", page);
        page_text(page, name);
        (void)fputs("\" src=\"", page);
        if (status == NACRE_OK) {
            status = page_picture(page, &picture, error);
        }
        (void)fputs("\">\n<figcaption>", page);
        page_text(page, name);
        (void)fputs("</figcaption>\n</figure>\n", page);
        picture_finish(&picture);
    }
    (void)fputs("</div>\n", page);
    return status;
}
