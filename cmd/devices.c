/* nacre devices: lists the devices that a computer offers. */
#include "base/opencl.h"
#include "cmd/verbs.h"

#include <jansson.h>
#include <stdint.h>
#include <stdlib.h>

/* What is told of one OpenCL device. */
struct description {
    char name[256], version[256];
    const char *type;
    cl_uint compute_units;
    cl_ulong memory; /* bytes */
};

static struct description describe(cl_device_id device)
{
    struct description d = {.type = "other"};
    cl_device_type type = 0;
    /* What a driver does not tell stays empty or 0. */
    (void)clGetDeviceInfo(device, CL_DEVICE_NAME, sizeof d.name - 1, d.name, NULL);
    (void)clGetDeviceInfo(device, CL_DEVICE_VERSION, sizeof d.version - 1, d.version, NULL);
    (void)clGetDeviceInfo(device, CL_DEVICE_TYPE, sizeof type, &type, NULL);
    (void)clGetDeviceInfo(device, CL_DEVICE_MAX_COMPUTE_UNITS, sizeof d.compute_units,
                          &d.compute_units, NULL);
    (void)clGetDeviceInfo(device, CL_DEVICE_GLOBAL_MEM_SIZE, sizeof d.memory, &d.memory, NULL);
    if (type & CL_DEVICE_TYPE_GPU) {
        d.type = "GPU";
    } else if (type & CL_DEVICE_TYPE_CPU) {
        d.type = "CPU";
    } else if (type & CL_DEVICE_TYPE_ACCELERATOR) {
        d.type = "accelerator";
    }
    return d;
}

static void print_text(const cl_device_id *devices, size_t count)
{
    if (count == 0) {
        (void)printf("OpenCL: no device; install one (Debian: pocl-opencl-icd)\n");
        return;
    }
    (void)printf("OpenCL (--device takes the number or part of the name):\n");
    for (size_t i = 0; i < count; i++) {
        struct description d = describe(devices[i]);
        (void)printf("  %zu  %s\n     %s, %u compute units, %.1f GiB, %s\n", i, d.name, d.type,
                     d.compute_units, (double)d.memory / 0x1p30, d.version);
    }
}

static int print_json(const cl_device_id *devices, size_t count, struct nacre_error *error)
{
    int result = NACRE_OK;
    json_t *list = json_array();
    json_t *root = json_pack("{s:o}", "opencl", list);
    for (size_t i = 0; i < count && root; i++) {
        struct description d = describe(devices[i]);
        /* A driver's text that is no UTF-8 makes packing fail, and the device is left out. */
        (void)json_array_append_new(
            list, json_pack("{s:I, s:s, s:s, s:I, s:I, s:s}", "index", (json_int_t)i, "name",
                            d.name, "type", d.type, "compute_units", (json_int_t)d.compute_units,
                            "memory_bytes", (json_int_t)d.memory, "version", d.version));
    }
    if (!root || json_dumpf(root, stdout, JSON_INDENT(2)) != 0) {
        result = nacre_fail(error, "the list of devices cannot be written");
    }
    (void)putchar('\n');
    json_decref(root);
    return result;
}

static int run(const void *settings, const struct invocation *invocation, struct nacre_error *error)
{
    size_t count = opencl_list(NULL, 0);
    cl_device_id *devices = calloc(count + 1, sizeof *devices);
    (void)settings; /* it has no options of its own */
    if (!devices) {
        return nacre_fail_memory(error, "the list of devices");
    }
    size_t found = opencl_list(devices, count);
    count = found < count ? found : count;
    int result = NACRE_OK;
    if (invocation->json) {
        result = print_json(devices, count, error);
    } else {
        print_text(devices, count);
    }
    free(devices);
    return result;
}

const struct verb verb_devices = {
    .name = "devices",
    .operands = "",
    .summary = "list OpenCL devices",
    .text = "Prints the number, name, kind, compute units, memory and OpenCL version of every "
            "device that computing can run on.",
    .run = run,
};
