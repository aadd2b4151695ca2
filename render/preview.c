/* Drawing a lit scene by OpenGL. */
#include "render/preview.h"

#include "base/opencl.h"
#include "render/osmesa.h"
#include "render/preview_mesh.h"
#include "render/view.h"

#include <stdio.h>
#include <stdlib.h>

extern const struct opencl_source preview_vertex_vert, preview_pixel_frag, preview_depth_frag;

enum { FACES = 6, LAYERS_FINE = 8, MAP_FINE = 2048, MAP_COARSE = 1024 };

static const char version[] = "#version 400 core\n";

/* Half extent of a map of depths at unit distance; over 1, so that reading between texels stays inside. */
static const double map_tangent = 1.01;

/* A program for surfaces of one kind. */
struct shade {
    int pictures, end; /* lights that cast pictures, and all, that it adds */
    bool translucent, bounded;
    GLuint program;
};

struct surface {
    struct preview_mesh mesh;
    bool translucent;
    double specular, index; /* 0 and 1 where the effect is not called for */
    const struct scene_object *settings;
    GLuint program;
};

struct preview {
    struct osmesa gl;
    const struct scene *scene;
    const struct light *lights[PREVIEW_LIGHTS_MAXIMUM]; /* in the shader's order */
    size_t light_count;
    size_t picture_count,
        hard_count; /* those that cast pictures are first, then the others that are not soft */
    const struct environment *environment; /* or NULL */
    bool shadows;
    struct surface *surfaces;
    size_t surface_count;
    struct shade *shades; /* no more than surfaces */
    size_t shade_count;
    double nearest_mm, farthest_mm; /* of the scene from its farthest light or camera */
    GLuint depth_program;
    GLuint frame;
    int scale; /* its pixels to one of the picture, in x and y */
    GLuint maps;
    int map_size, layer_count;
    int layers[PREVIEW_LIGHTS_MAXIMUM][FACES];
    float *pixels;
};

static int check_gl(const struct preview *preview, const char *action, struct nacre_error *error)
{
    GLenum code = preview->gl.GetError();
    return code == GL_NO_ERROR ? NACRE_OK
           : code == GL_OUT_OF_MEMORY
               ? nacre_fail_memory(error, "a preview")
               : nacre_fail(error, "cannot draw a preview: OpenGL says 0x%x when %s", code, action);
}

/* The source behind `begin` in place of the line that tells its name, which OpenGL does not know. */
static int compile(const struct osmesa *gl, GLenum kind, const char *begin,
                   const struct opencl_source *source, GLuint *shader, struct nacre_error *error)
{
    char message[512] = "";
    GLint good = GL_FALSE;
    const char **lines = calloc(source->line_count, sizeof *lines);
    if (!lines) {
        return nacre_fail_memory(error, "a shader");
    }
    for (size_t i = 0; i < source->line_count; i++) {
        lines[i] = i ? source->lines[i] : begin;
    }
    *shader = gl->CreateShader(kind);
    gl->ShaderSource(*shader, (GLsizei)source->line_count, lines, NULL);
    free(lines);
    gl->CompileShader(*shader);
    gl->GetShaderiv(*shader, GL_COMPILE_STATUS, &good);
    gl->GetShaderInfoLog(*shader, sizeof message, NULL, message);
    return good ? NACRE_OK
                : nacre_fail(error, "cannot draw a preview: %s: %s", source->name, message);
}

static int link_program(const struct osmesa *gl, const char *begin,
                        const struct opencl_source *pixels, GLuint *program,
                        struct nacre_error *error)
{
    char message[512] = "";
    GLint good = GL_FALSE;
    GLuint shaders[2] = {0, 0};
    int status = compile(gl, GL_VERTEX_SHADER, version, &preview_vertex_vert, &shaders[0], error);
    if (status == NACRE_OK) {
        status = compile(gl, GL_FRAGMENT_SHADER, begin, pixels, &shaders[1], error);
    }
    if (status == NACRE_OK) {
        *program = gl->CreateProgram();
        gl->AttachShader(*program, shaders[0]);
        gl->AttachShader(*program, shaders[1]);
        gl->LinkProgram(*program);
        gl->GetProgramiv(*program, GL_LINK_STATUS, &good);
        gl->GetProgramInfoLog(*program, sizeof message, NULL, message);
        status = good ? NACRE_OK : nacre_fail(error, "cannot draw a preview: %s", message);
    }
    gl->DeleteShader(shaders[0]);
    gl->DeleteShader(shaders[1]);
    return status;
}

static int upload_surface(struct preview *preview, const struct stage *stage, size_t number,
                          struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    const struct stage_object *object = &stage->objects[number];
    const struct render_object_effects *effects = &stage->effects.objects[number];
    const struct scene_object *settings = &stage->scene->objects[number];
    const struct mesh *mesh = &object->mesh;
    bool shines = effects->highlights && render_has(&stage->effects, RENDER_HIGHLIGHTS);
    bool bounded = effects->fresnel && render_has(&stage->effects, RENDER_FRESNEL);
    struct surface *surface = &preview->surfaces[preview->surface_count++];
    *surface = (struct surface){.translucent = object->translucent,
                                .specular = shines ? settings->gloss.specular : 0,
                                .index = bounded ? settings->index : 1,
                                .settings = settings};
    int status =
        preview_mesh_make(&surface->mesh, gl, mesh, (const float(*)[3])object->light, error);
    return status == NACRE_OK ? check_gl(preview, "taking a mesh", error) : status;
}

static void draw_surfaces(const struct preview *preview, const struct view *view, bool shaded)
{
    const struct osmesa *gl = &preview->gl;
    for (size_t i = 0; i < preview->surface_count; i++) {
        const struct surface *surface = &preview->surfaces[i];
        const struct scene_object *settings = surface->settings;
        if (shaded) {
            GLuint program = surface->program;
            gl->UseProgram(program);
            gl->Uniform1f(gl->GetUniformLocation(program, "index"), (float)surface->index);
            gl->Uniform3f(gl->GetUniformLocation(program, "colour"), (float)settings->color[0],
                          (float)settings->color[1], (float)settings->color[2]);
            gl->Uniform1f(gl->GetUniformLocation(program, "specular"), (float)surface->specular);
            gl->Uniform1f(gl->GetUniformLocation(program, "roughness"),
                          (float)settings->gloss.roughness);
        }
        preview_mesh_draw(&surface->mesh, gl, view);
    }
}

/* The lights that a surface's program adds. */
static struct shade shade_of(const struct preview *preview, const struct surface *surface)
{
    /* Highlights of soft lights, whose light is baked, are on translucent objects alone. */
    bool glossy = surface->specular > 0, all = surface->translucent && glossy;
    size_t end = all ? preview->light_count : preview->hard_count;
    end = surface->translucent && !glossy ? 0 : end;
    return (struct shade){.pictures =
                              (int)(end < preview->picture_count ? end : preview->picture_count),
                          .end = (int)end,
                          .translucent = surface->translucent,
                          .bounded = surface->index > 1};
}

static bool shades_alike(const struct shade *a, const struct shade *b)
{
    return a->pictures == b->pictures && a->end == b->end && a->translucent == b->translucent &&
           a->bounded == b->bounded;
}

/* A program for each kind of surface that there is. */
static int make_shades(struct preview *preview, struct nacre_error *error)
{
    for (size_t i = 0; i < preview->surface_count; i++) {
        struct shade shade = shade_of(preview, &preview->surfaces[i]);
        size_t k = 0;
        while (k < preview->shade_count && !shades_alike(&preview->shades[k], &shade)) {
            k++;
        }
        if (k == preview->shade_count) {
            char begin[256];
            (void)snprintf(begin, sizeof begin,
                           "%s#define PICTURES %d\n#define END %d\n#define TRANSLUCENT %s\n"
                           "#define BOUNDED %s\n",
                           version, shade.pictures, shade.end, shade.translucent ? "true" : "false",
                           shade.bounded ? "true" : "false");
            if (link_program(&preview->gl, begin, &preview_pixel_frag, &shade.program, error) !=
                NACRE_OK) {
                return NACRE_FAILED;
            }
            preview->shades[preview->shade_count++] = shade;
        }
        preview->surfaces[i].program = preview->shades[k].program;
    }
    return NACRE_OK;
}

/* The matrix of a pyramid of half extents tan_x and tan_y, by columns. */
static void set_projection(const struct preview *preview, GLuint program, const struct view *view)
{
    double n = preview->nearest_mm, f = preview->farthest_mm;
    struct vec3 rows[4] = {vec3_scale(view->right, 1 / view->tan_x),
                           vec3_scale(view->up, 1 / view->tan_y),
                           vec3_scale(view->forward, (f + n) / (f - n)), view->forward};
    const double offsets[4] = {0, 0, -2 * f * n / (f - n), 0};
    float matrix[16];
    for (int row = 0; row < 4; row++) {
        matrix[row] = (float)rows[row].x;
        matrix[4 + row] = (float)rows[row].y;
        matrix[8 + row] = (float)rows[row].z;
        matrix[12 + row] = (float)(offsets[row] - vec3_dot(rows[row], view->position));
    }
    preview->gl.UniformMatrix4fv(preview->gl.GetUniformLocation(program, "projection"), 1, GL_FALSE,
                                 matrix);
}

/* How far planes have to be apart so that nothing is cut off. */
static void find_planes(struct preview *preview, const struct stage *stage)
{
    struct vec3 eye = vec3_from_doubles(preview->scene->camera.position_mm);
    double farthest = 1;
    for (size_t i = 0; i < preview->scene->object_count; i++) {
        struct vec3 low, high;
        mesh_bounds(&stage->objects[i].mesh, &low, &high);
        for (int corner = 0; corner < 8; corner++) {
            struct vec3 p = {corner & 1 ? high.x : low.x, corner & 2 ? high.y : low.y,
                             corner & 4 ? high.z : low.z};
            /* The camera goes round: it is as far as from the vertical's other side. */
            farthest = fmax(farthest, vec3_length(p) + vec3_length(eye));
            for (size_t l = 0; l < preview->light_count; l++) {
                farthest =
                    fmax(farthest, vec3_length(vec3_subtract(p, preview->lights[l]->position)));
            }
        }
    }
    preview->farthest_mm = 2 * farthest;
    preview->nearest_mm = farthest * 1e-4;
}

/* The axes of one of the six maps round a light. */
static struct view face_view(const struct light *light, int face)
{
    struct vec3 r = light->right, u = light->up, f = light->forward;
    const struct vec3 axes[FACES][3] = {
        {r, u, f},
        {vec3_scale(f, -1), u, r},
        {f, u, vec3_scale(r, -1)},
        {r, vec3_scale(f, -1), u},
        {r, f, vec3_scale(u, -1)},
        {vec3_scale(r, -1), u, vec3_scale(f, -1)},
    };
    return (struct view){.position = light->position,
                         .right = axes[face][0],
                         .up = axes[face][1],
                         .forward = axes[face][2],
                         .tan_x = map_tangent,
                         .tan_y = map_tangent};
}

/* Whether the light shines into one of the six directions round it. */
static bool face_needed(const struct light *light, int face)
{
    double half = acos(-1.0) / 4;
    switch (light->kind) {
    case LIGHT_POINT:
        return true;
    case LIGHT_AREA:
        return face != 5; /* none of its light goes back */
    case LIGHT_SPOT:
        return face == 0 || (face != 5 && light->cos_edge < cos(half)) || light->cos_edge < 0;
    default:
        return face == 0 || (face < 3 && light->tan_x > 1) ||
               (face > 2 && face < 5 && light->tan_y > 1);
    }
}

static int draw_maps(struct preview *preview, struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    GLuint frame;
    for (size_t i = 0; i < preview->light_count; i++) {
        for (int face = 0; face < FACES; face++) {
            bool needed = preview->shadows && face_needed(preview->lights[i], face);
            preview->layers[i][face] = needed ? preview->layer_count++ : -1;
        }
    }
    preview->map_size = preview->layer_count <= LAYERS_FINE ? MAP_FINE : MAP_COARSE;
    gl->GenTextures(1, &preview->maps);
    gl->ActiveTexture(GL_TEXTURE0);
    gl->BindTexture(GL_TEXTURE_2D_ARRAY, preview->maps);
    gl->TexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_DEPTH_COMPONENT32F, preview->map_size,
                   preview->map_size, preview->layer_count > 0 ? preview->layer_count : 1, 0,
                   GL_DEPTH_COMPONENT, GL_FLOAT, NULL);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_COMPARE_FUNC, GL_LEQUAL);
    gl->GenFramebuffers(1, &frame);
    gl->BindFramebuffer(GL_FRAMEBUFFER, frame);
    gl->DrawBuffer(GL_NONE);
    gl->ReadBuffer(GL_NONE);
    gl->Viewport(0, 0, preview->map_size, preview->map_size);
    gl->UseProgram(preview->depth_program);
    for (size_t i = 0; i < preview->light_count; i++) {
        for (int face = 0; face < FACES; face++) {
            struct view view = face_view(preview->lights[i], face);
            if (preview->layers[i][face] >= 0) {
                gl->FramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, preview->maps, 0,
                                            preview->layers[i][face]);
                gl->Clear(GL_DEPTH_BUFFER_BIT);
                set_projection(preview, preview->depth_program, &view);
                draw_surfaces(preview, &view, false);
            }
        }
    }
    return check_gl(preview, "drawing shadows", error);
}

/* The location of a member of the shader's lights[number]. */
static GLint light_location(const struct preview *preview, GLuint program, size_t number,
                            const char *member)
{
    char name[64];
    (void)snprintf(name, sizeof name, "lights[%zu].%s", number, member);
    return preview->gl.GetUniformLocation(program, name);
}

static void set_light_vector(const struct preview *preview, GLuint program, size_t number,
                             const char *member, struct vec3 v)
{
    preview->gl.Uniform3f(light_location(preview, program, number, member), (float)v.x, (float)v.y,
                          (float)v.z);
}

/* The extents that all slides have room in. */
static void find_slides(const struct preview *preview, int *width, int *height)
{
    *width = *height = 1;
    for (size_t i = 0; i < preview->light_count; i++) {
        const struct picture *slide = &preview->lights[i]->slide;
        *width = slide->rgb && slide->width > *width ? slide->width : *width;
        *height = slide->rgb && slide->height > *height ? slide->height : *height;
    }
}

/* The slides as layers of one texture, each in its corner; white where there is none. */
static void upload_slides(const struct preview *preview)
{
    const struct osmesa *gl = &preview->gl;
    const float white[3] = {1, 1, 1};
    int width, height;
    GLuint texture;
    find_slides(preview, &width, &height);
    gl->GenTextures(1, &texture);
    gl->ActiveTexture(GL_TEXTURE1);
    gl->BindTexture(GL_TEXTURE_2D_ARRAY, texture);
    gl->TexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RGB32F, width, height,
                   preview->light_count > 0 ? (GLsizei)preview->light_count : 1, 0, GL_RGB,
                   GL_FLOAT, NULL);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    for (size_t i = 0; i < preview->light_count; i++) {
        const struct picture *slide = &preview->lights[i]->slide;
        gl->TexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, 0, 0, (GLint)i, slide->rgb ? slide->width : 1,
                          slide->rgb ? slide->height : 1, 1, GL_RGB, GL_FLOAT,
                          slide->rgb ? slide->rgb : white);
    }
}

static void set_light(const struct preview *preview, GLuint program, size_t i)
{
    const struct osmesa *gl = &preview->gl;
    const struct light *light = preview->lights[i];
    const struct picture *slide = &light->slide;
    bool wide = light->kind == LIGHT_POINT || light->kind == LIGHT_AREA;
    int width, height;
    find_slides(preview, &width, &height);
    gl->Uniform2f(light_location(preview, program, i, "slide"),
                  (float)(slide->rgb ? slide->width : 1) / (float)width,
                  (float)(slide->rgb ? slide->height : 1) / (float)height);
    gl->Uniform1i(light_location(preview, program, i, "lambert"), light->kind == LIGHT_AREA);
    set_light_vector(preview, program, i, "position", light->position);
    set_light_vector(preview, program, i, "right", light->right);
    set_light_vector(preview, program, i, "up", light->up);
    set_light_vector(preview, program, i, "forward", light->forward);
    set_light_vector(preview, program, i, "intensity", vec3_from_doubles(light->intensity));
    gl->Uniform1f(light_location(preview, program, i, "cos_full"),
                  wide ? -2 : (float)light->cos_full);
    gl->Uniform1f(light_location(preview, program, i, "cos_edge"),
                  wide ? -3 : (float)light->cos_edge);
    gl->Uniform2f(light_location(preview, program, i, "tangents"), (float)light->tan_x,
                  (float)light->tan_y);
    gl->Uniform1iv(light_location(preview, program, i, "layers"), FACES, preview->layers[i]);
}

/* What stays the same in all frames, for each program. */
static int set_lights(const struct preview *preview, struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    upload_slides(preview);
    for (size_t k = 0; k < preview->shade_count; k++) {
        GLuint program = preview->shades[k].program;
        gl->UseProgram(program);
        gl->Uniform1i(gl->GetUniformLocation(program, "depths"), 0);
        gl->Uniform1i(gl->GetUniformLocation(program, "slides"), 1);
        for (size_t i = 0; i < preview->light_count; i++) {
            set_light(preview, program, i);
        }
        gl->Uniform1f(gl->GetUniformLocation(program, "depth_tangent"), (float)map_tangent);
        gl->Uniform2f(gl->GetUniformLocation(program, "depth_planes"), (float)preview->nearest_mm,
                      (float)preview->farthest_mm);
        gl->Uniform1f(gl->GetUniformLocation(program, "depth_texel"),
                      (float)(2 * map_tangent / preview->map_size));
        gl->Uniform1f(gl->GetUniformLocation(program, "exposure"),
                      (float)preview->scene->image.exposure);
    }
    return check_gl(preview, "setting the lights", error);
}

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
               ? check_gl(preview, "making room for a picture", error)
               : nacre_fail(error, "cannot draw a preview: OpenGL cannot draw floats");
}

/* By where the shader has their light from: 0 a picture, 1 a point, 2 beforehand. */
static int light_group(const struct light *light)
{
    return light->kind == LIGHT_PROJECTOR ? 0 : light->soft ? 2 : 1;
}

static int order_lights(struct preview *preview, const struct stage *stage,
                        struct nacre_error *error)
{
    size_t count = stage->scene->light_count, ends[3];
    if (count > PREVIEW_LIGHTS_MAXIMUM) {
        return nacre_fail(error, "a preview shows at most %d lights, and the scene has %zu",
                          PREVIEW_LIGHTS_MAXIMUM, count);
    }
    for (int group = 0; group < 3; group++) {
        for (size_t i = 0; i < count; i++) {
            if (light_group(&stage->lights[i]) == group) {
                preview->lights[preview->light_count++] = &stage->lights[i];
            }
        }
        ends[group] = preview->light_count;
    }
    preview->picture_count = ends[0];
    preview->hard_count = ends[1];
    preview->environment = stage->light_count > count ? &stage->lights[count].environment : NULL;
    preview->shadows = render_has(&stage->effects, RENDER_SHADOWS);
    return NACRE_OK;
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
    if (order_lights(made, stage, error) != NACRE_OK) {
        goto out;
    }
    if (osmesa_open(&made->gl, error) != NACRE_OK ||
        link_program(&made->gl, version, &preview_depth_frag, &made->depth_program, error) !=
            NACRE_OK) {
        goto out;
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        if (upload_surface(made, stage, i, error) != NACRE_OK) {
            goto out;
        }
    }
    find_planes(made, stage);
    made->gl.Enable(GL_DEPTH_TEST);
    if (draw_maps(made, error) == NACRE_OK && make_shades(made, error) == NACRE_OK &&
        set_lights(made, error) == NACRE_OK) {
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
        set_projection(preview, program, &view);
    }
    draw_surfaces(preview, &view, true);
    gl->ReadPixels(0, 0, width, height, GL_RGBA, GL_FLOAT, preview->pixels);
    if (check_gl(preview, "drawing", error) != NACRE_OK) {
        picture_finish(picture);
        return NACRE_FAILED;
    }
    reduce(preview, &view, picture);
    return NACRE_OK;
}
