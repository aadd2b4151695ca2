/* Light transport by Monte Carlo: the host's side. */
#include "rig/virtual/montecarlo.h"

#include "base/opencl.h"
#include "base/progress.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source montecarlo_cl;

enum {
    FINEST = 4,   /* voxels along a surface point */
    LAYERS = 512, /* at most */
    BATCHES = 16, /* of paths, from whose differences the standard error comes */
    TOTALS = 5,
    MOST_MATERIALS = 256,
};

static const double MOST_CELLS = 64e6;
static const size_t MOST_PATHS =
    (size_t)1 << 20; /* at once: a number of 24 bits before the point holds their sum */

/* As the kernel has it. */
struct slab {
    cl_int nx, ny, nz, side, margin, width, height, window;
    cl_float cell, layer, majorant;
    cl_uint seed, channel, first;
};

enum buffer { SLAB, MATERIALS, VOXELS, ABOVE, POINTS, TALLIES, SUMS, BUFFERS };

struct montecarlo {
    struct opencl opencl;
    struct slab slab;
    cl_float4 materials[3][MOST_MATERIALS];
    size_t material_count;
    float majorants[3];
    bool matched, isotropic, clear;
    uint8_t *voxels; /* [ny][nx][nz], of materials */
    float *above;    /* [ny][nx][nz + 1], of the channel at hand */
    cl_mem buffers[BUFFERS];
    size_t sizes[BUFFERS];
    cl_program programs[2]; /* by estimator */
    cl_kernel kernels[2];
};

static size_t column_count(const struct montecarlo *montecarlo)
{
    return (size_t)montecarlo->slab.nx * (size_t)montecarlo->slab.ny;
}

static void fill_materials(struct montecarlo *montecarlo, const struct sample *sample)
{
    montecarlo->matched = montecarlo->isotropic = montecarlo->clear = true;
    montecarlo->material_count = sample->material_count;
    for (size_t i = 0; i < sample->material_count; i++) {
        const struct sample_material *material = &sample->materials[i];
        montecarlo->matched = montecarlo->matched && material->index == 1;
        for (int c = 0; c < 3; c++) {
            float extinction =
                (float)(material->scattering_per_mm[c] + material->absorption_per_mm[c]);
            montecarlo->clear = montecarlo->clear && material->absorption_per_mm[c] == 0;
            montecarlo->isotropic = montecarlo->isotropic && material->anisotropy[c] == 0;
            montecarlo->materials[c][i] =
                (cl_float4){.s = {(float)material->scattering_per_mm[c], extinction,
                                  (float)material->anisotropy[c], (float)material->index}};
            montecarlo->majorants[c] = fmaxf(montecarlo->majorants[c], extinction);
        }
    }
}

static int lay_out(struct montecarlo *montecarlo, const struct sample *sample,
                   struct nacre_error *error)
{
    struct slab *slab = &montecarlo->slab;
    int side = sample->inclusion_count == 0        ? 1
               : sample->voxels.subdivide > FINEST ? sample->voxels.subdivide
                                                   : FINEST;
    double cell = sample->pitch_mm / side;
    double layers = sample->inclusion_count == 0 ? 1 : ceil(sample->thickness_mm / cell);
    double nx = ((double)sample->width + 2.0 * sample->margin_points) * side;
    double ny = ((double)sample->height + 2.0 * sample->margin_points) * side;
    layers = fmin(layers, LAYERS);
    if (nx * ny * layers > MOST_CELLS || nx * ny * layers < 1) {
        return nacre_fail(
            error,
            "Monte Carlo needs %.0f x %.0f x %.0f voxels, which is not from 1 to %.0f "
            "million; make the slab smaller",
            nx, ny, layers, MOST_CELLS * 1e-6);
    }
    if (sample->material_count > MOST_MATERIALS) {
        return nacre_fail(error, "Monte Carlo knows %d materials at most, not %zu", MOST_MATERIALS,
                          sample->material_count);
    }
    *slab = (struct slab){.nx = (cl_int)nx,
                          .ny = (cl_int)ny,
                          .nz = (cl_int)layers,
                          .side = side,
                          .margin = sample->margin_points,
                          .width = sample->width,
                          .height = sample->height,
                          .cell = (cl_float)cell,
                          .layer = (cl_float)(sample->thickness_mm / layers)};
    return NACRE_OK;
}

static int fill_voxels(struct montecarlo *montecarlo, const struct sample *sample,
                       struct nacre_error *error)
{
    const struct slab *slab = &montecarlo->slab;
    double corner = sample->margin_points * sample->pitch_mm;
    double cell = sample->pitch_mm / slab->side;
    double layer = sample->thickness_mm / slab->nz;
    size_t columns = column_count(montecarlo);
    /* NOLINTNEXTLINE(clang-analyzer-optin.portability.UnixAPI): lay_out refuses a slab without voxels */
    montecarlo->voxels = calloc(columns, (size_t)slab->nz);
    montecarlo->above = calloc(columns, ((size_t)slab->nz + 1) * sizeof *montecarlo->above);
    if (!montecarlo->voxels || !montecarlo->above) {
        return nacre_fail_memory(error, "the voxels");
    }
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < slab->ny; y++) {
        uint8_t *voxel = montecarlo->voxels + (size_t)y * (size_t)slab->nx * (size_t)slab->nz;
        for (int i = 0; i < slab->nx * slab->nz; i++) {
            int x = i / slab->nz;
            const double place[3] = {(x + 0.5) * cell - corner, (y + 0.5) * cell - corner,
                                     (i % slab->nz + 0.5) * layer};
            *voxel++ = (uint8_t)sample_material_at(sample, place);
        }
    }
    return NACRE_OK;
}

static int build(struct montecarlo *montecarlo, enum montecarlo_estimator estimator,
                 struct nacre_error *error)
{
    char options[64];
    cl_int status;
    if (montecarlo->kernels[estimator]) {
        return NACRE_OK;
    }
    (void)snprintf(options, sizeof options, "%s%s%s%s%s", /* fits */
                   estimator == MONTECARLO_EXITANCE ? "-DEXITANCE " : "",
                   montecarlo->matched ? "-DMATCHED " : "",
                   montecarlo->isotropic ? "-DISOTROPIC " : "", montecarlo->clear ? "-DCLEAR " : "",
                   montecarlo->material_count == 1 ? "-DALIKE" : "");
    if (opencl_build(&montecarlo->opencl, &montecarlo_cl, options, &montecarlo->programs[estimator],
                     error)) {
        return NACRE_FAILED;
    }
    montecarlo->kernels[estimator] =
        clCreateKernel(montecarlo->programs[estimator], "trace", &status);
    return opencl_check(&montecarlo->opencl, status, "cannot make the kernel that traces light",
                        error);
}

int montecarlo_new(const struct sample *sample, const char *device, struct montecarlo **montecarlo,
                   struct nacre_error *error)
{
    int status = NACRE_OK;
    struct montecarlo *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "the paths of light");
        goto out;
    }
    status = lay_out(made, sample, error);
    if (!status) {
        fill_materials(made, sample);
        status = fill_voxels(made, sample, error);
    }
    if (!status) {
        status = opencl_open(device, &made->opencl, error);
    }
out:
    if (status) {
        montecarlo_free(made);
        made = NULL;
    }
    *montecarlo = made;
    return status;
}

void montecarlo_free(struct montecarlo *montecarlo)
{
    if (!montecarlo) {
        return;
    }
    for (int i = 0; i < BUFFERS; i++) {
        if (montecarlo->buffers[i]) {
            (void)clReleaseMemObject(montecarlo->buffers[i]); /* nothing to do if it fails */
        }
    }
    for (int i = 0; i < 2; i++) {
        if (montecarlo->kernels[i]) {
            (void)clReleaseKernel(montecarlo->kernels[i]);
        }
        if (montecarlo->programs[i]) {
            (void)clReleaseProgram(montecarlo->programs[i]);
        }
    }
    opencl_close(&montecarlo->opencl);
    free(montecarlo->voxels);
    free(montecarlo->above);
    free(montecarlo);
}

/* Copy bytes into a buffer, which is made anew where it is too small. */
static int upload(struct montecarlo *montecarlo, enum buffer which, const void *bytes, size_t size,
                  struct nacre_error *error)
{
    cl_int status = CL_SUCCESS;
    if (size > montecarlo->sizes[which]) {
        if (montecarlo->buffers[which]) {
            (void)clReleaseMemObject(montecarlo->buffers[which]); /* nothing to do if it fails */
        }
        montecarlo->buffers[which] =
            clCreateBuffer(montecarlo->opencl.context, CL_MEM_READ_WRITE, size, NULL, &status);
        montecarlo->sizes[which] = status == CL_SUCCESS ? size : 0;
    }
    if (status == CL_SUCCESS) {
        status = clEnqueueWriteBuffer(montecarlo->opencl.queue, montecarlo->buffers[which], CL_TRUE,
                                      0, size, bytes, 0, NULL, NULL);
    }
    return opencl_check(&montecarlo->opencl, status, "cannot copy the sample", error);
}

/* The optical depth above every voxel of a channel. */
static void fill_above(struct montecarlo *montecarlo, int channel)
{
    const struct slab *slab = &montecarlo->slab;
    for (size_t i = 0; i < column_count(montecarlo); i++) {
        const uint8_t *voxels = montecarlo->voxels + i * (size_t)slab->nz;
        float *above = montecarlo->above + i * ((size_t)slab->nz + 1);
        double depth = 0;
        for (int z = 0; z < slab->nz; z++) {
            above[z] = (float)depth;
            depth += (double)montecarlo->materials[channel][voxels[z]].s[1] * (double)slab->layer;
        }
        above[slab->nz] = (float)depth;
    }
}

/* What a trace adds up, and where. */
struct tally {
    size_t entries; /* responses', then totals' */
    uint64_t *fixed;
    double *sums, *squares; /* over batches */
};

static int prepare(struct montecarlo *montecarlo, const struct montecarlo_request *request,
                   struct nacre_error *error)
{
    struct slab *slab = &montecarlo->slab;
    size_t columns = column_count(montecarlo);
    int channel = request->channel;
    slab->window = request->window;
    slab->seed = request->seed;
    slab->channel = (cl_uint)channel;
    slab->majorant = montecarlo->majorants[channel];
    fill_above(montecarlo, channel);
    const struct {
        enum buffer which;
        const void *bytes;
        size_t size;
    } parts[] = {
        {VOXELS, montecarlo->voxels, columns * (size_t)slab->nz},
        {ABOVE, montecarlo->above, columns * ((size_t)slab->nz + 1) * sizeof *montecarlo->above},
        {MATERIALS, montecarlo->materials[channel], montecarlo->material_count * sizeof(cl_float4)},
        {POINTS, request->points, request->count * sizeof *request->points}};
    int status = build(montecarlo, request->estimator, error);
    for (size_t i = 0; i < sizeof parts / sizeof *parts && !status; i++) {
        status = upload(montecarlo, parts[i].which, parts[i].bytes, parts[i].size, error);
    }
    return status;
}

/* Trace `paths` paths of each point from number `first` on and add what they give to fixed. */
static int run(struct montecarlo *montecarlo, const struct montecarlo_request *request,
               struct tally *tally, size_t first, size_t paths, struct nacre_error *error)
{
    cl_command_queue queue = montecarlo->opencl.queue;
    cl_kernel kernel = montecarlo->kernels[request->estimator];
    size_t plane = (size_t)request->window * (size_t)request->window * request->count;
    size_t size[2] = {paths, request->count};
    montecarlo->slab.first = (cl_uint)first;
    memset(tally->fixed, 0, tally->entries * sizeof *tally->fixed);
    int status = upload(montecarlo, SLAB, &montecarlo->slab, sizeof montecarlo->slab, error);
    if (!status) {
        status = upload(montecarlo, TALLIES, tally->fixed, plane * sizeof *tally->fixed, error);
    }
    if (!status) {
        status = upload(montecarlo, SUMS, tally->fixed,
                        request->count * TOTALS * sizeof *tally->fixed, error);
    }
    if (status) {
        return status;
    }
    cl_int code = CL_SUCCESS;
    for (int i = 0; i < BUFFERS && code == CL_SUCCESS; i++) {
        code = clSetKernelArg(kernel, (cl_uint)i, sizeof(cl_mem), &montecarlo->buffers[i]);
    }
    if (code == CL_SUCCESS) {
        code = clEnqueueNDRangeKernel(queue, kernel, 2, NULL, size, NULL, 0, NULL, NULL);
    }
    if (code == CL_SUCCESS) {
        code = clEnqueueReadBuffer(queue, montecarlo->buffers[TALLIES], CL_TRUE, 0,
                                   plane * sizeof *tally->fixed, tally->fixed, 0, NULL, NULL);
    }
    if (code == CL_SUCCESS) {
        code = clEnqueueReadBuffer(queue, montecarlo->buffers[SUMS], CL_TRUE, 0,
                                   request->count * TOTALS * sizeof *tally->fixed,
                                   tally->fixed + plane, 0, NULL, NULL);
    }
    return opencl_check(&montecarlo->opencl, code, "cannot trace light", error);
}

/* One batch: its mean of each entry into sums and squares. */
static int run_batch(struct montecarlo *montecarlo, const struct montecarlo_request *request,
                     struct tally *tally, int batch, size_t paths, struct nacre_error *error)
{
    size_t most = MOST_PATHS / request->count > 0 ? MOST_PATHS / request->count : 1;
    int status = NACRE_OK;
    double *means = calloc(tally->entries, sizeof *means);
    if (!means) {
        return nacre_fail_memory(error, "the responses");
    }
    for (size_t done = 0; done < paths && !status;) {
        size_t now = paths - done < most ? paths - done : most;
        status = run(montecarlo, request, tally, (size_t)batch * paths + done, now, error);
        for (size_t i = 0; i < tally->entries && !status; i++) {
            means[i] += (double)tally->fixed[i] * 0x1p-40 / (double)paths;
        }
        done += now;
        if (!status && progress_interrupted()) {
            status = NACRE_CANCELLED;
        }
    }
    for (size_t i = 0; i < tally->entries && !status; i++) {
        tally->sums[i] += means[i];
        tally->squares[i] += means[i] * means[i];
    }
    free(means);
    return status;
}

static int check_request(const struct montecarlo *montecarlo,
                         const struct montecarlo_request *request, struct nacre_error *error)
{
    if (request->window < 1 || request->window > 1023 || request->window % 2 == 0) {
        return nacre_fail(error, "the window is %d; it must be odd, from 1 to 1023",
                          request->window);
    }
    if (request->paths < 1 || request->paths > UINT32_MAX / 2) {
        return nacre_fail(error, "Monte Carlo traces from 1 to %u paths for each point, not %llu",
                          UINT32_MAX / 2, (unsigned long long)request->paths);
    }
    for (size_t i = 0; i < request->count; i++) {
        const int *point = request->points[i];
        if (point[0] < 0 || point[0] >= montecarlo->slab.width || point[1] < 0 ||
            point[1] >= montecarlo->slab.height) {
            return nacre_fail(error, "surface point (%d, %d) is not on the sample", point[0],
                              point[1]);
        }
    }
    return NACRE_OK;
}

static void give_results(const struct montecarlo_request *request, const struct tally *tally,
                         float *responses, float *deviations, struct montecarlo_totals *totals)
{
    size_t plane = (size_t)request->window * (size_t)request->window * request->count;
    for (size_t i = 0; i < plane; i++) {
        double mean = tally->sums[i] / BATCHES;
        double variance = fmax(0, tally->squares[i] / BATCHES - mean * mean) / (BATCHES - 1);
        responses[i] = (float)mean;
        if (deviations) {
            deviations[i] = (float)sqrt(variance);
        }
    }
    for (size_t i = 0; i < request->count && totals; i++) {
        const double *sums = tally->sums + plane + i * TOTALS;
        totals[i] = (struct montecarlo_totals){.up = sums[0] / BATCHES,
                                               .down = sums[1] / BATCHES,
                                               .aside = sums[2] / BATCHES,
                                               .absorbed = sums[3] / BATCHES,
                                               .camera = sums[4] / BATCHES};
    }
}

int montecarlo_trace(struct montecarlo *montecarlo, const struct montecarlo_request *request,
                     float *responses, float *deviations, struct montecarlo_totals *totals,
                     struct nacre_error *error)
{
    struct tally tally = {0};
    int status = check_request(montecarlo, request, error);
    if (status || request->count == 0) {
        return status;
    }
    size_t paths = (size_t)((request->paths + BATCHES - 1) / BATCHES);
    tally.entries = ((size_t)request->window * (size_t)request->window + TOTALS) * request->count;
    tally.fixed = calloc(tally.entries, sizeof *tally.fixed);
    tally.sums = calloc(tally.entries, 2 * sizeof *tally.sums);
    if (!tally.fixed || !tally.sums) {
        status = nacre_fail_memory(error, "the responses");
        goto out;
    }
    tally.squares = tally.sums + tally.entries;
    status = prepare(montecarlo, request, error);
    for (int batch = 0; batch < BATCHES && !status; batch++) {
        status = run_batch(montecarlo, request, &tally, batch, paths, error);
    }
    if (!status) {
        give_results(request, &tally, responses, deviations, totals);
    }
out:
    free(tally.fixed);
    free(tally.sums);
    return status;
}
