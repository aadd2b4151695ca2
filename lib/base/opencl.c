/* Choosing an OpenCL device and building embedded kernels for it. */
#include "base/opencl.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

enum { MAX_PLATFORMS = 16, MAX_DEVICES = 64, LOG_SHOWN = 700 };

const char *opencl_status_name(cl_int status)
{
#define NAME(code)                                                                                 \
    case code:                                                                                     \
        return #code
    switch (status) {
        NAME(CL_SUCCESS);
        NAME(CL_DEVICE_NOT_FOUND);
        NAME(CL_DEVICE_NOT_AVAILABLE);
        NAME(CL_COMPILER_NOT_AVAILABLE);
        NAME(CL_MEM_OBJECT_ALLOCATION_FAILURE);
        NAME(CL_OUT_OF_RESOURCES);
        NAME(CL_OUT_OF_HOST_MEMORY);
        NAME(CL_BUILD_PROGRAM_FAILURE);
        NAME(CL_INVALID_VALUE);
        NAME(CL_INVALID_DEVICE);
        NAME(CL_INVALID_CONTEXT);
        NAME(CL_INVALID_COMMAND_QUEUE);
        NAME(CL_INVALID_HOST_PTR);
        NAME(CL_INVALID_MEM_OBJECT);
        NAME(CL_INVALID_BUILD_OPTIONS);
        NAME(CL_INVALID_PROGRAM);
        NAME(CL_INVALID_PROGRAM_EXECUTABLE);
        NAME(CL_INVALID_KERNEL_NAME);
        NAME(CL_INVALID_KERNEL);
        NAME(CL_INVALID_ARG_INDEX);
        NAME(CL_INVALID_ARG_VALUE);
        NAME(CL_INVALID_ARG_SIZE);
        NAME(CL_INVALID_KERNEL_ARGS);
        NAME(CL_INVALID_WORK_DIMENSION);
        NAME(CL_INVALID_WORK_GROUP_SIZE);
        NAME(CL_INVALID_WORK_ITEM_SIZE);
        NAME(CL_INVALID_GLOBAL_OFFSET);
        NAME(CL_INVALID_EVENT);
        NAME(CL_INVALID_OPERATION);
        NAME(CL_INVALID_BUFFER_SIZE);
        NAME(CL_INVALID_GLOBAL_WORK_SIZE);
    default:
        return "an unknown OpenCL status";
    }
#undef NAME
}

int opencl_check(const struct opencl *opencl, cl_int status, const char *action,
                 struct nacre_error *error)
{
    if (status == CL_SUCCESS) {
        return NACRE_OK;
    }
    return nacre_fail(error, "%s: %s on %s", action, opencl_status_name(status), opencl->name);
}

size_t opencl_list(cl_device_id *devices, size_t capacity)
{
    cl_platform_id platforms[MAX_PLATFORMS];
    cl_uint platform_count = 0;
    size_t count = 0;
    if (clGetPlatformIDs(MAX_PLATFORMS, platforms, &platform_count) != CL_SUCCESS) {
        return 0;
    }
    for (cl_uint p = 0; p < platform_count && p < MAX_PLATFORMS; p++) {
        cl_device_id found[MAX_DEVICES];
        cl_uint found_count = 0;
        if (clGetDeviceIDs(platforms[p], CL_DEVICE_TYPE_ALL, MAX_DEVICES, found, &found_count) !=
            CL_SUCCESS) {
            continue;
        }
        for (cl_uint d = 0; d < found_count && d < MAX_DEVICES; d++, count++) {
            if (devices && count < capacity) {
                devices[count] = found[d];
            }
        }
    }
    return count;
}

static void device_name(cl_device_id device, char *name, size_t size)
{
    name[0] = '\0';
    (void)clGetDeviceInfo(device, CL_DEVICE_NAME, size, name, NULL); /* an empty name is no harm */
}

static int choose_first(const cl_device_id *devices, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        cl_device_type type = 0;
        (void)clGetDeviceInfo(devices[i], CL_DEVICE_TYPE, sizeof type, &type, NULL);
        if (type & CL_DEVICE_TYPE_GPU) {
            return (int)i;
        }
    }
    return 0;
}

/* The index of the device that `selector` means, or -1. */
static int choose_device(const char *selector, const cl_device_id *devices, size_t count)
{
    char *end = NULL;
    errno = 0;
    long index = strtol(selector, &end, 10);
    if (end != selector && *end == '\0') {
        return errno == 0 && index >= 0 && (size_t)index < count ? (int)index : -1;
    }
    for (size_t i = 0; i < count; i++) {
        char name[256];
        device_name(devices[i], name, sizeof name);
        if (strcasestr(name, selector)) {
            return (int)i;
        }
    }
    return -1;
}

int opencl_open(const char *selector, struct opencl *opencl, struct nacre_error *error)
{
    cl_device_id devices[MAX_DEVICES];
    cl_int status = CL_SUCCESS;
    size_t count = opencl_list(devices, MAX_DEVICES);
    *opencl = (struct opencl){0};
    if (count == 0) {
        return nacre_fail(error,
                          "no OpenCL device: install one (Debian: pocl-opencl-icd); if it is, see "
                          "that HOME or POCL_CACHE_DIR names a folder that can be written");
    }
    if (count > MAX_DEVICES) {
        count = MAX_DEVICES;
    }
    const char *from = "--device";
    if (!selector || !*selector) {
        selector = getenv("NACRE_DEVICE");
        from = "NACRE_DEVICE";
    }
    int chosen = selector && *selector ? choose_device(selector, devices, count)
                                       : choose_first(devices, count);
    if (chosen < 0) {
        return nacre_fail(error, "%s: no OpenCL device is called '%s'; `nacre devices` lists them",
                          from, selector);
    }
    opencl->device = devices[chosen];
    device_name(opencl->device, opencl->name, sizeof opencl->name);
    (void)clGetDeviceInfo(opencl->device, CL_DEVICE_PLATFORM, sizeof(cl_platform_id),
                          &opencl->platform, NULL);
    (void)clGetDeviceInfo(opencl->device, CL_DEVICE_MAX_COMPUTE_UNITS, sizeof opencl->compute_units,
                          &opencl->compute_units, NULL);
    opencl->context = clCreateContext(NULL, 1, &opencl->device, NULL, NULL, &status);
    int result = opencl_check(opencl, status, "cannot create a context", error);
    if (result == NACRE_OK) {
        opencl->queue = clCreateCommandQueue(opencl->context, opencl->device, 0, &status);
        result = opencl_check(opencl, status, "cannot create a command queue", error);
    }
    if (result != NACRE_OK) {
        opencl_close(opencl);
    }
    return result;
}

void opencl_close(struct opencl *opencl)
{
    if (opencl->queue) {
        (void)clReleaseCommandQueue(opencl->queue);
    }
    if (opencl->context) {
        (void)clReleaseContext(opencl->context);
    }
    *opencl = (struct opencl){0};
}

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
    if (asprintf(&all, "%s -I%s", options ? options : "", folder) < 0) {
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

int opencl_build(const struct opencl *opencl, const struct opencl_source *source,
                 const char *options, cl_program *program, struct nacre_error *error)
{
    char *replaced = NULL, *extended = NULL;
    cl_int status = CL_SUCCESS;
    int result = NACRE_FAILED;
    *program = NULL;
    if (read_override(source->name, &replaced, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (replaced) {
        options = extended = options_with_folder(options);
        if (!extended) {
            result = nacre_fail_memory(error, source->name);
            goto out;
        }
    }
    /* OpenCL 1.2's prototype lacks a const that every implementation honours. */
    *program = replaced ? clCreateProgramWithSource(opencl->context, 1, (const char **)&replaced,
                                                    NULL, &status)
                        : clCreateProgramWithSource(opencl->context, (cl_uint)source->line_count,
                                                    (const char **)source->lines, NULL, &status);
    result = opencl_check(opencl, status, source->name, error);
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
out:
    free(extended);
    free(replaced);
    return result;
}
