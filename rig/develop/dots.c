/* Finding the projected dots in a frame, to a small part of a pixel. */
#include "rig/develop/dots.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum {
    MARGIN = 2, /* pixels around the bright part that may hold a rest of the dot */
    RING = 2,   /* width of the frame around that, from which the background is taken */
};

/* A connected bright area. */
struct blob {
    int left, top, right, bottom; /* inclusive */
    size_t area;
};

struct blobs {
    struct blob *list;
    size_t count, capacity;
};

static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a;
    float y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Half of what a pixel inside a dot shows: the value that half the dots' pixels pass, halved. */
static int bright_level(const float *lit, size_t pixels, double share, float *level,
                        struct nacre_error *error)
{
    size_t count = 0;
    float *values = malloc(pixels * sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "the levels of a dots pattern");
    }
    for (size_t i = 0; i < pixels; i++) {
        if (!isnan(lit[i])) {
            values[count++] = lit[i];
        }
    }
    qsort(values, count, sizeof *values, compare_floats);
    size_t rank = count ? (size_t)((double)(count - 1) * (1 - 0.5 * share)) : 0;
    *level = count ? values[rank] / 2 : 0;
    free(values);
    return NACRE_OK;
}

/* Grow the blob from `start` over bright pixels not seen before; 8-connected, so that a dot split by a dead pixel
 * stays one. */
static struct blob grow(const float *lit, float level, int width, int height, size_t start,
                        bool *seen, size_t *stack)
{
    int x0 = (int)(start % (size_t)width);
    int y0 = (int)(start / (size_t)width);
    struct blob blob = {x0, y0, x0, y0, 0};
    size_t depth = 0;
    seen[start] = true;
    stack[depth++] = start;
    while (depth) {
        size_t at = stack[--depth];
        int x = (int)(at % (size_t)width);
        int y = (int)(at / (size_t)width);
        blob.area++;
        blob.left = x < blob.left ? x : blob.left;
        blob.right = x > blob.right ? x : blob.right;
        blob.top = y < blob.top ? y : blob.top;
        blob.bottom = y > blob.bottom ? y : blob.bottom;
        for (int k = 0; k < 9; k++) {
            int nx = x + k % 3 - 1;
            int ny = y + k / 3 - 1;
            size_t next = (size_t)ny * (size_t)width + (size_t)nx;
            if (nx >= 0 && nx < width && ny >= 0 && ny < height && !seen[next] &&
                lit[next] > level) {
                seen[next] = true;
                stack[depth++] = next;
            }
        }
    }
    return blob;
}

static int find_blobs(const float *lit, float level, int width, int height, struct blobs *blobs,
                      struct nacre_error *error)
{
    size_t pixels = (size_t)width * (size_t)height;
    int status = NACRE_OK;
    bool *seen = calloc(pixels, sizeof *seen);
    size_t *stack = malloc(pixels * sizeof *stack);
    if (!seen || !stack) {
        status = nacre_fail_memory(error, "the dots of a pattern");
        goto out;
    }
    for (size_t i = 0; i < pixels; i++) {
        if (lit[i] > level && !seen[i]) {
            if (blobs->count == blobs->capacity) {
                size_t capacity = blobs->capacity ? 2 * blobs->capacity : 64;
                struct blob *list = realloc(blobs->list, capacity * sizeof *list);
                if (!list) {
                    status = nacre_fail_memory(error, "the dots of a pattern");
                    goto out;
                }
                blobs->list = list;
                blobs->capacity = capacity;
            }
            blobs->list[blobs->count++] = grow(lit, level, width, height, i, seen, stack);
        }
    }
out:
    free(seen);
    free(stack);
    return status;
}

/* Background of a blob: the mean over the ring of pixels outside its margin. NaN where the ring leaves the frame or
 * the measured area. */
static double ring_mean(const float *lit, int width, int height, struct blob inner)
{
    double sum = 0;
    size_t count = 0;
    if (inner.left < RING || inner.top < RING || inner.right + RING >= width ||
        inner.bottom + RING >= height) {
        return NAN;
    }
    for (int y = inner.top - RING; y <= inner.bottom + RING; y++) {
        for (int x = inner.left - RING; x <= inner.right + RING; x++) {
            if (x < inner.left || x > inner.right || y < inner.top || y > inner.bottom) {
                sum += lit[(size_t)y * (size_t)width + (size_t)x];
                count++;
            }
        }
    }
    return sum / (double)count;
}

static struct point centroid(const float *lit, int width, int height, const struct blob *blob)
{
    struct blob inner = {blob->left - MARGIN, blob->top - MARGIN, blob->right + MARGIN,
                         blob->bottom + MARGIN, blob->area};
    double background = ring_mean(lit, width, height, inner);
    struct point sum = {0, 0};
    double weight = 0;
    for (int y = inner.top; !isnan(background) && y <= inner.bottom; y++) {
        for (int x = inner.left; x <= inner.right; x++) {
            double above = lit[(size_t)y * (size_t)width + (size_t)x] - background;
            sum.x += above * (x + 0.5);
            sum.y += above * (y + 0.5);
            weight += above;
        }
    }
    return isnan(background) ? (struct point){NAN, NAN}
                             : (struct point){sum.x / weight, sum.y / weight};
}

static int compare_areas(const void *a, const void *b)
{
    size_t x = ((const struct blob *)a)->area;
    size_t y = ((const struct blob *)b)->area;
    return (x > y) - (x < y);
}

static int median_area(const struct blobs *blobs, size_t *area, struct nacre_error *error)
{
    struct blob *sorted = malloc((blobs->count + 1) * sizeof *sorted);
    if (!sorted) {
        return nacre_fail_memory(error, "the dots of a pattern");
    }
    memcpy(sorted, blobs->list, blobs->count * sizeof *sorted);
    qsort(sorted, blobs->count, sizeof *sorted, compare_areas);
    *area = sorted[blobs->count / 2].area;
    free(sorted);
    return NACRE_OK;
}

/* The mean of the pixels around a gap of one or two, NaN where it is no such gap but the border of what is measured. */
static float mean_around(const float *lit, int width, int height, int x, int y)
{
    float sum = 0;
    int count = 0;
    for (int k = 0; k < 9; k++) {
        int nx = x + k % 3 - 1;
        int ny = y + k / 3 - 1;
        if (nx >= 0 && nx < width && ny >= 0 && ny < height) {
            float value = lit[(size_t)ny * (size_t)width + (size_t)nx];
            sum += isnan(value) ? 0 : value;
            count += isnan(value) ? 0 : 1;
        }
    }
    return count >= 5 ? sum / (float)count : NAN;
}

/* A copy without the gaps that lone defect pixels leave: a dot near one would be lost for it. Where the dot is even, and
 * beside it, the copy is right; on its edge the centre moves by a part of what one pixel of the dot weighs. NULL: no
 * memory. */
static float *mend(const float *lit, int width, int height)
{
    size_t pixels = (size_t)width * (size_t)height;
    float *mended = malloc((pixels ? pixels : 1) * sizeof *mended);
    for (size_t i = 0; mended && i < pixels; i++) {
        mended[i] = isnan(lit[i]) ? mean_around(lit, width, height, (int)(i % (size_t)width),
                                                (int)(i / (size_t)width))
                                  : lit[i];
    }
    return mended;
}

int dots_find(const float *lit, int width, int height, double share, struct dots *dots,
              struct nacre_error *error)
{
    struct blobs blobs = {0};
    float level = 0;
    size_t typical = 0;
    int status = NACRE_OK;
    float *mended = mend(lit, width, height);
    *dots = (struct dots){0};
    if (!mended) {
        status = nacre_fail_memory(error, "a dots pattern");
        goto out;
    }
    status = bright_level(mended, (size_t)width * (size_t)height, share, &level, error);
    if (status != NACRE_OK || !(level > 0)) {
        goto out;
    }
    status = find_blobs(mended, level, width, height, &blobs, error);
    if (status != NACRE_OK || blobs.count == 0) {
        goto out;
    }
    status = median_area(&blobs, &typical, error);
    if (status != NACRE_OK) {
        goto out;
    }
    dots->centres = malloc(blobs.count * sizeof *dots->centres);
    if (!dots->centres) {
        status = nacre_fail_memory(error, "the dots of a pattern");
        goto out;
    }
    for (size_t i = 0; i < blobs.count; i++) {
        struct point centre = centroid(mended, width, height, &blobs.list[i]);
        bool usual = 5 * blobs.list[i].area >= 2 * typical && 2 * blobs.list[i].area <= 5 * typical;
        if (usual && !isnan(centre.x) && !isnan(centre.y)) {
            dots->centres[dots->count++] = centre;
        }
    }
out:
    free(mended);
    free(blobs.list);
    return status;
}

void dots_finish(struct dots *dots)
{
    if (dots) {
        free(dots->centres);
        *dots = (struct dots){0};
    }
}
