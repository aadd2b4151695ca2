/* A camera of the kernel's vivid driver, whose pictures are known and which fails when it is told to. */
#ifndef TESTS_LAB_VIVID_H
#define TESTS_LAB_VIVID_H

enum vivid_pattern {
    VIVID_BLACK = 5,
    VIVID_WHITE = 6,
    VIVID_RED = 7,
    VIVID_GREEN = 8,
    VIVID_BLUE = 9
};

struct vivid {
    char path[32]; /* of the device node */
};

/* Plug in a webcam by module `vivid`, or `vivid-exposure` which has a control for it; `options` are the module's. It
 * shows flat pictures without text. */
struct vivid vivid_plug(const char *module, const char *options);
void vivid_unplug(struct vivid *camera); /* one that is not plugged in is left alone */

/* A control by its name in the driver. */
int vivid_get(const struct vivid *camera, const char *name);
void vivid_set(const struct vivid *camera, const char *name, int value);

#endif
