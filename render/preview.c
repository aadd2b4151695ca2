/* Drawing a lit scene by OpenGL. */
#include "render/preview.h"

#include "render/preview_parts.h"

#include <stdlib.h>

extern const struct opencl_source preview_depth_frag;

/* What pictures are drawn on. */
static int make_canvas(struct preview *preview, bool smooth, struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    const struct scene_image *image = &preview->scene->image;
    int larger = image->width > image->height ? image->width : image->height;
    GLint most = 0;
    GLuint buffers[2];
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
    gl->GenFramebuffers(1, &preview->frame);
    gl->BindFramebuffer(GL_FRAMEBUFFER, preview->frame);
    gl->GenRenderbuffers(2, buffers);
    for (int i = 0; i < 2; i++) {
        gl->BindRenderbuffer(GL_RENDERBUFFER, buffers[i]);
        gl->RenderbufferStorage(GL_RENDERBUFFER, i ? GL_DEPTH_COMPONENT32F : GL_RGBA32F, width,
                                height);
        gl->FramebufferRenderbuffer(GL_FRAMEBUFFER, i ? GL_DEPTH_ATTACHMENT : GL_COLOR_ATTACHMENT0,
                                    GL_RENDERBUFFER, buffers[i]);
    }
    gl->PixelStorei(GL_PACK_ALIGNMENT, 1);
    return gl->CheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE
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
        preview_link(&made->gl, PREVIEW_VERSION, &preview_depth_frag, &made->depth_program,
                     error) != NACRE_OK) {
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
    gl->BindFramebuffer(GL_FRAMEBUFFER, preview->frame);
    gl->Viewport(0, 0, width, height);
    gl->ClearColor((float)image->background[0], (float)image->background[1],
                   (float)image->background[2], 0);
    gl->Clear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    for (size_t k = 0; k < preview->shade_count; k++) {
        GLuint program = preview->shades[k].program;
        gl->UseProgram(program);
        gl->Uniform3f(gl->GetUniformLocation(program, "eye"), (float)view.position.x,
                      (float)view.position.y, (float)view.position.z);
        preview_set_projection(preview, program, &view);
    }
    preview_draw_surfaces(preview, &view, true);
    gl->ReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, preview->pixels);
    if (preview_check(preview, "drawing", error) != NACRE_OK) {
        picture_finish(picture);
        return NACRE_FAILED;
    }
    reduce(preview, &view, picture);
    return NACRE_OK;
}
