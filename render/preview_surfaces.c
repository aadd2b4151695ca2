/* The surfaces of a preview, and a program for each kind of them. */
#include "render/preview_parts.h"

#include <stdio.h>

extern const struct opencl_source preview_pixel_frag, preview_whole_vert;

int preview_upload_surface(struct preview *preview, const struct stage *stage, size_t number,
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
    return status == NACRE_OK ? preview_check(preview, "taking a mesh", error) : status;
}

/* The stencil has 8 bits; the shader tells surfaces of one value apart. */
static GLint stencil_of(size_t surface)
{
    return (GLint)(surface % 255) + 1;
}

void preview_draw_surfaces(const struct preview *preview, const struct view *view, GLint number)
{
    const struct osmesa *gl = &preview->gl;
    for (size_t i = 0; i < preview->surface_count; i++) {
        gl->StencilFunc(GL_ALWAYS, stencil_of(i), 0xff);
        gl->Uniform1f(number, (float)(i + 1));
        preview_mesh_draw(&preview->surfaces[i].mesh, gl, view);
    }
}

void preview_light_surfaces(const struct preview *preview)
{
    const struct osmesa *gl = &preview->gl;
    for (size_t i = 0; i < preview->surface_count; i++) {
        const struct surface *surface = &preview->surfaces[i];
        const struct scene_object *settings = surface->settings;
        GLuint program = surface->program;
        gl->UseProgram(program);
        gl->StencilFunc(GL_EQUAL, stencil_of(i), 0xff);
        gl->Uniform1f(gl->GetUniformLocation(program, "number"), (float)(i + 1));
        gl->Uniform1f(gl->GetUniformLocation(program, "index"), (float)surface->index);
        gl->Uniform3f(gl->GetUniformLocation(program, "colour"), (float)settings->color[0],
                      (float)settings->color[1], (float)settings->color[2]);
        gl->Uniform1f(gl->GetUniformLocation(program, "specular"), (float)surface->specular);
        gl->Uniform1f(gl->GetUniformLocation(program, "roughness"),
                      (float)settings->gloss.roughness);
        gl->DrawArrays(GL_TRIANGLES, 0, 3);
    }
}

/* The lights that a surface's program adds. */
static struct shade shade_of(const struct preview *preview, const struct surface *surface)
{
    /* Highlights of soft lights, whose light is baked, are on translucent objects alone. */
    bool glossy = surface->specular > 0, all = surface->translucent && glossy;
    size_t end = all ? preview->light_count : preview->hard_count;
    end = surface->translucent && !glossy ? 0 : end;
    bool round = false;
    for (size_t i = 0; i < end; i++) {
        for (int face = 1; face < PREVIEW_FACES; face++) {
            round = round || preview->layers[i][face] >= 0;
        }
    }
    return (struct shade){.pictures =
                              (int)(end < preview->picture_count ? end : preview->picture_count),
                          .end = (int)end,
                          .translucent = surface->translucent,
                          .bounded = surface->index > 1,
                          .round = round};
}

static bool shades_alike(const struct shade *a, const struct shade *b)
{
    return a->pictures == b->pictures && a->end == b->end && a->translucent == b->translucent &&
           a->bounded == b->bounded && a->round == b->round;
}

int preview_make_shades(struct preview *preview, struct nacre_error *error)
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
                           "#define BOUNDED %s\n#define ROUND %s\n",
                           PREVIEW_VERSION, shade.pictures, shade.end,
                           shade.translucent ? "true" : "false", shade.bounded ? "true" : "false",
                           shade.round ? "true" : "false");
            if (preview_link(&preview->gl, &preview_whole_vert, begin, &preview_pixel_frag,
                             &shade.program, error) != NACRE_OK) {
                return NACRE_FAILED;
            }
            preview->shades[preview->shade_count++] = shade;
        }
        preview->surfaces[i].program = preview->shades[k].program;
    }
    return NACRE_OK;
}

void preview_set_projection(const struct preview *preview, GLuint program, const struct view *view)
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
