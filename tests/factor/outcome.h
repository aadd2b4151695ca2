/* What comes of factorizing a sample, and how far the material is from the sample itself. */
#ifndef TESTS_FACTOR_OUTCOME_H
#define TESTS_FACTOR_OUTCOME_H

#include "sample.h"

#include "factor/factorize.h"

struct outcome {
    int status;
    struct nacre_material material;
    struct factor_summary summary;
};

/* Factorize it as floats; the caller looks at the status, whose reason `error` takes. */
struct outcome outcome_of(const struct sample *sample, const struct factor_options *options,
                          const struct opencl *opencl, struct nacre_error *error);
void outcome_finish(struct outcome *outcome);

/* The errors of a material, measured anew from the sample. The caller calls error_report_finish. */
struct error_report outcome_judge(const struct sample *sample,
                                  const struct nacre_material *material);

#endif
