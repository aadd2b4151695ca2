/* Refining plain meshes for the camera and lighting their vertices. */
#include "render/plain.h"

#include "render/irradiance.h"

enum {
    RAYS = 144, /* to an area light: the steps of a penumbra vanish between them */
    FIRST_SPLITS =
        48, /* over the largest extent, so that no visible middle hides between unseen edges */
    VERTICES_A_STEP = 4096,
};

static const double edge_pixels = 8;

struct view {
    struct vec3 position, forward;
    double pixel;      /* angle, radians */
    double cos_corner; /* of the angle to the picture's corner, with a margin */
};

bool plain_wanted(const struct scene *scene)
{
    for (size_t i = 0; i < scene->light_count; i++) {
        if (scene->lights[i].kind == LIGHT_AREA) {
            return true;
        }
    }
    return false;
}

static double allowed_in_view(const void *context, struct vec3 a, struct vec3 b)
{
    const struct view *view = context;
    struct vec3 middle = vec3_scale(vec3_add(a, b), 0.5);
    struct vec3 way = vec3_subtract(middle, view->position);
    double distance = vec3_length(way), half = vec3_length(vec3_subtract(b, a)) / 2;
    double off = acos(fmin(fmax(vec3_dot(vec3_unit(way), view->forward), -1), 1));
    double reach = distance > half ? asin(half / distance) : 2;
    if (off - reach > acos(view->cos_corner)) {
        return HUGE_VAL; /* out of the picture */
    }
    return fmax(distance - half, distance / 4) * view->pixel * edge_pixels;
}

int plain_refine(struct mesh *mesh, const struct scene *scene, size_t limit,
                 struct nacre_error *error)
{
    const struct scene_camera *camera = &scene->camera;
    struct vec3 low, high, position = vec3_from_doubles(camera->position_mm);
    double half = tan(camera->angle_deg / 2 * acos(-1.0) / 180);
    double aspect = (double)scene->image.height / scene->image.width;
    bool limited;
    mesh_bounds(mesh, &low, &high);
    double even = vec3_length(vec3_subtract(high, low)) / FIRST_SPLITS;
    struct view view = {
        .position = position,
        .forward = vec3_unit(vec3_subtract(vec3_from_doubles(camera->at_mm), position)),
        .pixel = 2 * half / scene->image.width,
        .cos_corner = cos(fmin(atan(half * hypot(1, aspect)) * 1.05, 1.5)),
    };
    if (mesh_subdivide(mesh, mesh_edge_even, &even, limit, &limited, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return mesh_subdivide(mesh, allowed_in_view, &view, limit, &limited, error);
}

int plain_light(const struct mesh *mesh, const struct world *world, const struct light *lights,
                size_t light_count, uint64_t seed, struct progress *progress,
                float (*irradiance)[3], struct nacre_error *error)
{
    for (size_t begin = 0; begin < mesh->vertex_count; begin += VERTICES_A_STEP) {
        size_t left = mesh->vertex_count - begin;
        size_t end = begin + (left < VERTICES_A_STEP ? left : VERTICES_A_STEP);
        int stopped =
            progress_step(progress, (double)begin, (double)mesh->vertex_count, NULL, error);
        if (stopped != NACRE_OK) {
            return stopped;
        }
#pragma omp parallel for schedule(dynamic, 64)
        for (size_t i = begin; i < end; i++) {
            double sum[3] = {0};
            for (size_t l = 0; l < light_count; l++) {
                double one[3] = {0};
                if (lights[l].kind == LIGHT_AREA) {
                    (void)irradiance_penumbra(world, &lights[l], vec3_from(mesh->positions[i]),
                                              vec3_from(mesh->normals[i]), RAYS, seed + l, i, one);
                }
                for (int c = 0; c < 3; c++) {
                    sum[c] += one[c];
                }
            }
            vec3_store(vec3_from_doubles(sum), irradiance[i]);
        }
    }
    return NACRE_OK;
}
