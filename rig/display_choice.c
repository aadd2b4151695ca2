/* Choosing cards, connectors and modes. */
#include "rig/display_choice.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Modes whose refresh is farther than this from the wanted one are others: 59.94 does for 60. */
static const double refresh_reach_hz = 0.5;

/* A list in a message ends after so many entries. */
enum { LISTED = 12 };

struct list {
    char text[400];
    size_t count;
};

static void add(struct list *list, const char *entry)
{
    size_t used = strlen(list->text);
    if (list->count < LISTED) {
        (void)snprintf(list->text + used, sizeof list->text - used, "%s%s",
                       list->count > 0 ? ", " : "", entry);
    } else if (list->count == LISTED) {
        (void)snprintf(list->text + used, sizeof list->text - used, ", ...");
    }
    list->count++;
}

static int read_size(const char **text)
{
    char *end = NULL;
    long value = **text >= '0' && **text <= '9' ? strtol(*text, &end, 10) : 0;
    if (end) {
        *text = end;
    }
    return value >= 1 && value <= 32767 ? (int)value : 0;
}

int display_mode_parse(const char *text, struct display_mode_wish *wish, struct nacre_error *error)
{
    const char *rest = text;
    *wish = (struct display_mode_wish){.width = read_size(&rest)};
    bool good = wish->width > 0 && *rest == 'x';
    rest += good;
    wish->height = good ? read_size(&rest) : 0;
    good = wish->height > 0;
    if (good && *rest == '@') {
        char *end = NULL;
        good = rest[1] >= '0' && rest[1] <= '9';
        wish->refresh_hz = good ? strtod(rest + 1, &end) : 0;
        good = wish->refresh_hz >= 1 && wish->refresh_hz <= 1000;
        rest = good ? end : rest;
    }
    if (!good || *rest != '\0') {
        return nacre_fail(error, "\"%s\" is no mode; write it as 1920x1080 or 1920x1080@60", text);
    }
    return NACRE_OK;
}

void display_mode_print(const struct display_mode *mode, char text[DISPLAY_MODE_TEXT])
{
    (void)snprintf(text, DISPLAY_MODE_TEXT, "%ux%u@%.5g", (unsigned)mode->timing.hdisplay,
                   (unsigned)mode->timing.vdisplay, mode->refresh_hz);
}

struct display_mode display_mode_of(const drmModeModeInfo *timing)
{
    double pixels = (double)timing->htotal * timing->vtotal;
    bool interlaced = timing->flags & DRM_MODE_FLAG_INTERLACE;
    bool doubled = timing->flags & DRM_MODE_FLAG_DBLSCAN;
    double lines =
        (interlaced ? 0.5 : 1) * (doubled ? 2 : 1) * (timing->vscan > 1 ? timing->vscan : 1);
    double refresh_hz =
        pixels > 0 && timing->clock > 0 ? timing->clock * 1e3 / (pixels * lines) : timing->vrefresh;
    return (struct display_mode){.timing = *timing, .refresh_hz = refresh_hz};
}

bool display_mode_is_whole(const struct display_mode *mode)
{
    return !(mode->timing.flags & (DRM_MODE_FLAG_INTERLACE | DRM_MODE_FLAG_DBLSCAN)) &&
           mode->timing.vscan <= 1 && mode->refresh_hz >= 1;
}

static const struct display_connector *find(const struct display_card *card, const char *name)
{
    for (size_t i = 0; i < card->connector_count; i++) {
        const struct display_connector *connector = &card->connectors[i];
        if (name ? strcmp(connector->name, name) == 0 : connector->connected) {
            return connector;
        }
    }
    return NULL;
}

int display_choose_card(const struct display_card *cards, size_t count, const char *connector,
                        size_t *chosen, struct nacre_error *error)
{
    struct list list = {.count = 0};
    *chosen = 0;
    for (size_t i = 0; i < count; i++) {
        if (find(&cards[i], connector)) {
            *chosen = i;
            return NACRE_OK;
        }
        for (size_t k = 0; k < cards[i].connector_count; k++) {
            char entry[DISPLAY_NAME];
            (void)snprintf(entry, sizeof entry, "%s of %s", cards[i].connectors[k].name,
                           cards[i].path);
            add(&list, entry);
        }
    }
    if (list.count == 0) {
        return nacre_fail(error, "projector: the machine has no graphics card with a connector; "
                                 "load its driver, and see that the kernel was not started with "
                                 "nomodeset");
    }
    if (connector) {
        return nacre_fail(error,
                          "projector %s: no graphics card has such a connector; there are %s; name "
                          "one of them as projector.egl.connector in the station file",
                          connector, list.text);
    }
    return nacre_fail(error,
                      "projector: none is connected; there are %s; plug the projector in and turn "
                      "it on",
                      list.text);
}

int display_choose_connector(const struct display_card *card, const char *name, size_t *chosen,
                             struct nacre_error *error)
{
    struct list all = {.count = 0};
    struct list connected = {.count = 0};
    *chosen = card->connector_count;
    for (size_t i = 0; i < card->connector_count; i++) {
        const struct display_connector *connector = &card->connectors[i];
        add(&all, connector->name);
        if (connector->connected) {
            add(&connected, connector->name);
        }
        if (name ? strcmp(connector->name, name) == 0 : connector->connected) {
            *chosen = i;
        }
    }
    if (!name && connected.count > 1) {
        return nacre_fail(
            error,
            "projector %s: several connectors are connected, %s; name the projector's "
            "as projector.egl.connector in the station file",
            card->path, connected.text);
    }
    if (*chosen < card->connector_count) {
        const struct display_connector *connector = &card->connectors[*chosen];
        return connector->connected
                   ? NACRE_OK
                   : nacre_fail(error,
                                "projector %s: nothing is connected to it; plug the projector in "
                                "and turn it on%s%s",
                                connector->name,
                                connected.count ? ", or name another connector; connected are "
                                                : "",
                                connected.text);
    }
    if (name) {
        return nacre_fail(
            error,
            "projector %s: the graphics card %s has no such connector; it has %s; name "
            "one of them as projector.egl.connector in the station file",
            name, card->path, all.count ? all.text : "none");
    }
    return nacre_fail(error, "projector %s: %s%s%s", card->path,
                      all.count ? "nothing is connected to " : "the graphics card has no connector",
                      all.text,
                      all.count ? "; plug the projector in and turn it on"
                                : "; name another as projector.egl.device in the station file");
}

/* How far the mode is from the wish; infinity if it is another. */
static double distance(const struct display_mode *mode, const struct display_mode_wish *wish)
{
    double hertz = wish->refresh_hz > 0 ? fabs(mode->refresh_hz - wish->refresh_hz) : 0;
    bool same = mode->timing.hdisplay == wish->width && mode->timing.vdisplay == wish->height;
    return same && hertz <= refresh_reach_hz && display_mode_is_whole(mode) ? hertz : INFINITY;
}

static int choose_wish(const struct display_connector *connector, const char *text, size_t *chosen,
                       struct nacre_error *error)
{
    struct display_mode_wish wish;
    struct list list = {.count = 0};
    double nearest = INFINITY;
    int status = display_mode_parse(text, &wish, error);
    if (status != NACRE_OK) {
        return nacre_fail_within(error, "projector %s: projector.egl.mode", connector->name);
    }
    for (size_t i = 0; i < connector->mode_count; i++) {
        const struct display_mode *mode = &connector->modes[i];
        char entry[DISPLAY_MODE_TEXT];
        double away = distance(mode, &wish);
        if (away < nearest) {
            nearest = away;
            *chosen = i;
        }
        if (display_mode_is_whole(mode)) {
            display_mode_print(mode, entry);
            add(&list, entry);
        }
    }
    if (nearest == INFINITY) {
        return nacre_fail(error,
                          "projector %s: has no mode %s; it has %s; name one of them as "
                          "projector.egl.mode in the station file",
                          connector->name, text, list.count ? list.text : "none");
    }
    return NACRE_OK;
}

int display_choose_mode(const struct display_connector *connector, const char *text, size_t *chosen,
                        struct nacre_error *error)
{
    size_t first = connector->mode_count;
    *chosen = 0;
    if (text) {
        return choose_wish(connector, text, chosen, error);
    }
    for (size_t i = connector->mode_count; i-- > 0;) {
        const struct display_mode *mode = &connector->modes[i];
        bool preferred = mode->timing.type & DRM_MODE_TYPE_PREFERRED;
        if (display_mode_is_whole(mode) &&
            (preferred || first == connector->mode_count ||
             !(connector->modes[first].timing.type & DRM_MODE_TYPE_PREFERRED))) {
            first = i;
        }
    }
    if (first == connector->mode_count) {
        return nacre_fail(error,
                          "projector %s: tells no mode that is not interlaced; look at its cable",
                          connector->name);
    }
    *chosen = first;
    return NACRE_OK;
}

bool display_region_fits(const struct display_region *region, int frame_width, int frame_height)
{
    return region->left >= 0 && region->top >= 0 && region->width >= 1 && region->height >= 1 &&
           region->width <= frame_width && region->height <= frame_height &&
           region->left <= frame_width - region->width &&
           region->top <= frame_height - region->height;
}
