/* A camera that sees the screen. */
#include "feeder.h"

#include "guest.h"
#include "rig/station.h"
#include "rig/virtual/virtual.h"
#include "unity.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

static const char node[] = "/dev/video0";

/* From the trigger's edge to the beginning of an exposure, as cameras have it. */
static const int64_t shutter_ns = 200000;
static const int64_t late_ns = 40000000;
/* Before the trigger, for the frame of another pattern. */
static const int64_t early_ns = 5000000;

static void must(int result, const char *what)
{
    TEST_ASSERT_TRUE_MESSAGE(result >= 0, what);
}

static void open_video(struct feeder *feeder, int width, int height)
{
    struct v4l2_format format = {.type = V4L2_BUF_TYPE_VIDEO_OUTPUT,
                                 .fmt.pix = {.width = (uint32_t)width,
                                             .height = (uint32_t)height,
                                             .pixelformat = V4L2_PIX_FMT_SRGGB8,
                                             .field = V4L2_FIELD_NONE}};
    struct v4l2_requestbuffers request = {
        .count = FEEDER_BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};
    guest_run("modprobe v4l2loopback video_nr=0 max_buffers=%d", FEEDER_BUFFERS);
    guest_wait_for(node, true);
    feeder->video = open(node, O_RDWR | O_CLOEXEC);
    must(feeder->video, node);
    must(ioctl(feeder->video, VIDIOC_S_FMT, &format), "VIDIOC_S_FMT");
    TEST_ASSERT_EQUAL_INT(width, format.fmt.pix.width);
    TEST_ASSERT_EQUAL_INT(height, format.fmt.pix.height);
    feeder->frame_bytes = (size_t)width * (size_t)height;
    must(ioctl(feeder->video, VIDIOC_REQBUFS, &request), "VIDIOC_REQBUFS");
    TEST_ASSERT_EQUAL_INT(FEEDER_BUFFERS, request.count);
    must(ioctl(feeder->video, VIDIOC_STREAMON, &format.type), "VIDIOC_STREAMON");
    for (unsigned i = 0; i < FEEDER_BUFFERS; i++) {
        struct v4l2_buffer buffer = {
            .index = i, .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};
        must(ioctl(feeder->video, VIDIOC_QUERYBUF, &buffer), "VIDIOC_QUERYBUF");
        feeder->buffers[i] = mmap(NULL, feeder->frame_bytes, PROT_READ | PROT_WRITE, MAP_SHARED,
                                  feeder->video, (off_t)buffer.m.offset);
        TEST_ASSERT_TRUE(feeder->buffers[i] != MAP_FAILED);
    }
}

/* What the kernel, or a board, noted of the trigger's line. False where it is gone. */
static bool read_line(const struct feeder *feeder, struct feeder_line *line)
{
    char path[224];
    char text[96] = "";
    char *rest = text;
    if (feeder->look) {
        return feeder->look(line);
    }
    (void)snprintf(path, sizeof path, "%s/sim_gpio0/value", feeder->chip->lines);
    FILE *file = fopen(path, "r");
    bool good = file && fgets(text, sizeof text, file) != NULL;
    if (file) {
        (void)fclose(file);
    }
    line->level = (int)strtol(rest, &rest, 10);
    line->rises = (unsigned)strtoul(rest, &rest, 10);
    line->rise_ns = strtoll(rest, &rest, 10);
    line->fall_ns = strtoll(rest, &rest, 10);
    return good;
}

void feeder_begin(struct feeder *feeder, const char *station, const struct screen *screen,
                  const struct gpio_sim *chip)
{
    struct station settings;
    struct nacre_error error;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, station_read(station, &settings, &error), error.text);
    *feeder = (struct feeder){.screen = screen,
                              .chip = chip,
                              .width = settings.sample.width,
                              .height = settings.sample.height};
    size_t points = (size_t)feeder->width * (size_t)feeder->height;
    feeder->levels = calloc(points, 1);
    feeder->before = calloc(points, 1);
    feeder->lit = calloc(points, 1);
    TEST_ASSERT_TRUE(feeder->levels && feeder->before && feeder->lit);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, virtual_station_new(&settings, &feeder->station, &error), error.text);
    open_video(feeder, settings.camera.width, settings.camera.height);
    station_finish(&settings);
    struct feeder_line line = {0};
    TEST_ASSERT_TRUE(!chip || read_line(feeder, &line));
    feeder->rises = line.rises;
}

void feeder_finish(struct feeder *feeder)
{
    if (!feeder->station) {
        return;
    }
    for (int i = 0; i < FEEDER_BUFFERS; i++) {
        (void)munmap(feeder->buffers[i], feeder->frame_bytes);
    }
    (void)close(feeder->video);
    guest_run("rmmod v4l2loopback");
    guest_wait_for(node, false);
    virtual_station_free(feeder->station);
    free(feeder->levels);
    free(feeder->before);
    free(feeder->lit);
    *feeder = (struct feeder){.station = NULL};
}

void feeder_unplug(struct feeder *feeder)
{
    int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    must(ioctl(feeder->video, VIDIOC_STREAMOFF, &type), "VIDIOC_STREAMOFF");
}

void feeder_lay_white(struct feeder *feeder, bool on)
{
    virtual_station_set_white_layer(feeder->station, on);
}

/* What the card sends to the sample; all else must be black. */
static void read_levels(const struct feeder *feeder, uint8_t *levels)
{
    int width;
    int height;
    uint32_t *pixels = screen_read(feeder->screen, &width, &height);
    for (int y = 0; y < feeder->height; y++) {
        for (int x = 0; x < feeder->width; x++) {
            uint32_t pixel = pixels[(y + feeder->top) * width + x + feeder->left];
            levels[y * feeder->width + x] = (uint8_t)(pixel & 255);
        }
    }
    screen_check(pixels, width, height, levels, feeder->left, feeder->top, feeder->width,
                 feeder->height);
    free(pixels);
}

/* The raw frame that the virtual camera makes of what is lit, until the next call. */
static const uint16_t *expose(struct feeder *feeder, int64_t exposure_ns)
{
    static const int64_t long_ns = 3600000000000;
    struct camera *camera = virtual_station_camera(feeder->station);
    struct trigger *trigger = virtual_station_trigger(feeder->station);
    struct camera_frame frame = {.raw = NULL};
    struct nacre_error error;
    int64_t time_ns;
    bool good = camera->ops->arm(camera, exposure_ns, &error) == NACRE_OK &&
                trigger->ops->fire(trigger, exposure_ns, &time_ns, &error) == NACRE_OK &&
                camera->ops->take(camera, long_ns, &frame, &error) == NACRE_OK;
    TEST_ASSERT_TRUE_MESSAGE(good, error.text);
    return frame.raw;
}

/* Light the virtual sample; what it makes of that is found once. */
static void light(struct feeder *feeder, const uint8_t *levels)
{
    struct projector *projector = virtual_station_projector(feeder->station);
    size_t points = (size_t)feeder->width * (size_t)feeder->height;
    struct nacre_error error;
    int64_t time_ns;
    if (memcmp(levels, feeder->lit, points) != 0 || feeder->pulses == 0) {
        memcpy(feeder->lit, levels, points);
        TEST_ASSERT_EQUAL_INT_MESSAGE(
            NACRE_OK, projector->ops->show(projector, levels, &time_ns, &error), error.text);
        (void)expose(feeder, feeder->exposures_ns[0]);
    }
}

/* Hand a frame over whose exposure ended at `end_ns`. */
static void write_frame(struct feeder *feeder, const uint16_t *raw, int64_t end_ns,
                        enum feeder_fault fault)
{
    unsigned index = feeder->written++ % FEEDER_BUFFERS;
    uint8_t *bytes = feeder->buffers[index];
    int64_t stamp_us = (end_ns + feeder->stamp_delay_ns) / 1000;
    struct v4l2_buffer buffer = {.index = index,
                                 .type = V4L2_BUF_TYPE_VIDEO_OUTPUT,
                                 .memory = V4L2_MEMORY_MMAP,
                                 .field = V4L2_FIELD_NONE,
                                 .bytesused = (uint32_t)feeder->frame_bytes,
                                 .sequence = feeder->sequence,
                                 .timestamp = {stamp_us / 1000000, stamp_us % 1000000}};
    for (size_t i = 0; i < feeder->frame_bytes; i++) {
        bytes[i] = (uint8_t)raw[i];
    }
    if (fault == FEEDER_DAMAGED) {
        memset(bytes, 255, feeder->frame_bytes / 2);
        buffer.flags = V4L2_BUF_FLAG_ERROR;
    } else if (fault == FEEDER_TORN) {
        memset(bytes + feeder->frame_bytes / 2, 0, feeder->frame_bytes / 2);
        buffer.bytesused /= 2;
    }
    must(ioctl(feeder->video, VIDIOC_QBUF, &buffer), "VIDIOC_QBUF");
}

static enum feeder_fault fault_of(struct feeder *feeder)
{
    const struct feeder_injection *injection = feeder->injections;
    for (; injection && injection->pulse; injection++) {
        if (injection->pulse == feeder->pulses) {
            feeder->injected++;
            return injection->fault;
        }
    }
    return FEEDER_SOUND;
}

/* The exposure of the plan that a pulse was meant to be. */
static int64_t snap(const struct feeder *feeder, int64_t width_ns)
{
    const int64_t *exposures_ns = feeder->exposures_ns;
    int64_t middle_ns = (exposures_ns[0] + exposures_ns[1]) / 2;
    return exposures_ns[width_ns > middle_ns];
}

/* What the camera makes of a pulse. */
static void deliver(struct feeder *feeder, const struct feeder_line *line)
{
    int64_t exposure_ns = snap(feeder, line->fall_ns - line->rise_ns);
    int64_t end_ns = line->rise_ns + shutter_ns + exposure_ns;
    enum feeder_fault fault = fault_of(feeder);
    const uint8_t *levels = feeder->levels;
    if (fault == FEEDER_LATE) {
        end_ns += late_ns;
    } else if (fault == FEEDER_PREVIOUS) {
        levels = feeder->before;
        end_ns = line->rise_ns - early_ns;
    }
    feeder->sequence += fault == FEEDER_SKIPPED;
    light(feeder, levels);
    const uint16_t *raw = expose(feeder, exposure_ns);
    for (int i = 0; i < 1 + (fault == FEEDER_REPEATED) - (fault == FEEDER_LOST); i++) {
        write_frame(feeder, raw, end_ns, fault);
    }
    feeder->sequence++;
}

/* The pattern when the pulse was first seen. */
static void begin_watching(struct feeder *feeder)
{
    size_t points = (size_t)feeder->width * (size_t)feeder->height;
    uint8_t *levels = calloc(points, 1);
    TEST_ASSERT_NOT_NULL(levels);
    read_levels(feeder, levels);
    if (memcmp(levels, feeder->levels, points) != 0) {
        memcpy(feeder->before, feeder->levels, points);
        memcpy(feeder->levels, levels, points);
    }
    light(feeder, levels);
    feeder->watching = true;
    free(levels);
}

/* The pattern must have stayed on the glass. */
static void end_watching(struct feeder *feeder)
{
    int points = feeder->width * feeder->height;
    uint32_t *pixels = screen_read_region(feeder->screen, feeder->left, feeder->top, feeder->width,
                                          feeder->height);
    for (int i = 0; i < points; i++) {
        TEST_ASSERT_EQUAL_HEX32(feeder->levels[i] * 0x10101U, pixels[i]);
    }
    feeder->watching = false;
    free(pixels);
}

void feeder_step(struct feeder *feeder)
{
    struct feeder_line line;
    if (!read_line(feeder, &line)) {
        feeder->rises = 0; /* of the next chip */
        feeder->watching = false;
        return;
    }
    if (line.rises == feeder->rises) {
        return;
    }
    if (!feeder->watching) {
        begin_watching(feeder);
    }
    if (line.level == 0) {
        end_watching(feeder);
        feeder->missed += line.rises - feeder->rises - 1;
        feeder->rises = line.rises;
        feeder->pulses++;
        deliver(feeder, &line);
    }
}
