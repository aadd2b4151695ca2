/* The OpenCL device that a program computes on, and building the kernels that are embedded in it.
 */
#ifndef BASE_OPENCL_H
#define BASE_OPENCL_H

#include "nacre/error.h"

#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <stddef.h>

/* An embedded NAME.cl: the symbol is NAME_cl, declared `extern const struct opencl_source NAME_cl;`
 * where it is used and defined by tools/embed_cl.py. */
struct opencl_source {
    const char *name; /* "update.cl" */
    const char *const *lines;
    size_t line_count;
};

struct opencl {
    cl_platform_id platform;
    cl_device_id device;
    cl_context context;
    cl_command_queue queue; /* in order */
    cl_uint compute_units;
    struct opencl_programs *programs; /* that opencl_build has built */
    char name[256];
};

/* Open a device. `selector` is NULL or "" for NACRE_DEVICE's value, or without that the first GPU, else the first
 * device; otherwise an index as `nacre devices` prints it, or part of a device's name. The caller closes it. */
int opencl_open(const char *selector, struct opencl *opencl, struct nacre_error *error);
void opencl_close(struct opencl *opencl); /* a zeroed one is allowed */

/* Every device, in the order of the indices that opencl_open takes; call with NULL to count. Returns their number, 0
 * where no OpenCL platform is installed. */
size_t opencl_list(cl_device_id *devices, size_t capacity);

/* Compile `source` with `options` ("-DT=12"), or take the program that was built from both before. A failure carries the
 * device and the first lines of the compiler's log. Where NACRE_CL_DIR is set and that folder has a file of the same name,
 * that file is compiled instead of the embedded text, each time. The caller releases the program. One thread at a time. */
int opencl_build(const struct opencl *opencl, const struct opencl_source *source,
                 const char *options, cl_program *program, struct nacre_error *error);

/* The name of an OpenCL status ("CL_OUT_OF_RESOURCES"). */
const char *opencl_status_name(cl_int status);

/* Turn a status into an error with the text "ACTION: CL_NAME on DEVICE"; NACRE_OK for CL_SUCCESS.
 */
int opencl_check(const struct opencl *opencl, cl_int status, const char *action,
                 struct nacre_error *error);

#endif
