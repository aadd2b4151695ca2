/* scene.yaml: what a picture shows, as read from the file.
 *
 * Units. Lengths are in mm, angles in degrees; x and y are horizontal and z points up (right-handed). A light's
 * `irradiance` is what it makes, unshadowed, on a surface at its point `at_mm` that faces it. A plain surface of
 * reflectance rho under irradiance E has the radiance rho E / pi; a translucent one pi L(x_o) = sum over surface points
 * x_i of E(x_i) R_d(x_i, x_o). A picture's value is radiance times pi times `exposure`: white under irradiance 1 is
 * `exposure`. An environment's values are radiance times pi too: one of 1 all around makes the irradiance 1. */
#ifndef RENDER_SCENE_H
#define RENDER_SCENE_H

#include "base/settings.h"
#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>

/* The last is the scene's `environment`, not one of its `lights`. */
enum scene_light_kind { LIGHT_AREA, LIGHT_POINT, LIGHT_SPOT, LIGHT_PROJECTOR, LIGHT_ENVIRONMENT };

enum scene_pattern { PATTERN_NONE, PATTERN_CHECKS, PATTERN_STRIPES, PATTERN_GRID };

/* What a projector shows: an image file, or a built-in pattern. */
struct scene_texture {
    char *image;
    int pattern; /* enum scene_pattern */
    int count;   /* checks, stripes or meshes across the picture's width */
    double bright[3], dark[3];
    int line, column; /* 0: there is none */
};

struct scene_light {
    int kind; /* enum scene_light_kind */
    int line, column;
    double position_mm[3], at_mm[3], up[3];
    double irradiance[3];
    double size_mm[2]; /* area: width and height */
    double angle_deg;  /* full: of the spot's cone, of the projected picture's width */
    double soft_deg;   /* spot: over which the cone's edge fades, inwards */
    struct scene_texture texture;
};

enum scene_shape { SHAPE_MESH, SHAPE_KNOT, SHAPE_SPHERE, SHAPE_BOX, SHAPE_QUAD };
enum scene_mapping { MAPPING_UV, MAPPING_PLANAR, MAPPING_BOX, MAPPING_CYLINDER, MAPPING_SPHERE };
enum scene_tiling { TILING_MIRROR, TILING_REPEAT };
enum scene_mode { MODE_FULL, MODE_ALBEDO };
enum scene_thin { THIN_THROUGH, THIN_SAME_SIDE };

/* How an object is made of a factored material. */
struct scene_material {
    char *file; /* material.exr; NULL: the object is plain */
    int line;
    int mapping;      /* enum scene_mapping */
    int axis;         /* planar, cylinder: 0 x, 1 y, 2 z of the object */
    double point_mm;  /* surface point on the object; 0: the material's pitch */
    double offset[2]; /* surface points by which the material is moved */
    int tiling;       /* enum scene_tiling */
    int mode;         /* enum scene_mode */
    int thin;         /* enum scene_thin */
};

struct scene_gloss {
    double specular;  /* strength of the highlight */
    double roughness; /* its width */
    double
        reflection; /* of the surroundings' mirror image: times Fresnel's where there is an index */
    int specular_line, reflection_line;
};

struct scene_object {
    int shape; /* enum scene_shape */
    int line, column;
    char *file;             /* SHAPE_MESH */
    double size_mm[3];      /* of meshes, knots and spheres the first, the largest extent, counts */
    double thickness;       /* SHAPE_KNOT */
    double position_mm[3];  /* of the bottom's centre, after turning */
    double rotation_deg[3]; /* about x, then y, then z */
    double color[3];        /* plain objects: diffuse reflectance */
    double index;           /* of refraction; 1: light enters and leaves alike at all angles */
    int index_line;
    struct scene_material material;
    struct scene_gloss gloss;
};

/* Light from all around, infinitely far away. */
struct scene_environment {
    char *
        image; /* equirectangular: top row up, middle column along y, right of it x; NULL: alike all around */
    double color[3];
    double rotation_deg; /* about z */
    int line, column;    /* 0: there is none */
};

struct scene_camera {
    double position_mm[3], at_mm[3], up[3];
    double angle_deg; /* full horizontal */
    int line, column;
};

struct scene_image {
    int width, height;
    double exposure;
    double background[3];
};

struct scene {
    struct scene_image image;
    struct scene_camera camera;
    struct scene_environment environment;
    struct scene_light *lights;
    size_t light_count;
    int bounces, bounces_line; /* of light between surfaces */
    char **without;            /* effects that are forbidden; see effects.h */
    size_t without_count;
    int without_line;
    struct scene_object *objects;
    size_t object_count;
    int objects_line, objects_column;
};

/* Read and check a scene. On failure nothing is held; messages name file, line and column. */
int scene_read(const char *path, struct scene *scene, struct nacre_error *error);

/* The same from text, with relative paths taken from `folder`. */
int scene_parse(const char *name, const char *folder, const char *text, size_t size,
                struct scene *scene, struct nacre_error *error);

/* Refuse an output that is one of the files which the scene names. */
int scene_check_output(const struct scene *scene, const char *path, struct nacre_error *error);
void scene_finish(struct scene *scene);

#endif
