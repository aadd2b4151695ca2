/* nacre devices: lists the devices that a computer offers. */
#include "base/clock.h"
#include "base/opencl.h"
#include "cmd/devices_rig.h"
#include "cmd/json_print.h"
#include "cmd/verbs.h"
#include "factor/layout.h"
#include "factor/tune_trial.h"
#include "rig/trigger_usb.h"

#include <jansson.h>
#include <stdint.h>
#include <stdlib.h>

struct devices_settings {
    bool tune;
};

static const struct option_spec devices_options[] = {
    {.name = "tune",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct devices_settings, tune),
     .sentence = "time the tiles of factoring's kernels on the device that --device chooses, which "
                 "takes some minutes, and remember which are best"},
    {0}};

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

/* What is told of one trigger board. */
struct board {
    struct usb_place place;
    struct board_status status;
    struct nacre_error problem; /* no text: none */
};

struct boards {
    struct board *list;
    size_t count;
    struct nacre_error problem; /* why there is no list; no text: there is one */
};

/* Ask the board what it has to say. */
static void question(struct board *board)
{
    struct clock clock = clock_monotonic();
    struct usb_port *port = NULL;
    struct trigger *trigger = NULL;
    if (usb_libusb_port(&trigger_usb_kind, board->place.name, &port, &board->problem) != NACRE_OK ||
        trigger_usb_new(port, &clock, &trigger, &board->problem) != NACRE_OK) {
        return;
    }
    /* What fails is in the text. */
    (void)trigger_usb_status(trigger, &board->status, &board->problem);
    trigger->ops->close(trigger);
}

/* All boards that are plugged in; the caller frees the list. A computer without USB has none. */
static struct boards find_boards(void)
{
    struct boards boards = {.count = 0};
    struct usb_place *places = NULL;
    size_t count = 0;
    if (usb_libusb_list(&trigger_usb_kind, &places, &count, &boards.problem) != NACRE_OK) {
        return boards;
    }
    boards.list = calloc(count + 1, sizeof *boards.list);
    boards.count = boards.list ? count : 0;
    for (size_t i = 0; i < boards.count; i++) {
        boards.list[i].place = places[i];
        question(&boards.list[i]);
    }
    free(places);
    return boards;
}

static void print_boards(const struct boards *boards)
{
    if (boards->problem.text[0] != '\0') {
        (void)printf("Trigger boards: %s\n", boards->problem.text);
        return;
    }
    if (boards->count == 0) {
        (void)printf("Trigger boards: none\n");
        return;
    }
    (void)printf("Trigger boards:\n");
    for (size_t i = 0; i < boards->count; i++) {
        const struct board *board = &boards->list[i];
        if (board->problem.text[0] != '\0') {
            (void)printf("  %s  %s\n", board->place.name, board->problem.text);
        } else if (board->status.state & BOARD_LOCKED) {
            (void)printf("  %s  locked to a wheel of %.3f Hz, gain %d\n", board->place.name,
                         trigger_usb_wheel_hz(&board->status), board->status.settings.gain);
        } else {
            (void)printf("  %s  finds no colour wheel\n", board->place.name);
        }
    }
}

static json_t *boards_json(const struct boards *boards)
{
    json_t *list = json_array();
    for (size_t i = 0; i < boards->count && list; i++) {
        const struct board *board = &boards->list[i];
        json_t *entry = json_pack("{s:s}", "place", board->place.name);
        if (board->problem.text[0] != '\0') {
            (void)json_object_set_new(entry, "problem", json_string(board->problem.text));
        } else {
            (void)json_object_set_new(entry, "locked",
                                      json_boolean(board->status.state & BOARD_LOCKED));
            (void)json_object_set_new(entry, "wheel_hz",
                                      json_real(trigger_usb_wheel_hz(&board->status)));
            (void)json_object_set_new(entry, "gain", json_integer(board->status.settings.gain));
        }
        (void)json_array_append_new(list, entry);
    }
    return list;
}

static void print_text(const cl_device_id *devices, size_t count)
{
    if (count == 0) {
        (void)printf(
            "OpenCL: no device; install one (Debian: pocl-opencl-icd); if it is, see that HOME or "
            "POCL_CACHE_DIR names a folder that can be written\n");
        return;
    }
    (void)printf("OpenCL (--device takes the number or part of the name):\n");
    for (size_t i = 0; i < count; i++) {
        struct description d = describe(devices[i]);
        (void)printf("  %zu  %s\n     %s, %u compute units, %.1f GiB, %s\n", i, d.name, d.type,
                     d.compute_units, (double)d.memory / 0x1p30, d.version);
    }
}

static int print_json(const cl_device_id *devices, size_t count, const struct boards *boards,
                      const struct rig_devices *rig, struct nacre_error *error)
{
    json_t *list = json_array();
    json_t *root = json_pack("{s:o, s:o}", "opencl", list, "trigger_boards", boards_json(boards));
    for (size_t i = 0; i < count && root; i++) {
        struct description d = describe(devices[i]);
        /* A driver's text that is no UTF-8 makes packing fail, and the device is left out. */
        (void)json_array_append_new(
            list, json_pack("{s:I, s:s, s:s, s:I, s:I, s:s}", "index", (json_int_t)i, "name",
                            d.name, "type", d.type, "compute_units", (json_int_t)d.compute_units,
                            "memory_bytes", (json_int_t)d.memory, "version", d.version));
    }
    rig_devices_json(rig, root);
    return json_print(root, error);
}

static int tune(const struct invocation *invocation, struct nacre_error *error)
{
    struct opencl opencl = {0};
    struct progress progress = progress_begin("tuning", invocation->quiet);
    const struct update_tile *tiles = NULL;
    char *path = tune_path();
    int status = opencl_open(invocation->device, &opencl, error);
    if (status == NACRE_OK) {
        (void)printf("%s; remembered in %s\n", opencl.name, path ? path : "nothing");
        size_t count = update_tiles(layout_lanes(&opencl), &tiles);
        status = tune_trial(&opencl, tiles, count, &progress, stdout, error);
    }
    progress_end(&progress);
    opencl_close(&opencl);
    free(path);
    return status;
}

static int run(const void *settings, const struct invocation *invocation, struct nacre_error *error)
{
    if (((const struct devices_settings *)settings)->tune) {
        return tune(invocation, error);
    }
    size_t count = opencl_list(NULL, 0);
    cl_device_id *devices = calloc(count + 1, sizeof *devices);
    if (!devices) {
        return nacre_fail_memory(error, "the list of devices");
    }
    size_t found = opencl_list(devices, count);
    count = found < count ? found : count;
    struct boards boards = find_boards();
    struct rig_devices rig = {.camera_count = 0};
    int result = rig_devices_find(&rig, error);
    if (result == NACRE_OK && invocation->json) {
        result = print_json(devices, count, &boards, &rig, error);
    } else if (result == NACRE_OK) {
        print_text(devices, count);
        rig_devices_print(&rig);
        print_boards(&boards);
    }
    rig_devices_finish(&rig);
    free(boards.list);
    free(devices);
    return result;
}

const struct verb verb_devices = {
    .name = "devices",
    .operands = "",
    .summary = "list OpenCL devices, cameras, displays, GPIO chips and trigger boards",
    .text = "Prints the number, name, kind, compute units, memory and OpenCL version of every "
            "device that computing can run on; of every camera its raw formats; of every graphics "
            "card its connectors and their modes; of every GPIO chip the lines that have names or "
            "are held; and of every trigger board its place on the USB and the colour wheel that "
            "it is locked to; or why a device cannot be used.\n\n"
            "--tune measures instead which register tiles suit the multiplicative updates of "
            "`nacre factor` on a device, with the responses as floats and as half floats. The "
            "results are kept in tiles.tsv in $CACHE_DIRECTORY, else in the folder nacre of "
            "$XDG_CACHE_HOME or of ~/.cache, and used from then on; without them, tiles that were "
            "good elsewhere are.",
    .options = devices_options,
    .settings_size = sizeof(struct devices_settings),
    .run = run,
};
