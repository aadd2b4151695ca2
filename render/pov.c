/* Writing POV-Ray 3.7 scenes. */
#include "render/pov.h"

#include "render/output_file.h"

#include <stdio.h>
#include <stdlib.h>

enum { AREA_LIGHTS = 9 }; /* on a side; 2^3 + 1, as `adaptive` wants */

/* Paths in the folder, on the heap; NULL when memory ran out. */
static char *main_path(const char *folder)
{
    char *path = NULL;
    return asprintf(&path, "%s/" POV_MAIN, folder) < 0 ? NULL : path;
}

static char *part_path(const char *folder, const char *name, size_t number, const char *ending)
{
    char *path = NULL;
    return asprintf(&path, "%s/%s-%zu.%s", folder, name, number, ending) < 0 ? NULL : path;
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

/* An opaque case round a projector with the slide as its only opening: light would go round a slide alone. */
static void put_slide(FILE *file, const struct light *light, size_t number)
{
    double s = light->distance_mm * 0.02, w = light->tan_x * s, h = light->tan_y * s;
    double l = 1.2 * fmax(s, fmax(w, h));
    struct vec3 corner =
        vec3_along(vec3_along(vec3_along(light->position, s, light->forward), -w, light->right), -h,
                   light->up);
    (void)fprintf(
        file,
        "polygon {\n  5, <0, 0>, <1, 0>, <1, 1>, <0, 1>, <0, 0>\n"
        "  pigment { image_map { exr \"slide-%zu.exr\" once interpolate 2 filter all 1 } }\n"
        "  finish { ambient 0 diffuse 0 }\n  matrix ",
        number);
    struct vec3 columns[4] = {vec3_scale(light->right, 2 * w), vec3_scale(light->up, 2 * h),
                              light->forward, corner};
    (void)fprintf(file, "<");
    for (int k = 0; k < 4; k++) {
        (void)fprintf(file, "%s%.7g, %.7g, %.7g", k ? ", " : "", columns[k].x, columns[k].y,
                      columns[k].z);
    }
    (void)fprintf(file,
                  ">\n  no_image no_reflection\n}\n"
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

/* All objects and lights. Where area lights were calculated beforehand, they shine on translucent objects alone, to
 * make highlights. */
static void put_everything(FILE *file, const struct scene *scene, const struct light *lights,
                           const struct pov_object *objects)
{
    bool area = false;
    for (size_t i = 0; i < scene->light_count; i++) {
        area = area || lights[i].kind == LIGHT_AREA;
        if (lights[i].kind != LIGHT_AREA) {
            put_light(file, &lights[i], scene->image.exposure, i, false);
        }
    }
    for (size_t i = 0; i < scene->object_count; i++) {
        (void)fprintf(file, "#include \"object-%zu.inc\"\n", i);
    }
    for (int own = 1; area && own >= 0; own--) {
        (void)fprintf(file, own ? "\n#if (" POV_BAKED ")\nlight_group {\n" : "#else\n");
        for (size_t i = 0; i < scene->light_count; i++) {
            if (lights[i].kind == LIGHT_AREA) {
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

/* One texture a vertex. POV-Ray adds emission and diffuse light, both times the pigment. */
static void put_textures(FILE *file, const struct pov_object *object, size_t number,
                         double exposure)
{
    size_t count = object->mesh->vertex_count;
    (void)fprintf(file, "  texture_list {\n    %zu", count);
    for (size_t i = 0; i < count; i++) {
        const float *light = object->radiosity ? object->radiosity[i] : object->irradiance[i];
        double colour[3] = {light[0] * exposure, light[1] * exposure, light[2] * exposure};
        if (object->radiosity) {
            (void)fprintf(
                file, ",\n    texture { pigment { rgb <%.6g, %.6g, %.6g> } finish { finish_%zu } }",
                colour[0], colour[1], colour[2], number);
        } else {
            (void)fprintf(
                file,
                ",\n    texture { pigment { pigment_%zu } finish { finish_%zu emission " POV_BAKED
                "*<%.6g, %.6g, %.6g> } }",
                number, number, colour[0], colour[1], colour[2]);
        }
    }
    (void)fprintf(file, "\n  }\n");
}

static void put_object(FILE *file, const struct pov_object *object, size_t number, double exposure)
{
    const struct mesh *mesh = object->mesh;
    const struct scene_gloss *gloss = &object->settings->gloss;
    bool textured = object->radiosity || object->irradiance;
    (void)fprintf(file, "// Object %zu%s.\n", number,
                  object->radiosity    ? ": the light that leaves each vertex is its emission"
                  : object->irradiance ? ": the area lights on each vertex are its emission"
                                       : "");
    (void)fprintf(file,
                  "#declare finish_%zu = finish {\n"
                  "  ambient 0 diffuse %d emission %d specular %.6g roughness %.6g\n}\n",
                  number, object->radiosity ? 0 : 1, object->radiosity ? 1 : 0, gloss->specular,
                  gloss->roughness);
    if (!object->radiosity) {
        (void)fprintf(file, "#declare pigment_%zu = pigment { ", number);
        put_colour(file, object->settings->color, 1);
        (void)fprintf(file, " }\n");
    }
    (void)fprintf(file, "#declare object_%zu = mesh2 {\n", number);
    put_triples(file, "vertex_vectors", (const float(*)[3])mesh->positions, mesh->vertex_count);
    put_triples(file, "normal_vectors", (const float(*)[3])mesh->normals, mesh->vertex_count);
    if (textured) {
        put_textures(file, object, number, exposure);
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
    (void)fprintf(file, "}\n");
}

static int write_object(const char *folder, const struct pov_object *object, size_t number,
                        double exposure, struct nacre_error *error)
{
    struct output_file output;
    int status = output_file_open(&output, part_path(folder, "object", number, "inc"), error);
    if (status == NACRE_OK) {
        put_object(output.file, object, number, exposure);
    }
    return output_file_close(&output, status, error);
}

static int write_main(const char *folder, const struct scene *scene, const struct light *lights,
                      const struct pov_object *objects, struct nacre_error *error)
{
    struct output_file output;
    int status = output_file_open(&output, main_path(folder), error);
    if (status == NACRE_OK) {
        FILE *file = output.file;
        (void)fprintf(file,
                      "// Written by nacre render. Lengths are in mm, z is up. Render with\n"
                      "//   povray +I" POV_MAIN " +Opicture.exr +FE +W%d +H%d +A\n"
                      "#version 3.7;\nglobal_settings { assumed_gamma 1.0 }\n\n"
                      "// At 0 POV-Ray traces area lights on plain objects itself: slower, in "
                      "coarser steps.\n"
                      "#ifndef (" POV_BAKED ")\n#declare " POV_BAKED " = 1;\n#end\n\nbackground { ",
                      scene->image.width, scene->image.height);
        put_colour(file, scene->image.background, 1);
        (void)fprintf(file, " }\n\n");
        put_camera(file, scene);
        put_everything(file, scene, lights, objects);
    }
    return output_file_close(&output, status, error);
}

int pov_write(const char *folder, const struct scene *scene, const struct light *lights,
              const struct pov_object *objects, struct nacre_error *error)
{
    int status = write_main(folder, scene, lights, objects, error);
    for (size_t i = 0; status == NACRE_OK && i < scene->object_count; i++) {
        status = write_object(folder, &objects[i], i, scene->image.exposure, error);
    }
    for (size_t i = 0; status == NACRE_OK && i < scene->light_count; i++) {
        if (lights[i].kind == LIGHT_PROJECTOR) {
            char *path = part_path(folder, "slide", i, "exr");
            status = path ? picture_write(path, &lights[i].slide, NULL, error)
                          : nacre_fail_memory(error, "the name of a POV-Ray file");
            free(path);
        }
    }
    return status;
}
