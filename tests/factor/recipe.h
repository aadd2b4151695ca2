/* Made samples for the model with a kernel per term, and fits of them. */
#ifndef TESTS_FACTOR_RECIPE_H
#define TESTS_FACTOR_RECIPE_H

#include "sample.h"

#include "factor/factorize.h"

/* How a made response is: two reciprocal terms, times a gain at both ends. */
struct recipe {
    bool homogeneous, checks, noise;
    double slope; /* of the gain's logarithm along x, over the sample */
    bool one_way; /* light goes farther to the right than to the left */
    double scale;
};

/* The plane of one of the two terms. */
double recipe_plane(const struct recipe *recipe, int term, int x, int y);

struct sample recipe_make(const struct recipe *recipe, int width, int height, int channels,
                          int window);

/* So many terms, exactly so many iterations. */
struct factor_options recipe_options(int terms, int iterations);

/* Ends the test where it fails. */
struct nacre_material recipe_fit(const struct opencl *opencl, const struct sample *sample,
                                 const struct factor_options *options,
                                 struct factor_summary *summary);

/* Ends the test where the objective rose. */
void recipe_check_history(const struct nacre_material *material);

#endif
