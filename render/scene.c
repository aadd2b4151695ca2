/* Reading scene files. */
#include "render/scene.h"

#include "render/effects.h"
#include "render/vector.h"

#include <stdlib.h>
#include <string.h>

static const char *const light_words[] = {"area", "point", "spot", "projector", NULL};
static const char *const pattern_words[] = {"none", "checks", "stripes", "grid", NULL};
static const char *const shape_words[] = {"mesh", "knot", "sphere", "box", "quad", NULL};
static const char *const mapping_words[] = {"uv", "planar", "box", "cylinder", "sphere", NULL};
static const char *const axis_words[] = {"x", "y", "z", NULL};
static const char *const tiling_words[] = {"mirror", "repeat", NULL};
static const char *const mode_words[] = {"full", "albedo", NULL};
static const char *const thin_words[] = {"through", "same-side", NULL};

/* Coordinates beyond a kilometre are a slip. */
#define FAR_MM 1e6

static const struct settings_field image_fields[] = {
    {.key = "width",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct scene_image, width),
     .minimum = 1,
     .maximum = 16384,
     .fallback = "640",
     .sentence = "pixels"},
    {.key = "height",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct scene_image, height),
     .minimum = 1,
     .maximum = 16384,
     .fallback = "480",
     .sentence = "pixels"},
    {.key = "exposure",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_image, exposure),
     .minimum = 1e-6,
     .maximum = 1e6,
     .fallback = "1",
     .sentence = "the picture's value of a white surface under irradiance 1"},
    {.key = "background",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_image, background),
     .count = 3,
     .maximum = 1e6,
     .fallback = "0",
     .sentence = "the picture's red, green and blue where there is nothing"},
    {0}};

static const struct settings_schema image_schema = {
    .what = "image", .size = sizeof(struct scene_image), .fields = image_fields};

static const struct settings_field camera_fields[] = {
    {.key = "position_mm",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_camera, position_mm),
     .count = 3,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .required = true,
     .sentence = "where it stands"},
    {.key = "at_mm",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_camera, at_mm),
     .count = 3,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .required = true,
     .sentence = "what it looks at"},
    {.key = "up",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_camera, up),
     .count = 3,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .fallback = "[0, 0, 1]",
     .sentence = "the direction that is up in the picture"},
    {.key = "angle_deg",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_camera, angle_deg),
     .minimum = 0.1,
     .maximum = 170,
     .fallback = "35",
     .sentence = "full horizontal angle of view"},
    {0}};

static const struct settings_schema camera_schema = {
    .what = "camera",
    .size = sizeof(struct scene_camera),
    .fields = camera_fields,
    .line_offset = offsetof(struct scene_camera, line),
    .column_offset = offsetof(struct scene_camera, column)};

static const struct settings_field texture_fields[] = {
    {.key = "image",
     .kind = SETTINGS_PATH,
     .offset = offsetof(struct scene_texture, image),
     .sentence = "EXR or PNG file to project"},
    {.key = "pattern",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_texture, pattern),
     .words = pattern_words,
     .fallback = "none",
     .sentence = "a built-in square picture in place of a file"},
    {.key = "count",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct scene_texture, count),
     .minimum = 1,
     .maximum = 256,
     .fallback = "8",
     .sentence = "checks, stripes or meshes across the pattern"},
    {.key = "bright",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_texture, bright),
     .count = 3,
     .maximum = 1e3,
     .fallback = "1",
     .sentence = "colour of the pattern's bright parts"},
    {.key = "dark",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_texture, dark),
     .count = 3,
     .maximum = 1e3,
     .fallback = "0",
     .sentence = "colour of the pattern's dark parts"},
    {0}};

static const struct settings_schema texture_schema = {
    .what = "texture",
    .size = sizeof(struct scene_texture),
    .fields = texture_fields,
    .line_offset = offsetof(struct scene_texture, line),
    .column_offset = offsetof(struct scene_texture, column)};

static const struct settings_field light_fields[] = {
    {.key = "kind",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_light, kind),
     .required = true,
     .words = light_words,
     .sentence = "area, point, spot, or projector, which casts a sharp picture"},
    {.key = "position_mm",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_light, position_mm),
     .count = 3,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .required = true,
     .sentence = "where it is; an area light's middle"},
    {.key = "at_mm",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_light, at_mm),
     .count = 3,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .fallback = "[0, 0, 0]",
     .sentence = "the point at which it is aimed"},
    {.key = "up",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_light, up),
     .count = 3,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .fallback = "[0, 1, 0]",
     .sentence = "the direction of an area's height or a projected picture's top"},
    {.key = "irradiance",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_light, irradiance),
     .count = 3,
     .maximum = 1e6,
     .fallback = "1",
     .sentence = "red, green and blue on an unshadowed surface at at_mm that faces the light"},
    {.key = "size_mm",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_light, size_mm),
     .count = 2,
     .minimum = 1e-3,
     .maximum = FAR_MM,
     .fallback = "100",
     .sentence = "area: width and height"},
    {.key = "angle_deg",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_light, angle_deg),
     .minimum = 0.1,
     .maximum = 170,
     .fallback = "30",
     .sentence = "full angle of a spot's cone or of a projected picture's width"},
    {.key = "soft_deg",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_light, soft_deg),
     .maximum = 85,
     .fallback = "2",
     .sentence = "spot: angle over which the cone's edge fades, inwards"},
    {.key = "texture",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct scene_light, texture),
     .schema = &texture_schema,
     .sentence = "what a projector shows"},
    {0}};

static const struct settings_schema light_schema = {
    .what = "light",
    .size = sizeof(struct scene_light),
    .fields = light_fields,
    .line_offset = offsetof(struct scene_light, line),
    .column_offset = offsetof(struct scene_light, column)};

static const struct settings_field material_fields[] = {
    {.key = "file",
     .kind = SETTINGS_PATH,
     .offset = offsetof(struct scene_material, file),
     .required = true,
     .sentence = "a factored material"},
    {.key = "mapping",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_material, mapping),
     .words = mapping_words,
     .fallback = "box",
     .sentence = "how the material lies on the surface"},
    {.key = "axis",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_material, axis),
     .words = axis_words,
     .fallback = "z",
     .sentence = "the object's axis that planar looks along and cylinder turns about"},
    {.key = "point_mm",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_material, point_mm),
     .maximum = FAR_MM,
     .fallback = "0",
     .sentence = "size of a surface point on the object; 0: as measured"},
    {.key = "offset",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_material, offset),
     .count = 2,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .fallback = "0",
     .sentence = "surface points by which the material is shifted"},
    {.key = "tiling",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_material, tiling),
     .words = tiling_words,
     .fallback = "mirror",
     .sentence = "how it goes on beyond its border"},
    {.key = "mode",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_material, mode),
     .words = mode_words,
     .fallback = "full",
     .sentence = "full, or albedo: without subsurface scattering"},
    {.key = "thin",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_material, thin),
     .words = thin_words,
     .fallback = "through",
     .sentence = "whether light goes through thin parts"},
    {0}};

static const struct settings_schema material_schema = {.what = "material",
                                                       .size = sizeof(struct scene_material),
                                                       .fields = material_fields,
                                                       .line_offset =
                                                           offsetof(struct scene_material, line)};

static const struct settings_field gloss_fields[] = {
    {.key = "specular",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_gloss, specular),
     .maximum = 100,
     .fallback = "0",
     .line_offset = offsetof(struct scene_gloss, specular_line),
     .sentence = "strength of the highlight"},
    {.key = "roughness",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_gloss, roughness),
     .minimum = 1e-4,
     .maximum = 1,
     .fallback = "0.02",
     .sentence = "width of the highlight, as POV-Ray takes it"},
    {.key = "reflection",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_gloss, reflection),
     .maximum = 1,
     .fallback = "0",
     .line_offset = offsetof(struct scene_gloss, reflection_line),
     .sentence = "strength of the surroundings' mirror image, times Fresnel's where there is an "
                 "index"},
    {0}};

static const struct settings_schema gloss_schema = {
    .what = "gloss", .size = sizeof(struct scene_gloss), .fields = gloss_fields};

static const struct settings_field object_fields[] = {
    {.key = "shape",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct scene_object, shape),
     .words = shape_words,
     .required = true,
     .sentence = "a built-in shape, or a mesh from a file"},
    {.key = "file",
     .kind = SETTINGS_PATH,
     .offset = offsetof(struct scene_object, file),
     .sentence = "mesh: any file that Assimp reads (OBJ, PLY, glTF ...)"},
    {.key = "size_mm",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_object, size_mm),
     .count = 3,
     .minimum = 1e-3,
     .maximum = FAR_MM,
     .fallback = "100",
     .sentence =
         "extents in x, y, z; of meshes, knots and spheres the first is the largest extent"},
    {.key = "thickness",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_object, thickness),
     .minimum = 0.1,
     .maximum = 0.8,
     .fallback = "0.5",
     .sentence = "knot: radius of the tube over that of its winding"},
    {.key = "position_mm",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_object, position_mm),
     .count = 3,
     .minimum = -FAR_MM,
     .maximum = FAR_MM,
     .fallback = "0",
     .sentence = "of the middle of the object's bottom"},
    {.key = "rotation_deg",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_object, rotation_deg),
     .count = 3,
     .minimum = -360,
     .maximum = 360,
     .fallback = "0",
     .sentence = "turned about x, then y, then z"},
    {.key = "color",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_object, color),
     .count = 3,
     .maximum = 1,
     .fallback = "0.5",
     .sentence = "diffuse reflectance of an object without a material"},
    {.key = "index",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_object, index),
     .minimum = 1,
     .maximum = 4,
     .fallback = "1",
     .line_offset = offsetof(struct scene_object, index_line),
     .sentence = "of refraction: how light enters, leaves and is mirrored by its angle"},
    {.key = "material",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct scene_object, material),
     .schema = &material_schema,
     .sentence = "makes the object translucent"},
    {.key = "gloss",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct scene_object, gloss),
     .schema = &gloss_schema,
     .sentence = "highlight"},
    {0}};

static const struct settings_schema object_schema = {
    .what = "object",
    .size = sizeof(struct scene_object),
    .fields = object_fields,
    .line_offset = offsetof(struct scene_object, line),
    .column_offset = offsetof(struct scene_object, column)};

static const struct settings_field environment_fields[] = {
    {.key = "image",
     .kind = SETTINGS_PATH,
     .offset = offsetof(struct scene_environment, image),
     .sentence = "equirectangular EXR or PNG file; without it all directions are alike"},
    {.key = "color",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct scene_environment, color),
     .count = 3,
     .maximum = 1e6,
     .fallback = "1",
     .sentence = "its values, or what the image is multiplied with; 1 all around is irradiance 1"},
    {.key = "rotation_deg",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct scene_environment, rotation_deg),
     .minimum = -360,
     .maximum = 360,
     .fallback = "0",
     .sentence = "about z; at 0 the image's middle lies along y"},
    {0}};

static const struct settings_schema environment_schema = {
    .what = "environment",
    .size = sizeof(struct scene_environment),
    .fields = environment_fields,
    .line_offset = offsetof(struct scene_environment, line),
    .column_offset = offsetof(struct scene_environment, column)};

static const struct settings_field scene_fields[] = {
    {.key = "image",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct scene, image),
     .schema = &image_schema,
     .sentence = "size and exposure of the picture"},
    {.key = "camera",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct scene, camera),
     .schema = &camera_schema,
     .required = true,
     .sentence = "the view"},
    {.key = "environment",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct scene, environment),
     .schema = &environment_schema,
     .sentence = "light from all around, which the picture shows behind everything"},
    {.key = "bounces",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct scene, bounces),
     .maximum = 16,
     .fallback = "0",
     .line_offset = offsetof(struct scene, bounces_line),
     .sentence = "how often light passes on from surface to surface"},
    {.key = "without",
     .kind = SETTINGS_STRINGS,
     .offset = offsetof(struct scene, without),
     .length_offset = offsetof(struct scene, without_count),
     .line_offset = offsetof(struct scene, without_line),
     .words = render_effects_forbiddable,
     .sentence = "effects that must not be rendered, by the names that --explain prints"},
    {.key = "lights",
     .kind = SETTINGS_LIST,
     .offset = offsetof(struct scene, lights),
     .length_offset = offsetof(struct scene, light_count),
     .schema = &light_schema,
     .required = true,
     .sentence = "what shines"},
    {.key = "objects",
     .kind = SETTINGS_LIST,
     .offset = offsetof(struct scene, objects),
     .length_offset = offsetof(struct scene, object_count),
     .line_offset = offsetof(struct scene, objects_line),
     .column_offset = offsetof(struct scene, objects_column),
     .schema = &object_schema,
     .required = true,
     .sentence = "what is shone upon"},
    {0}};

static const struct settings_schema scene_schema = {
    .what = "scene file", .size = sizeof(struct scene), .fields = scene_fields};

static bool apart(const double a[3], const double b[3])
{
    return vec3_length(vec3_subtract(vec3_from_doubles(a), vec3_from_doubles(b))) > 1e-6;
}

static int check_light(const char *name, const struct scene_light *light, struct nacre_error *error)
{
    const struct scene_texture *texture = &light->texture;
    bool shows = texture->image || texture->pattern != PATTERN_NONE;
    if (!apart(light->position_mm, light->at_mm)) {
        return nacre_fail(error, "%s:%d:%d: the light's position_mm and at_mm are the same point",
                          name, light->line, light->column);
    }
    if (light->kind == LIGHT_PROJECTOR && !shows) {
        return nacre_fail(
            error,
            "%s:%d:%d: the projector shows nothing; give it a texture with an image or "
            "a pattern",
            name, light->line, light->column);
    }
    if (light->kind != LIGHT_PROJECTOR && shows) {
        return nacre_fail(error,
                          "%s:%d:%d: only a projector can have a texture; make its kind projector",
                          name, texture->line, texture->column);
    }
    if (texture->image && texture->pattern != PATTERN_NONE) {
        return nacre_fail(error, "%s:%d:%d: the texture has an image and a pattern; leave one out",
                          name, texture->line, texture->column);
    }
    return NACRE_OK;
}

static int check(const char *name, const struct scene *scene, struct nacre_error *error)
{
    const struct scene_camera *camera = &scene->camera;
    const double *background = scene->image.background;
    struct vec3 view = vec3_unit(
        vec3_subtract(vec3_from_doubles(camera->at_mm), vec3_from_doubles(camera->position_mm)));
    struct vec3 up = vec3_unit(vec3_from_doubles(camera->up));
    if (!apart(camera->position_mm, camera->at_mm)) {
        return nacre_fail(error, "%s:%d:%d: the camera's position_mm and at_mm are the same point",
                          name, camera->line, camera->column);
    }
    if (vec3_length(vec3_cross(view, up)) < 1e-4) {
        return nacre_fail(error, "%s:%d:%d: the camera looks along its own `up`; give another up",
                          name, camera->line, camera->column);
    }
    if (scene->environment.line > 0 &&
        fmax(fmax(background[0], background[1]), background[2]) > 0) {
        return nacre_fail(error,
                          "%s:%d:%d: the environment is the picture's background; leave out "
                          "image.background",
                          name, scene->environment.line, scene->environment.column);
    }
    for (size_t i = 0; i < scene->light_count; i++) {
        if (check_light(name, &scene->lights[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct scene_object *object = &scene->objects[i];
        if ((object->shape == SHAPE_MESH) != (object->file != NULL)) {
            return nacre_fail(error,
                              object->file ? "%s:%d:%d: only a mesh has a file; make its shape mesh"
                                           : "%s:%d:%d: a mesh needs a file",
                              name, object->line, object->column);
        }
    }
    return scene->object_count > 0
               ? NACRE_OK
               : nacre_fail(error, "%s:%d:%d: the scene has no objects; give it one", name,
                            scene->objects_line, scene->objects_column);
}

int scene_read(const char *path, struct scene *scene, struct nacre_error *error)
{
    int status = settings_read(path, &scene_schema, scene, error);
    if (status == NACRE_OK && check(path, scene, error) != NACRE_OK) {
        scene_finish(scene);
        status = NACRE_FAILED;
    }
    return status;
}

int scene_parse(const char *name, const char *folder, const char *text, size_t size,
                struct scene *scene, struct nacre_error *error)
{
    int status = settings_parse(name, folder, text, size, &scene_schema, scene, error);
    if (status == NACRE_OK && check(name, scene, error) != NACRE_OK) {
        scene_finish(scene);
        status = NACRE_FAILED;
    }
    return status;
}

void scene_finish(struct scene *scene)
{
    settings_finish(&scene_schema, scene);
}
