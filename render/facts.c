/* Looking at materials and meshes for what their effects depend on. */
#include "render/facts.h"

enum {
    CONVEX_TESTS = 50000000, /* of a corner against a plane; larger meshes are not looked at */
    THIN_TRIANGLES = 4096,
};

/* Of a mesh's extent: rounding of its coordinates, and what no picture shows. */
static const double flat = 1e-5;

static bool planes_alike(const float *planes, size_t count, size_t channels, size_t plane)
{
    for (size_t i = 0; i < count; i++) {
        const float *first = planes + i * channels * plane;
        for (size_t k = 0; k < plane * (channels - 1); k++) {
            if (first[plane + k] != first[k % plane]) {
                return false;
            }
        }
    }
    return true;
}

static bool material_is_grey(const struct nacre_material *material)
{
    size_t texels = (size_t)material->width * (size_t)material->height;
    size_t window = (size_t)material->window * (size_t)material->window;
    size_t channels = (size_t)material->channels, factors = (size_t)material->factor_channels;
    size_t terms = (size_t)material->terms;
    size_t kernels = (size_t)nacre_material_kernel_count(material);
    return planes_alike(material->kernels, kernels, channels, window) &&
           planes_alike(material->f, terms, factors, texels) &&
           (!material->h || planes_alike(material->h, terms, factors, texels)) &&
           (!material->centre || planes_alike(material->centre, 1, channels, texels));
}

static double kernel_spread(const float *kernel, int window)
{
    double sum = 0, square = 0;
    for (int i = 0; i < window * window; i++) {
        int x = i % window - window / 2, y = i / window - window / 2;
        sum += kernel[i];
        square += (double)kernel[i] * (x * x + y * y);
    }
    return sum > 0 ? sqrt(square / sum) : 0;
}

void facts_of_material(struct render_object_facts *facts, const struct nacre_material *material,
                       const struct appearance *appearance)
{
    size_t window = (size_t)material->window * (size_t)material->window;
    size_t texels = (size_t)material->width * (size_t)material->height;
    int kernels = nacre_material_kernel_count(material);
    facts->kernels = kernels;
    facts->terms = material->terms;
    facts->grey = material_is_grey(material);
    facts->gathers = appearance->gathers;
    facts->reach_points = (material->window / 2 + 1) * sqrt(2); /* NOLINT: K is odd */
    for (size_t i = 0; i < texels * 3; i++) {
        facts->local = facts->local || appearance->local[i] > 0;
    }
    for (size_t i = 0; i < (size_t)kernels * (size_t)material->channels; i++) {
        facts->spread_points = fmax(
            facts->spread_points, kernel_spread(material->kernels + i * window, material->window));
    }
}

/* Whether all corners lie behind the planes of all triangles. */
static bool is_convex(const struct mesh *mesh, double extent)
{
    if ((double)mesh->vertex_count * (double)mesh->triangle_count > CONVEX_TESTS) {
        return false;
    }
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        struct vec3 normal = vec3_unit(mesh_triangle_cross(mesh, t));
        struct vec3 corner = vec3_from(mesh->positions[mesh->triangles[t][0]]);
        double limit = vec3_dot(normal, corner) + flat * extent;
        for (size_t v = 0; v < mesh->vertex_count; v++) {
            if (vec3_dot(normal, vec3_from(mesh->positions[v])) > limit) {
                return false;
            }
        }
    }
    return true;
}

void facts_of_mesh(struct render_object_facts *facts, const struct mesh *mesh,
                   const struct scene *scene)
{
    struct vec3 eye = vec3_from_doubles(scene->camera.position_mm);
    mesh_bounds(mesh, &facts->low, &facts->high);
    facts->convex = scene->object_count == 1 &&
                    is_convex(mesh, vec3_length(vec3_subtract(facts->high, facts->low)));
    struct vec3 outside = {fmax(fmax(facts->low.x - eye.x, eye.x - facts->high.x), 0),
                           fmax(fmax(facts->low.y - eye.y, eye.y - facts->high.y), 0),
                           fmax(fmax(facts->low.z - eye.z, eye.z - facts->high.z), 0)};
    double half = tan(scene->camera.angle_deg / 2 * acos(-1.0) / 180);
    facts->pixel_mm = vec3_length(outside) * 2 * half / scene->image.width;
}

double facts_thin_share(const struct world *world, size_t object, const struct mesh *mesh,
                        double reach_mm)
{
    size_t step = mesh->triangle_count / THIN_TRIANGLES + 1;
    double area = 0, thin = 0;
    for (size_t t = 0; t < mesh->triangle_count; t += step) {
        struct vec3 cross = mesh_triangle_cross(mesh, t), inward = vec3_scale(vec3_unit(cross), -1);
        struct world_hit hit, middle = {object, t, 1.0 / 3, 1.0 / 3};
        struct vec3 place = world_place(mesh, &middle);
        double share = vec3_length(cross);
        area += share;
        if (world_look(world, place, inward, inward, &hit) && hit.object == object) {
            struct vec3 way = vec3_subtract(world_place(mesh, &hit), place);
            thin += vec3_length(way) < reach_mm ? share : 0;
        }
    }
    return area > 0 ? thin / area : 0;
}
