/* Cameras of vivid. */
#include "vivid.h"

#include "guest.h"
#include "unity.h"

#include <fcntl.h>
#include <glob.h>
#include <linux/videodev2.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

static const char *loaded;

struct vivid vivid_plug(const char *module, const char *options)
{
    struct vivid camera;
    glob_t nodes;
    guest_run("modprobe %s n_devs=1 node_types=0x1 num_inputs=1 input_types=0 %s", module, options);
    loaded = module;
    TEST_ASSERT_EQUAL_INT(0, glob("/dev/video*", 0, NULL, &nodes));
    (void)snprintf(camera.path, sizeof camera.path, "%s", nodes.gl_pathv[0]);
    globfree(&nodes);
    vivid_set(&camera, "OSD Text Mode", 2);
    return camera;
}

void vivid_unplug(struct vivid *camera)
{
    if (camera->path[0]) {
        guest_run("rmmod %s", loaded);
        guest_wait_for(camera->path, false);
        camera->path[0] = '\0';
    }
}

/* Do `request` with a control; its value afterwards. */
static int control(const struct vivid *camera, const char *name, unsigned long request, int value)
{
    struct v4l2_queryctrl query = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
    int file = open(camera->path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    TEST_ASSERT_TRUE_MESSAGE(file >= 0, camera->path);
    bool found = false;
    while (!found && ioctl(file, VIDIOC_QUERYCTRL, &query) == 0) {
        found = strcmp((const char *)query.name, name) == 0;
        query.id |= found ? 0 : V4L2_CTRL_FLAG_NEXT_CTRL;
    }
    struct v4l2_control chosen = {.id = query.id, .value = value};
    found = found && ioctl(file, request, &chosen) == 0;
    (void)close(file);
    TEST_ASSERT_TRUE_MESSAGE(found, name);
    return chosen.value;
}

void vivid_set(const struct vivid *camera, const char *name, int value)
{
    (void)control(camera, name, VIDIOC_S_CTRL, value);
}

int vivid_get(const struct vivid *camera, const char *name)
{
    return control(camera, name, VIDIOC_G_CTRL, 0);
}
