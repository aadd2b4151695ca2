/* Convolution in the texture against the gather, plain and summing up: error and processor time in the same run, on a level
 * square and on a gently curved one of 100,000 vertices each, for kernels of their own for each of 4 and 8 terms. */
#include "timing.h"

#include "render/gather.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TILE_WIDTH = 212, TILE_HEIGHT = 154, DENSITY = 4 };

static const double point_mm = 0.934;

struct bench {
    struct opencl opencl;
    struct appearance appearance;
    struct mesh mesh;
    struct mapping mapping;
    struct light_samples samples;
    float (*light)[3], (*exact)[3];
};

static struct nacre_error error;

static void must(int status)
{
    if (status != NACRE_OK) {
        fail(error.text);
    }
}

static double random_share(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (double)(*state >> 8) / 16777216.0;
}

/* Kernels exp(-r / reach), wider from term to term; F and H smooth over the material, with grain. */
static void make_appearance(struct bench *bench, int window, int terms)
{
    struct nacre_material material = {.width = TILE_WIDTH,
                                      .height = TILE_HEIGHT,
                                      .channels = 3,
                                      .window = window,
                                      .terms = terms,
                                      .layout = NACRE_KERNEL_PER_TERM,
                                      .pixel = NACRE_FLOAT,
                                      .factor_channels = 3,
                                      .pitch_mm = point_mm,
                                      .method = "made"};
    size_t points = (size_t)TILE_WIDTH * TILE_HEIGHT, side = (size_t)window;
    uint32_t state = 1;
    must(nacre_material_allocate(&material, true, false, &error));
    for (size_t k = 0; k < (size_t)terms * 3; k++) {
        double reach = window * (0.02 + 0.08 * ((double)(k - k % 3) / 3 + 1) / terms) *
                       (1 + 0.1 * (double)(k % 3)),
               sum = 0;
        float *kernel = material.kernels + k * side * side;
        for (size_t i = 0; i < points; i++) {
            double x = (double)(i % TILE_WIDTH), y = (double)i / TILE_WIDTH;
            double wave = sin(0.05 * x * (1 + (double)(k - k % 3) / 3) + (double)k) * cos(0.07 * y);
            material.f[k * points + i] = (float)(0.6 + 0.3 * wave + 0.2 * random_share(&state));
            material.h[k * points + i] = (float)(0.6 - 0.3 * wave);
        }
        for (int pass = 0; pass < 2; pass++) {
            for (size_t i = 0; i < side * side; i++) {
                double x = (double)(i % side) - (double)(side - 1) / 2;
                double y = (double)(i - i % side) / (double)side - (double)(side - 1) / 2;
                double value = exp(-hypot(x, y) / reach);
                sum += pass == 0 ? value : 0;
                kernel[i] = (float)(value / sum);
            }
        }
    }
    for (size_t i = 0; i < points * 3; i++) {
        material.albedo[i] = 0.5F;
    }
    must(appearance_make(&bench->appearance, &material, &error));
    nacre_material_finish(&material);
}

/* A square rolled up on a cylinder of so many points (0: level), true to scale; vertices between lattice nodes. */
static void place(double u, double v, double radius, float position[3], float normal[3])
{
    struct vec3 p = {u, v, 0}, n = {0, 0, 1};
    if (radius > 0) {
        double r = radius * point_mm, angle = u / r;
        p = (struct vec3){r * sin(angle), v, r * cos(angle) - r};
        n = (struct vec3){sin(angle), 0, cos(angle)};
    }
    vec3_store(p, position);
    vec3_store(n, normal);
}

static void make_mesh(struct mesh *mesh, uint32_t side, double radius)
{
    uint32_t state = 7;
    size_t triangle = 0;
    must(mesh_allocate(mesh, (size_t)side * side, 2 * (size_t)(side - 1) * (side - 1), true,
                       &error));
    for (uint32_t i = 0; i < side * side; i++) {
        uint32_t column = i % side, row = i / side;
        double u = ((double)column - side / 2.0 + 0.5 * random_share(&state)) * point_mm;
        double v = (side / 2.0 - (double)row + 0.5 * random_share(&state)) * point_mm;
        place(u, v, radius, mesh->positions[i], mesh->normals[i]);
        mesh->uv[i][0] = (float)u;
        mesh->uv[i][1] = (float)v;
        if (column + 1 < side && row + 1 < side) {
            const uint32_t pair[2][3] = {{i, i + side, i + side + 1}, {i, i + side + 1, i + 1}};
            memcpy(mesh->triangles[triangle], pair, sizeof pair);
            triangle += 2;
        }
    }
}

/* A light that ends in a sharp edge, over waves. */
static void make_light(struct bench *bench)
{
    const struct mesh *meshes[1] = {&bench->mesh};
    const struct lit_surface surface = {&bench->mesh, &bench->mapping, 0, 1, NULL};
    struct world *world = NULL;
    must(world_new(meshes, 1, &world, &error));
    const struct lighting dark = {.world = world, .rays = 1, .seed = 1};
    must(samples_spread(&surface, &dark, DENSITY / (point_mm * point_mm), NULL, &bench->samples,
                        &error));
    for (size_t i = 0; i < bench->samples.count; i++) {
        struct light_sample *sample = &bench->samples.list[i];
        for (int c = 0; c < 3; c++) {
            double wave = 1.2 + sin(0.05 * (double)sample->x + c) * cos(0.04 * (double)sample->y);
            sample->flux[c] = sample->x > 0.3 * sqrt((double)bench->mesh.vertex_count)
                                  ? 0
                                  : (float)(wave * sample->area_mm2);
        }
    }
    world_free(world);
}

static double gather(struct bench *bench, double tolerance, enum gather_way way, float (*light)[3],
                     struct gather_counts *counts)
{
    const struct gather gather = {
        &bench->mesh, &bench->mapping, &bench->appearance, &bench->samples, false, tolerance, way,
        NULL};
    memset(light, 0, gather.mesh->vertex_count * sizeof *light);
    struct moment start = timing_now();
    must(gather_run(&gather, &bench->opencl, NULL, light, counts, &error));
    return timing_since(start).processor;
}

/* Build the kernels. */
static void warm_up(struct bench *bench, float (*light)[3])
{
    struct gather_counts counts;
    size_t count = bench->samples.count;
    bench->samples.count = count / 100;
    (void)gather(bench, 0.02, GATHER_SUMMED, light, &counts);
    bench->samples.count = count;
}

static double compare(const struct bench *bench)
{
    double off = 0, all = 0;
    for (size_t i = 0; i < bench->mesh.vertex_count * 3; i++) {
        double one = bench->light[i / 3][i % 3], two = bench->exact[i / 3][i % 3];
        off += (one - two) * (one - two);
        all += two * two;
    }
    return sqrt(off / all);
}

static double report(struct bench *bench, const char *name, double tolerance, enum gather_way way,
                     double plain)
{
    struct gather_counts counts;
    double seconds = gather(bench, tolerance, way, bench->light, &counts);
    printf("  %-9s %5.2f %%: %7.3f CPU s, %5.1f times sooner; error %.4f %%, told %.4f %%; %.0f %% "
           "of the vertices convolved\n",
           name, 100 * tolerance, seconds, plain / seconds, 100 * compare(bench),
           100 * counts.error, 100 * (double)counts.convolved / (double)counts.receivers);
    (void)fflush(stdout);
    return seconds;
}

/* More of the next best way's time than the machine's noise explains. */
static const double slower = 1.3;

/* Returns how often the way chosen was slower than another. */
static int run(struct bench *bench, uint32_t side, double radius, int window, int terms)
{
    const double none[3] = {0}, tolerances[] = {0.0067, 0.002};
    const struct scene_material settings = {.mapping = MAPPING_UV};
    struct motion still = motion_make(none, (struct vec3){0, 0, 0});
    struct gather_counts counts;
    make_appearance(bench, window, terms);
    make_mesh(&bench->mesh, side, radius);
    must(mapping_make(&bench->mapping, &settings, TILE_WIDTH, TILE_HEIGHT, point_mm, &bench->mesh,
                      &still, &error));
    must(mapping_follow(&bench->mapping, &bench->mesh, &error));
    make_light(bench);
    bench->light = allocate(bench->mesh.vertex_count * sizeof *bench->light);
    bench->exact = allocate(bench->mesh.vertex_count * sizeof *bench->exact);
    warm_up(bench, bench->light);
    double plain = gather(bench, 0, GATHER_SOONEST, bench->exact, &counts);
    printf("%s, %u vertices, window %d, %d terms, RGB, %zu samples: one by one %.3f CPU s\n",
           radius > 0 ? "curved" : "level", side * side, window, terms, bench->samples.count,
           plain);
    int failures = 0;
    for (int i = 0; i < 2; i++) {
        double summed = report(bench, "summed up", tolerances[i], GATHER_SUMMED, plain);
        double chosen = report(bench, "chosen", tolerances[i], GATHER_SOONEST, plain);
        if (side < 317) {
            (void)report(bench, "convolved", tolerances[i], GATHER_CONVOLVED, plain);
        }
        failures += chosen > slower * fmin(plain, summed);
    }
    free(bench->light);
    free(bench->exact);
    samples_finish(&bench->samples);
    mesh_finish(&bench->mesh);
    mapping_finish(&bench->mapping);
    appearance_finish(&bench->appearance);
    return failures;
}

int main(int argc, char **argv)
{
    struct bench bench = {0};
    long only = argc > 1 ? strtol(argv[1], NULL, 10) : -1;
    int failures = 0;
    must(opencl_open(NULL, &bench.opencl, &error));
    printf("%s\n", bench.opencl.name);
    for (int i = 0; i < 8; i++) {
        if (only < 0 || only == i) {
            failures +=
                run(&bench, 317, i < 4 ? 0 : 600, i % 2 == 0 ? 25 : 49, i / 2 % 2 == 0 ? 4 : 8);
        }
    }
    /* Where it begins to pay: noise of so short times says nothing about the choice. */
    const uint32_t sides[] = {20, 40, 80, 160};
    for (int i = 0; i < 8; i++) {
        if (only < 0 || only == 8 + i) {
            (void)run(&bench, sides[i % 4], 0, i < 4 ? 9 : 25, 4);
        }
    }
    if (failures > 0) {
        printf("slower than another way %d times\n", failures);
    }
    return failures > 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
