/* The lights of a preview: their maps of depths, their slides, and what shaders know of them. */
#include "render/preview_parts.h"

#include <stdio.h>

enum { LAYERS_FINE = 8, MAP_FINE = 2048, MAP_COARSE = 1024 };

/* Half extent of a map of depths at unit distance; over 1, so that reading between texels stays inside. */
static const double map_tangent = 1.01;

/* By where the shader has their light from: 0 a picture, 1 a point, 2 beforehand. */
static int light_group(const struct light *light)
{
    return light->kind == LIGHT_PROJECTOR ? 0 : light->soft ? 2 : 1;
}

int preview_order_lights(struct preview *preview, const struct stage *stage,
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

void preview_find_planes(struct preview *preview, const struct stage *stage)
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
    const struct vec3 axes[PREVIEW_FACES][3] = {
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

int preview_draw_maps(struct preview *preview, struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    GLuint frame;
    for (size_t i = 0; i < preview->light_count; i++) {
        for (int face = 0; face < PREVIEW_FACES; face++) {
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
        for (int face = 0; face < PREVIEW_FACES; face++) {
            struct view view = face_view(preview->lights[i], face);
            if (preview->layers[i][face] >= 0) {
                gl->FramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, preview->maps, 0,
                                            preview->layers[i][face]);
                gl->Clear(GL_DEPTH_BUFFER_BIT);
                preview_set_projection(preview, preview->depth_program, &view);
                preview_draw_surfaces(preview, &view, -1);
            }
        }
    }
    return preview_check(preview, "drawing shadows", error);
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
    gl->Uniform1iv(light_location(preview, program, i, "layers"), PREVIEW_FACES,
                   preview->layers[i]);
}

int preview_set_lights(const struct preview *preview, struct nacre_error *error)
{
    const struct osmesa *gl = &preview->gl;
    upload_slides(preview);
    for (size_t k = 0; k < preview->shade_count; k++) {
        GLuint program = preview->shades[k].program;
        gl->UseProgram(program);
        gl->Uniform1i(gl->GetUniformLocation(program, "depths"), 0);
        gl->Uniform1i(gl->GetUniformLocation(program, "slides"), 1);
        gl->Uniform1i(gl->GetUniformLocation(program, "seen_light"), 2);
        gl->Uniform1i(gl->GetUniformLocation(program, "seen_normal"), 3);
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
    return preview_check(preview, "setting the lights", error);
}
