/* k-means clustering. */
#include "factor/kmeans.h"

#include "factor/random.h"

#include <float.h>
#include <math.h>
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

    /* Bounds of distances (Hamerly 2010), which spare most of them once the centres move little. */
    float *above;  /* [count]: the own centre is not farther */
    float *below;  /* [count]: the other centres are not nearer */
    float *before; /* [clusters][length]: centres before they were moved */
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

/* Squared distances to the nearest of the centres so far and vector `candidate`. Returns their sum. */
static double add_candidate(const struct state *s, size_t candidate, float *distances)
{
    const float *centre = s->vectors + candidate * s->length;
    double total = 0;
#pragma omp parallel for
    for (size_t i = 0; i < s->count; i++) {
        float d = squared_distance(s->vectors + i * s->length, centre, s->length);
        distances[i] = d < s->distances[i] ? d : s->distances[i];
    }
    for (size_t i = 0; i < s->count; i++) {
        total += (double)distances[i];
    }
    return total;
}

/* k-means++ (Arthur and Vassilvitskii 2007), greedy: of a few vectors drawn far from the centres so far, the one that
 * leaves the least distance becomes the next. work: 2 x count. */
static void seed_centres(struct state *s, uint64_t seed, float *work)
{
    uint64_t drawn = 1;
    int candidates = 2;
    for (size_t k = s->clusters; k > 2; k /= 2) {
        candidates++;
    }
    for (size_t i = 0; i < s->count; i++) {
        s->distances[i] = FLT_MAX;
    }
    for (size_t k = 0; k < s->clusters; k++) {
        float *trial = work, *best = work + s->count;
        double least = INFINITY;
        for (int i = 0; i < (k == 0 ? 1 : candidates); i++) {
            size_t candidate = k == 0 ? (size_t)(random_bits(seed, 0) % s->count)
                                      : draw(s, random_uniform(seed, drawn++));
            double total = add_candidate(s, candidate, trial);
            if (total < least) {
                float *swap = best;
                best = trial;
                trial = swap;
                least = total;
                set_centre(s, k, candidate);
            }
        }
        memcpy(s->distances, best, s->count * sizeof *best);
    }
}

/* Room for the roundings of distances and of sums of bounds. */
#define SLACK 1e-4F

/* Find a vector's nearest centre, of equals the first, and its bounds. Returns whether it is another. */
static bool find_nearest(struct state *s, size_t i)
{
    const float *vector = s->vectors + i * s->length;
    uint32_t nearest = 0;
    float least = FLT_MAX, second = FLT_MAX;
    for (size_t k = 0; k < s->clusters; k++) {
        float d = squared_distance(vector, s->centres + k * s->length, s->length);
        if (d < least) {
            second = least;
            least = d;
            nearest = (uint32_t)k;
        } else if (d < second) {
            second = d;
        }
    }
    bool changed = s->labels[i] != nearest;
    s->labels[i] = nearest;
    s->distances[i] = least;
    s->above[i] = sqrtf(least) * (1 + SLACK);
    s->below[i] = sqrtf(second) * (1 - SLACK);
    return changed;
}

/* Give each vector to the nearest centre. Returns whether any changed. */
static bool assign(struct state *s)
{
    int changed = 0;
#pragma omp parallel for schedule(static) reduction(| : changed)
    for (size_t i = 0; i < s->count; i++) {
        if (s->above[i] < s->below[i]) {
            continue;
        }
        s->distances[i] = squared_distance(s->vectors + i * s->length,
                                           s->centres + s->labels[i] * s->length, s->length);
        s->above[i] = sqrtf(s->distances[i]) * (1 + SLACK);
        if (s->above[i] >= s->below[i]) {
            changed |= find_nearest(s, i);
        }
    }
    memset(s->sizes, 0, s->clusters * sizeof *s->sizes);
    for (size_t i = 0; i < s->count; i++) {
        s->sizes[s->labels[i]]++;
    }
    return changed;
}

/* The centres have moved: bounds follow. */
static void loosen(struct state *s, const float *moves)
{
    float farthest = 0;
    for (size_t k = 0; k < s->clusters; k++) {
        farthest = moves[k] > farthest ? moves[k] : farthest;
    }
    for (size_t i = 0; i < s->count; i++) {
        s->above[i] += moves[s->labels[i]];
        s->below[i] -= farthest;
    }
}

static void measure_distances(struct state *s)
{
#pragma omp parallel for
    for (size_t i = 0; i < s->count; i++) {
        s->distances[i] = squared_distance(s->vectors + i * s->length,
                                           s->centres + s->labels[i] * s->length, s->length);
    }
}

/* Move the vector farthest from its centre into each empty cluster. */
static void refill(struct state *s)
{
    bool measured = false;
    for (size_t k = 0; k < s->clusters; k++) {
        size_t farthest = 0;
        if (s->sizes[k] > 0) {
            continue;
        }
        if (!measured) {
            measure_distances(s);
            measured = true;
        }
        for (size_t i = 1; i < s->count; i++) {
            farthest = s->distances[i] > s->distances[farthest] ? i : farthest;
        }
        if (s->distances[farthest] > 0) {
            s->sizes[s->labels[farthest]]--;
            s->labels[farthest] = (uint32_t)k;
            s->sizes[k] = 1;
            s->distances[farthest] = 0;
            s->below[farthest] = 0; /* nothing is known of it now */
        }
    }
}

/* Move each centre to the mean of its vectors, summed in order; an empty cluster keeps its centre. moves: [clusters] */
static void move_centres(struct state *s, float *moves)
{
    memcpy(s->before, s->centres, s->clusters * s->length * sizeof *s->centres);
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
        moves[k] = (1 + SLACK) * sqrtf(squared_distance(s->before + k * s->length,
                                                        s->centres + k * s->length, s->length));
    }
    loosen(s, moves);
}

int kmeans(const float *vectors, size_t count, size_t length, int clusters, uint64_t seed,
           uint32_t *labels, struct nacre_error *error)
{
    size_t k = (size_t)clusters;
    struct state s = {
        .vectors = vectors, .count = count, .length = length, .clusters = k, .labels = labels};
    float *work = calloc(2 * count + k, sizeof *work);
    int status = NACRE_FAILED;
    s.centres = calloc(k * length + 1, sizeof *s.centres);
    s.sums = calloc(k * length + 1, sizeof *s.sums);
    s.sizes = calloc(k, sizeof *s.sizes);
    s.distances = calloc(count, sizeof *s.distances);
    s.above = calloc(count, sizeof *s.above);
    s.below = calloc(count, sizeof *s.below);
    s.before = calloc(k * length + 1, sizeof *s.before);
    if (!s.centres || !s.sums || !s.sizes || !s.distances || !work || !s.above || !s.below ||
        !s.before) {
        status = nacre_fail_memory(error, "the clusters");
        goto out;
    }
    memset(labels, 0, count * sizeof *labels);
    seed_centres(&s, seed, work);
    (void)assign(&s);
    for (int i = 0; i < ITERATIONS; i++) {
        refill(&s);
        move_centres(&s, work);
        if (!assign(&s)) {
            break;
        }
    }
    refill(&s);
    status = NACRE_OK;
out:
    free(s.centres);
    free(s.sums);
    free(s.sizes);
    free(s.distances);
    free(s.above);
    free(s.below);
    free(s.before);
    free(work);
    return status;
}
