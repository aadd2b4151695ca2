/* Reading scene files, and what keys that are good by themselves may not be together. */
#include "render/scene.h"

#include "render/scene_schema.h"
#include "render/vector.h"

#include <math.h>
#include <sys/stat.h>

/* As far as a direction needs it, also in POV-Ray's files, which have seven digits. */
static bool apart(const double a[3], const double b[3])
{
    double far = vec3_length(vec3_from_doubles(a)) + vec3_length(vec3_from_doubles(b));
    double away = vec3_length(vec3_subtract(vec3_from_doubles(a), vec3_from_doubles(b)));
    return away > fmax(1e-3, 1e-5 * far);
}

static int check_light(const char *name, const struct scene_light *light, struct nacre_error *error)
{
    const struct scene_texture *texture = &light->texture;
    bool shows = texture->image || texture->pattern != PATTERN_NONE;
    if (!apart(light->position_mm, light->at_mm)) {
        return nacre_fail(error,
                          "%s:%d:%d: the light's position_mm and at_mm are (nearly) the same point",
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
        return nacre_fail(
            error, "%s:%d:%d: the camera's position_mm and at_mm are (nearly) the same point", name,
            camera->line, camera->column);
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

static bool is_file(const struct stat *file, const char *path)
{
    struct stat status;
    return path && stat(path, &status) == 0 && status.st_dev == file->st_dev &&
           status.st_ino == file->st_ino;
}

int scene_check_output(const struct scene *scene, const char *path, struct nacre_error *error)
{
    struct stat file;
    if (stat(path, &file) != 0 || !S_ISREG(file.st_mode)) {
        return NACRE_OK;
    }
    bool read = is_file(&file, scene->environment.image);
    for (size_t i = 0; i < scene->light_count; i++) {
        read = read || is_file(&file, scene->lights[i].texture.image);
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct scene_object *object = &scene->objects[i];
        read = read || is_file(&file, object->file) || is_file(&file, object->material.file);
    }
    return read ? nacre_fail(error,
                             "%s is to be read and would be overwritten; give the output another "
                             "name",
                             path)
                : NACRE_OK;
}

void scene_finish(struct scene *scene)
{
    settings_finish(&scene_schema, scene);
}
