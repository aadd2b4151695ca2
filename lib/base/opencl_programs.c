/* The programs that were built for a device. */
#include "base/opencl_programs.h"

#include <stdlib.h>
#include <string.h>

struct opencl_programs {
    struct kept {
        const struct opencl_source *source;
        char *options;
        cl_program program;
    } kept[OPENCL_PROGRAMS_KEPT];
    size_t next;
};

int opencl_programs_new(struct opencl_programs **programs, struct nacre_error *error)
{
    *programs = calloc(1, sizeof **programs);
    return *programs ? NACRE_OK : nacre_fail_memory(error, "OpenCL's programs");
}

static void forget(struct kept *kept)
{
    if (kept->program) {
        (void)clReleaseProgram(kept->program);
    }
    free(kept->options);
    *kept = (struct kept){0};
}

void opencl_programs_free(struct opencl_programs *programs)
{
    for (size_t i = 0; programs && i < OPENCL_PROGRAMS_KEPT; i++) {
        forget(&programs->kept[i]);
    }
    free(programs);
}

cl_program opencl_programs_find(const struct opencl_programs *programs,
                                const struct opencl_source *source, const char *options)
{
    for (size_t i = 0; i < OPENCL_PROGRAMS_KEPT; i++) {
        const struct kept *kept = &programs->kept[i];
        if (kept->source == source && strcmp(kept->options, options) == 0) {
            return clRetainProgram(kept->program) == CL_SUCCESS ? kept->program : NULL;
        }
    }
    return NULL;
}

void opencl_programs_keep(struct opencl_programs *programs, const struct opencl_source *source,
                          const char *options, cl_program program)
{
    char *copy = strdup(options);
    if (copy && clRetainProgram(program) == CL_SUCCESS) {
        struct kept *kept = &programs->kept[programs->next++ % OPENCL_PROGRAMS_KEPT];
        forget(kept);
        *kept = (struct kept){source, copy, program};
    } else {
        free(copy);
    }
}
