/* What a card may do to pixels on their way to a display, turned off. */
#ifndef RIG_DISPLAY_PROPERTY_H
#define RIG_DISPLAY_PROPERTY_H

#include <stddef.h>
#include <stdint.h>

/* One property that was changed, to be set back. */
struct display_change {
    uint32_t object, object_type, property;
    uint64_t value;
    void *blob; /* where the value is that of a blob: its bytes */
    uint32_t blob_size;
};

enum { DISPLAY_CHANGES = 24 };

struct display_changes {
    struct display_change list[DISPLAY_CHANGES];
    size_t count;
    uint16_t *gamma; /* the table of a CRTC without properties for it, [3][gamma_size] */
    uint32_t crtc;
    uint32_t gamma_size;
    char remarks[512]; /* sentences about what is not as it should be, split by "; " */
};

/* Let the card send what is drawn, unchanged and in full range: colour tables and matrices off, no dithering, scaling,
 * rotation or overlays. What the driver refuses is told in the remarks. plane 0: the driver has no planes. */
void display_changes_make(int file, uint32_t connector, uint32_t crtc, uint32_t plane,
                          struct display_changes *changes);

/* Set everything back, as far as the driver lets us, and free. */
void display_changes_undo(int file, struct display_changes *changes);

#endif
