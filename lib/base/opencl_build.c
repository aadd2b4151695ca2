/* Building embedded kernels, each once for the same options. */
#include "base/opencl_programs.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { LOG_SHOWN = 700 };

/* The rest of a stream with a #line in front, on the heap; NULL with errno set where that fails. */
static char *read_source(FILE *file, const char *path)
{
    char *text = NULL;
    size_t size = 0;
    int c = 0;
    FILE *memory = open_memstream(&text, &size);
    if (!memory) {
        return NULL;
    }
    (void)fprintf(memory, "#line 1 \"%s\"\n", path);
    while ((c = fgetc(file)) != EOF) {
        (void)fputc(c, memory);
    }
    if (fclose(memory) != 0 || ferror(file)) {
        free(text);
        return NULL;
    }
    return text;
}

/* The text of the file `name` in NACRE_CL_DIR: *text stays NULL where the variable is not set or the folder holds no
 * such file, so that a folder may hold only what is being worked on. */
static int read_override(const char *name, char **text, struct nacre_error *error)
{
    char path[PATH_MAX];
    const char *folder = getenv("NACRE_CL_DIR");
    *text = NULL;
    if (!folder || !*folder) {
        return NACRE_OK;
    }
    if (access(folder, X_OK) != 0) {
        return nacre_fail_errno(error, errno, "NACRE_CL_DIR: cannot use %s", folder);
    }
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "re");
    if (!file && errno == ENOENT) {
        return NACRE_OK;
    }
    *text = file ? read_source(file, path) : NULL;
    int number = errno;
    if (file) {
        (void)fclose(file);
    }
    return *text ? NACRE_OK : nacre_fail_errno(error, number, "NACRE_CL_DIR: cannot read %s", path);
}

/* The options with NACRE_CL_DIR as a folder for includes, on the heap. OpenCL knows no quoting: its name must hold no space. */
static char *options_with_folder(const char *options)
{
    const char *folder = getenv("NACRE_CL_DIR");
    char *all = NULL;
    if (asprintf(&all, "%s -I%s", options, folder) < 0) {
        return NULL;
    }
    return all;
}

static int report_build_failure(const struct opencl *opencl, const char *name, cl_program program,
                                cl_int status, struct nacre_error *error)
{
    size_t size = 0;
    char *log = NULL;
    (void)clGetProgramBuildInfo(program, opencl->device, CL_PROGRAM_BUILD_LOG, 0, NULL, &size);
    log = calloc(1, size + 1);
    if (log) {
        (void)clGetProgramBuildInfo(program, opencl->device, CL_PROGRAM_BUILD_LOG, size, log, NULL);
    }
    (void)nacre_fail(error, "cannot build %s: %s on %s:\n%.*s", name, opencl_status_name(status),
                     opencl->name, LOG_SHOWN, log ? log : "");
    free(log);
    return NACRE_FAILED;
}

/* Compile, keeping nothing. */
static int compile(const struct opencl *opencl, const struct opencl_source *source,
                   const char *replaced, const char *options, cl_program *program,
                   struct nacre_error *error)
{
    cl_int status = CL_SUCCESS;
    /* OpenCL 1.2's prototype lacks a const that every implementation honours. */
    *program = replaced ? clCreateProgramWithSource(opencl->context, 1, (const char **)&replaced,
                                                    NULL, &status)
                        : clCreateProgramWithSource(opencl->context, (cl_uint)source->line_count,
                                                    (const char **)source->lines, NULL, &status);
    int result = opencl_check(opencl, status, source->name, error);
    if (result == NACRE_OK) {
        status = clBuildProgram(*program, 1, &opencl->device, options, NULL, NULL);
        if (status != CL_SUCCESS) {
            result = report_build_failure(opencl, source->name, *program, status, error);
        }
    }
    if (result != NACRE_OK && *program) {
        (void)clReleaseProgram(*program);
        *program = NULL;
    }
    return result;
}

int opencl_build(const struct opencl *opencl, const struct opencl_source *source,
                 const char *options, cl_program *program, struct nacre_error *error)
{
    char *replaced = NULL, *extended = NULL;
    int result = NACRE_FAILED;
    *program = NULL;
    options = options ? options : "";
    if (read_override(source->name, &replaced, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (replaced) { /* may be another text next time */
        extended = options_with_folder(options);
        result = extended ? compile(opencl, source, replaced, extended, program, error)
                          : nacre_fail_memory(error, source->name);
        goto out;
    }
    *program = opencl_programs_find(opencl->programs, source, options);
    if (*program) {
        result = NACRE_OK;
        goto out;
    }
    result = compile(opencl, source, NULL, options, program, error);
    if (result == NACRE_OK) {
        opencl_programs_keep(opencl->programs, source, options, *program);
    }
out:
    free(extended);
    free(replaced);
    return result;
}
