/* k-means clustering. */
#include "factor/kmeans.h"

#include "factor/random.h"

#include <float.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { ITERATIONS = 200 };

struct state {
    const float *vectors;
    size_t count, length, clusters;
    float *centres;   /* [clusters][length] */
    double *sums;     /* the same */
    size_t *sizes;    /* [clusters] */
    float *distances; /* [count]: squared, to the own centre */
    uint32_t *labels;
};

static float squared_distance(const float *a, const float *b, size_t length)
{
    float sum = 0;
#pragma omp simd reduction(+ : sum)
    for (size_t i = 0; i < length; i++) {
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    }
    return sum;
}

static void set_centre(struct state *s, size_t cluster, size_t vector)
{
    memcpy(s->centres + cluster * s->length, s->vectors + vector * s->length,
           s->length * sizeof *s->centres);
}

/* A vector drawn with probability in proportion to its squared distance; 0 where all distances are. */
static size_t draw(const struct state *s, double uniform)
{
    double total = 0, passed = 0;
    size_t last = 0;
    for (size_t i = 0; i < s->count; i++) {
        total += (double)s->distances[i];
    }
    for (size_t i = 0; i < s->count; i++) {
        if (s->distances[i] > 0) {
            passed += (double)s->distances[i];
            last = i;
            if (passed >= uniform * total) {
                break;
            }
        }
    }
    return last;
}

/* k-means++ (Arthur and Vassilvitskii 2007): each next centre far from those there are. */
static void seed_centres(struct state *s, uint64_t seed)
{
    size_t first = (size_t)(random_bits(seed, 0) % s->count);
    set_centre(s, 0, first);
    for (size_t i = 0; i < s->count; i++) {
        s->distances[i] = FLT_MAX;
    }
    for (size_t k = 1; k < s->clusters; k++) {
        const float *centre = s->centres + (k - 1) * s->length;
#pragma omp parallel for
        for (size_t i = 0; i < s->count; i++) {
            float d = squared_distance(s->vectors + i * s->length, centre, s->length);
            s->distances[i] = d < s->distances[i] ? d : s->distances[i];
        }
        set_centre(s, k, draw(s, random_uniform(seed, k)));
    }
}

/* Give each vector to the nearest centre, of equals the first. Returns whether any changed. */
static bool assign(struct state *s)
{
    int changed = 0;
#pragma omp parallel for reduction(| : changed)
    for (size_t i = 0; i < s->count; i++) {
        uint32_t nearest = 0;
        float least = FLT_MAX;
        for (size_t k = 0; k < s->clusters; k++) {
            float d =
                squared_distance(s->vectors + i * s->length, s->centres + k * s->length, s->length);
            if (d < least) {
                least = d;
                nearest = (uint32_t)k;
            }
        }
        changed |= s->labels[i] != nearest;
        s->labels[i] = nearest;
        s->distances[i] = least;
    }
    memset(s->sizes, 0, s->clusters * sizeof *s->sizes);
    for (size_t i = 0; i < s->count; i++) {
        s->sizes[s->labels[i]]++;
    }
    return changed;
}

/* Move the vector farthest from its centre into each empty cluster. Returns whether any moved. */
static bool refill(struct state *s)
{
    bool moved = false;
    for (size_t k = 0; k < s->clusters; k++) {
        size_t farthest = 0;
        if (s->sizes[k] > 0) {
            continue;
        }
        for (size_t i = 1; i < s->count; i++) {
            farthest = s->distances[i] > s->distances[farthest] ? i : farthest;
        }
        if (s->distances[farthest] > 0) {
            s->sizes[s->labels[farthest]]--;
            s->labels[farthest] = (uint32_t)k;
            s->sizes[k] = 1;
            s->distances[farthest] = 0;
            moved = true;
        }
    }
    return moved;
}

/* Move each centre to the mean of its vectors, summed in order; an empty cluster keeps its centre. */
static void move_centres(struct state *s)
{
    memset(s->sums, 0, s->clusters * s->length * sizeof *s->sums);
    for (size_t i = 0; i < s->count; i++) {
        double *sum = s->sums + s->labels[i] * s->length;
        for (size_t j = 0; j < s->length; j++) {
            sum[j] += (double)s->vectors[i * s->length + j];
        }
    }
    for (size_t k = 0; k < s->clusters; k++) {
        for (size_t j = 0; s->sizes[k] > 0 && j < s->length; j++) {
            s->centres[k * s->length + j] =
                (float)(s->sums[k * s->length + j] / (double)s->sizes[k]);
        }
    }
}

int kmeans(const float *vectors, size_t count, size_t length, int clusters, uint64_t seed,
           uint32_t *labels, struct nacre_error *error)
{
    size_t k = (size_t)clusters;
    struct state s = {
        .vectors = vectors, .count = count, .length = length, .clusters = k, .labels = labels};
    int status = NACRE_FAILED;
    s.centres = calloc(k * length + 1, sizeof *s.centres);
    s.sums = calloc(k * length + 1, sizeof *s.sums);
    s.sizes = calloc(k, sizeof *s.sizes);
    s.distances = calloc(count, sizeof *s.distances);
    if (!s.centres || !s.sums || !s.sizes || !s.distances) {
        status = nacre_fail_memory(error, "the clusters");
        goto out;
    }
    memset(labels, 0, count * sizeof *labels);
    seed_centres(&s, seed);
    (void)assign(&s);
    for (int i = 0; i < ITERATIONS; i++) {
        (void)refill(&s);
        move_centres(&s);
        if (!assign(&s)) {
            break;
        }
    }
    (void)refill(&s);
    status = NACRE_OK;
out:
    free(s.centres);
    free(s.sums);
    free(s.sizes);
    free(s.distances);
    return status;
}
