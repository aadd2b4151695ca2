/* Rays through Embree. */
#include "render/world.h"

#include <embree3/rtcore.h>

#include <stdlib.h>
#include <string.h>

struct world {
    RTCDevice device;
    RTCScene scene;
    double lift_mm;
    struct vec3 centre;
    double radius_mm;
};

static int check_device(RTCDevice device, struct nacre_error *error)
{
    enum RTCError code = rtcGetDeviceError(device);
    return code == RTC_ERROR_NONE
               ? NACRE_OK
               : nacre_fail(error, "Embree cannot prepare the scene's surfaces (error %d)",
                            (int)code);
}

static int add_mesh(struct world *world, const struct mesh *mesh, unsigned id,
                    struct nacre_error *error)
{
    RTCGeometry geometry = rtcNewGeometry(world->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    /* Embree reads up to 4 bytes past the last vertex of its own buffers, so it gets to own them. */
    void *vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                             3 * sizeof(float), mesh->vertex_count);
    void *triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              3 * sizeof(uint32_t), mesh->triangle_count);
    if (vertices && triangles) {
        memcpy(vertices, mesh->positions, mesh->vertex_count * sizeof *mesh->positions);
        memcpy(triangles, mesh->triangles, mesh->triangle_count * sizeof *mesh->triangles);
        rtcCommitGeometry(geometry);
        rtcAttachGeometryByID(world->scene, geometry, id);
    }
    rtcReleaseGeometry(geometry);
    return check_device(world->device, error);
}

int world_new(const struct mesh *const *meshes, size_t count, struct world **world,
              struct nacre_error *error)
{
    int status = NACRE_FAILED;
    struct world *made = calloc(1, sizeof *made);
    *world = NULL;
    if (!made) {
        return nacre_fail_memory(error, "the scene's surfaces");
    }
    world_sphere(meshes, count, &made->centre, &made->radius_mm);
    made->device = rtcNewDevice("threads=0");
    if (!made->device) {
        (void)nacre_fail(error, "Embree cannot start (error %d)", (int)rtcGetDeviceError(NULL));
        goto out;
    }
    made->scene = rtcNewScene(made->device);
    rtcSetSceneFlags(made->scene, RTC_SCENE_FLAG_ROBUST);
    for (size_t i = 0; i < count; i++) {
        if (add_mesh(made, meshes[i], (unsigned)i, error) != NACRE_OK) {
            goto out;
        }
        /* A few rounding steps of the coordinates; more would leak light past contacts. */
        for (size_t v = 0; v < meshes[i]->vertex_count; v++) {
            double size = vec3_length(vec3_from(meshes[i]->positions[v]));
            made->lift_mm = fmax(made->lift_mm, size * 2e-6);
        }
    }
    rtcCommitScene(made->scene);
    if (check_device(made->device, error) != NACRE_OK) {
        goto out;
    }
    *world = made;
    made = NULL;
    status = NACRE_OK;
out:
    world_free(made);
    return status;
}

void world_free(struct world *world)
{
    if (world) {
        if (world->scene) {
            rtcReleaseScene(world->scene);
        }
        if (world->device) {
            rtcReleaseDevice(world->device);
        }
        free(world);
    }
}

void world_sphere(const struct mesh *const *meshes, size_t count, struct vec3 *centre,
                  double *radius_mm)
{
    struct vec3 low = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (size_t i = 0; i < count; i++) {
        struct vec3 l, h;
        mesh_bounds(meshes[i], &l, &h);
        low = (struct vec3){fmin(low.x, l.x), fmin(low.y, l.y), fmin(low.z, l.z)};
        high = (struct vec3){fmax(high.x, h.x), fmax(high.y, h.y), fmax(high.z, h.z)};
    }
    *centre = vec3_scale(vec3_add(low, high), 0.5);
    *radius_mm = vec3_length(vec3_subtract(high, low)) / 2;
}

void world_bounds(const struct world *world, struct vec3 *centre, double *radius_mm)
{
    *centre = world->centre;
    *radius_mm = world->radius_mm;
}

struct vec3 world_place(const struct mesh *mesh, const struct world_hit *hit)
{
    const uint32_t *corners = mesh->triangles[hit->triangle];
    struct vec3 p = vec3_scale(vec3_from(mesh->positions[corners[0]]), 1 - hit->b1 - hit->b2);
    p = vec3_along(p, hit->b1, vec3_from(mesh->positions[corners[1]]));
    return vec3_along(p, hit->b2, vec3_from(mesh->positions[corners[2]]));
}

static struct RTCRayHit ray_along(struct vec3 start, struct vec3 way, float length)
{
    return (struct RTCRayHit){.ray = {.org_x = (float)start.x,
                                      .org_y = (float)start.y,
                                      .org_z = (float)start.z,
                                      .dir_x = (float)way.x,
                                      .dir_y = (float)way.y,
                                      .dir_z = (float)way.z,
                                      .tfar = length,
                                      .mask = UINT32_MAX},
                              .hit = {.geomID = RTC_INVALID_GEOMETRY_ID}};
}

static bool occluded(const struct world *world, struct vec3 start, struct vec3 way, float length)
{
    struct RTCIntersectContext context;
    struct RTCRayHit ray = ray_along(start, way, length);
    /* What the surface stands on begins right there, and is not in the way. */
    ray.ray.tnear = (float)(world->lift_mm / vec3_length(way));
    rtcInitIntersectContext(&context);
    rtcOccluded1(world->scene, &context, &ray.ray);
    return ray.ray.tfar < 0;
}

static bool trace(const struct world *world, struct RTCRayHit *ray)
{
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(world->scene, &context, ray);
    return ray->hit.geomID != RTC_INVALID_GEOMETRY_ID;
}

bool world_blocked(const struct world *world, struct vec3 surface, struct vec3 normal,
                   struct vec3 other)
{
    struct vec3 start = vec3_along(surface, world->lift_mm, normal);
    return occluded(world, start, vec3_subtract(other, start), 0.99999F);
}

bool world_look(const struct world *world, struct vec3 surface, struct vec3 normal,
                struct vec3 direction, struct world_hit *hit)
{
    return world_trace(world, vec3_along(surface, world->lift_mm, normal), direction, hit);
}

bool world_trace(const struct world *world, struct vec3 origin, struct vec3 direction,
                 struct world_hit *hit)
{
    struct RTCRayHit ray = ray_along(origin, direction, HUGE_VALF);
    if (!trace(world, &ray)) {
        return false;
    }
    *hit = (struct world_hit){ray.hit.geomID, ray.hit.primID, ray.hit.u, ray.hit.v};
    return true;
}
