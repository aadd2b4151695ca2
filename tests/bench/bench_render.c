/* What accuracy costs in the renderer: error against processor time of the plain gather, from photons and from spread
 * samples, and of the gather that nacre uses, on hills of 100,000 vertices of a material of the paper candle's size. */
#include "candle_model.h"
#include "plain_gather.h"
#include "timing.h"

#include "render/bake.h"
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

/* One way to the light at the vertices. */
struct way {
    double density;
    int rays;
    size_t photons;
    bool plain;
    double tolerance;
};

struct outcome {
    size_t samples;
    double light, gather; /* processor seconds */
    double error, bias;   /* relative to the RMS */
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

static void make_samples(const struct bench *bench, const struct way *way,
                         struct light_samples *samples)
{
    const struct lit_surface surface = {&bench->mesh, &bench->mapping, 0, 1};
    const struct lighting lighting = {.world = bench->world,
                                      .lights = bench->lights,
                                      .light_count = 2,
                                      .shadows = true,
                                      .rays = way->rays,
                                      .seed = 1};
    double point = bench->mapping.point_mm;
    must(way->photons > 0 ? samples_shoot(&surface, &lighting, way->photons, NULL, samples, &error)
                          : samples_spread(&surface, &lighting, way->density / (point * point),
                                           NULL, samples, &error));
}

/* The light that leaves where it fell, as bake_object adds it. */
static void add_local(const struct bench *bench, const struct light_samples *samples,
                      float (*radiosity)[3])
{
    size_t count = bench->mesh.vertex_count;
    float(*irradiance)[3] = allocate(count * sizeof *irradiance);
    must(local_light(&bench->mesh, samples, bench->mapping.point_mm, NULL, irradiance, &error));
    for (size_t i = 0; i < count; i++) {
        double local[3];
        receivers_lookup(&bench->mesh, &bench->mapping, i, bench->appearance.local, local);
        for (int c = 0; c < 3; c++) {
            radiosity[i][c] += (float)(local[c] * irradiance[i][c]);
        }
    }
    free(irradiance);
}

static struct outcome run(struct bench *bench, const struct way *way, size_t every,
                          float (*radiosity)[3], bool *done)
{
    struct light_samples samples;
    struct outcome outcome = {0};
    struct moment start = timing_now();
    memset(radiosity, 0, bench->mesh.vertex_count * sizeof *radiosity);
    make_samples(bench, way, &samples);
    add_local(bench, &samples, radiosity);
    outcome.light = timing_since(start).processor;
    outcome.samples = samples.count;
    struct gather gather = {&bench->mesh, &bench->mapping, &bench->appearance, &samples,
                            false,        way->tolerance,  GATHER_SOONEST};
    if (way->plain) {
        outcome.gather = plain_gather(&gather, &bench->opencl, every, radiosity, done);
    } else {
        struct gather_counts counts;
        start = timing_now();
        must(gather_run(&gather, &bench->opencl, NULL, radiosity, &counts, &error));
        outcome.gather = timing_since(start).processor;
        double receivers = (double)counts.receivers;
        printf("  %.3f s before, %.3f s to choose, %.3f s in all (wall); %.1f near pairs, %.2f "
               "posts and %.1f "
               "far pairs a "
               "receiver; at most %.3f %%\n",
               counts.prepare_seconds, counts.choose_seconds, counts.launch_seconds,
               (double)counts.points / receivers, (double)counts.posts / receivers,
               (double)counts.squares / receivers, 100 * counts.error);
    }
    samples_finish(&samples);
    return outcome;
}

static void compare(const struct bench *bench, float (*radiosity)[3], struct outcome *outcome)
{
    double square = 0, reference = 0, difference = 0, sum = 0;
    for (size_t i = 0; i < bench->mesh.vertex_count; i++) {
        for (int c = 0; bench->compared[i] && c < 3; c++) {
            double one = radiosity[i][c], two = bench->reference[i][c];
            square += (one - two) * (one - two);
            reference += two * two;
            difference += one - two;
            sum += two;
        }
    }
    outcome->error = sqrt(square / reference);
    outcome->bias = difference / sum;
}

static void report(const char *name, const struct way *way, const struct outcome *outcome)
{
    char how[64];
    if (way->photons > 0) {
        (void)snprintf(how, sizeof how, "%zu photons", way->photons);
    } else {
        (void)snprintf(how, sizeof how, "%g to a point x %d rays", way->density, way->rays);
    }
    printf(
        "%-12s %-26s %9zu samples  light %7.2f s  gather %7.2f s  error %6.3f %%  bias %+.3f %%\n",
        name, how, outcome->samples, outcome->light, outcome->gather, 100 * outcome->error,
        100 * outcome->bias);
    (void)fflush(stdout);
}

/* Ways on the same samples follow the plain one on them; the first has a tolerance that leaves the whole error just within
 * 1 %, what the samples are off included. */
static const struct way ways[] = {
    {.density = 1, .rays = 8, .photons = 1000000, .plain = true},
    {.density = 1, .rays = 8, .plain = true},
    {.density = 1, .rays = 8, .tolerance = 0.0085},
    {.density = 1, .rays = 8, .tolerance = 0.002},
    {.density = 1, .rays = 8, .tolerance = 0.0005},
    {.density = 4, .rays = 8, .plain = true},
    {.density = 4, .rays = 8, .tolerance = 0.016},
    {.density = 4, .rays = 8, .tolerance = 0.002},
    {.density = 16, .rays = 8, .plain = true},
    {.density = 16, .rays = 8, .tolerance = 0.018},
    {.density = 16, .rays = 8, .tolerance = 0.002},
};

/* More of the plain gather's time than the machine's noise explains. */
static const double slower = 1.3;

int main(int argc, char **argv)
{
    struct bench bench = {0};
    double fine = argc > 1 ? strtod(argv[1], NULL) : 16, plain = 0;
    int failures = 0;
    make_bench(&bench);
    size_t count = bench.mesh.vertex_count;
    bool *done = allocate(count * sizeof *done);
    float(*radiosity)[3] = allocate(count * sizeof *radiosity);
    printf("%s; %zu vertices, %zu triangles; "
           "processor seconds of both threads, plain ones from one receiver in %d\n",
           bench.opencl.name, count, bench.mesh.triangle_count, EVERY);
    struct way way = {.density = 0.1, .rays = 1, .plain = true};
    (void)run(&bench, &way, 200, radiosity, done); /* compiles */
    way = (struct way){.density = 0.1, .rays = 1, .tolerance = 0.02};
    (void)run(&bench, &way, 1, radiosity, done);
    way = (struct way){.density = fine, .rays = 16, .plain = true};
    struct outcome outcome = run(&bench, &way, EVERY, bench.reference, bench.compared);
    report("reference", &way, &outcome);
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
        outcome = run(&bench, &ways[i], ways[i].plain ? EVERY : 1, radiosity, done);
        compare(&bench, radiosity, &outcome);
        report(ways[i].plain ? "plain" : "gather", &ways[i], &outcome);
        plain = ways[i].plain ? outcome.gather : plain;
        if (!ways[i].plain) {
            printf("  tolerance %g: %.1f times sooner than plain\n", ways[i].tolerance,
                   plain / outcome.gather);
            failures += outcome.gather > slower * plain;
        }
    }
    if (failures > 0) {
        printf("slower than the plain gather %d times\n", failures);
    }
    return failures > 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
