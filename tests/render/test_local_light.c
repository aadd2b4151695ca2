/* Light that leaves where it fell: irradiance around vertices, against all samples one by one. */
#include "base/clock.h"
#include "render/local_light.h"
#include "render/random.h"
#include "stand.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

enum { LIT = 6000 };

static struct mesh mesh;
static struct light_samples samples;
static float (*irradiance)[3];
static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
    mesh_finish(&mesh);
    samples_finish(&samples);
    free(irradiance);
    irradiance = NULL;
}

/* A ball of radius 6 mm about (x, 0, 0), and light on its skin; one side of it in the dark. */
static void make_ball(double x, bool photons)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_sphere(&mesh, 6, 0.6, &error));
    samples.list = calloc(LIT, sizeof *samples.list);
    irradiance = calloc(mesh.vertex_count, sizeof *irradiance);
    TEST_ASSERT_TRUE(samples.list && irradiance);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        mesh.positions[i][0] += (float)x;
    }
    for (uint64_t i = 0; i < LIT; i++) {
        double z = 2 * random_uniform(1, 0, i) - 1, angle = 6.2831853 * random_uniform(1, 1, i);
        double across = sqrt(1 - z * z);
        const double normal[3] = {across * cos(angle), across * sin(angle), z};
        struct light_sample *sample = &samples.list[samples.count];
        for (int k = 0; k < 3 && normal[1] < 0.8; k++) {
            sample->normal[k] = (float)normal[k];
            sample->position[k] = (float)(6 * normal[k] + (k == 0 ? x : 0));
            sample->flux[k] = (float)random_uniform(2, (uint64_t)k, i);
        }
        sample->area_mm2 = photons ? 0 : 0.075F;
        samples.count += normal[1] < 0.8;
    }
}

/* As local_light.h says, over all samples in double precision. */
static void plainly(size_t vertex, double radius, double out[3])
{
    double area = 0, photons = acos(-1.0) * radius * radius / 3, nearest = HUGE_VAL;
    const float *p = mesh.positions[vertex], *n = mesh.normals[vertex], *around = NULL;
    bool spread = samples.list[0].area_mm2 > 0;
    out[0] = out[1] = out[2] = 0;
    for (size_t i = 0; i < samples.count; i++) {
        const struct light_sample *s = &samples.list[i];
        double square = 0, facing = 0;
        for (int k = 0; k < 3; k++) {
            square += pow((double)s->position[k] - p[k], 2);
            facing += (double)s->normal[k] * n[k];
        }
        double weight = fmax(1 - sqrt(square) / radius, 0);
        if (facing > 0 && square < nearest) {
            nearest = square;
            around = s->flux;
        }
        for (int c = 0; c < 3 && facing > 0; c++) {
            out[c] += weight * s->flux[c];
        }
        area += facing > 0 ? weight * s->area_mm2 : 0;
    }
    for (int c = 0; c < 3; c++) {
        out[c] = area > 0 || !spread ? out[c] / (spread ? area : photons) : around[c] / 0.075;
    }
}

/* Vertices that have a sample within the radius, or none within two: in between, whether one is found hangs on cubes. */
static void compare(double radius)
{
    size_t compared = 0;
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        double exact[3], nearest = HUGE_VAL;
        for (size_t j = 0; j < samples.count; j++) {
            double square = 0;
            for (int k = 0; k < 3; k++) {
                square += pow((double)samples.list[j].position[k] - mesh.positions[i][k], 2);
            }
            nearest = fmin(nearest, sqrt(square));
        }
        plainly(i, radius, exact);
        compared += nearest < 2 * radius;
        for (int c = 0; c < 3; c++) {
            if (nearest < 0.99 * radius) {
                /* Single precision has each sample's weight to 1e-6 of 1: less than 1e-4 of their sum. */
                TEST_ASSERT_DOUBLE_WITHIN(1e-4 * exact[c] + 1e-6, exact[c], irradiance[i][c]);
            } else if (nearest > 4 * radius) { /* beyond the cubes around */
                TEST_ASSERT_EQUAL_DOUBLE(0, irradiance[i][c]);
            }
        }
    }
    TEST_ASSERT_TRUE(compared > mesh.vertex_count / 2);
    TEST_ASSERT_TRUE(compared < mesh.vertex_count); /* some lie in the dark */
}

static void spread_samples_are_averaged_by_a_cone(void)
{
    make_ball(0, false);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, local_light(&mesh, &samples, 0.7, NULL, irradiance, &error));
    compare(0.7);
}

/* Cubes have negative numbers there. */
static void photons_give_a_density_on_either_side_of_the_origin(void)
{
    make_ball(-40, true);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, local_light(&mesh, &samples, 0.9, NULL, irradiance, &error));
    compare(0.9);
}

static void light_where_it_fell_is_given_up_at_the_deadline(void)
{
    struct clock clock = clock_monotonic();
    struct progress_deadline deadline = {.clock = &clock, .time_ns = clock_now_ns(&clock) - 1};
    struct progress progress = {.task = "lighting", .deadline = &deadline};
    make_ball(0, false);
    TEST_ASSERT_EQUAL_INT(NACRE_CANCELLED,
                          local_light(&mesh, &samples, 0.7, &progress, irradiance, &error));
    TEST_ASSERT_TRUE(deadline.passed);
    for (size_t i = 0; i < mesh.vertex_count; i++) { /* nothing was begun */
        TEST_ASSERT_EQUAL_FLOAT(0, irradiance[i][0]);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(spread_samples_are_averaged_by_a_cone);
    RUN_TEST(photons_give_a_density_on_either_side_of_the_origin);
    RUN_TEST(light_where_it_fell_is_given_up_at_the_deadline);
    return UNITY_END();
}
