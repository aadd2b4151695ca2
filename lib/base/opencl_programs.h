/* The programs that were built for a device, kept so that none is built twice: compilers take 50 ms and more each time. */
#ifndef BASE_OPENCL_PROGRAMS_H
#define BASE_OPENCL_PROGRAMS_H

#include "base/opencl.h"

/* More than a search through numbers of terms builds; the oldest makes room. */
enum { OPENCL_PROGRAMS_KEPT = 32 };

struct opencl_programs;

/* The caller frees it. */
int opencl_programs_new(struct opencl_programs **programs, struct nacre_error *error);
void opencl_programs_free(struct opencl_programs *programs); /* NULL is allowed */

/* The program that was built from `source` with `options`, for the caller to release, or NULL. */
cl_program opencl_programs_find(const struct opencl_programs *programs,
                                const struct opencl_source *source, const char *options);

/* Keep one that was built; not, where memory is short, and it is built again when it is asked for. */
void opencl_programs_keep(struct opencl_programs *programs, const struct opencl_source *source,
                          const char *options, cl_program program);

#endif
