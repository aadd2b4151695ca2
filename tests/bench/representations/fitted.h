/* Materials by libfactor, with what is told of them: the part of the study that does not fit by itself. */
#ifndef TESTS_BENCH_REPRESENTATIONS_FITTED_H
#define TESTS_BENCH_REPRESENTATIONS_FITTED_H

#include "sample.h"

#include "factor/factorize.h"

enum { FITTED_BITS = 8 };

/* What a run has at hand. */
struct bench {
    const char *nacre;
    struct opencl opencl;
    bool quick;
    bool shaped;       /* of a sweep: a kernel per term against 12 terms and 5 clusters alone */
    int points;        /* a side, at most */
    const char *plots; /* a folder for pictures, or NULL */
};

/* A model as it is stored. */
struct fitted {
    float *model;   /* all responses */
    float *of_kept; /* those of a fit to the kept ones; NULL where the exact response is known */
    size_t bytes;   /* of the stored numbers */
    size_t file;    /* of the file with all it tells; 0: there is no such file */
    int steps;
    double seconds; /* of the processor, for the fit of all */
};

/* A material by libfactor, of all or of the kept responses. */
struct nacre_material fitted_material(const struct bench *bench, const struct sample *sample,
                                      bool kept, const struct factor_options *options);

/* Defaults for the paper's model, stored as floats. */
struct factor_options fitted_paper(int terms, int clusters, enum factor_weight weight);

/* What is told of a material and of one of the kept responses, which may be NULL. Where `bits` are not 0 both are quantised
 * first and stored as half floats. fitted_finish. */
struct fitted fitted_tell(const struct sample *sample, struct nacre_material *full,
                          struct nacre_material *kept, int bits);

void fitted_finish(struct fitted *fitted);

#endif
