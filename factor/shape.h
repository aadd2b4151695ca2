/* Which planes and kernels a scan is better fitted with at equal bytes, by fits of a piece of it. */
#ifndef FACTOR_SHAPE_H
#define FACTOR_SHAPE_H

#include "factor/factorize.h"

struct shape {
    bool full, separate;
    int terms; /* of this shape in the bytes of those asked for with radial kernels and shared planes */
};

/* The options' kernels and planes, of which `auto` ones are chosen. `features` are those of the responses, `terms` how many
 * there would be with radial kernels, or those given, and shared planes, or those given. Tells the options' listener why. */
int shape_choose(const struct responses *responses, const struct features *features,
                 const struct factor_options *options, const struct opencl *opencl, int terms,
                 struct progress *progress, struct shape *shape, struct nacre_error *error);

/* Bytes of one term: its planes and its kernels, as the material counts them. */
double shape_bytes(const struct responses *responses, const struct factor_options *options,
                   const struct shape *shape, int sides);

#endif
