/* The seam between the conductor of a factorization and the methods that improve its factors. */
#ifndef FACTOR_METHOD_H
#define FACTOR_METHOD_H

#include "factor/responses.h"
#include "factor/tell.h"
#include "factor/terms_data.h"

#include <stddef.h>
#include <stdint.h>

/* What is to be factored. All of it stays the caller's and must outlive the method. Responses, kernels and factors are
 * in scaled units: response ~ (sum_t F H) g, with factors around 1. */
struct problem {
    const struct responses *responses;
    const uint32_t *ids;  /* [height][width]: the cluster of each point, also where not measured */
    const float *kernels; /* [clusters][channels][K][K], all above 0 */
    int clusters, terms;
    uint64_t seed;     /* of the first factors */
    double regularise; /* 0: not */

    /* Not NULL: the model with a kernel per term, and what it is fitted to. Then kernels and ids are those of one cluster. */
    const struct terms_data *data;
    const uint32_t *kinds; /* [height][width]: which term a point's light starts as; below terms */
};

struct method;

struct method_ops {
    const char *name; /* as recorded in the material: "mu" */

    /* One iteration of one channel: F once, H once. Where `objective` is not NULL it gets the objective before the
     * step, in scaled units: half the sum of (R - R')^2 / g over measured entries. */
    int (*step)(struct method *method, int channel, double *objective, struct nacre_error *error);

    /* The objective of one channel as its factors are. */
    int (*measure)(struct method *method, int channel, double *objective,
                   struct nacre_error *error);

    /* Copy the factors of one channel to f and h, [terms][height][width]; h is NULL where H = F, and planes that all
     * channels share are those of the first. */
    int (*read)(struct method *method, int channel, float *f, float *h, struct nacre_error *error);

    /* With a kernel per term: the kernels' numbers of one channel, [terms][numbers of a kernel]; else NULL. */
    int (*read_kernels)(struct method *method, int channel, float *numbers,
                        struct nacre_error *error);

    /* Replace the factors of one channel, values >= 0. */
    int (*write)(struct method *method, int channel, const float *f, const float *h,
                 struct nacre_error *error);

    /* A channel's whole state, from which the method goes on bit for bit: factors, extrapolation and whatever else
     * decides the next steps. state_size bytes, the same at any time; load refuses what cannot be a state. */
    size_t (*state_size)(const struct method *method, int channel);
    int (*save)(struct method *method, int channel, void *state, struct nacre_error *error);
    int (*load)(struct method *method, int channel, const void *state, struct nacre_error *error);

    /* Tell what was chosen for this problem and device, and why. */
    void (*explain)(const struct method *method, const struct listener *to);

    void (*free)(struct method *method);
};

/* A concrete method embeds this as its first member. */
struct method {
    const struct method_ops *ops;
};

static inline void method_free(struct method *method) /* NULL is allowed */
{
    if (method) {
        method->ops->free(method);
    }
}

#endif
