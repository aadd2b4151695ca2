/* Building the gather's kernels, sharing memory with them and launching them. */
#include "render/gather_device.h"

#include <stdio.h>
#include <stdlib.h>

extern const struct opencl_source gather_cl;

enum { ITEMS_A_LAUNCH = 256 /* between two looks at the user */, ALIGNMENT = 64 };

int gather_device_make(struct gather_device *device, const struct opencl *opencl,
                       const struct gather *gather, struct nacre_error *error)
{
    const struct appearance *appearance = gather->appearance;
    const struct mapping *mapping = gather->mapping;
    char options[512];
    cl_int status;
    *device = (struct gather_device){.opencl = opencl};
    (void)snprintf(options, sizeof options,
                   "-w -cl-fast-relaxed-math -DTERMS4=%d -DWINDOW=%d -DMIXED=%d -DONE_KERNEL=%d "
                   "-DCLUSTERS=%d -DPER_TERM=%d "
                   "-DPARTS=%d -DWIDTH=%d -DHEIGHT=%d -DMIRROR=%d -DSAME_SIDE=%d -DPOINT_MM=%.9ef",
                   appearance->terms / 4, appearance->window, appearance->mixed,
                   appearance->kernel_count == 1 && appearance->mixed == 1,
                   appearance->layout == NACRE_KERNEL_PAIR ? appearance->clusters : 0,
                   appearance->layout == NACRE_KERNEL_PER_TERM, appearance->basis.parts,
                   appearance->width, appearance->height, mapping->mirror, gather->same_side,
                   mapping->point_mm);
    if (opencl_build(opencl, &gather_cl, options, &device->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    device->gather = clCreateKernel(device->program, "gather", &status);
    if (status == CL_SUCCESS) {
        device->squares = clCreateKernel(device->program, "gather_squares", &status);
    }
    return opencl_check(opencl, status, "cannot make the kernel gather", error);
}

void gather_device_finish(struct gather_device *device)
{
    if (device->gather) {
        (void)clReleaseKernel(device->gather);
    }
    if (device->squares) {
        (void)clReleaseKernel(device->squares);
    }
    if (device->program) {
        (void)clReleaseProgram(device->program);
    }
    *device = (struct gather_device){0};
}

cl_mem device_share(struct device_memory *memory, const void *bytes, size_t size, void *owned,
                    struct nacre_error *error)
{
    cl_int status = CL_OUT_OF_RESOURCES;
    bool stands = bytes && size > 0;
    cl_mem_flags flags = stands ? CL_MEM_READ_ONLY | CL_MEM_USE_HOST_PTR : CL_MEM_READ_WRITE;
    struct device_piece *piece = NULL;
    if (memory->count < DEVICE_PIECES) {
        piece = &memory->pieces[memory->count++];
        *piece = (struct device_piece){.owned = owned};
        /* Some implementations refuse buffers of no size. */
        piece->memory = clCreateBuffer(memory->opencl->context, flags, size > 0 ? size : ALIGNMENT,
                                       stands ? (void *)(uintptr_t)bytes : NULL, &status);
    } else {
        free(owned);
    }
    (void)opencl_check(memory->opencl, status, "cannot copy the light samples", error);
    return status == CL_SUCCESS ? piece->memory : NULL;
}

void device_memory_finish(struct device_memory *memory)
{
    for (size_t i = 0; i < memory->count; i++) {
        if (memory->pieces[i].memory) {
            (void)clReleaseMemObject(memory->pieces[i].memory);
        }
        free(memory->pieces[i].owned);
    }
    memory->count = 0;
}

void *device_allocate(size_t size, struct nacre_error *error)
{
    void *memory = aligned_alloc(ALIGNMENT, (size / ALIGNMENT + 1) * ALIGNMENT);
    if (!memory) {
        (void)nacre_fail_memory(error, "the light samples");
    }
    return memory;
}

void device_set(struct device_arguments *arguments, const void *value, size_t size)
{
    if (arguments->status == NACRE_OK) {
        cl_int status = clSetKernelArg(arguments->kernel, arguments->count, size, value);
        arguments->status = opencl_check(arguments->memory->opencl, status, "cannot gather light",
                                         arguments->error);
    }
    arguments->count++;
}

void device_set_memory(struct device_arguments *arguments, cl_mem memory)
{
    if (!memory && arguments->status == NACRE_OK) {
        arguments->status = NACRE_FAILED; /* device_share has said why */
    }
    device_set(arguments, &memory, sizeof memory);
}

void device_set_shared(struct device_arguments *arguments, const void *bytes, size_t size)
{
    device_set_memory(arguments,
                      device_share(arguments->memory, bytes, size, NULL, arguments->error));
}

void device_set_number(struct device_arguments *arguments, size_t number)
{
    cl_uint value = (cl_uint)number;
    device_set(arguments, &value, sizeof value);
}

int device_launch(struct device_arguments *arguments, size_t count, double *done, double all,
                  struct progress *progress)
{
    const struct opencl *opencl = arguments->memory->opencl;
    size_t one = 1;
    for (size_t first = 0; arguments->status == NACRE_OK && first < count;
         first += ITEMS_A_LAUNCH) {
        size_t size = count - first < ITEMS_A_LAUNCH ? count - first : ITEMS_A_LAUNCH;
        cl_uint offset = (cl_uint)first;
        arguments->status = progress_step(progress, *done, all, NULL, arguments->error);
        if (arguments->status != NACRE_OK) {
            return arguments->status;
        }
        cl_int status = clSetKernelArg(arguments->kernel, 0, sizeof offset, &offset);
        if (status == CL_SUCCESS) {
            status = clEnqueueNDRangeKernel(opencl->queue, arguments->kernel, 1, NULL, &size, &one,
                                            0, NULL, NULL);
        }
        if (status == CL_SUCCESS) {
            status = clFinish(opencl->queue);
        }
        arguments->status = opencl_check(opencl, status, "cannot gather light", arguments->error);
        *done += (double)size;
    }
    return arguments->status;
}
