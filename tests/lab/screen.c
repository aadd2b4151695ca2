/* Graphics cards of vkms and bochs. */
#include "screen.h"

#include "guest.h"
#include "unity.h"

#include <fcntl.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

static bool is_driven_by(const char *path, const char *driver)
{
    int file = open(path, O_RDWR | O_CLOEXEC);
    TEST_ASSERT_TRUE_MESSAGE(file >= 0, path);
    drmVersion *version = drmGetVersion(file);
    bool same = version && strcmp(version->name, driver) == 0;
    drmFreeVersion(version);
    (void)close(file);
    return same;
}

struct screen screen_plug(const char *module, const char *driver)
{
    struct screen screen = {.path = ""};
    glob_t nodes;
    guest_run("modprobe %s", module);
    (void)snprintf(screen.module, sizeof screen.module, "%s", module);
    TEST_ASSERT_EQUAL_INT(0, glob("/dev/dri/card*", 0, NULL, &nodes));
    for (size_t i = 0; i < nodes.gl_pathc; i++) {
        if (is_driven_by(nodes.gl_pathv[i], driver)) {
            (void)snprintf(screen.path, sizeof screen.path, "%s", nodes.gl_pathv[i]);
        }
    }
    globfree(&nodes);
    TEST_ASSERT_TRUE_MESSAGE(screen.path[0], driver);
    (void)snprintf(screen.status, sizeof screen.status, "/sys/class/drm/%.16s-Virtual-1/status",
                   strrchr(screen.path, '/') + 1);
    return screen;
}

void screen_unplug(struct screen *screen)
{
    if (screen->path[0]) {
        guest_run("rmmod %s", screen->module);
        guest_wait_for(screen->path, false);
        screen->path[0] = '\0';
    }
}

/* The framebuffer of the first CRTC that shows one. */
static drmModeFB2 *find_framebuffer(int file)
{
    drmModeFB2 *found = NULL;
    drmModeRes *resources = drmModeGetResources(file);
    TEST_ASSERT_NOT_NULL(resources);
    for (int i = 0; i < resources->count_crtcs && !found; i++) {
        drmModeCrtc *crtc = drmModeGetCrtc(file, resources->crtcs[i]);
        if (crtc && crtc->buffer_id != 0) {
            found = drmModeGetFB2(file, crtc->buffer_id);
        }
        drmModeFreeCrtc(crtc);
    }
    drmModeFreeResources(resources);
    return found;
}

/* A framebuffer that is shown, mapped. */
struct shown {
    int file;
    drmModeFB2 *buffer;
    const uint8_t *bytes;
    size_t size;
};

static struct shown map_shown(const struct screen *screen)
{
    struct shown shown = {.file = open(screen->path, O_RDWR | O_CLOEXEC)};
    TEST_ASSERT_TRUE_MESSAGE(shown.file >= 0, screen->path);
    shown.buffer = find_framebuffer(shown.file);
    TEST_ASSERT_NOT_NULL_MESSAGE(shown.buffer, "nothing is shown");
    struct drm_mode_map_dumb map = {.handle = shown.buffer->handles[0]};
    TEST_ASSERT_EQUAL_INT(0, drmIoctl(shown.file, DRM_IOCTL_MODE_MAP_DUMB, &map));
    shown.size = (size_t)shown.buffer->pitches[0] * shown.buffer->height;
    shown.bytes = mmap(NULL, shown.size, PROT_READ, MAP_SHARED, shown.file, (off_t)map.offset);
    TEST_ASSERT_TRUE(shown.bytes != MAP_FAILED);
    return shown;
}

static void unmap_shown(struct shown *shown)
{
    (void)munmap((void *)shown->bytes, shown->size);
    drmModeFreeFB2(shown->buffer);
    (void)close(shown->file);
}

static uint32_t *copy_pixels(const struct shown *shown, int left, int top, int width, int height)
{
    uint32_t *pixels = calloc((size_t)width * (size_t)height, sizeof *pixels);
    TEST_ASSERT_NOT_NULL(pixels);
    for (int y = 0; y < height; y++) {
        uint32_t *row = &pixels[(size_t)y * (size_t)width];
        memcpy(row,
               shown->bytes + shown->buffer->offsets[0] +
                   (size_t)(y + top) * shown->buffer->pitches[0] + (size_t)left * sizeof *row,
               (size_t)width * sizeof *row);
        for (int x = 0; x < width; x++) {
            row[x] &= 0xffffff; /* the fourth byte means nothing */
        }
    }
    return pixels;
}

uint32_t *screen_read(const struct screen *screen, int *width, int *height)
{
    struct shown shown = map_shown(screen);
    *width = (int)shown.buffer->width;
    *height = (int)shown.buffer->height;
    uint32_t *pixels = copy_pixels(&shown, 0, 0, *width, *height);
    unmap_shown(&shown);
    return pixels;
}

uint32_t *screen_read_region(const struct screen *screen, int left, int top, int width, int height)
{
    struct shown shown = map_shown(screen);
    TEST_ASSERT_TRUE(left + width <= (int)shown.buffer->width &&
                     top + height <= (int)shown.buffer->height);
    uint32_t *pixels = copy_pixels(&shown, left, top, width, height);
    unmap_shown(&shown);
    return pixels;
}

void screen_check(const uint32_t *pixels, int width, int height, const uint8_t *levels, int left,
                  int top, int w, int h)
{
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            bool inside = x >= left && x < left + w && y >= top && y < top + h;
            uint32_t level = inside ? levels[(y - top) * w + x - left] : 0;
            char place[32];
            if (pixels[y * width + x] != level * 0x10101) {
                (void)snprintf(place, sizeof place, "(%d, %d)", x, y);
                TEST_ASSERT_EQUAL_HEX32_MESSAGE(level * 0x10101, pixels[y * width + x], place);
            }
        }
    }
}

void screen_dark(const struct screen *screen)
{
    bool done = false;
    for (int file = 3; file < 64 && !done; file++) {
        char link[32];
        char target[64] = "";
        (void)snprintf(link, sizeof link, "/proc/self/fd/%d", file);
        done = readlink(link, target, sizeof target - 1) > 0 && strcmp(target, screen->path) == 0 &&
               drmIsMaster(file);
        if (done) {
            drmModeRes *resources = drmModeGetResources(file);
            TEST_ASSERT_NOT_NULL(resources);
            TEST_ASSERT_EQUAL_INT(
                0, drmModeSetCrtc(file, resources->crtcs[0], 0, 0, 0, NULL, 0, NULL));
            drmModeFreeResources(resources);
        }
    }
    TEST_ASSERT_TRUE_MESSAGE(done, "nobody here has the card");
}

/* A property, wherever it is. */
struct place {
    uint32_t object, type, property;
    uint64_t value;
};

static bool find_in(int file, uint32_t object, uint32_t type, const char *name, struct place *place)
{
    bool found = false;
    drmModeObjectProperties *all = drmModeObjectGetProperties(file, object, type);
    for (uint32_t i = 0; all && i < all->count_props; i++) {
        drmModePropertyRes *property = drmModeGetProperty(file, all->props[i]);
        if (property && strcmp(property->name, name) == 0) {
            *place = (struct place){object, type, property->prop_id, all->prop_values[i]};
            found = true;
        }
        drmModeFreeProperty(property);
    }
    drmModeFreeObjectProperties(all);
    return found;
}

static struct place find_property(int file, const char *name)
{
    struct place place = {0};
    drmModeRes *resources = drmModeGetResources(file);
    TEST_ASSERT_NOT_NULL(resources);
    bool found = find_in(file, resources->crtcs[0], DRM_MODE_OBJECT_CRTC, name, &place) ||
                 find_in(file, resources->connectors[0], DRM_MODE_OBJECT_CONNECTOR, name, &place);
    drmModeFreeResources(resources);
    TEST_ASSERT_TRUE_MESSAGE(found, name);
    return place;
}

static int open_card(const struct screen *screen)
{
    int file = open(screen->path, O_RDWR | O_CLOEXEC);
    TEST_ASSERT_TRUE_MESSAGE(file >= 0, screen->path);
    return file;
}

uint64_t screen_get(const struct screen *screen, const char *name)
{
    int file = open_card(screen);
    struct place place = find_property(file, name);
    (void)close(file);
    return place.value;
}

void screen_set(const struct screen *screen, const char *name, uint64_t value)
{
    int file = open_card(screen);
    struct place place = find_property(file, name);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        0, drmModeObjectSetProperty(file, place.object, place.type, place.property, value), name);
    (void)close(file);
}

void *screen_get_bytes(const struct screen *screen, const char *name, size_t *size)
{
    int file = open_card(screen);
    struct place place = find_property(file, name);
    drmModePropertyBlobRes *blob = drmModeGetPropertyBlob(file, (uint32_t)place.value);
    void *bytes = NULL;
    *size = blob ? blob->length : 0;
    if (blob) {
        bytes = malloc(blob->length);
        TEST_ASSERT_NOT_NULL(bytes);
        memcpy(bytes, blob->data, blob->length);
    }
    drmModeFreePropertyBlob(blob);
    (void)close(file);
    return bytes;
}

void screen_set_bytes(const struct screen *screen, const char *name, const void *bytes, size_t size)
{
    int file = open_card(screen);
    struct place place = find_property(file, name);
    uint32_t blob = 0;
    TEST_ASSERT_EQUAL_INT(0, drmModeCreatePropertyBlob(file, bytes, size, &blob));
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        0, drmModeObjectSetProperty(file, place.object, place.type, place.property, blob), name);
    (void)close(file);
}
