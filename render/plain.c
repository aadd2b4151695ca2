/* Lighting the vertices of plain meshes. */
#include "render/plain.h"

enum { VERTICES_A_STEP = 4096 };

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
        single.rays = which == PLAIN_ROUGH ? PLAIN_ROUGH_RAYS : PLAIN_RAYS;
        single.seed = lighting->seed + l;
        if (light->soft && which != PLAIN_HARD) {
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

int plain_light(const struct mesh *mesh, size_t first, const struct lighting *lighting,
                enum plain_light which, struct progress *progress, float (*irradiance)[3],
                struct light_work *work, struct nacre_error *error)
{
    for (size_t begin = first; begin < mesh->vertex_count; begin += VERTICES_A_STEP) {
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
