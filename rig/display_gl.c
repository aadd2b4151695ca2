/* OpenGL ES 2 on EGL on GBM. */
#include "rig/display_gl.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GLES2/gl2.h>
#include <drm_fourcc.h>
#include <errno.h>
#include <gbm.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xf86drm.h>

/* The region's corners are the texture's; its first row is the uppermost. */
static const char vertex_text[] =
    "attribute vec2 corner;\n"
    "varying vec2 place;\n"
    "void main() {\n"
    "    place = corner;\n"
    "    gl_Position = vec4(corner * vec2(2, -2) + vec2(-1, 1), 0, 1);\n"
    "}\n";
/* Half floats would not tell 2000 pixels apart. */
static const char fragment_text[] = "precision highp float;\n"
                                    "uniform sampler2D levels;\n"
                                    "varying vec2 place;\n"
                                    "void main() {\n"
                                    "    gl_FragColor = vec4(texture2D(levels, place).rrr, 1);\n"
                                    "}\n";

struct display_gl {
    char name[DISPLAY_NAME];
    char renderer[128];
    int file;
    int width, height;
    struct display_region region;
    struct gbm_device *gbm;
    struct gbm_surface *gbm_surface;
    EGLDisplay display;
    EGLConfig config;
    EGLContext context;
    EGLSurface surface;
    GLuint program, texture, vertices;
    struct gbm_bo *shown; /* the buffer given out last */
};

static int fail_egl(const struct display_gl *gl, const char *what, struct nacre_error *error)
{
    return nacre_fail(
        error,
        "%s: %s (EGL error 0x%04x); is Mesa with the card's driver installed (Debian: "
        "libgl1-mesa-dri)?",
        gl->name, what, (unsigned)eglGetError());
}

/* EGL is told of the pixel format by GBM's name for it. */
static int choose_config(struct display_gl *gl, struct nacre_error *error)
{
    static const EGLint wanted[] = {EGL_SURFACE_TYPE,
                                    EGL_WINDOW_BIT,
                                    EGL_RED_SIZE,
                                    8,
                                    EGL_GREEN_SIZE,
                                    8,
                                    EGL_BLUE_SIZE,
                                    8,
                                    EGL_SAMPLE_BUFFERS,
                                    0,
                                    EGL_RENDERABLE_TYPE,
                                    EGL_OPENGL_ES2_BIT,
                                    EGL_NONE};
    EGLint count = 0;
    /* Deeper colours come first, and cards have hundreds of them with several samples a pixel. */
    if (!eglChooseConfig(gl->display, wanted, NULL, 0, &count) || count < 1) {
        return fail_egl(gl, "draws no pictures of 8 bits a colour", error);
    }
    EGLConfig *configs = calloc((size_t)count, sizeof *configs);
    if (!configs) {
        return nacre_fail_memory(error, "a display");
    }
    bool found = false;
    (void)eglChooseConfig(gl->display, wanted, configs, count, &count); /* it did above */
    for (EGLint i = 0; i < count && !found; i++) {
        EGLint format = 0;
        found = eglGetConfigAttrib(gl->display, configs[i], EGL_NATIVE_VISUAL_ID, &format) &&
                (uint32_t)format == GBM_FORMAT_XRGB8888;
        gl->config = configs[i];
    }
    free(configs);
    return found ? NACRE_OK : fail_egl(gl, "draws no pictures of 8 bits a colour", error);
}

static int make_surface(struct display_gl *gl, struct nacre_error *error)
{
    static const EGLint version[] = {EGL_CONTEXT_CLIENT_VERSION, 2, EGL_NONE};
    gl->gbm = gbm_create_device(gl->file);
    gl->gbm_surface =
        gl->gbm ? gbm_surface_create(gl->gbm, (uint32_t)gl->width, (uint32_t)gl->height,
                                     GBM_FORMAT_XRGB8888, GBM_BO_USE_SCANOUT | GBM_BO_USE_RENDERING)
                : NULL;
    if (!gl->gbm_surface) {
        return nacre_fail_errno(error, errno, "%s: makes no pictures of %d x %d pixels", gl->name,
                                gl->width, gl->height);
    }
    gl->display = eglGetPlatformDisplay(EGL_PLATFORM_GBM_KHR, gl->gbm, NULL);
    if (gl->display == EGL_NO_DISPLAY || !eglInitialize(gl->display, NULL, NULL) ||
        !eglBindAPI(EGL_OPENGL_ES_API)) {
        return fail_egl(gl, "does not start to draw", error);
    }
    int status = choose_config(gl, error);
    if (status != NACRE_OK) {
        return status;
    }
    gl->context = eglCreateContext(gl->display, gl->config, EGL_NO_CONTEXT, version);
    if (gl->context == EGL_NO_CONTEXT) {
        return fail_egl(gl, "has no OpenGL ES 2", error);
    }
    gl->surface = eglCreatePlatformWindowSurface(gl->display, gl->config, gl->gbm_surface, NULL);
    return gl->surface == EGL_NO_SURFACE ? fail_egl(gl, "draws on no screen", error) : NACRE_OK;
}

/* Let this thread draw. */
static int bind(const struct display_gl *gl, struct nacre_error *error)
{
    return eglMakeCurrent(gl->display, gl->surface, gl->surface, gl->context)
               ? NACRE_OK
               : fail_egl(gl, "cannot go on to draw", error);
}

static void unbind(const struct display_gl *gl)
{
    (void)eglMakeCurrent(gl->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
}

static int add_shader(const struct display_gl *gl, GLenum kind, const char *text,
                      struct nacre_error *error)
{
    GLint good = 0;
    char log[256] = "";
    GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &text, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (!good) {
        glGetShaderInfoLog(shader, sizeof log, NULL, log);
        log[strcspn(log, "\n")] = '\0';
    }
    glAttachShader(gl->program, shader);
    glDeleteShader(shader); /* the program keeps it */
    return good ? NACRE_OK
                : nacre_fail(error, "%s: %s does not take a shader: %s", gl->name, gl->renderer,
                             log);
}

static int make_program(struct display_gl *gl, struct nacre_error *error)
{
    static const GLfloat corners[] = {0, 0, 1, 0, 0, 1, 1, 1};
    GLint good = 0;
    gl->program = glCreateProgram();
    int status = add_shader(gl, GL_VERTEX_SHADER, vertex_text, error);
    if (status == NACRE_OK) {
        status = add_shader(gl, GL_FRAGMENT_SHADER, fragment_text, error);
    }
    if (status != NACRE_OK) {
        return status;
    }
    glBindAttribLocation(gl->program, 0, "corner");
    glLinkProgram(gl->program);
    glGetProgramiv(gl->program, GL_LINK_STATUS, &good);
    if (!good) {
        return nacre_fail(error, "%s: %s does not link its shaders", gl->name, gl->renderer);
    }
    glUseProgram(gl->program);
    glGenBuffers(1, &gl->vertices);
    glBindBuffer(GL_ARRAY_BUFFER, gl->vertices);
    glBufferData(GL_ARRAY_BUFFER, sizeof corners, corners, GL_STATIC_DRAW);
    glVertexAttribPointer(0, 2, GL_FLOAT, GL_FALSE, 0, NULL);
    glEnableVertexAttribArray(0);
    return NACRE_OK;
}

static int make_texture(struct display_gl *gl, struct nacre_error *error)
{
    GLint largest = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
    if (gl->region.width > largest || gl->region.height > largest) {
        return nacre_fail(error, "%s: %s draws at most %d x %d pixels, and the sample has %d x %d",
                          gl->name, gl->renderer, largest, largest, gl->region.width,
                          gl->region.height);
    }
    glGenTextures(1, &gl->texture);
    glBindTexture(GL_TEXTURE_2D, gl->texture);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_LUMINANCE, gl->region.width, gl->region.height, 0,
                 GL_LUMINANCE, GL_UNSIGNED_BYTE, NULL);
    return NACRE_OK;
}

/* Draw into the surface's back buffer. */
static int paint(const struct display_gl *gl, const uint8_t *levels, struct nacre_error *error)
{
    const struct display_region *region = &gl->region;
    glDisable(GL_DITHER);
    glDisable(GL_BLEND);
    glViewport(0, 0, gl->width, gl->height);
    glClearColor(0, 0, 0, 1);
    glClear(GL_COLOR_BUFFER_BIT);
    if (levels) {
        glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, region->width, region->height, GL_LUMINANCE,
                        GL_UNSIGNED_BYTE, levels);
        /* Rows count from the bottom. */
        glViewport(region->left, gl->height - region->top - region->height, region->width,
                   region->height);
        glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
    }
    glFinish();
    GLenum number = glGetError();
    return number == GL_NO_ERROR ? NACRE_OK
                                 : nacre_fail(error, "%s: %s cannot draw (OpenGL error 0x%04x)",
                                              gl->name, gl->renderer, (unsigned)number);
}

/* Levels of which every neighbour differs, with all 256 among them. */
static void fill_trial(uint8_t *levels, size_t count)
{
    uint32_t state = 1;
    for (size_t i = 0; i < count; i++) {
        state = state * UINT32_C(1664525) + UINT32_C(1013904223);
        levels[i] = (uint8_t)(i < 256 ? i : state >> 24);
    }
}

/* Compare what was drawn with what should have been, pixel by pixel. */
static int compare(const struct display_gl *gl, const uint8_t *levels, const uint8_t *drawn,
                   struct nacre_error *error)
{
    const struct display_region *region = &gl->region;
    for (int y = 0; y < gl->height; y++) {
        for (int x = 0; x < gl->width; x++) {
            int u = x - region->left;
            int v = y - region->top;
            bool inside = u >= 0 && u < region->width && v >= 0 && v < region->height;
            uint8_t wanted = inside ? levels[(size_t)v * (size_t)region->width + (size_t)u] : 0;
            const uint8_t *pixel =
                &drawn[4 * ((size_t)(gl->height - 1 - y) * (size_t)gl->width + (size_t)x)];
            for (int k = 0; k < 3; k++) {
                if (pixel[k] != wanted) {
                    return nacre_fail(error,
                                      "%s: %s draws level %d at (%d, %d) where %d should be; try "
                                      "another driver, with LIBGL_ALWAYS_SOFTWARE=1 for instance",
                                      gl->name, gl->renderer, pixel[k], x, y, wanted);
                }
            }
        }
    }
    return NACRE_OK;
}

/* Whether the card draws exactly. */
static int try_out(const struct display_gl *gl, struct nacre_error *error)
{
    size_t count = (size_t)gl->region.width * (size_t)gl->region.height;
    uint8_t *levels = malloc(count);
    uint8_t *drawn = malloc((size_t)gl->width * (size_t)gl->height * 4);
    int status = NACRE_OK;
    if (!levels || !drawn) {
        status = nacre_fail_memory(error, "a picture");
        goto out;
    }
    fill_trial(levels, count);
    status = paint(gl, levels, error);
    if (status != NACRE_OK) {
        goto out;
    }
    glReadPixels(0, 0, gl->width, gl->height, GL_RGBA, GL_UNSIGNED_BYTE, drawn);
    status = compare(gl, levels, drawn, error);
out:
    free(levels);
    free(drawn);
    return status;
}

static int set_up(struct display_gl *gl, struct nacre_error *error)
{
    const char *renderer = (const char *)glGetString(GL_RENDERER);
    (void)snprintf(gl->renderer, sizeof gl->renderer, "%s", renderer ? renderer : "OpenGL ES");
    int status = make_program(gl, error);
    if (status == NACRE_OK) {
        status = make_texture(gl, error);
    }
    return status == NACRE_OK ? try_out(gl, error) : status;
}

int display_gl_new(int file, const char *name, int width, int height,
                   const struct display_region *region, struct display_gl **gl,
                   struct nacre_error *error)
{
    int status = NACRE_OK;
    struct display_gl *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "a display");
        goto out;
    }
    *made = (struct display_gl){.file = file,
                                .width = width,
                                .height = height,
                                .region = *region,
                                .display = EGL_NO_DISPLAY,
                                .context = EGL_NO_CONTEXT,
                                .surface = EGL_NO_SURFACE};
    (void)snprintf(made->name, sizeof made->name, "%s", name);
    status = make_surface(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = bind(made, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = set_up(made, error);
    unbind(made);
out:
    if (status != NACRE_OK) {
        display_gl_free(made);
        made = NULL;
    }
    *gl = made;
    return status;
}

void display_gl_free(struct display_gl *gl)
{
    if (!gl) {
        return;
    }
    if (gl->shown) {
        gbm_surface_release_buffer(gl->gbm_surface, gl->shown);
    }
    if (gl->surface != EGL_NO_SURFACE) {
        (void)eglDestroySurface(gl->display, gl->surface);
    }
    if (gl->context != EGL_NO_CONTEXT) {
        (void)eglDestroyContext(gl->display, gl->context); /* and what was made in it */
    }
    if (gl->display != EGL_NO_DISPLAY) {
        (void)eglTerminate(gl->display);
    }
    if (gl->gbm_surface) {
        gbm_surface_destroy(gl->gbm_surface);
    }
    if (gl->gbm) {
        gbm_device_destroy(gl->gbm);
    }
    free(gl);
}

const char *display_gl_renderer(const struct display_gl *gl)
{
    return gl->renderer;
}

/* What the kernel is to know of a buffer, kept with it. */
struct registration {
    int file;
    uint32_t framebuffer;
};

static void forget(struct gbm_bo *buffer, void *data)
{
    struct registration *registration = data;
    (void)buffer;
    (void)drmModeRmFB(registration->file, registration->framebuffer);
    free(registration);
}

/* Make the buffer known as a framebuffer; 0 or errno. */
static int add_framebuffer(int file, struct gbm_bo *buffer, uint32_t *framebuffer)
{
    uint32_t handles[4] = {gbm_bo_get_handle(buffer).u32};
    uint32_t strides[4] = {gbm_bo_get_stride(buffer)};
    uint32_t offsets[4] = {gbm_bo_get_offset(buffer, 0)};
    uint64_t modifiers[4] = {gbm_bo_get_modifier(buffer)};
    uint32_t width = gbm_bo_get_width(buffer);
    uint32_t height = gbm_bo_get_height(buffer);
    uint64_t supported = 0;
    bool tiled = modifiers[0] != DRM_FORMAT_MOD_INVALID && modifiers[0] != DRM_FORMAT_MOD_LINEAR;
    if (tiled && drmGetCap(file, DRM_CAP_ADDFB2_MODIFIERS, &supported) == 0 && supported) {
        int planes = gbm_bo_get_plane_count(buffer);
        for (int i = 1; i < planes && i < 4; i++) {
            handles[i] = gbm_bo_get_handle_for_plane(buffer, i).u32;
            strides[i] = gbm_bo_get_stride_for_plane(buffer, i);
            offsets[i] = gbm_bo_get_offset(buffer, i);
            modifiers[i] = modifiers[0];
        }
        return drmModeAddFB2WithModifiers(file, width, height, GBM_FORMAT_XRGB8888, handles,
                                          strides, offsets, modifiers, framebuffer,
                                          DRM_MODE_FB_MODIFIERS)
                   ? errno
                   : 0;
    }
    return drmModeAddFB2(file, width, height, GBM_FORMAT_XRGB8888, handles, strides, offsets,
                         framebuffer, 0)
               ? errno
               : 0;
}

static int find_framebuffer(const struct display_gl *gl, struct gbm_bo *buffer,
                            uint32_t *framebuffer, struct nacre_error *error)
{
    struct registration *registration = gbm_bo_get_user_data(buffer);
    if (!registration) {
        registration = calloc(1, sizeof *registration);
        if (!registration) {
            return nacre_fail_memory(error, "a framebuffer");
        }
        registration->file = gl->file;
        int number = add_framebuffer(gl->file, buffer, &registration->framebuffer);
        if (number != 0) {
            free(registration);
            return nacre_fail_errno(error, number, "%s: does not show what %s draws", gl->name,
                                    gl->renderer);
        }
        gbm_bo_set_user_data(buffer, registration, forget);
    }
    *framebuffer = registration->framebuffer;
    return NACRE_OK;
}

/* Give out the buffer that was painted, and take the one before back. */
static int swap(struct display_gl *gl, uint32_t *framebuffer, struct nacre_error *error)
{
    if (!eglSwapBuffers(gl->display, gl->surface)) {
        return fail_egl(gl, "does not give out what it drew", error);
    }
    struct gbm_bo *buffer = gbm_surface_lock_front_buffer(gl->gbm_surface);
    if (!buffer) {
        return nacre_fail(error, "%s: %s gives out no buffer", gl->name, gl->renderer);
    }
    int status = find_framebuffer(gl, buffer, framebuffer, error);
    if (status != NACRE_OK) {
        gbm_surface_release_buffer(gl->gbm_surface, buffer);
        return status;
    }
    if (gl->shown) {
        gbm_surface_release_buffer(gl->gbm_surface, gl->shown);
    }
    gl->shown = buffer;
    return NACRE_OK;
}

int display_gl_draw(struct display_gl *gl, const uint8_t *levels, uint32_t *framebuffer,
                    struct nacre_error *error)
{
    int status = bind(gl, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = paint(gl, levels, error);
    if (status == NACRE_OK) {
        status = swap(gl, framebuffer, error);
    }
    unbind(gl);
    return status;
}
