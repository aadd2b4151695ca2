/* Asking the kernel for cards, connectors and modes. */
#include "rig/display_list.h"

#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xf86drm.h>

static int read_connector(int file, uint32_t id, struct display_connector *made)
{
    /* Looks at the connector anew, where we may. */
    drmModeConnector *found = drmModeGetConnector(file, id);
    if (!found) {
        return errno;
    }
    const char *type = drmModeGetConnectorTypeName(found->connector_type);
    size_t count = found->count_modes > 0 ? (size_t)found->count_modes : 0;
    *made = (struct display_connector){.id = id,
                                       .connected = found->connection == DRM_MODE_CONNECTED,
                                       .modes = calloc(count + 1, sizeof *made->modes)};
    (void)snprintf(made->name, sizeof made->name, "%s-%u", type ? type : "Unknown",
                   found->connector_type_id);
    if (made->modes) {
        made->mode_count = count;
        for (size_t i = 0; i < count; i++) {
            made->modes[i] = display_mode_of(&found->modes[i]);
        }
    }
    drmModeFreeConnector(found);
    return made->modes ? 0 : ENOMEM;
}

int display_card_read(int file, const char *path, struct display_card *card)
{
    int number = 0;
    *card = (struct display_card){.connector_count = 0};
    (void)snprintf(card->path, sizeof card->path, "%s", path);
    drmVersion *version = drmGetVersion(file);
    drmModeRes *resources = version ? drmModeGetResources(file) : NULL;
    if (!resources) {
        number = errno ? errno : EINVAL;
        goto out;
    }
    (void)snprintf(card->driver, sizeof card->driver, "%s", version->name);
    size_t count = resources->count_connectors > 0 ? (size_t)resources->count_connectors : 0;
    card->connectors = calloc(count + 1, sizeof *card->connectors);
    number = card->connectors ? 0 : ENOMEM;
    for (size_t i = 0; i < count && number == 0; i++) {
        number = read_connector(file, resources->connectors[i], &card->connectors[i]);
        card->connector_count = i + 1;
    }
out:
    drmModeFreeResources(resources);
    drmFreeVersion(version);
    if (number != 0) {
        display_card_finish(card);
    }
    return number;
}

void display_card_finish(struct display_card *card)
{
    if (!card) {
        return;
    }
    for (size_t i = 0; i < card->connector_count; i++) {
        free(card->connectors[i].modes);
    }
    free(card->connectors);
    card->connectors = NULL;
    card->connector_count = 0;
}

/* "/dev/dri/card10" comes after "/dev/dri/card9". */
static int by_number(const void *a, const void *b)
{
    const char *one = *(char *const *)a;
    const char *other = *(char *const *)b;
    size_t lengths[] = {strlen(one), strlen(other)};
    return lengths[0] == lengths[1] ? strcmp(one, other) : lengths[0] < lengths[1] ? -1 : 1;
}

int display_cards_list(struct display_card **cards, size_t *count, char *refused, size_t size,
                       struct nacre_error *error)
{
    glob_t nodes = {0};
    int status = NACRE_OK;
    *cards = NULL;
    *count = 0;
    refused[0] = '\0';
    /* No match leaves no paths. */
    (void)glob("/dev/dri/card[0-9]*", 0, NULL, &nodes);
    if (nodes.gl_pathc > 1) {
        qsort(nodes.gl_pathv, nodes.gl_pathc, sizeof *nodes.gl_pathv, by_number);
    }
    *cards = calloc(nodes.gl_pathc + 1, sizeof **cards);
    if (!*cards) {
        status = nacre_fail_memory(error, "the list of graphics cards");
        goto out;
    }
    for (size_t i = 0; i < nodes.gl_pathc; i++) {
        int file = open(nodes.gl_pathv[i], O_RDWR | O_CLOEXEC);
        if (file < 0) {
            if (errno == EACCES || errno == EPERM) {
                (void)snprintf(refused, size, "%s", nodes.gl_pathv[i]);
            }
            continue;
        }
        /* A card that only draws has no connectors to tell of. */
        *count += display_card_read(file, nodes.gl_pathv[i], &(*cards)[*count]) == 0;
        (void)close(file);
    }
out:
    globfree(&nodes);
    return status;
}

void display_cards_free(struct display_card *cards, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        display_card_finish(&cards[i]);
    }
    free(cards);
}

int display_fail_open(const char *path, struct nacre_error *error)
{
    return nacre_fail(
        error,
        "projector %s: may not be opened; install udev/70-nacre-display.rules, and be "
        "in the group nacre",
        path);
}
