/* Light from surface to surface: closed forms, the integrating sphere, and samples against photons. */
#include "render/irradiance.h"
#include "render/stage.h"
#include "stand.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct mesh mesh;
static struct world *world;
static struct scene scene;
static struct stage stage;
static struct render_report report;
static float (*radiosity)[3];
static struct nacre_error error;

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
}

void tearDown(void)
{
    stage_finish(&stage);
    scene_finish(&scene);
    render_report_finish(&report);
    world_free(world);
    world = NULL;
    mesh_finish(&mesh);
    free(radiosity);
    radiosity = NULL;
    scratch_remove();
}

/* Seen from within. */
static void make_hollow_sphere(double radius, double edge)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_sphere(&mesh, radius, edge, &error));
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        uint32_t swapped = mesh.triangles[i][1];
        mesh.triangles[i][1] = mesh.triangles[i][2];
        mesh.triangles[i][2] = swapped;
    }
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        for (int k = 0; k < 3; k++) {
            mesh.normals[i][k] = -mesh.normals[i][k];
        }
    }
}

static void make_world(void)
{
    const struct mesh *meshes[1] = {&mesh};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, world_new(meshes, 1, &world, &error), error.text);
    radiosity = calloc(mesh.vertex_count, sizeof *radiosity);
    TEST_ASSERT_NOT_NULL(radiosity);
}

static void receive(const struct lit_point *point, int rays, double out[3])
{
    const struct reflector reflector = {.mesh = &mesh, .radiosity = (const float(*)[3])radiosity};
    const struct lighting lighting = {
        .world = world, .reflectors = &reflector, .rays = rays, .seed = 5};
    struct light_work work = {0};
    irradiance_at(&lighting, point, out, &work);
    TEST_ASSERT_EQUAL_UINT64((uint64_t)rays, work.bounce_rays);
}

/* An enclosure that shines evenly: irradiance is the radiosity, by every single ray. */
static void an_even_enclosure_is_a_furnace(void)
{
    make_hollow_sphere(10, 2);
    make_world();
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        radiosity[i][0] = 0.75F;
    }
    for (size_t i = 0; i < mesh.vertex_count; i += 3) {
        const struct lit_point point = {vec3_from(mesh.positions[i]), vec3_from(mesh.normals[i]), 1,
                                        i};
        double out[3];
        receive(&point, 7, out);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.75, out[0]); /* single precision */
    }
}

/* The integrating sphere: each point of it receives the mean radiosity, wherever light comes from. */
static void a_sphere_spreads_light_evenly(void)
{
    make_hollow_sphere(10, 0.6);
    make_world();
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        double z = mesh.positions[i][2] / 10;
        radiosity[i][1] = (float)(z * z);
    }
    for (size_t i = 0; i < mesh.vertex_count; i += mesh.vertex_count / 7) {
        const struct lit_point point = {vec3_from(mesh.positions[i]), vec3_from(mesh.normals[i]), 1,
                                        i};
        double out[3];
        receive(&point, 4096, out);
        /* The mean of z^2 is 1/3, its variance 4/45: independent rays would scatter by 0.0047, 3 times of which are
         * allowed; facets 0.06 radii wide are off by (0.06 / 2)^2 / 2 of 1. */
        TEST_ASSERT_DOUBLE_WITHIN(0.0145, 1.0 / 3, out[1]);
    }
}

/* Two squares face each other: the known form factor from the middle of one to the other. */
static void parallel_plates_exchange_their_form_factor(void)
{
    const double distances[] = {4, 10, 30};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 20, 20, &error));
    make_world();
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        radiosity[i][2] = 1;
    }
    for (size_t i = 0; i < sizeof distances / sizeof *distances; i++) {
        double a = 10 / distances[i], r = sqrt(1 + a * a), out[3];
        double factor = 4 * (a / r * atan(a / r) / acos(-1.0));
        const struct lit_point above = {{0, 0, distances[i]}, {0, 0, -1}, 1, i};
        receive(&above, 4096, out);
        /* 3 deviations of independent rays. */
        TEST_ASSERT_DOUBLE_WITHIN(3 * sqrt(factor * (1 - factor) / 4096), factor, out[2]);
        const struct lit_point below = {{0, 0, -distances[i]}, {0, 0, 1}, 1, i};
        receive(&below, 64, out);
        TEST_ASSERT_EQUAL_DOUBLE(0, out[2]); /* the back is dark */
    }
}

static void prepare(const char *text, const struct render_settings *settings)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, scene_parse("scene.yaml", scratch_path(""), text, strlen(text), &scene, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_prepare(&stage, &scene, settings, &report, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, stage_bake(&stage, stand_opencl(), &report, &error),
                                  error.text);
}

static void finish(void)
{
    stage_finish(&stage);
    scene_finish(&scene);
    render_report_finish(&report);
}

static void write_obj(const char *name)
{
    FILE *file = fopen(scratch_path(name), "w");
    TEST_ASSERT_NOT_NULL(file);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        (void)fprintf(file, "v %.9g %.9g %.9g\n", (double)mesh.positions[i][0],
                      (double)mesh.positions[i][1], (double)mesh.positions[i][2]);
    }
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        (void)fprintf(file, "f %u %u %u\n", mesh.triangles[i][0] + 1, mesh.triangles[i][1] + 1,
                      mesh.triangles[i][2] + 1);
    }
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

#define CAMERA                                                                                     \
    "image: {width: 32, height: 24}\ncamera: {position_mm: [0, -300, 50], at_mm: [0, 0, 50]}\n"

/* A sphere of reflectance rho lit from its middle: E (rho + rho^2 + ... rho^n) comes on top after n bounces. */
static void bounces_in_a_sphere_add_up_to_their_series(void)
{
    const struct render_settings settings = {
        .bake = {.density = 1, .rays = 4, .seed = 1, .quiet = true}, .triangle_limit = 2000};
    make_hollow_sphere(50, 8);
    write_obj("hollow.obj");
    for (int bounces = 1; bounces <= 5; bounces += 2) {
        char text[1024];
        double series[3] = {0};
        const double rho[3] = {0.8, 0.5, 0.2};
        (void)snprintf(text, sizeof text,
                       CAMERA "bounces: %d\n"
                              "lights: [{kind: point, position_mm: [0, 0, 50], at_mm: [50, 0, 50], "
                              "irradiance: 2}]\n"
                              "objects: [{shape: mesh, file: hollow.obj, size_mm: 100, color: "
                              "[0.8, 0.5, 0.2]}]\n",
                       bounces);
        prepare(text, &settings);
        for (int k = 1; k <= bounces; k++) {
            for (int c = 0; c < 3; c++) {
                series[c] += 2 * pow(rho[c], k);
            }
        }
        for (size_t i = 0; i < stage.objects[0].mesh.vertex_count; i++) {
            for (int c = 0; c < 3; c++) {
                /* Edges of 8 in a radius of 50, split further: middles of edges are nearer by (4 / 50)^2 / 2 = 0.3 %,
                 * so brighter by twice that, and normals meet the light at up to 0.08 radians. */
                TEST_ASSERT_DOUBLE_WITHIN(0.013 * series[c], series[c],
                                          stage.objects[0].light[i][c]);
            }
        }
        finish();
    }
}

static void write_material(const char *name, int window, double reach)
{
    struct nacre_material material = stand_even_material(16, window, reach, 0.6);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_material_write(scratch_path(name), &material, &error), error.text);
    nacre_material_finish(&material);
}

/* A translucent floor under a white plain ceiling, with a light between them. */
#define ROOM                                                                                       \
    CAMERA "bounces: 2\n"                                                                          \
           "lights: [{kind: point, position_mm: [5, 0, 20], irradiance: 1}]\n"                     \
           "objects:\n"                                                                            \
           "  - {shape: quad, size_mm: [60, 60, 1], material: {file: material.exr, mapping: "      \
           "planar, point_mm: 3}}\n"                                                               \
           "  - {shape: quad, size_mm: [60, 60, 1], position_mm: [0, 0, 40], rotation_deg: [180, " \
           "0, 0], color: [0.9, 0.5, 0.1]}\n"

/* Mean radiosity of the floor away from its border. */
static void floor_mean(double mean[3])
{
    const struct stage_object *floor = &stage.objects[0];
    double count = 0;
    mean[0] = mean[1] = mean[2] = 0;
    for (size_t i = 0; i < floor->mesh.vertex_count; i++) {
        if (fabsf(floor->mesh.positions[i][0]) < 20 && fabsf(floor->mesh.positions[i][1]) < 20) {
            count++;
            for (int c = 0; c < 3; c++) {
                mean[c] += floor->light[i][c];
            }
        }
    }
    TEST_ASSERT_TRUE(count > 100);
    for (int c = 0; c < 3; c++) {
        mean[c] /= count;
    }
}

static void samples_and_photons_agree_on_bounces(void)
{
    enum { RUNS = 8 };
    struct render_settings settings = {.bake = {.density = 6, .rays = 8, .seed = 1, .quiet = true},
                                       .triangle_limit = 2000};
    double sampled[3], without[3], sum[3] = {0}, square[3] = {0};
    char dark[1024];
    write_material("material.exr", 1, 1); /* no width: photons leave it where they met it */
    prepare(ROOM, &settings);
    floor_mean(sampled);
    finish();
    for (unsigned run = 0; run < RUNS; run++) {
        double mean[3];
        settings.bake.photons = 60000;
        settings.bake.seed = 10 + run;
        prepare(ROOM, &settings);
        floor_mean(mean);
        finish();
        for (int c = 0; c < 3; c++) {
            sum[c] += mean[c] / RUNS;
            square[c] += mean[c] * mean[c] / RUNS;
        }
    }
    settings.bake.photons = 0;
    (void)snprintf(dark, sizeof dark, "without: [interreflection]\n" ROOM);
    prepare(dark, &settings);
    floor_mean(without);
    for (int c = 0; c < 3; c++) {
        double deviation = sqrt((square[c] - sum[c] * sum[c]) / (RUNS - 1));
        /* 3 comparisons of a mean of 8 runs, whose scatter is known from them: Student's t at 7 degrees of freedom is
         * above 5.4 once in 1000. Samples scatter by 1 / sqrt(number of rays on the floor's middle), below 0.2 %, and
         * vertices between which the ceiling's light is linear are 1.7 mm apart at 20 mm from the light. */
        TEST_ASSERT_TRUE(deviation < 0.01 * sampled[c]);
        TEST_ASSERT_DOUBLE_WITHIN(5.4 * deviation + 0.004 * sampled[c], sum[c], sampled[c]);
    }
    /* The ceiling's colour is in what it passes on: of the first bounce nine times as much red as blue. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0, without[0] - without[2]);
    TEST_ASSERT_TRUE(sampled[0] - without[0] > 6 * (sampled[2] - without[2]));
    TEST_ASSERT_TRUE(sampled[0] > 1.02 * without[0]);
}

/* With a gather: an even enclosure of translucent floor and ceiling makes what its albedo says. The pair of plates passes
 * light on with the floor's albedo whether that has width or not, away from the border. */
static void translucent_objects_pass_light_on(void)
{
    const struct render_settings settings = {
        .bake = {.density = 6, .rays = 16, .seed = 1, .quiet = true}, .triangle_limit = 2000};
    double narrow[3], wide[3], mean_narrow = 0, mean_wide = 0;
    write_material("material.exr", 1, 1);
    prepare(ROOM, &settings);
    floor_mean(narrow);
    for (size_t i = 0; i < stage.objects[1].mesh.vertex_count; i++) {
        mean_narrow += stage.objects[1].light[i][0] / (double)stage.objects[1].mesh.vertex_count;
    }
    finish();
    write_material("material.exr", 5, 0.6);
    prepare(ROOM, &settings);
    floor_mean(wide);
    TEST_ASSERT_TRUE(stage.effects.objects[0].subsurface);
    TEST_ASSERT_TRUE(report.objects[0].counts.gather.receivers > 0);
    for (size_t i = 0; i < stage.objects[1].mesh.vertex_count; i++) {
        mean_wide += stage.objects[1].light[i][0] / (double)stage.objects[1].mesh.vertex_count;
    }
    /* Width moves light by about one surface point of 3 mm: of a spot 20 mm wide some per cent over the border of what
     * is looked at, and off the border of the floor. */
    TEST_ASSERT_TRUE(mean_wide > 0.05);
    TEST_ASSERT_DOUBLE_WITHIN(0.08 * mean_narrow, mean_narrow, mean_wide);
    TEST_ASSERT_DOUBLE_WITHIN(0.08 * narrow[0], narrow[0], wide[0]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(an_even_enclosure_is_a_furnace);
    RUN_TEST(a_sphere_spreads_light_evenly);
    RUN_TEST(parallel_plates_exchange_their_form_factor);
    RUN_TEST(bounces_in_a_sphere_add_up_to_their_series);
    RUN_TEST(samples_and_photons_agree_on_bounces);
    RUN_TEST(translucent_objects_pass_light_on);
    return UNITY_END();
}
