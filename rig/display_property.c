/* Properties of connectors, CRTCs and planes. */
#include "rig/display_property.h"

#include <errno.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

/* What a property must be: a word of an enumeration, or a number. */
struct demand {
    uint32_t object_type;
    const char *name;
    const char *word;
    uint64_t value;
    const char *meaning; /* of a refusal */
};

static const struct demand demands[] = {
    {DRM_MODE_OBJECT_CRTC, "DEGAMMA_LUT", NULL, 0, "levels may go through a colour table"},
    {DRM_MODE_OBJECT_CRTC, "CTM", NULL, 0, "colours may be mixed"},
    {DRM_MODE_OBJECT_CRTC, "GAMMA_LUT", NULL, 0, "levels may go through a colour table"},
    {DRM_MODE_OBJECT_CRTC, "VRR_ENABLED", NULL, 0, "the refresh may vary"},
    {DRM_MODE_OBJECT_CONNECTOR, "Broadcast RGB", "Full", 0, "levels may be sent in limited range"},
    {DRM_MODE_OBJECT_CONNECTOR, "Colorspace", "Default", 0, "the projector may change colours"},
    {DRM_MODE_OBJECT_CONNECTOR, "HDR_OUTPUT_METADATA", NULL, 0, "the projector may change levels"},
    {DRM_MODE_OBJECT_CONNECTOR, "content type", "Graphics", 0, "the projector may smooth pictures"},
    {DRM_MODE_OBJECT_CONNECTOR, "max bpc", NULL, 8, "levels may be dithered"},
    {DRM_MODE_OBJECT_CONNECTOR, "dithering mode", "off", 0, "levels may be dithered"},
    {DRM_MODE_OBJECT_CONNECTOR, "dither", "off", 0, "levels may be dithered"},
    {DRM_MODE_OBJECT_CONNECTOR, "underscan", "off", 0, "pixels may be scaled"},
    {DRM_MODE_OBJECT_CONNECTOR, "scaling mode", "None", 0, "pixels may be scaled"},
    {DRM_MODE_OBJECT_PLANE, "rotation", NULL, DRM_MODE_ROTATE_0, "the picture may be turned"},
    {DRM_MODE_OBJECT_PLANE, "alpha", NULL, 0xffff, "levels may be lowered"},
};

static void remark(struct display_changes *changes, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

static void remark(struct display_changes *changes, const char *format, ...)
{
    size_t used = strlen(changes->remarks);
    va_list arguments;
    if (used > 0) {
        (void)snprintf(changes->remarks + used, sizeof changes->remarks - used, "; ");
        used = strlen(changes->remarks);
    }
    va_start(arguments, format);
    /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): it is initialized */
    (void)vsnprintf(changes->remarks + used, sizeof changes->remarks - used, format, arguments);
    va_end(arguments);
}

/* The number that stands for a demand's word, or nearest to its number. */
static bool wanted_value(const drmModePropertyRes *property, const struct demand *demand,
                         uint64_t *value)
{
    *value = demand->value;
    if (!demand->word) {
        if (property->flags & DRM_MODE_PROP_RANGE && property->count_values == 2) {
            *value = *value < property->values[0] ? property->values[0] : *value;
            *value = *value > property->values[1] ? property->values[1] : *value;
        }
        return true;
    }
    for (int i = 0; i < property->count_enums; i++) {
        if (strcmp(property->enums[i].name, demand->word) == 0) {
            *value = property->enums[i].value;
            return true;
        }
    }
    return false;
}

/* Remember a property as it is; without memory for its bytes it is left off when all is set back. */
static void remember(int file, const struct demand *demand, uint32_t object,
                     const drmModePropertyRes *property, uint64_t value,
                     struct display_changes *changes)
{
    struct display_change change = {.object = object,
                                    .object_type = demand->object_type,
                                    .property = property->prop_id,
                                    .value = value};
    drmModePropertyBlobRes *blob = property->flags & DRM_MODE_PROP_BLOB && value != 0
                                       ? drmModeGetPropertyBlob(file, (uint32_t)value)
                                       : NULL;
    if (blob) {
        change.blob = malloc(blob->length);
        if (change.blob) {
            memcpy(change.blob, blob->data, blob->length);
            change.blob_size = blob->length;
        }
        drmModeFreePropertyBlob(blob);
    }
    if (changes->count < DISPLAY_CHANGES) {
        changes->list[changes->count++] = change;
    } else {
        free(change.blob);
    }
}

static void meet(int file, const struct demand *demand, uint32_t object,
                 const drmModePropertyRes *property, uint64_t value,
                 struct display_changes *changes)
{
    uint64_t wanted;
    if (property->flags & DRM_MODE_PROP_IMMUTABLE) {
        return;
    }
    if (!wanted_value(property, demand, &wanted)) {
        remark(changes, "its \"%s\" cannot be %s: %s", demand->name, demand->word, demand->meaning);
        return;
    }
    if (wanted == value) {
        return;
    }
    remember(file, demand, object, property, value, changes);
    if (drmModeObjectSetProperty(file, object, demand->object_type, property->prop_id, wanted) !=
        0) {
        remark(changes, "its driver does not change \"%s\" (%s): %s", demand->name, strerror(errno),
               demand->meaning);
    }
}

/* Go through an object's properties; whether it has one called `sought`. */
static bool meet_all(int file, uint32_t object, uint32_t object_type, const char *sought,
                     struct display_changes *changes)
{
    bool found = false;
    drmModeObjectProperties *properties = drmModeObjectGetProperties(file, object, object_type);
    for (uint32_t i = 0; properties && i < properties->count_props; i++) {
        drmModePropertyRes *property = drmModeGetProperty(file, properties->props[i]);
        for (size_t k = 0; property && k < sizeof demands / sizeof *demands; k++) {
            if (demands[k].object_type == object_type &&
                strcmp(demands[k].name, property->name) == 0) {
                meet(file, &demands[k], object, property, properties->prop_values[i], changes);
            }
        }
        found = found || (property && strcmp(property->name, sought) == 0);
        drmModeFreeProperty(property);
    }
    drmModeFreeObjectProperties(properties);
    return found;
}

/* A straight table for a CRTC that has one but no property for it. */
static void straighten(int file, uint32_t crtc, struct display_changes *changes)
{
    drmModeCrtc *found = drmModeGetCrtc(file, crtc);
    uint32_t size = found && found->gamma_size > 1 ? (uint32_t)found->gamma_size : 0;
    drmModeFreeCrtc(found);
    uint16_t *straight = size > 0 ? calloc(size, sizeof *straight) : NULL;
    uint16_t *former = size > 0 ? calloc((size_t)3 * size, sizeof *former) : NULL;
    if (straight && former &&
        drmModeCrtcGetGamma(file, crtc, size, former, former + size, former + (size_t)2 * size) ==
            0) {
        changes->gamma = former;
        changes->gamma_size = size;
        changes->crtc = crtc;
        former = NULL;
    }
    for (uint32_t i = 0; straight && i < size; i++) {
        straight[i] = (uint16_t)(i * UINT64_C(65535) / (size - 1));
    }
    if (size > 0 &&
        (!straight || drmModeCrtcSetGamma(file, crtc, size, straight, straight, straight) != 0)) {
        remark(changes, "its driver does not straighten its gamma table: levels may go through it");
    }
    free(straight);
    free(former);
}

void display_changes_make(int file, uint32_t connector, uint32_t crtc, uint32_t plane,
                          struct display_changes *changes)
{
    *changes = (struct display_changes){.count = 0};
    if (!meet_all(file, crtc, DRM_MODE_OBJECT_CRTC, "GAMMA_LUT", changes)) {
        straighten(file, crtc, changes);
    }
    if (!meet_all(file, connector, DRM_MODE_OBJECT_CONNECTOR, "Broadcast RGB", changes)) {
        remark(changes,
               "its driver has no \"Broadcast RGB\": see that levels are sent and taken in "
               "full range");
    }
    if (plane != 0) {
        (void)meet_all(file, plane, DRM_MODE_OBJECT_PLANE, "", changes);
    }
}

void display_changes_undo(int file, struct display_changes *changes)
{
    while (changes->count > 0) {
        struct display_change *change = &changes->list[--changes->count];
        uint32_t blob = 0;
        if (change->blob &&
            drmModeCreatePropertyBlob(file, change->blob, change->blob_size, &blob) == 0) {
            change->value = blob;
        }
        /* Blobs without bytes are gone; what a driver refuses now it refused before. */
        (void)drmModeObjectSetProperty(file, change->object, change->object_type, change->property,
                                       change->value);
        if (blob != 0) {
            (void)drmModeDestroyPropertyBlob(file, blob); /* the driver holds it */
        }
        free(change->blob);
        change->blob = NULL;
    }
    if (changes->gamma) {
        (void)drmModeCrtcSetGamma(file, changes->crtc, changes->gamma_size, changes->gamma,
                                  changes->gamma + changes->gamma_size,
                                  changes->gamma + (size_t)2 * changes->gamma_size);
        free(changes->gamma);
        changes->gamma = NULL;
    }
}
