/* The gather's program on an OpenCL device, and the memory and arguments of its kernels. */
#ifndef RENDER_GATHER_DEVICE_H
#define RENDER_GATHER_DEVICE_H

#include "base/opencl.h"
#include "base/progress.h"
#include "render/gather.h"

#include <stddef.h>

enum { DEVICE_PIECES = 80 };

/* The program, specialised to a material, a mapping and how light passes. */
struct gather_device {
    const struct opencl *opencl;
    cl_program program;
    cl_kernel gather, squares;
};

int gather_device_make(struct gather_device *device, const struct opencl *opencl,
                       const struct gather *gather, struct nacre_error *error);
void gather_device_finish(struct gather_device *device);

/* Device memory, and host memory that it may stand on. */
struct device_memory {
    const struct opencl *opencl;
    size_t count;
    struct device_piece {
        cl_mem memory;
        void *owned;
    } pieces[DEVICE_PIECES];
};

/* Memory of the device over the host's, which must stay until device_memory_finish; or of the size alone. `owned`, which
 * may be NULL, is freed then. NULL where it fails. */
cl_mem device_share(struct device_memory *memory, const void *bytes, size_t size, void *owned,
                    struct nacre_error *error);
void device_memory_finish(struct device_memory *memory);

/* Host memory for what the device reads as float16s. */
void *device_allocate(size_t size, struct nacre_error *error);

/* A kernel's arguments as they are set one after the other, the first being left to device_launch. */
struct device_arguments {
    struct device_memory *memory;
    cl_kernel kernel;
    cl_uint count; /* begins as 1 */
    int status;
    struct nacre_error *error;
};

void device_set(struct device_arguments *arguments, const void *value, size_t size);
void device_set_memory(struct device_arguments *arguments, cl_mem memory);
void device_set_shared(struct device_arguments *arguments, const void *bytes, size_t size);
void device_set_number(struct device_arguments *arguments, size_t number);

/* Run work items 0 ... count - 1; they begin as number *done of `all`, which goes on. */
int device_launch(struct device_arguments *arguments, size_t count, double *done, double all,
                  struct progress *progress);

#endif
