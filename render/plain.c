/* Refining plain meshes for the camera and lighting their vertices. */
#include "render/plain.h"

#include "render/effects.h"

enum {
    FIRST_SPLITS =
        48, /* over the largest extent, so that no visible middle hides between unseen edges */
    VERTICES_A_STEP = 4096,
};

static const double edge_pixels = 8, contact_pixels = 0.4;

struct view {
    struct vec3 position, forward;
    double pixel;      /* angle, radians */
    double cos_corner; /* of the angle to the picture's corner, with a margin */
    bool around;       /* the camera goes round the vertical through `at` */
    struct vec3 at;
    const struct world *others; /* or NULL */
};

/* Where the camera comes nearest to a point. */
static struct vec3 nearest_position(const struct view *view, struct vec3 point)
{
    struct vec3 arm = vec3_subtract(view->position, view->at);
    struct vec3 towards = vec3_subtract(point, view->at);
    double radius = hypot(arm.x, arm.y), length = fmax(hypot(towards.x, towards.y), 1e-9);
    return (struct vec3){view->at.x + towards.x / length * radius,
                         view->at.y + towards.y / length * radius, view->position.z};
}

static double allowed_in_view(const void *context, struct vec3 a, struct vec3 b)
{
    const struct view *view = context;
    struct vec3 middle = vec3_scale(vec3_add(a, b), 0.5);
    struct vec3 way =
        vec3_subtract(middle, view->around ? nearest_position(view, middle) : view->position);
    double distance = vec3_length(way), half = vec3_length(vec3_subtract(b, a)) / 2;
    double off = acos(fmin(fmax(vec3_dot(vec3_unit(way), view->forward), -1), 1));
    double reach = distance > half ? asin(half / distance) : 2;
    if (!view->around && off - reach > acos(view->cos_corner)) {
        return HUGE_VAL; /* out of the picture */
    }
    double pixel_mm = fmax(distance - half, distance / 4) * view->pixel;
    bool cut = view->others && 2 * half > contact_pixels * pixel_mm &&
               2 * half <= edge_pixels * pixel_mm && world_crossed(view->others, a, b);
    return pixel_mm * (cut ? contact_pixels : edge_pixels);
}

int plain_refine(struct mesh *mesh, const struct scene *scene, bool around,
                 const struct world *others, size_t limit, struct nacre_error *error)
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
        .around = around,
        .at = vec3_from_doubles(camera->at_mm),
        .others = others,
        .cos_corner = cos(fmin(atan(half * hypot(1, aspect)) * 1.05, 1.5)),
    };
    if (mesh_subdivide(mesh, mesh_edge_even, &even, limit, &limited, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return mesh_subdivide(mesh, allowed_in_view, &view, limit, &limited, error);
}

static void light_vertex(const struct lighting *lighting, enum plain_light which,
                         const struct lit_point *point, double sum[3], struct light_work *work)
{
    struct lighting single = *lighting;
    sum[0] = sum[1] = sum[2] = 0;
    if (which == PLAIN_SURFACES) {
        single.rays = PLAIN_SURFACE_RAYS;
        single.light_count = 0;
        irradiance_at(&single, point, sum, work);
        return;
    }
    for (size_t l = 0; l < lighting->light_count; l++) {
        const struct light *light = &lighting->lights[l];
        double one[3] = {0};
        single.rays = PLAIN_RAYS;
        single.seed = lighting->seed + l;
        if (light->soft && which == PLAIN_SOFT) {
            irradiance_penumbra(&single, light, point, one, work);
        } else if (!light->soft && which == PLAIN_HARD) {
            single.lights = light;
            single.light_count = 1;
            single.reflectors = NULL;
            irradiance_at(&single, point, one, work);
        }
        for (int c = 0; c < 3; c++) {
            sum[c] += one[c];
        }
    }
}

int plain_light(const struct mesh *mesh, const struct lighting *lighting, enum plain_light which,
                struct progress *progress, float (*irradiance)[3], struct light_work *work,
                struct nacre_error *error)
{
    for (size_t begin = 0; begin < mesh->vertex_count; begin += VERTICES_A_STEP) {
        size_t left = mesh->vertex_count - begin;
        size_t end = begin + (left < VERTICES_A_STEP ? left : VERTICES_A_STEP);
        int stopped =
            progress_step(progress, (double)begin, (double)mesh->vertex_count, NULL, error);
        if (stopped != NACRE_OK) {
            return stopped;
        }
#pragma omp parallel
        {
            struct light_work own = {0};
#pragma omp for schedule(dynamic, 64)
            for (size_t i = begin; i < end; i++) {
                const struct lit_point point = {vec3_from(mesh->positions[i]),
                                                vec3_from(mesh->normals[i]), 1, i};
                double sum[3];
                light_vertex(lighting, which, &point, sum, &own);
                vec3_store(vec3_from_doubles(sum), irradiance[i]);
            }
#pragma omp critical(plain_work)
            light_work_add(work, &own);
        }
    }
    return NACRE_OK;
}
