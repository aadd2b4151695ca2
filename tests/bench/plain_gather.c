/* Host part of the pinned baseline: sorting, lists of what is in reach, launches. */
#include "plain_gather.h"

#include "halves.h"
#include "render/bundles.h"
#include "render/receivers.h"
#include "timing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = 16, LEAF = 64, FIELDS = 13, ITEMS_A_LAUNCH = 256 };

extern const struct opencl_source plain_gather_cl;

/* In the order of the kernel's arguments, after `first`. */
enum { BUNDLES, H, LIST_STARTS, LISTS, LEAF_STARTS, SAMPLES, FACTORS, KERNELS, IDS, OUT, BUFFERS };

struct plain_bundle {
    float fields[FIELDS][LANES];
    int32_t chart[LANES];
};

struct plain_sample {
    float position[3], x, y, flux[3];
    int32_t chart;
    uint32_t texel, unused[2];
};

struct plain {
    const struct gather *gather;
    const struct opencl *opencl;
    struct receivers receivers;
    uint32_t *order;
    size_t bundle_count;
    cl_program program;
    cl_kernel kernel;
    cl_mem buffers[BUFFERS];
};

static struct nacre_error error;

static void check(const struct plain *plain, cl_int status, const char *action)
{
    if (opencl_check(plain->opencl, status, action, &error) != NACRE_OK) {
        fail(error.text);
    }
}

static void upload(struct plain *plain, int buffer, const void *bytes, size_t size)
{
    cl_int status;
    plain->buffers[buffer] = clCreateBuffer(plain->opencl->context, CL_MEM_READ_WRITE,
                                            size > 0 ? size : 16, NULL, &status);
    check(plain, status, "cannot make a buffer");
    if (bytes && size > 0) {
        check(plain,
              clEnqueueWriteBuffer(plain->opencl->queue, plain->buffers[buffer], CL_TRUE, 0, size,
                                   bytes, 0, NULL, NULL),
              "cannot fill a buffer");
    }
    check(
        plain,
        clSetKernelArg(plain->kernel, (cl_uint)buffer + 1, sizeof(cl_mem), &plain->buffers[buffer]),
        "cannot set an argument");
}

static void build(struct plain *plain)
{
    const struct appearance *a = plain->gather->appearance;
    const struct mapping *mapping = plain->gather->mapping;
    char options[256];
    cl_int status;
    if (a->layout != NACRE_KERNEL_SINGLE || a->mixed != 1 || a->factor_channels != 3) {
        fail("the plain gather knows layout single with hard clusters and three channels alone");
    }
    (void)snprintf(options, sizeof options,
                   "-w -cl-fast-relaxed-math -DTERMS4=%d -DWINDOW=%d -DWIDTH=%d -DHEIGHT=%d "
                   "-DMIRROR=%d -DPOINT_MM=%.9ef",
                   a->terms / 4, a->window, a->width, a->height, mapping->mirror,
                   mapping->point_mm);
    if (opencl_build(plain->opencl, &plain_gather_cl, options, &plain->program, &error) !=
        NACRE_OK) {
        fail(error.text);
    }
    plain->kernel = clCreateKernel(plain->program, "plain_gather", &status);
    check(plain, status, "cannot make the plain gather");
}

/* from[plane of 3][terms] to to[term][4] */
static void by_terms(const float *from, size_t terms, float *to)
{
    for (size_t t = 0; t < terms; t++) {
        for (size_t c = 0; c < 3; c++) {
            to[t * 4 + c] = from[c * terms + t];
        }
        to[t * 4 + 3] = 0;
    }
}

static void upload_material(struct plain *plain)
{
    const struct appearance *a = plain->gather->appearance;
    size_t texels = (size_t)a->width * (size_t)a->height, terms = (size_t)a->terms;
    size_t side = (size_t)a->window + 2;
    float *factors = allocate(texels * terms * 4 * sizeof *factors);
    for (size_t i = 0; i < texels; i++) {
        by_terms(a->f + i * terms * 3, terms, factors + i * terms * 4);
    }
    upload(plain, FACTORS, factors, texels * terms * 4 * sizeof *factors);
    upload(plain, KERNELS, a->kernels,
           (size_t)a->kernel_count * side * side * 4 * sizeof *a->kernels);
    upload(plain, IDS, a->ids, texels * sizeof *a->ids);
    free(factors);
}

static void fill_bundle(const struct plain *plain, size_t bundle, struct plain_bundle *out,
                        float *h)
{
    size_t terms = (size_t)plain->gather->appearance->terms, count = plain->receivers.count;
    for (size_t j = 0; j < LANES; j++) {
        /* The last bundle is filled up with its own last receiver. */
        size_t place = bundle * LANES + j < count ? bundle * LANES + j : count - 1;
        uint32_t i = plain->order[place];
        const struct receiver *r = &plain->receivers.list[i];
        for (size_t k = 0; k < 3; k++) {
            out->fields[k][j] = r->position[k];
            out->fields[3 + k][j] = r->along_x[k];
            out->fields[6 + k][j] = r->along_y[k];
        }
        out->fields[9][j] = r->along_x[3];
        out->fields[10][j] = r->along_y[3];
        out->fields[11][j] = (float)r->flip_x;
        out->fields[12][j] = (float)r->flip_y;
        out->chart[j] = r->chart;
        by_terms(plain->receivers.h + (size_t)i * terms * 3, terms, h + j * terms * 4);
    }
}

static struct bundle_box *upload_receivers(struct plain *plain)
{
    size_t count = plain->receivers.count;
    size_t terms = (size_t)plain->gather->appearance->terms;
    const float *positions = plain->receivers.list[0].position;
    size_t stride = sizeof *plain->receivers.list / sizeof(float);
    plain->bundle_count = (count + LANES - 1) / LANES;
    plain->order = allocate(count * sizeof *plain->order);
    struct bundle_box *boxes = allocate(plain->bundle_count * sizeof *boxes);
    struct plain_bundle *bundles = allocate(plain->bundle_count * sizeof *bundles);
    float *h = allocate(plain->bundle_count * LANES * terms * 4 * sizeof *h);
    for (size_t i = 0; i < count; i++) {
        plain->order[i] = (uint32_t)i;
    }
    halves_sort(positions, stride, plain->order, count, LANES);
    for (size_t i = 0; i < plain->bundle_count; i++) {
        size_t size = count - i * LANES < LANES ? count - i * LANES : LANES;
        boxes[i] = bundles_box(positions, stride, plain->order + i * LANES, size);
        fill_bundle(plain, i, &bundles[i], h + i * LANES * terms * 4);
    }
    upload(plain, BUNDLES, bundles, plain->bundle_count * sizeof *bundles);
    upload(plain, H, h, plain->bundle_count * LANES * terms * 4 * sizeof *h);
    upload(plain, OUT, NULL, plain->bundle_count * LANES * 4 * sizeof(float));
    free(bundles);
    free(h);
    return boxes;
}

/* Within a leaf, samples of one kernel follow each other. Insertion sort, as leaves are short. */
static void sort_by_kernel(const struct gather *gather, uint32_t *order, size_t count)
{
    const struct light_sample *list = gather->samples->list;
    const uint32_t *ids = gather->appearance->ids;
    for (size_t i = 1; i < count; i++) {
        uint32_t moved = order[i];
        size_t j = i;
        for (; j > 0 && ids[list[order[j - 1]].texel] > ids[list[moved].texel]; j--) {
            order[j] = order[j - 1];
        }
        order[j] = moved;
    }
}

/* Samples in leaves of 64 neighbours; returns the leaves' boxes. */
static struct bundle_box *upload_samples(struct plain *plain, size_t *leaf_count)
{
    const struct light_samples *samples = plain->gather->samples;
    size_t stride = sizeof *samples->list / sizeof(float), lit = 0;
    uint32_t *order = allocate((samples->count + 1) * sizeof *order);
    for (size_t i = 0; i < samples->count; i++) {
        const float *flux = samples->list[i].flux;
        if (flux[0] + flux[1] + flux[2] > 0) {
            order[lit++] = (uint32_t)i;
        }
    }
    halves_sort(samples->list[0].position, stride, order, lit, LEAF);
    *leaf_count = (lit + LEAF - 1) / LEAF;
    for (size_t i = 0; i < *leaf_count; i++) {
        size_t left = lit - i * LEAF;
        sort_by_kernel(plain->gather, order + i * LEAF, left < LEAF ? left : LEAF);
    }
    struct plain_sample *list = allocate((lit + 1) * sizeof *list);
    struct bundle_box *boxes = allocate((*leaf_count + 1) * sizeof *boxes);
    uint32_t *starts = allocate((*leaf_count + 1) * sizeof *starts);
    for (size_t i = 0; i < lit; i++) {
        const struct light_sample *from = &samples->list[order[i]];
        list[i] = (struct plain_sample){
            .x = from->x, .y = from->y, .chart = from->chart, .texel = from->texel};
        memcpy(list[i].position, from->position, sizeof from->position);
        memcpy(list[i].flux, from->flux, sizeof from->flux);
    }
    for (size_t i = 0; i < *leaf_count; i++) {
        size_t begin = i * LEAF, end = begin + LEAF < lit ? begin + LEAF : lit;
        boxes[i] = bundles_box(samples->list[0].position, stride, order + begin, end - begin);
        starts[i] = (uint32_t)begin;
        starts[i + 1] = (uint32_t)end;
    }
    upload(plain, SAMPLES, list, lit * sizeof *list);
    upload(plain, LEAF_STARTS, starts, (*leaf_count + 1) * sizeof *starts);
    free(order);
    free(list);
    free(starts);
    return boxes;
}

static void upload_lists(struct plain *plain, const struct bundle_box *to,
                         const struct bundle_box *leaves, size_t leaf_count, size_t every)
{
    const struct gather *gather = plain->gather;
    double half = gather->appearance->window / 2 + 1; /* NOLINT: K is odd */
    double reach = half * sqrt(2) * gather->mapping->point_mm;
    size_t count = 0, capacity = 4096;
    uint32_t *lists = allocate(capacity * sizeof *lists);
    uint32_t *starts = allocate((plain->bundle_count + 1) * sizeof *starts);
    for (size_t i = 0; i < plain->bundle_count; i++) {
        for (size_t j = 0; i % every == 0 && j < leaf_count; j++) {
            if (bundles_gap(&to[i], &leaves[j]) >= reach) {
                continue;
            }
            if (count == capacity) {
                capacity *= 2;
                lists = realloc(lists, capacity * sizeof *lists);
                if (!lists) {
                    fail("no memory");
                }
            }
            lists[count++] = (uint32_t)j;
        }
        starts[i + 1] = (uint32_t)count;
    }
    upload(plain, LIST_STARTS, starts, (plain->bundle_count + 1) * sizeof *starts);
    upload(plain, LISTS, lists, count * sizeof *lists);
    free(lists);
    free(starts);
}

static void launch(const struct plain *plain)
{
    for (size_t first = 0; first < plain->bundle_count; first += ITEMS_A_LAUNCH) {
        size_t left = plain->bundle_count - first;
        size_t size = left < ITEMS_A_LAUNCH ? left : ITEMS_A_LAUNCH, one = 1;
        cl_uint offset = (cl_uint)first;
        check(plain, clSetKernelArg(plain->kernel, 0, sizeof offset, &offset),
              "cannot set an argument");
        check(plain,
              clEnqueueNDRangeKernel(plain->opencl->queue, plain->kernel, 1, NULL, &size, &one, 0,
                                     NULL, NULL),
              "cannot gather");
    }
    check(plain, clFinish(plain->opencl->queue), "cannot gather");
}

static void download(const struct plain *plain, size_t every, float (*radiosity)[3], bool *done)
{
    size_t count = plain->bundle_count * LANES;
    float(*sums)[4] = allocate(count * sizeof *sums);
    check(plain,
          clEnqueueReadBuffer(plain->opencl->queue, plain->buffers[OUT], CL_TRUE, 0,
                              count * sizeof *sums, sums, 0, NULL, NULL),
          "cannot read the light");
    for (size_t i = 0; i < plain->receivers.count; i++) {
        uint32_t vertex = plain->receivers.vertices[plain->order[i]];
        for (int c = 0; i / LANES % every == 0 && c < 3; c++) {
            radiosity[vertex][c] += sums[i][c];
            done[vertex] = true;
        }
    }
    free(sums);
}

double plain_gather(const struct gather *gather, const struct opencl *opencl, size_t every,
                    float (*radiosity)[3], bool *done)
{
    struct plain plain = {.gather = gather, .opencl = opencl};
    size_t leaf_count;
    build(&plain);
    struct moment start = timing_now();
    if (receivers_make(&plain.receivers, gather->mesh, gather->mapping, gather->appearance,
                       &error) != NACRE_OK) {
        fail(error.text);
    }
    struct bundle_box *to = upload_receivers(&plain);
    struct bundle_box *leaves = upload_samples(&plain, &leaf_count);
    upload_lists(&plain, to, leaves, leaf_count, every);
    upload_material(&plain);
    double seconds = timing_since(start).processor;
    start = timing_now();
    launch(&plain);
    seconds += timing_since(start).processor * (double)every;
    download(&plain, every, radiosity, done);
    for (int i = 0; i < BUFFERS; i++) {
        (void)clReleaseMemObject(plain.buffers[i]);
    }
    (void)clReleaseKernel(plain.kernel);
    (void)clReleaseProgram(plain.program);
    receivers_finish(&plain.receivers);
    free(plain.order);
    free(to);
    free(leaves);
    return seconds;
}
