/* Taking a display and flipping its pictures. */
#include "rig/display_kms.h"

#include "rig/display_list.h"
#include "rig/display_property.h"
#include "rig/holder.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xf86drm.h>

/* A flip takes a refresh or two; a driver that needs longer than this does not do it. */
static const int64_t flip_limit_ns = 1000000000;

struct display {
    struct clock *clock;
    int file;
    char name[DISPLAY_NAME];
    char path[DISPLAY_PATH];
    uint32_t connector, crtc, plane;
    struct display_mode mode;
    drmModeCrtc *former; /* what the CRTC showed */
    struct display_changes changes;
    bool changed;    /* `changes` are made */
    bool set;        /* our mode is set */
    uint32_t shown;  /* framebuffer */
    uint64_t serial; /* of the last flip */
};

static int fail_open(const char *path, int number, struct nacre_error *error)
{
    switch (number) {
    case EACCES:
    case EPERM:
        return display_fail_open(path, error);
    case ENOENT:
    case ENXIO:
    case ENODEV:
        return nacre_fail(error,
                          "projector %s: is not there; load the graphics card's driver, or name "
                          "another as projector.egl.device in the station file",
                          path);
    default:
        return nacre_fail_errno(error, number, "projector %s: cannot be opened", path);
    }
}

/* Find the node of the card that is meant. */
static int choose_path(const struct display_settings *settings, char *path, size_t size,
                       struct nacre_error *error)
{
    struct display_card *cards = NULL;
    size_t count = 0;
    size_t chosen = 0;
    char refused[DISPLAY_PATH];
    if (settings->device) {
        (void)snprintf(path, size, "%s", settings->device);
        return NACRE_OK;
    }
    int status = display_cards_list(&cards, &count, refused, sizeof refused, error);
    if (status == NACRE_OK) {
        status = display_choose_card(cards, count, settings->connector, &chosen, error);
        if (status != NACRE_OK && refused[0]) {
            status = fail_open(refused, EACCES, error);
        }
    }
    if (status == NACRE_OK) {
        (void)snprintf(path, size, "%s", cards[chosen].path);
    }
    display_cards_free(cards, count);
    return status;
}

/* Be the one who may set modes. */
static int take(const struct display *display, struct nacre_error *error)
{
    char holder[80];
    if (drmIsMaster(display->file) || drmSetMaster(display->file) == 0) {
        return NACRE_OK;
    }
    holder_find(display->path, holder, sizeof holder);
    return nacre_fail(error,
                      "projector %s: is in use by %s; stop that, or give the projector a graphics "
                      "card of its own",
                      display->path, holder);
}

static int check_driver(const struct display *display, struct nacre_error *error)
{
    uint64_t monotonic = 0;
    if (drmGetCap(display->file, DRM_CAP_TIMESTAMP_MONOTONIC, &monotonic) != 0 || monotonic == 0) {
        return nacre_fail(error,
                          "projector %s: its driver does not stamp flips by the monotonic clock; "
                          "use another card or kernel",
                          display->path);
    }
    return NACRE_OK;
}

static int choose(struct display *display, const struct display_settings *settings,
                  struct nacre_error *error)
{
    struct display_card card = {.connector_count = 0};
    size_t connector = 0;
    size_t mode = 0;
    int number = display_card_read(display->file, display->path, &card);
    int status = NACRE_OK;
    if (number != 0) {
        status = nacre_fail(error,
                            "projector %s: is no graphics card that sets modes; name another as "
                            "projector.egl.device in the station file",
                            display->path);
        goto out;
    }
    status = display_choose_connector(&card, settings->connector, &connector, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = display_choose_mode(&card.connectors[connector], settings->mode, &mode, error);
    if (status != NACRE_OK) {
        goto out;
    }
    display->connector = card.connectors[connector].id;
    display->mode = card.connectors[connector].modes[mode];
    (void)snprintf(display->name, sizeof display->name, "projector %s (%s)",
                   card.connectors[connector].name, display->path);
out:
    display_card_finish(&card);
    return status;
}

/* The CRTC that feeds another connector, or 0. */
static uint32_t crtc_of(int file, uint32_t connector)
{
    uint32_t crtc = 0;
    drmModeConnector *found = drmModeGetConnectorCurrent(file, connector);
    drmModeEncoder *encoder =
        found && found->encoder_id ? drmModeGetEncoder(file, found->encoder_id) : NULL;
    if (encoder) {
        crtc = encoder->crtc_id;
    }
    drmModeFreeEncoder(encoder);
    drmModeFreeConnector(found);
    return crtc;
}

static bool is_taken(int file, const drmModeRes *resources, uint32_t crtc, uint32_t ours)
{
    bool taken = false;
    for (int i = 0; i < resources->count_connectors; i++) {
        taken = taken || (resources->connectors[i] != ours &&
                          crtc_of(file, resources->connectors[i]) == crtc);
    }
    return taken;
}

/* The bits of the CRTCs that can feed the connector. */
static uint32_t possible_crtcs(int file, uint32_t connector)
{
    uint32_t possible = 0;
    drmModeConnector *found = drmModeGetConnectorCurrent(file, connector);
    for (int i = 0; found && i < found->count_encoders; i++) {
        drmModeEncoder *encoder = drmModeGetEncoder(file, found->encoders[i]);
        possible |= encoder ? encoder->possible_crtcs : 0;
        drmModeFreeEncoder(encoder);
    }
    drmModeFreeConnector(found);
    return possible;
}

/* The CRTC that feeds our connector already, or else one that feeds none. */
static int choose_crtc(struct display *display, const drmModeRes *resources, int *index,
                       struct nacre_error *error)
{
    uint32_t possible = possible_crtcs(display->file, display->connector);
    uint32_t present = crtc_of(display->file, display->connector);
    for (int i = 0; i < resources->count_crtcs && i < 32; i++) {
        uint32_t crtc = resources->crtcs[i];
        bool good = possible >> i & 1 && (present == 0 || crtc == present) &&
                    !is_taken(display->file, resources, crtc, display->connector);
        if (good) {
            display->crtc = crtc;
            *index = i;
            return NACRE_OK;
        }
    }
    return nacre_fail(error,
                      "%s: the graphics card cannot feed one more display; disconnect another",
                      display->name);
}

static uint64_t plane_type(int file, uint32_t plane)
{
    uint64_t type = DRM_PLANE_TYPE_OVERLAY;
    drmModeObjectProperties *properties =
        drmModeObjectGetProperties(file, plane, DRM_MODE_OBJECT_PLANE);
    for (uint32_t i = 0; properties && i < properties->count_props; i++) {
        drmModePropertyRes *property = drmModeGetProperty(file, properties->props[i]);
        if (property && strcmp(property->name, "type") == 0) {
            type = properties->prop_values[i];
        }
        drmModeFreeProperty(property);
    }
    drmModeFreeObjectProperties(properties);
    return type;
}

/* Find the plane that modes are set on, and turn off those that lie above it. */
static void find_plane(struct display *display, int index)
{
    if (drmSetClientCap(display->file, DRM_CLIENT_CAP_UNIVERSAL_PLANES, 1) != 0) {
        return;
    }
    drmModePlaneRes *planes = drmModeGetPlaneResources(display->file);
    for (uint32_t i = 0; planes && i < planes->count_planes; i++) {
        drmModePlane *plane = drmModeGetPlane(display->file, planes->planes[i]);
        bool feeds = plane && plane->possible_crtcs >> index & 1;
        bool shows = plane && plane->crtc_id == display->crtc;
        bool primary =
            feeds && plane_type(display->file, plane->plane_id) == DRM_PLANE_TYPE_PRIMARY;
        if (primary && (display->plane == 0 || shows)) {
            display->plane = plane->plane_id;
        } else if (shows && !primary) {
            /* One that stays on is seen by the camera. */
            (void)drmModeSetPlane(display->file, plane->plane_id, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
        }
        drmModeFreePlane(plane);
    }
    drmModeFreePlaneResources(planes);
}

static int find_pipeline(struct display *display, struct nacre_error *error)
{
    int index = 0;
    drmModeRes *resources = drmModeGetResources(display->file);
    if (!resources) {
        return nacre_fail_errno(error, errno, "%s: cannot tell its CRTCs", display->name);
    }
    int status = choose_crtc(display, resources, &index, error);
    drmModeFreeResources(resources);
    if (status != NACRE_OK) {
        return status;
    }
    display->former = drmModeGetCrtc(display->file, display->crtc);
    find_plane(display, index);
    display_changes_make(display->file, display->connector, display->crtc, display->plane,
                         &display->changes);
    display->changed = true;
    return NACRE_OK;
}

int display_open(const struct display_settings *settings, struct clock *clock,
                 struct display **display, struct nacre_error *error)
{
    int status = NACRE_OK;
    struct display *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "a display");
        goto out;
    }
    made->clock = clock;
    made->file = -1;
    status = choose_path(settings, made->path, sizeof made->path, error);
    if (status != NACRE_OK) {
        goto out;
    }
    made->file = open(made->path, O_RDWR | O_CLOEXEC | O_NONBLOCK);
    if (made->file < 0) {
        status = fail_open(made->path, errno, error);
        goto out;
    }
    status = choose(made, settings, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = take(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check_driver(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = find_pipeline(made, error);
out:
    if (status != NACRE_OK) {
        display_close(made);
        made = NULL;
    }
    *display = made;
    return status;
}

/* Show what was shown before; what has gone meanwhile stays dark. */
static void restore(struct display *display)
{
    const drmModeCrtc *former = display->former;
    uint32_t connector = display->connector;
    drmModeModeInfo mode = {0};
    bool showed = former && former->mode_valid && former->buffer_id != 0;
    if (showed) {
        mode = former->mode;
    }
    if (!showed || drmModeSetCrtc(display->file, display->crtc, former->buffer_id, former->x,
                                  former->y, &connector, 1, &mode) != 0) {
        (void)drmModeSetCrtc(display->file, display->crtc, 0, 0, 0, NULL, 0, NULL);
    }
}

void display_close(struct display *display)
{
    if (!display) {
        return;
    }
    if (display->changed) {
        display_changes_undo(display->file, &display->changes);
        restore(display);
    }
    drmModeFreeCrtc(display->former);
    if (display->file >= 0) {
        (void)close(display->file); /* gives the display to others, too */
    }
    free(display);
}

int display_file(const struct display *display)
{
    return display->file;
}

const char *display_name(const struct display *display)
{
    return display->name;
}

const struct display_mode *display_mode(const struct display *display)
{
    return &display->mode;
}

int64_t display_refresh_ns(const struct display *display)
{
    return llround(1e9 / display->mode.refresh_hz);
}

const char *display_remarks(const struct display *display)
{
    return display->changes.remarks;
}

/* Whether the kernel knows the connector as connected; it does not look anew. */
static bool is_connected(const struct display *display)
{
    drmModeConnector *found = drmModeGetConnectorCurrent(display->file, display->connector);
    bool connected = found && found->connection != DRM_MODE_DISCONNECTED;
    drmModeFreeConnector(found);
    return connected;
}

/* Fail for a call that was refused, or that did not come about, and say so if the display is gone. */
static int fail_call(struct display *display, int number, const char *what,
                     struct nacre_error *error)
{
    display->set = false;
    if (number == ENODEV || !is_connected(display)) {
        return nacre_fail(error, "%s: was unplugged; plug it in again", display->name);
    }
    if (number == EACCES || number == EPERM) {
        char holder[80];
        holder_find(display->path, holder, sizeof holder);
        return nacre_fail(error, "%s: was taken by %s; stop that", display->name, holder);
    }
    return nacre_fail_errno(error, number, "%s: %s", display->name, what);
}

/* Take the event of our flip out of what was read; earlier ones may come late. */
static bool find_event(const char *bytes, size_t size, uint64_t serial, struct display_flip *flip)
{
    struct drm_event_vblank event;
    bool found = false;
    for (size_t at = 0; at + sizeof event.base <= size; at += event.base.length) {
        memcpy(&event.base, bytes + at, sizeof event.base);
        if (event.base.length < sizeof event.base || event.base.length > size - at) {
            break;
        }
        if (event.base.type != DRM_EVENT_FLIP_COMPLETE || event.base.length < sizeof event) {
            continue;
        }
        memcpy(&event, bytes + at, sizeof event);
        if (event.user_data == serial) {
            found = true;
            *flip = (struct display_flip){.stamp_ns = (int64_t)event.tv_sec * 1000000000 +
                                                      (int64_t)event.tv_usec * 1000,
                                          .sequence = event.sequence,
                                          .counted = event.sequence != 0};
        }
    }
    return found;
}

/* Wait for the flip's event; 0 or errno. */
static int wait_for(const struct display *display, struct display_flip *flip)
{
    char bytes[1024];
    int64_t end_ns = clock_now_ns(display->clock) + flip_limit_ns;
    for (;;) {
        int64_t left_ns = end_ns - clock_now_ns(display->clock);
        struct pollfd wanted = {.fd = display->file, .events = POLLIN};
        if (left_ns <= 0) {
            return ETIMEDOUT;
        }
        int found = poll(&wanted, 1, (int)(left_ns / 1000000) + 1);
        if (found < 0 && errno != EINTR) {
            return errno;
        }
        if (found > 0 && wanted.revents & (POLLERR | POLLHUP | POLLNVAL)) {
            return ENODEV;
        }
        ssize_t size = found > 0 ? read(display->file, bytes, sizeof bytes) : 0;
        if (size < 0 && errno != EAGAIN && errno != EINTR) {
            return errno;
        }
        if (size > 0 && find_event(bytes, (size_t)size, display->serial, flip)) {
            return 0;
        }
    }
}

static int set_mode(struct display *display, uint32_t framebuffer, struct nacre_error *error)
{
    int result = drmModeSetCrtc(display->file, display->crtc, framebuffer, 0, 0,
                                &display->connector, 1, &display->mode.timing);
    if (result != 0) {
        return fail_call(display, errno, "its driver refuses the mode", error);
    }
    /* A pointer that another program left there. */
    (void)drmModeSetCursor(display->file, display->crtc, 0, 0, 0);
    display->set = true;
    return NACRE_OK;
}

int display_check(struct display *display, struct nacre_error *error)
{
    drmModeCrtc *crtc = drmModeGetCrtc(display->file, display->crtc);
    if (!crtc) {
        return fail_call(display, errno, "cannot tell what it shows", error);
    }
    bool ours = crtc->mode_valid && crtc->buffer_id == display->shown;
    drmModeFreeCrtc(crtc);
    if (!is_connected(display)) {
        display->set = false;
        return nacre_fail(error, "%s: was unplugged; plug it in again", display->name);
    }
    if (!ours) {
        display->set = false;
        return nacre_fail(error, "%s: another program has put its own picture there; stop it",
                          display->name);
    }
    return NACRE_OK;
}

int display_flip(struct display *display, uint32_t framebuffer, struct display_flip *flip,
                 struct nacre_error *error)
{
    int status = NACRE_OK;
    if (!is_connected(display)) {
        display->set = false;
        return nacre_fail(error, "%s: was unplugged; plug it in again", display->name);
    }
    if (!display->set) {
        status = set_mode(display, framebuffer, error);
        if (status != NACRE_OK) {
            return status;
        }
    }
    int64_t began_ns = clock_now_ns(display->clock);
    display->serial++;
    /* NOLINTNEXTLINE(performance-no-int-to-ptr): it is a number for the kernel to give back */
    if (drmModePageFlip(display->file, display->crtc, framebuffer, DRM_MODE_PAGE_FLIP_EVENT,
                        (void *)(uintptr_t)display->serial) != 0) {
        return fail_call(display, errno, "its driver does not flip pictures", error);
    }
    int number = wait_for(display, flip);
    if (number != 0) {
        return fail_call(display, number, "does not tell that it has flipped its picture", error);
    }
    /* Stamps are of the refresh, which may have begun a moment ago, but never of one before. */
    if (flip->stamp_ns < began_ns - display_refresh_ns(display)) {
        return nacre_fail(error,
                          "%s: its flip is stamped %" PRId64
                          " ms before it was asked for; use another driver",
                          display->name, (began_ns - flip->stamp_ns) / 1000000);
    }
    display->shown = framebuffer;
    return display_check(display, error);
}
