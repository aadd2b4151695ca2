/* Asking V4L2 for cameras. */
#include "rig/camera_list.h"

#include "rig/camera_stream.h"

#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

static void list_formats(int file, uint32_t type, struct camera_listed *camera)
{
    struct v4l2_fmtdesc listed = {.type = type};
    for (; ioctl(file, VIDIOC_ENUM_FMT, &listed) == 0; listed.index++) {
        const struct camera_format *format = camera_format_of(listed.pixelformat);
        if (format && camera->format_count < CAMERA_LISTED_FORMATS) {
            camera->formats[camera->format_count++] = format;
        }
    }
}

/* Whether the node is one of a camera, as far as it can be told. */
static bool look_at(const char *path, struct camera_listed *camera)
{
    struct v4l2_capability found = {.version = 0};
    int file = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    *camera = (struct camera_listed){.format_count = 0};
    (void)snprintf(camera->path, sizeof camera->path, "%s", path);
    if (file < 0) {
        (void)camera_fail_open(path, errno, &camera->problem);
        return true;
    }
    bool pictures = ioctl(file, VIDIOC_QUERYCAP, &found) == 0;
    uint32_t can =
        found.capabilities & V4L2_CAP_DEVICE_CAPS ? found.device_caps : found.capabilities;
    pictures = pictures && can & V4L2_CAP_STREAMING &&
               can & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE);
    if (pictures) {
        (void)snprintf(camera->card, sizeof camera->card, "%.32s", (const char *)found.card);
        list_formats(file,
                     can & V4L2_CAP_VIDEO_CAPTURE_MPLANE ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE
                                                         : V4L2_BUF_TYPE_VIDEO_CAPTURE,
                     camera);
    }
    (void)close(file);
    return pictures;
}

int camera_list(struct camera_listed **cameras, size_t *count, struct nacre_error *error)
{
    glob_t nodes = {0};
    int status = NACRE_OK;
    *count = 0;
    (void)glob("/dev/video[0-9]*", 0, NULL, &nodes); /* no match leaves no paths */
    *cameras = calloc(nodes.gl_pathc + 1, sizeof **cameras);
    if (!*cameras) {
        status = nacre_fail_memory(error, "the list of cameras");
        goto out;
    }
    for (size_t i = 0; i < nodes.gl_pathc; i++) {
        *count += look_at(nodes.gl_pathv[i], &(*cameras)[*count]);
    }
out:
    globfree(&nodes);
    return status;
}
