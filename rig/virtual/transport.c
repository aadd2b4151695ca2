/* Light transport on voxels: responses and lit pictures of a sample. */
#include "rig/virtual/transport.h"

#include "nacre/scan.h"
#include "rig/virtual/diffusion.h"
#include "rig/virtual/fresnel.h"
#include "rig/virtual/medium.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    TILE = 4,                /* surface points along a side of what is solved on one box */
    LANES = DIFFUSION_BATCH, /* of them at once */
    BATCHES = TILE * TILE / LANES,
};

struct transport {
    struct medium *medium;
    struct diffusion *diffusion;
    float *single; /* [3][height][width]: light scattered once, which leaves where it came in */
    double decay_mm
        [MEDIUM_CHANNELS]; /* over which light falls off to 1 / e in the clearest material */
    struct diffusion_problem problem; /* all of the slab, for lit pictures */
    struct transport_facts facts;
    char without[128]; /* what the sample's file forbids, for the record */
};

/* How far light goes in the clearest material of the sample: the slowest mode of a slab between its extrapolated
 * boundaries. */
static double longest_decay_mm(const struct sample *sample, int channel)
{
    double longest = 0;
    for (size_t i = 0; i < sample->material_count; i++) {
        const struct sample_material *material = &sample->materials[i];
        double absorption = material->absorption_per_mm[channel];
        double extinction =
            absorption + (1 - material->anisotropy[channel]) * material->scattering_per_mm[channel];
        double beyond = 2 * fresnel_boundary_a(material->index) / (3 * extinction);
        double across = 3.14159265358979 / (sample->thickness_mm + 2 * beyond);
        longest = fmax(longest, 1 / sqrt(3 * absorption * extinction + across * across));
    }
    return longest;
}

/* What one column adds to its point's light that was scattered once and leaves along the normal. */
static double once_scattered(const struct medium *medium, int channel, int x, int y)
{
    double index = medium->index[medium_cell(medium, x, y, 0)];
    double through = fresnel_through_normal(index) / index;
    double left = 1;
    double sum = 0;
    for (int z = 0; z < medium->nz; z++) {
        size_t cell = (size_t)channel * medium_cells(medium) + medium_cell(medium, x, y, z);
        double extinction = (double)medium->scattering[cell] + medium->absorption[cell];
        double lost =
            -left * expm1(-2 * extinction * (medium->edges_mm[z + 1] - medium->edges_mm[z]));
        sum += 0.5 * medium->scattering[cell] / extinction * lost;
        left -= lost;
    }
    return 0.25 * through * through * sum;
}

static void fill_single(struct transport *transport)
{
    const struct medium *medium = transport->medium;
    int side = medium->subdivide;
    float *single = transport->single;
    for (int c = 0; c < MEDIUM_CHANNELS; c++) {
        for (int y = 0; y < medium->height; y++) {
            for (int x = 0; x < medium->width; x++) {
                double sum = 0;
                for (int i = 0; i < side * side; i++) {
                    sum += once_scattered(medium, c, (x + medium->margin) * side + i % side,
                                          (y + medium->margin) * side + i / side);
                }
                *single++ = (float)(sum / (side * side));
            }
        }
    }
}

int transport_new(const struct sample *sample, struct transport **transport,
                  struct nacre_error *error)
{
    int status = NACRE_OK;
    size_t points = (size_t)sample->width * (size_t)sample->height;
    struct transport *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "the light transport");
        goto out;
    }
    made->single = calloc(points, MEDIUM_CHANNELS * sizeof *made->single);
    if (!made->single) {
        status = nacre_fail_memory(error, "the light transport");
        goto out;
    }
    status = medium_new(sample, &made->medium, error);
    if (status) {
        goto out;
    }
    status = diffusion_new(made->medium, &made->diffusion, error);
    if (status) {
        goto out;
    }
    fill_single(made);
    sample_without_text(sample, made->without, sizeof made->without);
    for (int c = 0; c < MEDIUM_CHANNELS; c++) {
        made->decay_mm[c] = longest_decay_mm(sample, c);
    }
    const struct medium *medium = made->medium;
    made->facts = (struct transport_facts){.width = sample->width,
                                           .height = sample->height,
                                           .pitch_mm = sample->pitch_mm,
                                           .voxels = {medium->nx, medium->ny, medium->nz},
                                           .subdivide = medium->subdivide,
                                           .cell_mm = medium->cell_mm,
                                           .first_mm = medium->edges_mm[1],
                                           .last_mm = medium->edges_mm[medium->nz] -
                                                      medium->edges_mm[medium->nz - 1]};
out:
    if (status) {
        transport_free(made);
        made = NULL;
    }
    *transport = made;
    return status;
}

void transport_free(struct transport *transport)
{
    if (transport) {
        diffusion_problem_finish(&transport->problem);
        diffusion_free(transport->diffusion);
        medium_free(transport->medium);
        free(transport->single);
        free(transport);
    }
}

struct transport_facts transport_facts(const struct transport *transport)
{
    return transport->facts;
}

/* The system's first voxel of column `i` of surface point (x, y), and the problem's. */
static size_t point_column(const struct transport *transport, int x, int y, int i, int place[2])
{
    const struct medium *medium = transport->medium;
    place[0] = (x + medium->margin) * medium->subdivide + i % medium->subdivide;
    place[1] = (y + medium->margin) * medium->subdivide + i / medium->subdivide;
    return diffusion_cell(transport->diffusion, place[0], place[1], 0);
}

/* Put a point's irradiance into lanes of the problem, for all channels at once. */
static void light_point(const struct transport *transport, struct diffusion_problem *problem, int x,
                        int y, float4 irradiance)
{
    const struct medium *medium = transport->medium;
    for (int i = 0; i < medium->subdivide * medium->subdivide; i++) {
        int place[2];
        const float4 *source =
            transport->diffusion->source + point_column(transport, x, y, i, place);
        float4 *given = (float4 *)(void *)problem->source +
                        diffusion_problem_cell(problem, place[0], place[1], 0);
        for (int z = 0; z < medium->nz; z++) {
            given[z] = source[z] * irradiance;
        }
    }
}

static float4 view_point(const struct transport *transport, const struct diffusion_problem *problem,
                         int x, int y)
{
    const struct medium *medium = transport->medium;
    float4 sum = {0};
    for (int i = 0; i < medium->subdivide * medium->subdivide; i++) {
        int place[2];
        const float4 *source =
            transport->diffusion->source + point_column(transport, x, y, i, place);
        const float4 *values = (const float4 *)(const void *)problem->values +
                               diffusion_problem_cell(problem, place[0], place[1], 0);
        for (int z = 0; z < medium->nz; z++) {
            sum += source[z] * values[z];
        }
    }
    return sum;
}

int transport_apply(struct transport *transport, const float *irradiance, float *radiosity,
                    struct nacre_error *error)
{
    const struct medium *medium = transport->medium;
    struct diffusion_problem *problem = &transport->problem;
    const struct diffusion_box all = {0, 0, medium->nx, medium->ny, 0};
    size_t points = (size_t)medium->width * (size_t)medium->height;
    int status = NACRE_OK;
    if (problem->levels) {
        diffusion_problem_darken(problem);
    } else {
        status = diffusion_problem_set(problem, transport->diffusion, all, DIFFUSION_CHANNELS, -1,
                                       error);
    }
    if (status) {
        return status;
    }
    for (size_t i = 0; i < points; i++) {
        float4 lit = {irradiance[i], irradiance[points + i], irradiance[2 * points + i], 0};
        light_point(transport, problem, (int)(i % (size_t)medium->width),
                    (int)(i / (size_t)medium->width), lit);
    }
    status = diffusion_solve(problem, error);
    if (status) {
        return status;
    }
    for (size_t i = 0; i < points; i++) {
        float4 seen = view_point(transport, problem, (int)(i % (size_t)medium->width),
                                 (int)(i / (size_t)medium->width));
        for (size_t c = 0; c < MEDIUM_CHANNELS; c++) {
            size_t at = c * points + i;
            radiosity[at] = seen[c] + transport->single[at] * irradiance[at];
        }
    }
    return NACRE_OK;
}

/* The responses of a row of tiles, as they are computed. */
struct tile_row {
    struct transport *transport;
    int window;
    int reach[MEDIUM_CHANNELS]; /* of the boxes, beyond the window, in points */
    int y;                      /* of the first point */
    float *responses;           /* [TILE][width][3][K][K] */
    double *leaving; /* [TILE][width][3][2]: light that leaves anywhere, and within the window */
};

static int clip(int value, int high)
{
    return value < 0 ? 0 : value > high ? high : value;
}

/* The box of voxels in which the points of the tile at (x, y) are solved. Beyond its sides light goes on falling off: by
 * the decay of the slowest mode, and like 1 / sqrt(r) as it spreads. */
static struct diffusion_box tile_box(const struct tile_row *row, int x, int channel)
{
    const struct medium *medium = row->transport->medium;
    int side = medium->subdivide;
    int around = row->window / 2 + row->reach[channel];
    int before = medium->margin - around;
    int after = medium->margin + TILE + around;
    double fall =
        medium->cell_mm / row->transport->decay_mm[channel] + 0.5 / ((around + 0.5 * TILE) * side);
    return (struct diffusion_box){.x0 = clip((x + before) * side, medium->nx),
                                  .y0 = clip((row->y + before) * side, medium->ny),
                                  .x1 = clip((x + after) * side, medium->nx),
                                  .y1 = clip((row->y + after) * side, medium->ny),
                                  .open = (float)(fall / (1 + 0.5 * fall))};
}

/* The surface point of a lane of a batch of the tile that begins at column x0; false if there is none. */
static bool lane_point(const struct tile_row *row, int x0, int batch, int lane, int *x, int *y)
{
    const struct medium *medium = row->transport->medium;
    int i = batch * LANES + lane;
    *x = x0 + i % TILE;
    *y = row->y + i / TILE;
    return *x < medium->width && *y < medium->height;
}

static void light_batch(const struct tile_row *row, struct diffusion_problem *problem, int x0,
                        int batch, int channel)
{
    const struct medium *medium = row->transport->medium;
    for (int lane = 0; lane < LANES; lane++) {
        int x;
        int y;
        if (!lane_point(row, x0, batch, lane, &x, &y)) {
            continue;
        }
        for (int i = 0; i < medium->subdivide * medium->subdivide; i++) {
            int place[2];
            const float4 *source =
                row->transport->diffusion->source + point_column(row->transport, x, y, i, place);
            size_t first = diffusion_problem_cell(problem, place[0], place[1], 0);
            for (int z = 0; z < medium->nz; z++) {
                /* NOLINTNEXTLINE(clang-analyzer-core.NullDereference): solver_set has set it */
                problem->source[(first + (size_t)z) * LANES + (size_t)lane] = source[z][channel];
            }
        }
    }
}

/* The light that leaves each column of the box, for all lanes, into seen[columns][LANES]. */
static void view_box(const struct tile_row *row, const struct diffusion_problem *problem,
                     int channel, float *seen)
{
    const struct diffusion *diffusion = row->transport->diffusion;
    const struct diffusion_box *box = &problem->box;
    for (int y = box->y0; y < box->y1; y++) {
        for (int x = box->x0; x < box->x1; x++) {
            const float4 *source = diffusion->source + diffusion_cell(diffusion, x, y, 0);
            const float *values =
                problem->values + diffusion_problem_cell(problem, x, y, 0) * LANES;
            float sums[LANES] = {0};
            for (size_t z = 0; z < problem->column; z++) {
                for (size_t lane = 0; lane < LANES; lane++) {
                    sums[lane] += source[z][channel] * *values++;
                }
            }
            memcpy(seen, sums, sizeof sums);
            seen += LANES;
        }
    }
}

/* The light that leaves the columns x0 <= x < x1, y0 <= y < y1 of what view_box saw. */
static double sum_columns(const struct diffusion_box *box, const float *seen, int lane,
                          struct diffusion_box part)
{
    size_t columns = (size_t)(box->x1 - box->x0);
    double sum = 0;
    for (int y = part.y0 > box->y0 ? part.y0 : box->y0; y < part.y1 && y < box->y1; y++) {
        for (int x = part.x0 > box->x0 ? part.x0 : box->x0; x < part.x1 && x < box->x1; x++) {
            size_t at = (size_t)(y - box->y0) * columns + (size_t)(x - box->x0);
            sum += (double)seen[at * LANES + (size_t)lane];
        }
    }
    return sum;
}

/* The columns of the points from (x0, y0) to before (x1, y1). */
static struct diffusion_box points_box(const struct medium *medium, int x0, int y0, int x1, int y1)
{
    return (struct diffusion_box){.x0 = (x0 + medium->margin) * medium->subdivide,
                                  .y0 = (y0 + medium->margin) * medium->subdivide,
                                  .x1 = (x1 + medium->margin) * medium->subdivide,
                                  .y1 = (y1 + medium->margin) * medium->subdivide};
}

/* Gather the response of point (x, y) from the columns. The solver's tolerance may leave tails that are negative by
 * less than a millionth of the peak; they are 0. */
static void gather_response(const struct tile_row *row, const struct diffusion_box *box, int lane,
                            int x, int y, int channel, const float *seen)
{
    const struct medium *medium = row->transport->medium;
    int k = row->window;
    int half = k / 2;
    size_t plane = (size_t)k * (size_t)k;
    size_t point = (size_t)(y - row->y) * (size_t)medium->width + (size_t)x;
    size_t entry = point * MEDIUM_CHANNELS + (size_t)channel;
    float *response = row->responses + entry * plane;
    double single =
        (double)row->transport->single[((size_t)channel * (size_t)medium->height + (size_t)y) *
                                           (size_t)medium->width +
                                       (size_t)x];
    for (int i = 0; i < k * k; i++) {
        int out_x = x + i % k - half;
        int out_y = y + i / k - half;
        double sum = i == k * k / 2 ? single : 0;
        if (out_x >= 0 && out_x < medium->width && out_y >= 0 && out_y < medium->height) {
            sum += sum_columns(box, seen, lane,
                               points_box(medium, out_x, out_y, out_x + 1, out_y + 1));
        }
        response[i] = (float)fmax(sum, 0);
    }
    row->leaving[2 * entry] = single + sum_columns(box, seen, lane, *box);
    row->leaving[2 * entry + 1] =
        single + sum_columns(box, seen, lane,
                             points_box(medium, x - half, y - half, x + half + 1, y + half + 1));
}

/* What a thread needs to solve tiles. */
struct solver {
    struct diffusion_problem problem;
    float *seen;
    size_t seen_capacity;
};

static int solver_set(struct solver *solver, const struct tile_row *row, int x, int channel,
                      struct nacre_error *error)
{
    const struct diffusion_box box = tile_box(row, x, channel);
    size_t needed = (size_t)(box.x1 - box.x0) * (size_t)(box.y1 - box.y0) * LANES;
    if (needed > solver->seen_capacity) {
        free(solver->seen);
        solver->seen = calloc(needed, sizeof *solver->seen);
        solver->seen_capacity = solver->seen ? needed : 0;
        if (!solver->seen) {
            return nacre_fail_memory(error, "the responses");
        }
    }
    return diffusion_problem_set(&solver->problem, row->transport->diffusion, box, DIFFUSION_BATCH,
                                 channel, error);
}

static void solver_finish(struct solver *solver)
{
    diffusion_problem_finish(&solver->problem);
    free(solver->seen);
}

/* Solve the points of one tile in one channel. */
static int solve_tile(const struct tile_row *row, struct solver *solver, int x0, int channel,
                      struct nacre_error *error)
{
    struct diffusion_problem *problem = &solver->problem;
    int status = solver_set(solver, row, x0, channel, error);
    for (int batch = 0; batch < BATCHES && !status; batch++) {
        if (batch > 0) {
            diffusion_problem_darken(problem);
        }
        light_batch(row, problem, x0, batch, channel);
        status = diffusion_solve(problem, error);
        if (status) {
            break;
        }
        view_box(row, problem, channel, solver->seen);
        for (int lane = 0; lane < LANES; lane++) {
            int x;
            int y;
            if (lane_point(row, x0, batch, lane, &x, &y)) {
                gather_response(row, &problem->box, lane, x, y, channel, solver->seen);
            }
        }
    }
    return status;
}

static int solve_row(const struct tile_row *row, struct nacre_error *error)
{
    int tiles = (row->transport->medium->width + TILE - 1) / TILE;
    int status = NACRE_OK;
#pragma omp parallel
    {
        struct solver solver = {0};
#pragma omp for schedule(dynamic)
        for (int i = 0; i < tiles * MEDIUM_CHANNELS; i++) {
            struct nacre_error mine;
            if (progress_interrupted()) {
                continue; /* the caller's progress_step tells */
            }
            if (solve_tile(row, &solver, i % tiles * TILE, i / tiles, &mine)) {
#pragma omp critical
                {
                    status = NACRE_FAILED;
                    if (error) {
                        *error = mine;
                    }
                }
            }
        }
        solver_finish(&solver);
    }
    return status;
}

/* Write the row's responses, and note how much of their light lies outside their windows. */
static int write_row(const struct tile_row *row, struct nacre_scan_writer *writer,
                     struct nacre_error *error)
{
    struct transport_facts *facts = &row->transport->facts;
    size_t size = MEDIUM_CHANNELS * (size_t)row->window * (size_t)row->window;
    for (int i = 0; i < TILE * facts->width; i++) {
        const double *leaving = row->leaving + (size_t)i * MEDIUM_CHANNELS * 2;
        int y = row->y + i / facts->width;
        if (y >= facts->height) {
            break;
        }
        int status =
            nacre_scan_write(writer, i % facts->width, y, row->responses + (size_t)i * size, error);
        if (status) {
            return status;
        }
        double all = leaving[0] + leaving[2] + leaving[4];
        double within = leaving[1] + leaving[3] + leaving[5];
        double outside = all > 0 ? fmax(1 - within / all, 0) : 0;
        facts->outside_mean += outside / ((double)facts->width * facts->height);
        facts->outside_max = fmax(facts->outside_max, outside);
    }
    return NACRE_OK;
}

int transport_reach(const struct transport *transport, int window, int channel)
{
    /* What a side throws back has gone there and back when it reaches the window's edge; a side that is open throws a
     * part back only. */
    static const double REACH_DECAYS = 6;
    double points = transport->decay_mm[channel] * REACH_DECAYS / transport->facts.pitch_mm;
    double reach = ceil(0.5 * (points - 0.5 * window));
    return reach < 2 ? 2 : reach > 100000 ? 100000 : (int)reach;
}

static int begin_scan(const struct transport *transport, int window, const char *path,
                      struct nacre_scan_writer **writer, struct nacre_error *error)
{
    const struct transport_facts *facts = &transport->facts;
    struct nacre_scan_info info = {.width = facts->width,
                                   .height = facts->height,
                                   .window = window,
                                   .channels = MEDIUM_CHANNELS,
                                   .pixel = NACRE_FLOAT,
                                   .pitch_mm = facts->pitch_mm};
    (void)snprintf(info.source, sizeof info.source, /* far shorter than its room */
                   "nacre simulate: diffusion, %d x %d x %d voxels of %.4g mm%s", facts->voxels[0],
                   facts->voxels[1], facts->voxels[2], facts->cell_mm, transport->without);
    return nacre_scan_create(path, &info, writer, error);
}

int transport_write_scan(struct transport *transport, int window, const char *path,
                         struct progress *progress, struct nacre_error *error)
{
    struct transport_facts *facts = &transport->facts;
    struct nacre_scan_writer *writer = NULL;
    struct tile_row row = {.transport = transport, .window = window};
    int status = NACRE_OK;
    if (window < 1 || window % 2 == 0 || window > 1023) {
        return nacre_fail(error, "the window is %d; it must be odd, from 1 to 1023", window);
    }
    size_t entries = TILE * (size_t)facts->width * MEDIUM_CHANNELS;
    for (int c = 0; c < MEDIUM_CHANNELS; c++) {
        row.reach[c] = facts->reach_points[c] = transport_reach(transport, window, c);
    }
    facts->outside_mean = facts->outside_max = 0;
    row.responses = calloc(entries, (size_t)window * (size_t)window * sizeof *row.responses);
    row.leaving = calloc(entries, 2 * sizeof *row.leaving);
    if (!row.responses || !row.leaving) {
        status = nacre_fail_memory(error, "the responses");
        goto out;
    }
    status = begin_scan(transport, window, path, &writer, error);
    if (status) {
        goto out;
    }
    for (row.y = 0; row.y < facts->height; row.y += TILE) {
        status = solve_row(&row, error);
        if (!status) {
            status = progress_step(progress, row.y + TILE, facts->height, NULL, error);
        }
        if (!status) {
            status = write_row(&row, writer, error);
        }
        if (status) {
            goto out;
        }
    }
    status = nacre_scan_commit(writer, error);
    writer = NULL;
out:
    nacre_scan_discard(writer);
    free(row.responses);
    free(row.leaving);
    return status;
}
