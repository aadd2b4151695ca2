/* Environments and indices of refraction, against closed forms and plain numerical integration. */
#include "render/environment.h"
#include "render/fresnel.h"
#include "render/irradiance.h"
#include "render/random.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static const double pi = 3.14159265358979323846;

static struct light light;
static struct mesh mesh;
static struct world *world;
static struct nacre_error error;

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
}

void tearDown(void)
{
    light_finish(&light);
    mesh_finish(&mesh);
    world_free(world);
    world = NULL;
    scratch_remove();
}

static void make_world(void)
{
    const struct mesh *meshes[1] = {&mesh};
    struct vec3 centre;
    double radius;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, world_new(meshes, 1, &world, &error), error.text);
    world_bounds(world, &centre, &radius);
    light_surround(&light, centre, radius);
}

static void make_constant(double r, double g, double b)
{
    const struct scene_environment settings = {.color = {r, g, b}, .line = 1};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, light_make_environment(&light, &settings, &error),
                                  error.text);
}

/* A smooth sky with a sun of one pixel 2000 times as bright. */
static void make_sky(double rotation_deg)
{
    struct picture sky;
    enum { WIDTH = 64, HEIGHT = 32 };
    char *path = strdup(scratch_path("sky.exr"));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&sky, WIDTH, HEIGHT, &error));
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        int x = i % WIDTH, y = i / WIDTH;
        sky.rgb[3 * i] = 0.5F + 0.4F * (float)cos(2 * pi * x / WIDTH);
        sky.rgb[3 * i + 1] = (float)y / HEIGHT;
        sky.rgb[3 * i + 2] = 0.25F;
    }
    for (int c = 0; c < 3; c++) {
        sky.rgb[(8 * WIDTH + 40) * 3 + c] = 1000;
    }
    const struct scene_environment settings = {
        .image = path, .color = {1, 0.5, 2}, .rotation_deg = rotation_deg, .line = 1};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(path, &sky, NULL, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, light_make_environment(&light, &settings, &error),
                                  error.text);
    picture_finish(&sky);
    free(path);
}

static struct lighting lighting_of(int rays)
{
    return (struct lighting){.world = world,
                             .lights = &light,
                             .light_count = 1,
                             .shadows = true,
                             .rays = rays,
                             .seed = 1};
}

/* The furnace: a convex body under a constant environment has pi L everywhere, whatever the number of rays. */
static void a_convex_body_in_a_furnace_is_lit_exactly(void)
{
    struct light_work work = {0};
    make_constant(1, 0.5, 3);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_sphere(&mesh, 10, 2, &error));
    make_world();
    struct lighting lighting = lighting_of(5);
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        const struct world_hit middle = {0, i, 1.0 / 3, 1.0 / 3};
        double out[3];
        const struct lit_point point = {world_place(&mesh, &middle),
                                        vec3_unit(mesh_triangle_cross(&mesh, i)), 1, i};
        irradiance_at(&lighting, &point, out, &work);
        /* Five values of which each is exact: rounding alone. */
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1, out[0]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.5, out[1]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 3, out[2]);
    }
    TEST_ASSERT_EQUAL_UINT64(5 * mesh.triangle_count, work.shadow_rays);
    TEST_ASSERT_EQUAL_UINT64(5 * mesh.triangle_count, work.lookups[LOOKUP_SKY]);
}

/* Beside a long wall twice as high as it is far. */
static void a_wall_takes_its_share_of_the_sky(void)
{
    struct light_work work = {0};
    const double degrees[3] = {0, -90, 0};
    make_constant(1, 1, 1);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 200, 20000, &error));
    struct motion stand = motion_make(degrees, (struct vec3){0, 0, 100});
    mesh_move(&mesh, &stand);
    make_world();
    struct lighting lighting = lighting_of(4096);
    const struct lit_point point = {{100, 0, 0}, {0, 0, 1}, 1, 0};
    double out[3];
    irradiance_at(&lighting, &point, out, &work);
    /* An endless strip from the ground to the elevation a hides (1 - cos a) / 2 = 0.276, here a = atan(200 / 100).
     * Independent rays would scatter by sqrt(0.276 * 0.724 / 4096) = 0.007; even ones scatter less. */
    TEST_ASSERT_DOUBLE_WITHIN(0.009, 1 - (1 - cos(atan(2))) / 2, out[1]);
}

/* By the midpoint rule over the picture's own pixels, finely: in double, without importance. */
static void integrate(struct vec3 normal, double index, double sum[3])
{
    enum { ROWS = 1024, COLUMNS = 2048 };
    sum[0] = sum[1] = sum[2] = 0;
    for (int row = 0; row < ROWS; row++) {
        double theta = pi * (row + 0.5) / ROWS;
        double angle = sin(theta) * (pi / ROWS) * (2 * pi / COLUMNS);
        for (int column = 0; column < COLUMNS; column++) {
            double phi = 2 * pi * (column + 0.5) / COLUMNS, value[3];
            struct vec3 from = {sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)};
            double cosine = vec3_dot(from, normal);
            if (cosine > 0) {
                environment_value(&light.environment, from, value);
                for (int c = 0; c < 3; c++) {
                    sum[c] += value[c] / pi * cosine * angle * fresnel_transmitted(index, cosine);
                }
            }
        }
    }
}

static void check_sampling(double index)
{
    const struct vec3 normals[] = {
        {0, 0, 1}, {0, 0, -1}, {1, 0, 0}, {0.36, 0.48, 0.8}, {-0.8, 0.36, 0.48}};
    for (size_t i = 0; i < sizeof normals / sizeof *normals; i++) {
        enum { COUNT = 20000 };
        double sum[3] = {0}, square[3] = {0}, expected[3];
        for (unsigned k = 0; k < COUNT; k++) {
            const double u[2] = {random_uniform(7, i, 2 * k), random_uniform(7, i, 2 * k + 1)};
            struct light_arrival arrival =
                light_arrive(&light, (struct vec3){0, 0, 0}, normals[i], u);
            double cosine = vec3_dot(vec3_unit(arrival.from), normals[i]);
            for (int c = 0; c < 3; c++) {
                double value = arrival.irradiance[c] * fresnel_transmitted(index, cosine);
                sum[c] += value / COUNT;
                square[c] += value * value / COUNT;
            }
        }
        integrate(normals[i], index, expected);
        for (int c = 0; c < 3; c++) {
            double deviation = sqrt((square[c] - sum[c] * sum[c]) / COUNT);
            /* 15 comparisons: 4.5 standard deviations are passed once in 10^4; 1e-3 for the midpoint rule, of which
             * some 32 x 32 points lie in the sun's pixel, and its row's sine. */
            TEST_ASSERT_TRUE(deviation < 0.02 * expected[c]);
            TEST_ASSERT_DOUBLE_WITHIN(4.5 * deviation + 1e-3 * expected[c], expected[c], sum[c]);
        }
    }
}

static void importance_samples_agree_with_integration(void)
{
    make_sky(0);
    light_surround(&light, (struct vec3){0, 0, 0}, 1);
    check_sampling(1);
}

static void light_that_enters_agrees_with_integration(void)
{
    make_sky(70);
    light_surround(&light, (struct vec3){0, 0, 0}, 1);
    check_sampling(1.4);
}

static void the_density_of_directions_integrates_to_one(void)
{
    double sum = 0;
    make_sky(30);
    for (int i = 0; i < 640 * 320; i++) {
        /* The density is constant within a pixel, and ten by ten points of equal solid angle lie in each. */
        int row = i / 640;
        double z0 = cos(pi * (row / 10) / 32), z1 = cos(pi * (row / 10 + 1) / 32); /* NOLINT */
        double z = z0 + (z1 - z0) * (row % 10 + 0.5) / 10, r = sqrt(1 - z * z);
        double phi = 2 * pi * (i % 640 + 0.5) / 640 - 30 * pi / 180;
        struct vec3 from = {r * sin(phi), r * cos(phi), z};
        sum += environment_density(&light.environment, from) * (z0 - z1) / 10 * 2 * pi / 640;
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1, sum);
}

/* Photons through a disc in the sky's light: the flux that shadow rays find there. */
static void photons_of_an_environment_bring_what_arrives(void)
{
    enum { COUNT = 200000 };
    const struct vec3 middle = {4, 0, 2}, normal = vec3_unit((struct vec3){0.3, -0.1, 1});
    const double radius = 6;
    double flux = 0, square = 0, expected[3];
    make_sky(0);
    light_surround(&light, (struct vec3){0, 0, 0}, 20);
    for (unsigned k = 0; k < COUNT; k++) {
        double u[4];
        for (unsigned d = 0; d < 4; d++) {
            u[d] = random_uniform(3, k, d);
        }
        struct photon photon = light_emit(&light, middle, radius, u);
        double slope = vec3_dot(photon.direction, normal);
        double t = vec3_dot(vec3_subtract(middle, photon.origin), normal) / slope;
        struct vec3 hit = vec3_along(photon.origin, t, photon.direction);
        if (slope < 0 && t > 0 && vec3_length(vec3_subtract(hit, middle)) < radius) {
            flux += photon.flux[1] / COUNT;
            square += photon.flux[1] * photon.flux[1] / COUNT;
        }
    }
    integrate(normal, 1, expected);
    double all = expected[1] * pi * radius * radius;
    double deviation = sqrt((square - flux * flux) / COUNT);
    /* 4 standard deviations, and the integral's 1e-3. */
    TEST_ASSERT_TRUE(deviation < 0.01 * all);
    TEST_ASSERT_DOUBLE_WITHIN(4 * deviation + 1e-3 * all, all, flux);
}

/* The picture's middle lies along y, its right half on the side of x, its top up; rotation is about z. */
static void environments_are_turned_as_stated(void)
{
    double value[3];
    make_sky(0);
    /* The sun's pixel (40, 8): 8.5 of 64 columns right of the middle, 8.5 of 32 rows down. */
    double azimuth = 8.5 / 64 * 2 * pi, theta = 8.5 / 32 * pi;
    struct vec3 sun = {sin(theta) * sin(azimuth), sin(theta) * cos(azimuth), cos(theta)};
    environment_value(&light.environment, sun, value);
    TEST_ASSERT_DOUBLE_WITHIN(1, 1000, value[0]); /* half floats have 11 bits */
    TEST_ASSERT_DOUBLE_WITHIN(1, 500, value[1]);
    light_finish(&light);
    make_sky(90);
    struct vec3 turned = {-sun.y, sun.x, sun.z};
    environment_value(&light.environment, turned, value);
    TEST_ASSERT_DOUBLE_WITHIN(1, 1000, value[0]);
}

/* Known values: at normal incidence ((n - 1) / (n + 1))^2 is mirrored, at Brewster's angle half of what the other
 * polarisation mirrors, at a grazing angle all. */
static void fresnel_has_its_known_values(void)
{
    double n = 1.5, brewster = cos(atan(n));
    double inside = sqrt(1 - (1 - brewster * brewster) / (n * n));
    double s = (brewster - n * inside) / (brewster + n * inside);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.04, fresnel_mirrored(n, 1));
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, s * s / 2, fresnel_mirrored(n, brewster));
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1, fresnel_mirrored(n, 0));
    TEST_ASSERT_EQUAL_DOUBLE(1, fresnel_transmitted(n, 1));
    TEST_ASSERT_EQUAL_DOUBLE(0, fresnel_transmitted(n, 0));
    TEST_ASSERT_EQUAL_DOUBLE(1, fresnel_transmitted(1, 0.3));
}

/* Under a constant sky what enters is 1 - F_dr, over what enters along the normal. F_dr = 0.0918 at n = 1.5 (the
 * diffuse external reflectance; Walsh's formula, Duntley 1942, gives 0.09178). */
static void light_enters_as_walsh_found(void)
{
    struct light_work work = {0};
    make_constant(1, 1, 1);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 10, 10, &error));
    make_world();
    struct lighting lighting = lighting_of(4096);
    const struct lit_point point = {{0, 0, 0}, {0, 0, 1}, 1.5, 0};
    double out[3];
    irradiance_at(&lighting, &point, out, &work);
    /* The formula's last digit; 4096 even points on a bounded function of one of their coordinates: 1e-4. */
    TEST_ASSERT_DOUBLE_WITHIN(3e-4, (1 - 0.09178) / 0.96, out[0]);
    TEST_ASSERT_EQUAL_UINT64(4096, work.transmittances);
}

static void a_picture_that_is_not_finite_is_refused(void)
{
    struct picture sky;
    char *path = strdup(scratch_path("sky.exr"));
    const struct scene_environment settings = {.image = path, .color = {1, 1, 1}, .line = 1};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&sky, 4, 2, &error));
    sky.rgb[3 * 5] = NAN;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(path, &sky, NULL, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, light_make_environment(&light, &settings, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "(1, 1)"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
    picture_finish(&sky);
    free(path);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_convex_body_in_a_furnace_is_lit_exactly);
    RUN_TEST(a_wall_takes_its_share_of_the_sky);
    RUN_TEST(importance_samples_agree_with_integration);
    RUN_TEST(light_that_enters_agrees_with_integration);
    RUN_TEST(the_density_of_directions_integrates_to_one);
    RUN_TEST(photons_of_an_environment_bring_what_arrives);
    RUN_TEST(environments_are_turned_as_stated);
    RUN_TEST(fresnel_has_its_known_values);
    RUN_TEST(light_enters_as_walsh_found);
    RUN_TEST(a_picture_that_is_not_finite_is_refused);
    return UNITY_END();
}
