/* A problem placed on an OpenCL device, in the layout of layout.cl: what every method's kernels read. */
#ifndef FACTOR_LAYOUT_H
#define FACTOR_LAYOUT_H

#include "factor/method.h"

#include "base/opencl.h"

#include <stdbool.h>

/* As struct sizes in layout.cl. */
struct layout_sizes {
    cl_int width, height, window, terms, planes;
    cl_int blocks, stride, pad, row, lead, label_stride;
};

struct layout {
    const struct opencl *opencl;
    const struct problem *problem;
    struct layout_sizes sizes;
    size_t factor_floats; /* of one factor as it lies on the device */
    /* A work group that divides them. Left to PoCL it is another for each size of sample, and the kernel compiled anew. */
    size_t group;
    cl_mem labels;
    struct {
        cl_mem responses, mask;
        cl_mem kernels; /* [clusters][K + 1][K], each with a last row of zeros */
    } channels[RESPONSES_CHANNELS];
    float *staging; /* one factor */
};

/* How many points side by side suit a device: the `lanes` to load responses with. */
int layout_lanes(const struct opencl *opencl);

/* Place the problem, with `planes` planes in a factor (terms or more) and `rows` rows of zeros behind it. Keeps both
 * arguments and the problem's responses, which must outlive it. layout_finish, also after a failure. */
int layout_begin(struct layout *layout, const struct opencl *opencl, const struct problem *problem,
                 int planes, int rows, struct nacre_error *error);
void layout_finish(struct layout *layout); /* a zeroed one is allowed */

/* A buffer of `bytes`, copied from `from`, or with `shared` made of that memory itself; zeroed without `from`. The
 * caller releases it. */
int layout_make_buffer(const struct layout *layout, size_t bytes, void *from, bool shared,
                       cl_mem *buffer, struct nacre_error *error);

/* A zeroed factor, and copying it from and to [terms][height][width]. */
int layout_make_factor(const struct layout *layout, cl_mem *buffer, struct nacre_error *error);
int layout_write_factor(struct layout *layout, cl_mem buffer, const float *from,
                        struct nacre_error *error);
int layout_read_factor(struct layout *layout, cl_mem buffer, float *to, struct nacre_error *error);

/* Fill one factor of a channel with random values from the problem's seed, such that the products FH are 1 on average:
 * kernels are mean responses already. */
int layout_start_factor(struct layout *layout, int channel, bool of_h, cl_mem buffer,
                        struct nacre_error *error);

/* What factor values are around at the start. */
float layout_unit(const struct problem *problem);

/* Release a buffer; NULL is allowed. */
void layout_release(cl_mem buffer);

#endif
