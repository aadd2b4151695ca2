/* A projector on a connector of a graphics card, behind the projector seam: fullscreen, without a window system. */
#ifndef RIG_PROJECTOR_EGL_H
#define RIG_PROJECTOR_EGL_H

#include "base/clock.h"
#include "rig/display_kms.h"
#include "rig/projector.h"

struct projector_egl_settings {
    struct display_settings display;
    struct display_region region; /* of the sample in the projector's picture */
    int64_t
        latency_ns; /* from the refresh that begins to send a pattern until it is whole on the glass */
    int64_t period_ns; /* one turn of the colour wheel */
};

/* What became of the settings, for a person to read. */
struct projector_egl_info {
    char name[DISPLAY_NAME]; /* "projector HDMI-A-1 (/dev/dri/card0)" */
    char mode[DISPLAY_MODE_TEXT];
    char renderer[128]; /* what draws */
    int64_t refresh_ns;
    bool
        counted; /* false: the driver counts no refreshes, and each pattern gets one more refresh to appear */
    const char *remarks; /* what the driver did not let us set; may be empty */
};

/* Take the display and make it black. A projector that was unplugged is told so by `show`, and shows again once it is
 * back. `clock` is the system's monotonic one; nothing of `settings` is kept. */
int projector_egl_new(const struct projector_egl_settings *settings, struct clock *clock,
                      struct projector **projector, struct nacre_error *error);

/* The projector must be one of projector_egl_new, which keeps the texts. */
struct projector_egl_info projector_egl_info(const struct projector *projector);

#endif
