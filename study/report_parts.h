/* The sections of the report. Private to study. */
#ifndef STUDY_REPORT_PARTS_H
#define STUDY_REPORT_PARTS_H

#include "factor/error.h"
#include "study/page.h"
#include "study/report.h"

/* The third of the points is the median. */
enum { REPORT_POINTS = 6, REPORT_MEDIAN = 2 };

/* A surface point whose response is shown. */
struct report_point {
    int x, y;
    const char *why; /* "median error" */
};

struct report {
    const struct report_request *request;
    struct nacre_scan *scan;
    struct nacre_material material;
    struct error_report errors;
    struct report_point points[REPORT_POINTS];
    size_t point_count;
    FILE *page;
};

/* The last part of a path. */
const char *report_base_name(const char *path);

/* Choose the points to show: those that stand at fixed places in the order of their errors. */
int report_points_choose(struct report *report, struct nacre_error *error);

/* Each writes its section. */
int report_write_photograph(struct report *report, struct nacre_error *error);
int report_write_maps(struct report *report, struct nacre_error *error);
int report_write_responses(struct report *report, struct nacre_error *error);
int report_write_convergence(struct report *report, struct nacre_error *error);
int report_write_kernels(struct report *report, struct nacre_error *error);
int report_write_terms(struct report *report, struct nacre_error *error);
int report_write_table(struct report *report, struct nacre_error *error);
int report_write_pictures(struct report *report, struct nacre_error *error);

/* The bytes of the material's file. */
double report_file_bytes(const struct report *report);

#endif
