/* Drawing a lit scene by OpenGL. */
#include "render/preview.h"

#include "render/preview_parts.h"

#include <stdlib.h>

extern const struct opencl_source preview_vertex_vert, preview_depth_frag, preview_seen_frag;

static void make_texture(const struct osmesa *gl, GLenum unit, GLenum attachment, int width,
                         int height)
{
    GLuint texture;
    gl->GenTextures(1, &texture);
    gl->ActiveTexture(unit);
    gl->BindTexture(GL_TEXTURE_2D, texture);
    gl->TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, width, height, 0, GL_RGBA, GL_FLOAT, NULL);
    gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl->FramebufferTexture2D(GL_FRAMEBUFFER, attachment, GL_TEXTURE_2D, texture, 0);
}

/* A buffer to draw on. */
static GLuint make_buffer(const struct osmesa *gl, GLenum kind, int width, int height)
{
    GLuint buffer;
    gl->GenRenderbuffers(1, &buffer);
    gl->BindRenderbuffer(GL_RENDERBUFFER, buffer);
    gl->RenderbufferStorage(GL_RENDERBUFFER, kind, width, height);
    return buffer;
}

/* What pixels see, and the picture, which share depths and stencil. */
static bool make_frames(struct preview *preview, int width, int height)
{
    const struct osmesa *gl = &preview->gl;
    const GLenum both[2] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
    GLuint depths = make_buffer(gl, GL_DEPTH32F_STENCIL8, width, height);
    GLuint picture = make_buffer(gl, GL_RGBA32F, width, height);
    GLuint *frames[2] = {&preview->seen, &preview->frame};
    bool complete = true;
    for (int i = 0; i < 2; i++) {
        gl->GenFramebuffers(1, frames[i]);
        gl->BindFramebuffer(GL_FRAMEBUFFER, *frames[i]);
        gl->FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_STENCIL_ATTACHMENT, GL_RENDERBUFFER,
                                    depths);
        if (i == 0) {
            make_texture(gl, GL_TEXTURE2, both[0], width, height);
            make_texture(gl, GL_TEXTURE3, both[1], width, height);
            gl->DrawBuffers(2, both);
        } else {
            gl->FramebufferRenderbuffer(GL_FRAMEBUFFER, both[0], GL_RENDERBUFFER, picture);
        }
        complete =
            complete && gl->CheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
    }
    return complete;
}

/* What pictures are drawn on. */
static int make_canvas(struct preview *preview, bool smooth, struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    const struct scene_image *image = &preview->scene->image;
    int larger = image->width > image->height ? image->width : image->height;
    GLint most = 0;
    gl->GetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &most);
    if (larger > most) {
        return nacre_fail(error, "a preview of %d x %d pixels is larger than OpenGL draws (%d)",
                          image->width, image->height, most);
    }
    preview->scale = smooth && 2 * larger <= most ? 2 : 1;
    int width = image->width * preview->scale, height = image->height * preview->scale;
    preview->pixels = calloc((size_t)width * (size_t)height, 4 * sizeof *preview->pixels);
    if (!preview->pixels) {
        return nacre_fail_memory(error, "a preview");
    }
    gl->PixelStorei(GL_PACK_ALIGNMENT, 1);
    return make_frames(preview, width, height)
               ? preview_check(preview, "making room for a picture", error)
               : nacre_fail(error, "cannot draw a preview: OpenGL cannot draw floats");
}

int preview_probe(struct nacre_error *error)
{
    struct osmesa gl;
    int status = osmesa_open(&gl, error);
    osmesa_close(&gl);
    return status;
}

int preview_open(const struct stage *stage, bool smooth, struct preview **preview,
                 struct nacre_error *error)
{
    const struct scene *scene = stage->scene;
    struct preview *made = calloc(1, sizeof *made);
    int status = NACRE_FAILED;
    *preview = NULL;
    if (!made || !(made->surfaces = calloc(scene->object_count + 1, sizeof *made->surfaces)) ||
        !(made->shades = calloc(scene->object_count + 1, sizeof *made->shades))) {
        (void)nacre_fail_memory(error, "a preview");
        goto out;
    }
    made->scene = scene;
    if (preview_order_lights(made, stage, error) != NACRE_OK) {
        goto out;
    }
    if (osmesa_open(&made->gl, error) != NACRE_OK ||
        preview_link(&made->gl, &preview_vertex_vert, PREVIEW_VERSION, &preview_depth_frag,
                     &made->depth_program, error) != NACRE_OK ||
        preview_link(&made->gl, &preview_vertex_vert, PREVIEW_VERSION, &preview_seen_frag,
                     &made->seen_program, error) != NACRE_OK) {
        goto out;
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        if (preview_upload_surface(made, stage, i, error) != NACRE_OK) {
            goto out;
        }
    }
    preview_find_planes(made, stage);
    made->gl.Enable(GL_DEPTH_TEST);
    if (preview_draw_maps(made, error) == NACRE_OK &&
        preview_make_shades(made, error) == NACRE_OK &&
        preview_set_lights(made, error) == NACRE_OK) {
        status = make_canvas(made, smooth, error);
    }
out:
    if (status == NACRE_OK) {
        *preview = made;
    } else {
        preview_close(made);
    }
    return status;
}

void preview_close(struct preview *preview)
{
    if (preview) {
        osmesa_close(&preview->gl);
        for (size_t i = 0; i < preview->surface_count; i++) {
            preview_mesh_finish(&preview->surfaces[i].mesh);
        }
        free(preview->surfaces);
        free(preview->shades);
        free(preview->pixels);
        free(preview);
    }
}

/* What the camera sees of the environment in a pixel of the frame. */
static void see_environment(const struct preview *preview, const struct view *view, size_t x,
                            size_t row, float rgba[4])
{
    double width = preview->scene->image.width * (double)preview->scale;
    double height = preview->scene->image.height * (double)preview->scale, value[3];
    struct vec3 way = view->forward;
    way = vec3_along(way, (2 * ((double)x + 0.5) / width - 1) * view->tan_x, view->right);
    way = vec3_along(way, (2 * ((double)row + 0.5) / height - 1) * view->tan_y, view->up);
    environment_value(preview->environment, vec3_unit(way), value);
    for (int c = 0; c < 3; c++) {
        rgba[c] = (float)(value[c] * preview->scene->image.exposure);
    }
}

/* The mean of scale x scale pixels; OpenGL's rows run upwards. Where nothing was drawn alpha is 0. */
static void reduce(const struct preview *preview, const struct view *view, struct picture *picture)
{
    size_t scale = (size_t)preview->scale, width = (size_t)picture->width * scale;
    size_t height = (size_t)picture->height * scale;
    float share = 1 / (float)(scale * scale);
    for (size_t row = 0; row < height; row++) {
        float *from = preview->pixels + row * width * 4;
        float *to = picture->rgb + (height - 1 - row) / scale * (size_t)picture->width * 3;
        for (size_t x = 0; x < width; x++) {
            if (preview->environment && from[4 * x + 3] == 0) {
                see_environment(preview, view, x, row, from + 4 * x);
            }
            for (size_t c = 0; c < 3; c++) {
                to[x / scale * 3 + c] += from[4 * x + c] * share;
            }
        }
    }
}

static void set_vector(const struct osmesa *gl, GLuint program, const char *name, struct vec3 v)
{
    gl->Uniform3f(gl->GetUniformLocation(program, name), (float)v.x, (float)v.y, (float)v.z);
}

/* Draw what each pixel sees of the surfaces, and number them. */
static void draw_seen(const struct preview *preview, const struct view *view)
{
    const struct osmesa *gl = &preview->gl;
    gl->BindFramebuffer(GL_FRAMEBUFFER, preview->seen);
    gl->ClearColor(0, 0, 0, 0);
    gl->Clear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT | GL_STENCIL_BUFFER_BIT);
    gl->Enable(GL_STENCIL_TEST);
    gl->StencilOp(GL_KEEP, GL_KEEP, GL_REPLACE);
    gl->UseProgram(preview->seen_program);
    preview_set_projection(preview, preview->seen_program, view);
    preview_draw_surfaces(preview, view, gl->GetUniformLocation(preview->seen_program, "number"));
}

/* Light it, and leave the rest to the background. */
static void draw_picture(const struct preview *preview, const struct view *view, int width,
                         int height)
{
    const struct osmesa *gl = &preview->gl;
    const double *background = preview->scene->image.background;
    gl->BindFramebuffer(GL_FRAMEBUFFER, preview->frame);
    gl->ClearColor((float)background[0], (float)background[1], (float)background[2], 0);
    gl->Clear(GL_COLOR_BUFFER_BIT);
    gl->Disable(GL_DEPTH_TEST);
    gl->StencilOp(GL_KEEP, GL_KEEP, GL_KEEP);
    for (size_t k = 0; k < preview->shade_count; k++) {
        GLuint program = preview->shades[k].program;
        gl->UseProgram(program);
        set_vector(gl, program, "eye", view->position);
        set_vector(gl, program, "ahead", view->forward);
        set_vector(gl, program, "rightwards", vec3_scale(view->right, view->tan_x));
        set_vector(gl, program, "upwards", vec3_scale(view->up, view->tan_y));
        gl->Uniform2f(gl->GetUniformLocation(program, "half_size"), (float)width / 2,
                      (float)height / 2);
    }
    preview_light_surfaces(preview);
    gl->Enable(GL_DEPTH_TEST);
    gl->Disable(GL_STENCIL_TEST);
}

int preview_draw(struct preview *preview, double turn_deg, struct picture *picture,
                 struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    const struct scene_image *image = &preview->scene->image;
    struct view view = view_make(preview->scene, turn_deg);
    int width = image->width * preview->scale, height = image->height * preview->scale;
    if (picture_allocate(picture, image->width, image->height, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    gl->Viewport(0, 0, width, height);
    draw_seen(preview, &view);
    draw_picture(preview, &view, width, height);
    gl->ReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, preview->pixels);
    if (preview_check(preview, "drawing", error) != NACRE_OK) {
        picture_finish(picture);
        return NACRE_FAILED;
    }
    reduce(preview, &view, picture);
    return NACRE_OK;
}
