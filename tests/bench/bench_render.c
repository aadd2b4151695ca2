/* What accuracy costs in the renderer: error against processor time of the plain gather, from photons and from spread
 * samples, and of the gather that nacre uses, on hills of 100,000 vertices of a material of the paper candle's size. */
#include "candle_model.h"
#include "plain_gather.h"
#include "timing.h"

#include "render/gather_device.h"
#include "render/local_light.h"
#include "render/receivers.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { EVERY = 24 }; /* one bundle of receivers in so many is compared with the reference */

struct bench {
    struct opencl opencl;
    struct mesh mesh;
    struct mapping mapping;
    struct appearance appearance;
    struct light lights[2];
    struct world *world;
    float (*reference)[3]; /* smooth and local part, converged */
    bool *compared;
};

/* Light samples: so many to a surface point, or photons. */
struct amount {
    double density;
    int rays;
    size_t photons;
};

/* Samples and what they give: where they fell, and gathered plainly at the receivers that are compared. */
struct lit {
    struct light_samples samples;
    float (*local)[3], (*plain)[3];
    double light_seconds, plain_seconds,
        build_seconds; /* of the processor; the last of gather_run's program */
};

/* A gather with a tolerance, on the same samples. */
struct outcome {
    bool known;
    double seconds;
    double whole,
        bias; /* against the reference, the local part included: over its root mean square, and its mean */
    double added; /* against the plain gather, over its root mean square */
    double told;
};

static struct nacre_error error;

static void must(int status)
{
    if (status != NACRE_OK) {
        fail(error.text);
    }
}

static void make_lights(struct bench *bench)
{
    const struct scene_light lights[2] = {{.kind = LIGHT_AREA,
                                           .position_mm = {-90, 60, 320},
                                           .at_mm = {0, 0, 25},
                                           .up = {0, 1, 0},
                                           .size_mm = {220, 220},
                                           .irradiance = {1, 0.97, 0.92}},
                                          {.kind = LIGHT_AREA,
                                           .position_mm = {260, -330, 200},
                                           .at_mm = {0, 0, 25},
                                           .up = {0, 0, 1},
                                           .size_mm = {240, 240},
                                           .irradiance = {0.16, 0.18, 0.22}}};
    for (int i = 0; i < 2; i++) {
        must(light_make(&bench->lights[i], &lights[i], &error));
    }
}

/* Hills of 317 x 317 vertices, a surface point apart as seen from above; up to 35 degrees steep. */
static void make_hills(struct mesh *mesh, double point_mm)
{
    const uint32_t side = 317;
    size_t triangle = 0;
    must(mesh_allocate(mesh, (size_t)side * side, 2 * (size_t)(side - 1) * (side - 1), true,
                       &error));
    for (uint32_t i = 0; i < side * side; i++) {
        uint32_t column = i % side, row = i / side;
        double x = ((double)column - side / 2.0) * point_mm;
        double y = (side / 2.0 - (double)row) * point_mm, a = 0.1, b = 0.17;
        double slope_x = 0.45 * cos(a * x) * sin(a * y) + 0.25 * cos(b * (x + y));
        double slope_y = 0.45 * sin(a * x) * cos(a * y) + 0.25 * cos(b * (x + y));
        struct vec3 position = {x, y,
                                0.45 / a * sin(a * x) * sin(a * y) + 0.25 / b * sin(b * (x + y))};
        vec3_store(position, mesh->positions[i]);
        vec3_store(vec3_unit((struct vec3){-slope_x, -slope_y, 1}), mesh->normals[i]);
        mesh->uv[i][0] = (float)x;
        mesh->uv[i][1] = (float)y;
        if (column + 1 < side && row + 1 < side) {
            const uint32_t pair[2][3] = {{i, i + side, i + side + 1}, {i, i + side + 1, i + 1}};
            memcpy(mesh->triangles[triangle], pair, sizeof pair);
            triangle += 2;
        }
    }
}

static void make_bench(struct bench *bench)
{
    const double none[3] = {0};
    struct motion still = motion_make(none, (struct vec3){0, 0, 0});
    struct nacre_material material = candle_model();
    const struct scene_material settings = {.mapping = MAPPING_UV};
    const struct mesh *meshes[1] = {&bench->mesh};
    must(opencl_open(NULL, &bench->opencl, &error));
    must(appearance_make(&bench->appearance, &material, &error));
    make_hills(&bench->mesh, material.pitch_mm);
    must(mapping_make(&bench->mapping, &settings, material.width, material.height,
                      material.pitch_mm, &bench->mesh, &still, &error));
    must(mapping_follow(&bench->mapping, &bench->mesh, &error));
    must(world_new(meshes, 1, &bench->world, &error));
    make_lights(bench);
    nacre_material_finish(&material);
    bench->reference = allocate(bench->mesh.vertex_count * sizeof *bench->reference);
    bench->compared = allocate(bench->mesh.vertex_count * sizeof *bench->compared);
}

static void make_samples(const struct bench *bench, const struct amount *amount,
                         struct light_samples *samples)
{
    const struct lit_surface surface = {&bench->mesh, &bench->mapping, 0, 1, NULL};
    const struct lighting lighting = {.world = bench->world,
                                      .lights = bench->lights,
                                      .light_count = 2,
                                      .shadows = true,
                                      .rays = amount->rays,
                                      .seed = 1};
    double point = bench->mapping.point_mm;
    must(amount->photons > 0
             ? samples_shoot(&surface, &lighting, amount->photons, NULL, samples, &error)
             : samples_spread(&surface, &lighting, amount->density / (point * point), NULL, samples,
                              &error));
}

/* The light that leaves where it fell, as bake_object adds it. */
static void make_local(const struct bench *bench, struct lit *lit)
{
    must(local_light(&bench->mesh, &lit->samples, bench->mapping.point_mm, NULL, lit->local,
                     &error));
    for (size_t i = 0; i < bench->mesh.vertex_count; i++) {
        double local[3];
        receivers_lookup(&bench->mesh, &bench->mapping, i, bench->appearance.local, local);
        for (int c = 0; c < 3; c++) {
            lit->local[i][c] *= (float)local[c];
        }
    }
}

static struct gather gather_of(const struct bench *bench, const struct lit *lit, double tolerance)
{
    return (struct gather){&bench->mesh, &bench->mapping, &bench->appearance, &lit->samples,
                           false,        tolerance,       GATHER_SOONEST,     NULL};
}

static struct lit lit_make(struct bench *bench, const struct amount *amount, size_t every)
{
    size_t bytes = bench->mesh.vertex_count * sizeof(float[3]);
    struct lit lit = {.local = allocate(bytes), .plain = allocate(bytes)};
    struct moment start = timing_now();
    make_samples(bench, amount, &lit.samples);
    make_local(bench, &lit);
    lit.light_seconds = timing_since(start).processor;
    struct gather gather = gather_of(bench, &lit, 0);
    lit.plain_seconds = plain_gather(&gather, &bench->opencl, every, lit.plain, bench->compared);
    lit.build_seconds = HUGE_VAL;
    for (int i = 0; i < 3; i++) {
        struct gather_device device;
        start = timing_now();
        must(gather_device_make(&device, &bench->opencl, &gather, &error));
        gather_device_finish(&device);
        lit.build_seconds = fmin(lit.build_seconds, timing_since(start).processor);
    }
    return lit;
}

static void lit_finish(struct lit *lit)
{
    samples_finish(&lit->samples);
    free(lit->local);
    free(lit->plain);
}

/* How far light and its local part (or none) are off: root mean square over that of what it should be, and the mean. */
static double compare(const struct bench *bench, float (*light)[3], float (*local)[3],
                      float (*exact)[3], double *bias)
{
    double square = 0, all = 0, difference = 0, sum = 0;
    for (size_t i = 0; i < bench->mesh.vertex_count; i++) {
        for (int c = 0; bench->compared[i] && c < 3; c++) {
            double one = (double)light[i][c] + (local ? (double)local[i][c] : 0);
            double two = (double)exact[i][c];
            square += (one - two) * (one - two);
            all += two * two;
            difference += one - two;
            sum += two;
        }
    }
    *bias = difference / sum;
    return sqrt(square / all);
}

/* The plain gather's program is built before it is timed, and so is this one's taken to be. */
static void gather_once(const struct bench *bench, const struct lit *lit, double tolerance,
                        struct outcome *outcome)
{
    struct gather gather = gather_of(bench, lit, tolerance);
    struct gather_counts counts;
    float(*light)[3] = allocate(bench->mesh.vertex_count * sizeof *light);
    struct moment start = timing_now();
    double unused;
    must(gather_run(&gather, &bench->opencl, NULL, light, &counts, &error));
    double seconds = timing_since(start).processor - lit->build_seconds;
    outcome->seconds = outcome->known ? fmin(outcome->seconds, seconds) : seconds;
    outcome->known = true;
    outcome->told = counts.error;
    outcome->whole = compare(bench, light, lit->local, bench->reference, &outcome->bias);
    outcome->added = compare(bench, light, NULL, lit->plain, &unused);
    free(light);
}

static void report(const struct lit *lit, const char *name, double tolerance,
                   const struct outcome *outcome)
{
    printf("  %-28s tolerance %4.2f %%  whole error %6.3f %%  bias %+.3f %%  off from plain %6.3f "
           "%% (told %.3f %%)  %6.2f s  %5.1f times sooner\n",
           name, 100 * tolerance, 100 * outcome->whole, 100 * outcome->bias, 100 * outcome->added,
           100 * outcome->told, outcome->seconds, lit->plain_seconds / outcome->seconds);
    (void)fflush(stdout);
}

static void report_plain(const struct bench *bench, const struct amount *amount,
                         const struct lit *lit)
{
    double bias, error_of_samples = compare(bench, lit->plain, lit->local, bench->reference, &bias);
    char how[64];
    if (amount->photons > 0) {
        (void)snprintf(how, sizeof how, "%zu photons", amount->photons);
    } else {
        (void)snprintf(how, sizeof how, "%g to a point x %d rays", amount->density, amount->rays);
    }
    printf("%s: %zu samples, light %.2f s\n  %-28s whole error %6.3f %%  bias %+.3f %%  %6.2f s\n",
           how, lit->samples.count, lit->light_seconds, "plain", 100 * error_of_samples, 100 * bias,
           lit->plain_seconds);
    (void)fflush(stdout);
}

/* Tolerances among which the largest is looked for that keeps an error within the goal. */
static const double ladder[] = {0.002, 0.003, 0.004, 0.005, 0.006, 0.007, 0.008, 0.009,
                                0.01,  0.012, 0.014, 0.016, 0.018, 0.02,  0.023, 0.026};
enum { STEPS = sizeof ladder / sizeof *ladder, AGAIN = 2 };
static const double goal = 0.01;

/* By halving: a larger tolerance is taken not to lessen the error. Its time is the least of a few runs. STEPS: none. */
static size_t largest_within(const struct bench *bench, const struct lit *lit, bool whole,
                             struct outcome outcomes[STEPS])
{
    size_t low = 0, high = STEPS; /* below low all are within, from high on none */
    while (low < high) {
        size_t middle = (low + high) / 2;
        struct outcome *outcome = &outcomes[middle];
        if (!outcome->known) {
            gather_once(bench, lit, ladder[middle], outcome);
        }
        if ((whole ? outcome->whole : outcome->added) <= goal) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    for (int i = 0; low > 0 && i < AGAIN; i++) {
        gather_once(bench, lit, ladder[low - 1], &outcomes[low - 1]);
    }
    return low > 0 ? low - 1 : STEPS;
}

/* More of the plain gather's time than the machine's noise explains. */
static const double slower = 1.3;

/* Returns how often a gather took longer than the plain one. */
static int race(struct bench *bench, const struct amount *amount)
{
    static const char *names[2] = {"off from plain within 1 %", "whole error within 1 %"};
    struct lit lit = lit_make(bench, amount, EVERY);
    struct outcome outcomes[STEPS] = {{0}}, finest = {0};
    int failures = 0;
    report_plain(bench, amount, &lit);
    for (int i = 0; i < 2 && amount->photons == 0; i++) {
        size_t found = largest_within(bench, &lit, i == 1, outcomes);
        if (found == STEPS) {
            printf("  %-28s by no tolerance\n", names[i]);
            continue;
        }
        report(&lit, names[i], ladder[found], &outcomes[found]);
        failures += outcomes[found].seconds > slower * lit.plain_seconds;
    }
    if (amount->photons == 0) {
        gather_once(bench, &lit, ladder[0], &outcomes[0]);
        report(&lit, "as nacre render asks for", ladder[0], &outcomes[0]);
        failures += outcomes[0].seconds > slower * lit.plain_seconds;
    }
    if (amount->photons == 0 && amount->density <= 1) {
        gather_once(bench, &lit, 0.0005, &finest);
        report(&lit, "samples one by one", 0.0005, &finest);
        failures += finest.seconds > slower * lit.plain_seconds;
    }
    lit_finish(&lit);
    return failures;
}

/* What is compiled at first use is compiled before anything is timed. */
static void warm_up(struct bench *bench)
{
    const struct amount few = {.density = 0.1, .rays = 1};
    struct lit lit = lit_make(bench, &few, 200);
    struct outcome outcome = {0};
    gather_once(bench, &lit, 0.02, &outcome);
    lit_finish(&lit);
}

static void make_reference(struct bench *bench, double density)
{
    const struct amount many = {.density = density, .rays = 16};
    memset(bench->compared, 0, bench->mesh.vertex_count * sizeof *bench->compared);
    struct lit lit = lit_make(bench, &many, EVERY);
    for (size_t i = 0; i < bench->mesh.vertex_count; i++) {
        for (int c = 0; c < 3; c++) {
            bench->reference[i][c] = lit.plain[i][c] + lit.local[i][c];
        }
    }
    printf("reference: %zu samples, light %.2f s, gathered plainly %.2f s\n", lit.samples.count,
           lit.light_seconds, lit.plain_seconds);
    lit_finish(&lit);
}

int main(int argc, char **argv)
{
    static const struct amount amounts[] = {
        {.density = 1, .rays = 8, .photons = 1000000},
        {.density = 1, .rays = 8},
        {.density = 4, .rays = 8},
        {.density = 12, .rays = 8}, /* what is rendered with by default */
        {.density = 16, .rays = 8}};
    struct bench bench = {0};
    double fine = argc > 1 ? strtod(argv[1], NULL) : 16;
    int failures = 0;
    make_bench(&bench);
    printf("%s; %zu vertices, %zu triangles; processor seconds of both threads without building "
           "programs, plain ones from one receiver in %d\n",
           bench.opencl.name, bench.mesh.vertex_count, bench.mesh.triangle_count, EVERY);
    warm_up(&bench);
    make_reference(&bench, fine);
    for (size_t i = 0; i < sizeof amounts / sizeof *amounts; i++) {
        failures += amounts[i].density <= fine ? race(&bench, &amounts[i]) : 0;
    }
    if (failures > 0) {
        printf("slower than the plain gather %d times\n", failures);
    }
    return failures > 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
