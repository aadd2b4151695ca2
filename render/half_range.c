/* Estimating the largest values of a picture. */
#include "render/half_range.h"

/* Values between need no scaling: highlights may be some times brighter than what is looked at. */
static const double dim = 1.0 / 16, bright = 4096;

/* Of the lights that POV-Ray draws, at a vertex, unshadowed. */
static double hard_light(const struct stage *stage, struct vec3 place, struct vec3 normal)
{
    const double middle[2] = {0.5, 0.5};
    double sum = 0;
    for (size_t l = 0; l < stage->scene->light_count; l++) {
        if (!stage->lights[l].soft) {
            struct light_arrival arrival = light_arrive(&stage->lights[l], place, normal, middle);
            sum += fmax(arrival.irradiance[0], fmax(arrival.irradiance[1], arrival.irradiance[2]));
        }
    }
    return sum;
}

/* The largest value on an object, without the exposure. */
static double object_peak(const struct stage *stage, size_t number)
{
    const struct stage_object *object = &stage->objects[number];
    const struct scene_object *settings = &stage->scene->objects[number];
    double colour = fmax(settings->color[0], fmax(settings->color[1], settings->color[2]));
    double baked_share = object->translucent ? 1 : colour;
    double hard_share = (object->translucent ? 0 : colour) + settings->gloss.specular;
    double peak = 0;
    for (size_t i = 0; i < object->mesh.vertex_count; i++) {
        const float *light = object->light ? object->light[i] : NULL;
        double baked = light ? fmaxf(light[0], fmaxf(light[1], light[2])) : 0;
        double hard = hard_share > 0 ? hard_light(stage, vec3_from(object->mesh.positions[i]),
                                                  vec3_from(object->mesh.normals[i]))
                                     : 0;
        peak = fmax(peak, baked * baked_share + hard * hard_share);
    }
    return peak;
}

double half_range_scale(const struct stage *stage)
{
    const struct scene_image *image = &stage->scene->image;
    double peak = 0;
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        peak = fmax(peak, object_peak(stage, i));
    }
    peak *= image->exposure;
    for (int c = 0; c < 3; c++) {
        peak = fmax(peak, image->background[c]);
    }
    if (!(peak > 0) || !isfinite(peak) || (peak >= dim && peak <= bright)) {
        return 1;
    }
    return exp2(-round(log2(peak)));
}
