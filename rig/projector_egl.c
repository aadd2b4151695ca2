/* The projector on a graphics card. */
#include "rig/projector_egl.h"

#include "rig/display_gl.h"

#include <stdio.h>
#include <stdlib.h>

struct egl_projector {
    struct projector base;
    struct clock *clock;
    struct display *display;
    struct display_gl *gl;
    int64_t latency_ns;
    bool counted;
};

/* Draw, flip and tell when the whole picture will be on the glass. */
static int put(struct egl_projector *projector, const uint8_t *levels, int64_t *flip_ns,
               struct nacre_error *error)
{
    uint32_t framebuffer = 0;
    struct display_flip flip;
    int status = display_gl_draw(projector->gl, levels, &framebuffer, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = display_flip(projector->display, framebuffer, &flip, error);
    if (status != NACRE_OK) {
        return status;
    }
    /* Nobody knows when the refresh after an uncounted flip begins, only that it does within one. */
    *flip_ns = flip.stamp_ns + projector->latency_ns +
               (flip.counted ? 0 : display_refresh_ns(projector->display));
    projector->counted = flip.counted;
    return NACRE_OK;
}

static int show(struct projector *base, const uint8_t *levels, int64_t *flip_ns,
                struct nacre_error *error)
{
    struct egl_projector *projector = (struct egl_projector *)base;
    int status = put(projector, levels, flip_ns, error);
    if (status == NACRE_OK) {
        clock_sleep_until_ns(projector->clock, *flip_ns);
    }
    return status;
}

static int confirm(struct projector *base, struct nacre_error *error)
{
    return display_check(((struct egl_projector *)base)->display, error);
}

static void projector_close(struct projector *base)
{
    struct egl_projector *projector = (struct egl_projector *)base;
    display_gl_free(projector->gl);
    display_close(projector->display);
    free(projector);
}

static int check_region(const struct egl_projector *projector, const struct display_region *region,
                        struct nacre_error *error)
{
    const struct display_mode *mode = display_mode(projector->display);
    char text[DISPLAY_MODE_TEXT];
    if (display_region_fits(region, mode->timing.hdisplay, mode->timing.vdisplay)) {
        return NACRE_OK;
    }
    display_mode_print(mode, text);
    return nacre_fail(
        error,
        "%s: %d x %d pixels from (%d, %d) on do not lie in its picture of %s; correct "
        "projector.egl.left, top or mode, or sample.width or height",
        display_name(projector->display), region->width, region->height, region->left, region->top,
        text);
}

/* The first flip sets the mode and the second tells whether refreshes are counted. */
static int blank(struct egl_projector *projector, struct nacre_error *error)
{
    int64_t flip_ns;
    int status = put(projector, NULL, &flip_ns, error);
    return status == NACRE_OK ? put(projector, NULL, &flip_ns, error) : status;
}

int projector_egl_new(const struct projector_egl_settings *settings, struct clock *clock,
                      struct projector **projector, struct nacre_error *error)
{
    static const struct projector_ops ops = {
        .name = "egl", .show = show, .confirm = confirm, .close = projector_close};
    const struct display_region *region = &settings->region;
    int status = NACRE_OK;
    struct egl_projector *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "a projector");
        goto out;
    }
    made->base = (struct projector){&ops, region->width, region->height, settings->period_ns};
    made->clock = clock;
    made->latency_ns = settings->latency_ns;
    status = display_open(&settings->display, clock, &made->display, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = check_region(made, region, error);
    if (status != NACRE_OK) {
        goto out;
    }
    const struct display_mode *mode = display_mode(made->display);
    status = display_gl_new(display_file(made->display), display_name(made->display),
                            mode->timing.hdisplay, mode->timing.vdisplay, region, &made->gl, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = blank(made, error);
out:
    if (status != NACRE_OK && made) {
        projector_close(&made->base);
        made = NULL;
    }
    *projector = made ? &made->base : NULL;
    return status;
}

struct projector_egl_info projector_egl_info(const struct projector *projector)
{
    const struct egl_projector *own = (const struct egl_projector *)projector;
    struct projector_egl_info info = {.refresh_ns = display_refresh_ns(own->display),
                                      .counted = own->counted,
                                      .remarks = display_remarks(own->display)};
    (void)snprintf(info.name, sizeof info.name, "%s", display_name(own->display));
    (void)snprintf(info.renderer, sizeof info.renderer, "%s", display_gl_renderer(own->gl));
    display_mode_print(display_mode(own->display), info.mode);
    return info;
}
