/* What the files that draw previews share: preview.c, preview_lights.c, preview_program.c and preview_surfaces.c. */
#ifndef RENDER_PREVIEW_PARTS_H
#define RENDER_PREVIEW_PARTS_H

#include "base/opencl.h"
#include "render/osmesa.h"
#include "render/preview.h"
#include "render/preview_mesh.h"
#include "render/view.h"

enum { PREVIEW_FACES = 6 };

/* What every shader begins with. */
#define PREVIEW_VERSION "#version 420 core\n"

/* A program for surfaces of one kind. */
struct shade {
    int pictures, end; /* lights that cast pictures, and all, that it adds */
    bool translucent, bounded, round;
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
    GLuint depth_program, seen_program;
    GLuint seen, frame; /* what pixels see, and the picture */
    int scale;          /* its pixels to one of the picture, in x and y */
    GLuint maps;
    int map_size, layer_count;
    int layers[PREVIEW_LIGHTS_MAXIMUM][PREVIEW_FACES];
    float *pixels;
};

/* Turn what OpenGL has to say into an error; `action`: when. */
int preview_check(const struct preview *preview, const char *action, struct nacre_error *error);

/* Make a program of shaders for vertices and pixels; `begin` stands before the latter. */
int preview_link(const struct osmesa *gl, const struct opencl_source *vertices, const char *begin,
                 const struct opencl_source *pixels, GLuint *program, struct nacre_error *error);

/* The matrix of a view's pyramid. */
void preview_set_projection(const struct preview *preview, GLuint program, const struct view *view);

/* Hand an object of the stage to OpenGL. */
int preview_upload_surface(struct preview *preview, const struct stage *stage, size_t number,
                           struct nacre_error *error);

/* A program for each kind of surface that there is. */
int preview_make_shades(struct preview *preview, struct nacre_error *error);

/* All surfaces by the program in use, numbered in the stencil and at the uniform `number` (-1: none). */
void preview_draw_surfaces(const struct preview *preview, const struct view *view, GLint number);

/* Light what was drawn into the picture, each surface by its program. */
void preview_light_surfaces(const struct preview *preview);

/* Take the stage's lights in the shader's order. */
int preview_order_lights(struct preview *preview, const struct stage *stage,
                         struct nacre_error *error);

/* How far planes have to be apart so that nothing is cut off. */
void preview_find_planes(struct preview *preview, const struct stage *stage);

/* Draw the maps of depths that shadows are taken from. */
int preview_draw_maps(struct preview *preview, struct nacre_error *error);

/* What stays the same in all frames, for each program. */
int preview_set_lights(const struct preview *preview, struct nacre_error *error);

#endif
