/* Whether a point lies inside a translucent object. */
#include "render/inside.h"

enum { DIRECTIONS = 14 };

/* The object whose inner side all rays from the point meet first, or object_count. */
static size_t surrounding(const struct stage *stage, struct vec3 point)
{
    size_t none = stage->scene->object_count, around = none;
    for (int i = 0; i < DIRECTIONS; i++) {
        /* Evenly on the sphere, and along no axis, where meshes have their edges. */
        double z = 1 - (2 * i + 1.0) / DIRECTIONS, angle = 2.399963 * i + 0.3;
        double side = sqrt(1 - z * z);
        struct vec3 direction = {side * cos(angle), side * sin(angle), z};
        struct world_hit hit;
        if (!world_trace(stage->world, point, direction, &hit) ||
            (around != none && hit.object != around)) {
            return none;
        }
        const struct mesh *mesh = &stage->objects[hit.object].mesh;
        const uint32_t *t = mesh->triangles[hit.triangle];
        struct vec3 a = vec3_from(mesh->positions[t[0]]);
        struct vec3 outwards = vec3_cross(vec3_subtract(vec3_from(mesh->positions[t[1]]), a),
                                          vec3_subtract(vec3_from(mesh->positions[t[2]]), a));
        if (!stage->objects[hit.object].translucent || vec3_dot(outwards, direction) <= 0) {
            return none;
        }
        around = hit.object;
    }
    return around;
}

int lights_check_outside(const struct stage *stage, struct nacre_error *error)
{
    const struct scene *scene = stage->scene;
    for (size_t i = 0; i < scene->light_count; i++) {
        size_t around = surrounding(stage, vec3_from_doubles(scene->lights[i].position_mm));
        if (around < scene->object_count) {
            return nacre_fail(error,
                              "the light at line %d, column %d is inside the translucent object at "
                              "line %d, column %d "
                              "and would light nothing; move it out",
                              scene->lights[i].line, scene->lights[i].column,
                              scene->objects[around].line, scene->objects[around].column);
        }
    }
    return NACRE_OK;
}
