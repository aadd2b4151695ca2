/* The report: reading scan and material, then one section after the other. */
#include "study/report.h"

#include "nacre/whole_file.h"
#include "study/report_parts.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *report_base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static void write_key(FILE *page, const char *value, const char *meaning)
{
    (void)fprintf(page, "<div><b>%s</b><span>%s</span></div>\n", value, meaning);
}

/* Name, source and the figures that matter most. */
static void write_head(const struct report *report)
{
    FILE *page = report->page;
    const struct nacre_material *m = &report->material;
    const struct error_range *range = &report->errors.whole;
    double before = error_measured_bytes(m);
    double after = (double)nacre_material_size(m);
    const char *source = nacre_scan_info(report->scan)->source;
    char value[64];
    (void)fputs("<header>\n<h1>", page);
    page_text(page, report_base_name(report->request->material));
    (void)fputs("</h1>\n<p class=\"muted\">factored from <code>", page);
    page_text(page, report_base_name(report->request->scan));
    (void)fputs("</code>", page);
    if (source[0]) {
        (void)fputs(" — ", page);
        page_text(page, source);
    }
    (void)fputs("</p>\n<div class=\"key\">\n", page);
    if (range->points > 0) {
        (void)snprintf(value, sizeof value, "%.2f %%", 100 * range->mean);
        write_key(page, value, "mean relative error");
    }
    if (report->errors.without_centre.points > 0) {
        (void)snprintf(value, sizeof value, "%.2f %%", 100 * report->errors.without_centre.mean);
        write_key(page, value, "mean relative error without the centre entry");
    }
    (void)snprintf(value, sizeof value, "1 / %.0f", before / after);
    write_key(page, value, "factored over original size");
    (void)snprintf(value, sizeof value, "%d × %d", m->width, m->height);
    write_key(page, value, "surface points");
    if (m->layout == NACRE_KERNEL_PER_TERM) {
        (void)snprintf(value, sizeof value, "%d", m->terms);
        write_key(page, value, "terms, each with its kernel");
    } else {
        (void)snprintf(value, sizeof value, "%d, %d", m->terms, m->clusters);
        write_key(page, value, "terms, clusters");
    }
    (void)fputs("</div>\n</header>\n", page);
}

static void write_warnings(const struct report *report)
{
    const struct nacre_material *m = &report->material;
    if (m->warning_count == 0) {
        return;
    }
    (void)fputs("<div class=\"warn\">\n", report->page);
    for (size_t i = 0; i < m->warning_count; i++) {
        (void)fputs("<p>", report->page);
        page_text(report->page, m->warnings[i]);
        (void)fputs("</p>\n", report->page);
    }
    (void)fputs("</div>\n", report->page);
}

static int write_page(struct report *report, struct nacre_error *error)
{
    static int (*const sections[])(struct report *, struct nacre_error *) = {
        report_write_maps,  report_write_responses, report_write_convergence, report_write_kernels,
        report_write_terms, report_write_table,     report_write_pictures,
    };
    int status = NACRE_OK;
    char title[512];
    (void)snprintf(title, sizeof title, "%s — nacre report",
                   report_base_name(report->request->material));
    page_begin(report->page, title);
    write_head(report);
    write_warnings(report);
    for (size_t i = 0; i < sizeof sections / sizeof sections[0] && status == NACRE_OK; i++) {
        status = sections[i](report, error);
    }
    page_end(report->page);
    return status;
}

/* Read both files and compare them. */
static int read_inputs(struct report *report, struct progress *progress, struct nacre_error *error)
{
    int status = nacre_scan_open(report->request->scan, &report->scan, error);
    if (status == NACRE_OK) {
        status = nacre_material_read(report->request->material, &report->material, error);
    }
    if (status == NACRE_OK) {
        status = error_check_sizes(report->scan, &report->material, error);
    }
    if (status == NACRE_OK) {
        struct error_source source = error_source_scan(report->scan);
        status = error_measure(&source, &report->material, progress, &report->errors, error);
    }
    return status == NACRE_OK ? report_points_choose(report, error) : status;
}

int report_write(const char *path, const struct report_request *request, struct progress *progress,
                 struct nacre_error *error)
{
    struct report report = {.request = request};
    char *text = NULL;
    size_t size = 0;
    bool written = false;
    int status = read_inputs(&report, progress, error);
    if (status != NACRE_OK) {
        goto out;
    }
    report.page = open_memstream(&text, &size);
    if (!report.page) {
        status = nacre_fail_memory(error, path);
        goto out;
    }
    status = write_page(&report, error);
    written = !ferror(report.page);
    if (fclose(report.page) != 0 || !written) {
        status = status == NACRE_OK ? nacre_fail_memory(error, path) : status;
    }
    if (status == NACRE_OK) {
        status = whole_file_write(path, text, size, error);
    }
out:
    free(text);
    error_report_finish(&report.errors);
    nacre_material_finish(&report.material);
    nacre_scan_close(report.scan);
    return status;
}
