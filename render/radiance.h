/* The light that leaves a surface, as files for other renderers: per vertex as PLY, per texel as EXR.
 *
 * Values are radiance: the irradiance's unit per steradian, the same in all directions; white under irradiance 1 has
 * 1 / pi. They are linear and not multiplied by the picture's exposure. */
#ifndef RENDER_RADIANCE_H
#define RENDER_RADIANCE_H

#include "base/picture.h"
#include "nacre/error.h"
#include "render/mesh.h"
#include "render/stage.h"

#include <stdbool.h>
#include <stddef.h>

struct radiance {
    struct mesh mesh;  /* uv: in the picture, 0 to 1, v upwards; or NULL */
    float (*rgb)[3];   /* [vertex_count] */
    double aspect;     /* width over height of the picture that the texture coordinates go over */
    double picture_mm; /* width of that picture on the surface; 0: no texture coordinates */
    double point_mm;
};

/* What texels took from triangles. */
struct texel_counts {
    size_t covered;    /* texels whose middle a triangle covers */
    size_t padded;     /* others, near enough to one to be filled */
    size_t overlapped; /* covered by more than one; the first triangle's value is kept */
};

/* Copy an object that was baked; its places in the scene, or, with `own_frame`, as in the mesh's file. Texture
 * coordinates of built-in shapes, which are in mm, are made to fill the picture. Finish it whatever is returned. */
int radiance_take(struct radiance *radiance, const struct stage *stage, size_t object,
                  bool own_frame, struct nacre_error *error);
void radiance_finish(struct radiance *radiance);

/* Binary PLY with x y z nx ny nz [s t] red green blue, all floats. `comments` is NULL-terminated. */
int radiance_write_ply(const char *path, const struct radiance *radiance,
                       const char *const *comments, struct nacre_error *error);

/* Draw the values into a picture of `width` pixels by the texture coordinates. Texels up to `padding` away from the
 * nearest triangle take the value at its nearest point, so that bilinear lookups near a chart's border read nothing
 * black. Others are 0. Refuses a mesh without texture coordinates, and coordinates outside 0..1. */
int radiance_draw_texels(const struct radiance *radiance, int width, int padding,
                         struct picture *picture, struct texel_counts *counts,
                         struct nacre_error *error);

/* A width at which a texel is as large as a surface point of the material, or nearly so. */
int radiance_texel_width(const struct radiance *radiance);

/* FLOAT EXR, with `key=value` string attributes as picture_write takes them. */
int radiance_write_exr(const char *path, const struct picture *picture,
                       const char *const *attributes, struct nacre_error *error);

#endif
