/* One self-contained HTML page on how well a material stands for its scan. */
#ifndef STUDY_REPORT_H
#define STUDY_REPORT_H

#include "base/progress.h"

#include <stddef.h>

struct report_request {
    const char *scan, *material; /* paths */
    const char *photograph;      /* of the sample, or NULL */
    char *const *pictures;       /* paths of further pictures, EXR or PNG */
    size_t picture_count;
};

/* Write the page to `path`, whole or not at all: photograph, albedo and error map (Peers et al. 2006, figure 7),
 * measured responses beside factored ones, convergence, kernels, the row of Table 1 and the pictures. */
int report_write(const char *path, const struct report_request *request, struct progress *progress,
                 struct nacre_error *error);

#endif
