/* Choosing an OpenCL device. */
#include "base/opencl_programs.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { MAX_PLATFORMS = 16, MAX_DEVICES = 64 };

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
    if (result == NACRE_OK) {
        result = opencl_programs_new(&opencl->programs, error);
    }
    if (result != NACRE_OK) {
        opencl_close(opencl);
    }
    return result;
}

void opencl_close(struct opencl *opencl)
{
    opencl_programs_free(opencl->programs);
    if (opencl->queue) {
        (void)clReleaseCommandQueue(opencl->queue);
    }
    if (opencl->context) {
        (void)clReleaseContext(opencl->context);
    }
    *opencl = (struct opencl){0};
}
