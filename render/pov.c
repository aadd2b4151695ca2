/* Writing POV-Ray 3.7 scenes. */
#include "render/pov.h"

#include "render/fresnel.h"
#include "render/pov_digest.h"
#include "render/pov_sky.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

enum { AREA_LIGHTS = 9 }; /* on a side; 2^3 + 1, as `adaptive` wants */

/* A path in the folder, on the heap; NULL when memory ran out. */
__attribute__((format(printf, 2, 3))) static char *path_in(const char *folder, const char *format,
                                                           ...)
{
    char name[64], *path = NULL;
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(name, sizeof name, format, arguments);
    va_end(arguments);
    return asprintf(&path, "%s/%s", folder, name) < 0 ? NULL : path;
}

static void put_vector(FILE *file, struct vec3 v)
{
    (void)fprintf(file, "<%.7g, %.7g, %.7g>", v.x, v.y, v.z);
}

static void put_colour(FILE *file, const double colour[3], double factor)
{
    (void)fprintf(file, "rgb <%.6g, %.6g, %.6g>", colour[0] * factor, colour[1] * factor,
                  colour[2] * factor);
}

static void put_camera(FILE *file, const struct scene *scene)
{
    const struct scene_camera *camera = &scene->camera;
    (void)fprintf(file, "// POV-Ray is left-handed; the minus before x makes it right-handed.\n"
                        "camera {\n  location ");
    put_vector(file, vec3_from_doubles(camera->position_mm));
    (void)fprintf(file, "\n  sky ");
    put_vector(file, vec3_from_doubles(camera->up));
    (void)fprintf(file, "\n  right -x*%d/%d\n  up y\n  angle %.7g\n  look_at ", scene->image.width,
                  scene->image.height, camera->angle_deg);
    put_vector(file, vec3_from_doubles(camera->at_mm));
    (void)fprintf(file, "\n}\n\n");
}

/* An opaque case of half side l round a projector with a window of 2 w by 2 h at distance s: light would go round a slide
 * alone. */
static void put_case(FILE *file, const struct light *light, double l, double s, double w, double h)
{
    (void)fprintf(file,
                  "union {\n  difference {\n    box { <%.7g, %.7g, %.7g>, <%.7g, %.7g, %.7g> }\n"
                  "    box { <%.7g, %.7g, %.7g>, <%.7g, %.7g, %.7g> }\n  }\n",
                  -l, -l, -s, l, l, s, -0.97 * l, -0.97 * l, -0.97 * s, 0.97 * l, 0.97 * l,
                  1.01 * s);
    (void)fprintf(file,
                  "  polygon {\n    10, <%.7g, %.7g>, <%.7g, %.7g>, <%.7g, %.7g>, <%.7g, %.7g>, "
                  "<%.7g, %.7g>,\n    <%.7g, %.7g>, <%.7g, %.7g>, <%.7g, %.7g>, <%.7g, %.7g>, "
                  "<%.7g, %.7g>\n    translate %.7g*z\n  }\n",
                  -l, -l, l, -l, l, l, -l, l, -l, -l, -w, -h, w, -h, w, h, -w, h, -w, -h, s);
    (void)fprintf(file, "  pigment { rgb 0 }\n  finish { ambient 0 diffuse 0 }\n  matrix <");
    struct vec3 frame[4] = {light->right, light->up, light->forward, light->position};
    for (int k = 0; k < 4; k++) {
        (void)fprintf(file, "%s%.7g, %.7g, %.7g", k ? ", " : "", frame[k].x, frame[k].y,
                      frame[k].z);
    }
    (void)fprintf(file, ">\n  no_image no_reflection\n}\n\n");
}

/* A projector's slide in its case. */
static void put_slide(FILE *file, const struct light *light, size_t number)
{
    double s = light->distance_mm * 0.02, w = light->tan_x * s, h = light->tan_y * s;
    double l = 1.2 * fmax(s, fmax(w, h));
    struct vec3 corner =
        vec3_along(vec3_along(vec3_along(light->position, s, light->forward), -w, light->right), -h,
                   light->up);
    if (!light->slide.rgb) { /* an open window */
        put_case(file, light, l, s, w, h);
        return;
    }
    (void)fprintf(file,
                  "polygon {\n  5, <0, 0>, <1, 0>, <1, 1>, <0, 1>, <0, 0>\n"
                  "  pigment { image_map { exr \"" POV_SLIDE
                  "\" once interpolate 2 filter all 1 } }\n"
                  "  finish { ambient 0 diffuse 0 }\n  matrix ",
                  number);
    struct vec3 columns[4] = {vec3_scale(light->right, 2 * w), vec3_scale(light->up, 2 * h),
                              light->forward, corner};
    (void)fprintf(file, "<");
    for (int k = 0; k < 4; k++) {
        (void)fprintf(file, "%s%.7g, %.7g, %.7g", k ? ", " : "", columns[k].x, columns[k].y,
                      columns[k].z);
    }
    (void)fprintf(file, ">\n  no_image no_reflection\n}\n");
    put_case(file, light, l, s, w, h);
}
/* `soft`: an area light as POV-Ray's own; else from its middle, which does for highlights. */
static void put_light(FILE *file, const struct light *light, double exposure, size_t number,
                      bool soft)
{
    /* fade_power 2 gives 2 / (1 + (d / f)^2), which is 2 f^2 / d^2 where f is far below every distance. */
    double f = light->distance_mm / 100;
    struct vec3 aim = vec3_along(light->position, light->distance_mm, light->forward);
    (void)fprintf(file, "light_source {\n  ");
    put_vector(file, light->position);
    (void)fprintf(file, "\n  ");
    put_colour(file, light->intensity, exposure / (2 * f * f));
    (void)fprintf(file, "\n  fade_distance %.7g fade_power 2\n", f);
    if (light->kind == LIGHT_SPOT) {
        double degrees = 180 / acos(-1.0);
        (void)fprintf(file, "  spotlight radius %.7g falloff %.7g tightness 0 point_at ",
                      acos(light->cos_full) * degrees, acos(light->cos_edge) * degrees);
        put_vector(file, aim);
        (void)fprintf(file, "\n");
    } else if (light->kind == LIGHT_AREA) {
        (void)fprintf(file,
                      "  spotlight radius 90 falloff 90 tightness 1 // Lambert's law\n  point_at ");
        put_vector(file, aim);
        (void)fprintf(file, "\n");
    }
    if (light->kind == LIGHT_AREA && soft) {
        /* The lights of the grid sit in the middles of their shares. */
        double share = (AREA_LIGHTS - 1.0) / AREA_LIGHTS;
        (void)fprintf(file, "  area_light ");
        put_vector(file, vec3_scale(light->right, light->width_mm * share));
        (void)fprintf(file, ", ");
        put_vector(file, vec3_scale(light->up, light->height_mm * share));
        (void)fprintf(file, ", %d, %d adaptive 1 area_illumination on\n", AREA_LIGHTS, AREA_LIGHTS);
    }
    (void)fprintf(file, "}\n");
    if (light->kind == LIGHT_PROJECTOR) {
        put_slide(file, light, number);
    }
}

/* All objects and lights. Where soft lights were calculated beforehand, they shine on translucent objects alone, to
 * make highlights. */
static void put_everything(FILE *file, const struct scene *scene, const struct light *lights,
                           const struct pov_object *objects)
{
    bool area = false;
    for (size_t i = 0; i < scene->light_count; i++) {
        area = area || lights[i].soft;
        if (!lights[i].soft) {
            put_light(file, &lights[i], scene->image.exposure, i, false);
        }
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        (void)fprintf(file, "#include \"" POV_OBJECT "\"\n", i);
    }
    for (int own = 1; area && own >= 0; own--) {
        (void)fprintf(file, own ? "\n#if (" POV_BAKED ")\nlight_group {\n" : "#else\n");
        for (size_t i = 0; i < scene->light_count; i++) {
            if (lights[i].soft) {
                put_light(file, &lights[i], scene->image.exposure, i, !own);
            }
        }
        for (size_t i = 0; i < scene->object_count; i++) {
            if (objects[i].radiosity) {
                (void)fprintf(file, "object { object_%zu }\n", i);
            }
        }
        (void)fprintf(file, own ? "global_lights on\n}\n" : "#end\n\n");
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        if (!area || !objects[i].radiosity) {
            (void)fprintf(file, "object { object_%zu }\n", i);
        }
    }
}

static void put_triples(FILE *file, const char *name, const float (*values)[3], size_t count)
{
    (void)fprintf(file, "  %s {\n    %zu", name, count);
    for (size_t i = 0; i < count; i++) {
        (void)fprintf(file, ",\n    <%.7g, %.7g, %.7g>", (double)values[i][0], (double)values[i][1],
                      (double)values[i][2]);
    }
    (void)fprintf(file, "\n  }\n");
}

/* What of the light that leaves a vertex the camera gets: by the angle, where the surface has an index. */
static double leaving(const struct pov_object *object, const struct scene *scene, size_t vertex)
{
    struct vec3 place = vec3_from(object->mesh->positions[vertex]);
    struct vec3 eye = vec3_from_doubles(scene->camera.position_mm);
    struct vec3 normal = vec3_from(object->mesh->normals[vertex]);
    return fresnel_transmitted(object->settings->index,
                               vec3_dot(vec3_unit(vec3_subtract(eye, place)), normal));
}

/* One texture a vertex. POV-Ray adds emission and diffuse light, both times the pigment. */
static void put_textures(FILE *file, const struct pov_object *object, size_t number,
                         const struct scene *scene)
{
    size_t count = object->mesh->vertex_count;
    (void)fprintf(file, "  texture_list {\n    %zu", count);
    for (size_t i = 0; i < count; i++) {
        double factor = scene->image.exposure;
        if (object->radiosity) {
            const float *light = object->radiosity[i];
            factor *= object->fresnel ? leaving(object, scene, i) : 1;
            (void)fprintf(
                file, ",\n    texture { pigment { rgb <%.6g, %.6g, %.6g> } finish { finish_%zu } }",
                light[0] * factor, light[1] * factor, light[2] * factor, number);
            continue;
        }
        const float *all = object->irradiance[i], *soft = object->soft[i];
        (void)fprintf(
            file,
            ",\n    texture { pigment { pigment_%zu } finish { finish_%zu emission " POV_BAKED
            "*<%.6g, %.6g, %.6g>",
            number, number, soft[0] * factor, soft[1] * factor, soft[2] * factor);
        if (all[0] > soft[0] || all[1] > soft[1] || all[2] > soft[2]) {
            (void)fprintf(file, " + <%.6g, %.6g, %.6g>", (all[0] - soft[0]) * factor,
                          (all[1] - soft[1]) * factor, (all[2] - soft[2]) * factor);
        }
        (void)fprintf(file, " } }");
    }
    (void)fprintf(file, "\n  }\n");
}

/* The mirror image of the surroundings. */
static void put_reflection(FILE *file, const struct pov_object *object)
{
    double strength = object->settings->gloss.reflection;
    if (object->reflection && object->settings->index > 1) {
        (void)fprintf(file, "  reflection { 0, %.6g fresnel on }\n", strength);
    } else if (object->reflection) {
        (void)fprintf(file, "  reflection { %.6g }\n", strength);
    }
}

static void put_object(FILE *file, const struct pov_object *object, size_t number,
                       const struct scene *scene)
{
    const struct mesh *mesh = object->mesh;
    const struct scene_gloss *gloss = &object->settings->gloss;
    bool textured = object->radiosity || object->irradiance;
    (void)fprintf(file, "// Object %zu%s.\n", number,
                  object->radiosity    ? ": the light that leaves each vertex is its emission"
                  : object->irradiance ? ": the light that was calculated is its emission"
                                       : "");
    (void)fprintf(file,
                  "#declare finish_%zu = finish {\n"
                  "  ambient 0 diffuse %d emission %d",
                  number, object->radiosity ? 0 : 1, object->radiosity ? 1 : 0);
    if (object->highlights) {
        (void)fprintf(file, " specular %.6g roughness %.6g", gloss->specular, gloss->roughness);
    }
    (void)fprintf(file, "\n");
    put_reflection(file, object);
    (void)fprintf(file, "}\n");
    if (!object->radiosity) {
        (void)fprintf(file, "#declare pigment_%zu = pigment { ", number);
        put_colour(file, object->settings->color, 1);
        (void)fprintf(file, " }\n");
    }
    (void)fprintf(file, "#declare object_%zu = mesh2 {\n", number);
    put_triples(file, "vertex_vectors", (const float(*)[3])mesh->positions, mesh->vertex_count);
    put_triples(file, "normal_vectors", (const float(*)[3])mesh->normals, mesh->vertex_count);
    if (textured) {
        put_textures(file, object, number, scene);
    }
    (void)fprintf(file, "  face_indices {\n    %zu", mesh->triangle_count);
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        const uint32_t *t = mesh->triangles[i];
        (void)fprintf(file, ",\n    <%u, %u, %u>", t[0], t[1], t[2]);
        if (textured) {
            (void)fprintf(file, ", %u, %u, %u", t[0], t[1], t[2]);
        }
    }
    (void)fprintf(file, "\n  }\n");
    if (!textured) {
        (void)fprintf(file, "  pigment { pigment_%zu }\n  finish { finish_%zu }\n", number, number);
    }
    if (object->reflection && object->settings->index > 1) {
        (void)fprintf(file, "  interior { ior %.6g }\n", object->settings->index);
    }
    (void)fprintf(file, "}\n");
}

static int write_object(const char *folder, const struct pov_object *object, size_t number,
                        const struct scene *scene, struct nacre_error *error)
{
    struct output_file output;
    int status = pov_text_open(&output, path_in(folder, POV_OBJECT, number), error);
    if (status == NACRE_OK) {
        put_object(output.file, object, number, scene);
    }
    return pov_text_close(&output, status, error);
}

static int write_main(const char *folder, const struct scene *scene, const struct light *lights,
                      const struct environment *environment, const struct pov_object *objects,
                      struct nacre_error *error)
{
    struct output_file output;
    int status = pov_text_open(&output, path_in(folder, POV_MAIN), error);
    if (status == NACRE_OK) {
        FILE *file = output.file;
        (void)fprintf(file,
                      "// Lengths are in mm, z is up. Render with\n"
                      "//   povray +I" POV_MAIN " +Opicture.exr +FE +W%d +H%d +A\n"
                      "#version 3.7;\nglobal_settings { assumed_gamma 1.0 }\n\n"
                      "// At 0 POV-Ray traces area lights on plain objects itself: slower, in "
                      "coarser steps.\n"
                      "#ifndef (" POV_BAKED ")\n#declare " POV_BAKED " = 1;\n#end\n\n",
                      scene->image.width, scene->image.height);
        pov_sky_put(file, scene, environment);
        put_camera(file, scene);
        put_everything(file, scene, lights, objects);
    }
    return pov_text_close(&output, status, error);
}

int pov_write(const char *folder, const struct scene *scene, const struct light *lights,
              const struct environment *environment, const struct pov_object *objects,
              struct nacre_error *error)
{
    int status = write_main(folder, scene, lights, environment, objects, error);
    for (size_t i = 0; status == NACRE_OK && i < scene->object_count; i++) {
        status = write_object(folder, &objects[i], i, scene, error);
    }
    for (size_t i = 0; status == NACRE_OK && i < scene->light_count; i++) {
        if (lights[i].slide.rgb) {
            status = pov_picture_write(path_in(folder, POV_SLIDE, i), &lights[i].slide, error);
        }
    }
    if (status == NACRE_OK && environment && environment->picture.rgb) {
        status = pov_sky_write(folder, environment, scene->image.exposure, error);
    }
    return status;
}
