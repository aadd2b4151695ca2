/* k-means: separation, determinism, empty clusters, more clusters than different vectors. */
#include "factor/kmeans.h"

#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

/* As in omp.h, which not every compiler has. */
extern int omp_get_max_threads(void);
extern void omp_set_num_threads(int threads);

enum { COUNT = 600, LENGTH = 7 };

void setUp(void)
{
}

void tearDown(void)
{
}

static void cluster(const float *vectors, size_t count, size_t length, int clusters, uint64_t seed,
                    uint32_t *labels)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_MESSAGE(
        NACRE_OK, kmeans(vectors, count, length, clusters, seed, labels, &error), error.text);
}

static size_t count_used(const uint32_t *labels, size_t count, int clusters)
{
    size_t used = 0;
    for (uint32_t k = 0; k < (uint32_t)clusters; k++) {
        size_t i = 0;
        while (i < count && labels[i] != k) {
            i++;
        }
        used += i < count;
    }
    return used;
}

/* Clouds of spread 0.1 around points that are 1 apart: vector i belongs to cloud i % clouds. */
static float *make_clouds(size_t clouds)
{
    float *vectors = malloc((size_t)COUNT * LENGTH * sizeof *vectors);
    TEST_ASSERT_NOT_NULL(vectors);
    for (size_t i = 0; i < COUNT; i++) {
        for (size_t j = 0; j < LENGTH; j++) {
            float noise = 0.1F * (float)random_uniform(11, i * LENGTH + j);
            vectors[i * LENGTH + j] = (j == i % clouds ? 1.0F : 0.0F) + noise;
        }
    }
    return vectors;
}

static void separate_clouds_are_found_from_any_seed(void)
{
    float *vectors = make_clouds(5);
    uint32_t labels[COUNT];
    for (uint64_t seed = 0; seed < 20; seed++) {
        cluster(vectors, COUNT, LENGTH, 5, seed, labels);
        for (size_t i = 5; i < COUNT; i++) {
            TEST_ASSERT_EQUAL_UINT32(labels[i % 5], labels[i]);
        }
        TEST_ASSERT_EQUAL_UINT64(5, count_used(labels, COUNT, 5));
    }
    free(vectors);
}

static void the_same_seed_gives_the_same_labels_on_any_number_of_threads(void)
{
    float *vectors = make_clouds(1);
    uint32_t one[COUNT], two[COUNT];
    int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    cluster(vectors, COUNT, LENGTH, 9, 4, one);
    omp_set_num_threads(3);
    cluster(vectors, COUNT, LENGTH, 9, 4, two);
    omp_set_num_threads(threads);
    TEST_ASSERT_EQUAL_MEMORY(one, two, sizeof one);
    free(vectors);
}

static void another_seed_may_give_other_labels(void)
{
    float *vectors = make_clouds(1);
    uint32_t one[COUNT], two[COUNT];
    cluster(vectors, COUNT, LENGTH, 9, 4, one);
    cluster(vectors, COUNT, LENGTH, 9, 5, two);
    TEST_ASSERT_TRUE(memcmp(one, two, sizeof one) != 0);
    free(vectors);
}

static void as_many_clusters_as_different_vectors_gives_each_its_own(void)
{
    float *vectors = make_clouds(1);
    uint32_t labels[40];
    cluster(vectors, 40, LENGTH, 40, 2, labels);
    TEST_ASSERT_EQUAL_UINT64(40, count_used(labels, 40, 40));
    free(vectors);
}

static void more_clusters_than_different_vectors_leaves_some_empty(void)
{
    static const float vectors[12][2] = {{0, 0}, {1, 0}, {0, 0}, {1, 0}, {2, 2}, {0, 0},
                                         {2, 2}, {1, 0}, {0, 0}, {1, 0}, {2, 2}, {0, 0}};
    uint32_t labels[12];
    cluster(&vectors[0][0], 12, 2, 10, 1, labels);
    for (size_t i = 0; i < 12; i++) {
        TEST_ASSERT_TRUE(labels[i] < 10);
        for (size_t j = 0; j < 12; j++) {
            int same = vectors[i][0] == vectors[j][0] && vectors[i][1] == vectors[j][1];
            TEST_ASSERT_EQUAL_INT(same, labels[i] == labels[j]);
        }
    }
}

/* Vectors at 0 (many), 10 and 10.5: two centres seeded on the pair far away would leave none near 0, whichever k-means++
 * draws; no cluster may end empty while vectors differ. */
static void no_cluster_stays_empty_while_vectors_differ(void)
{
    float vectors[50];
    uint32_t labels[50];
    for (uint64_t seed = 0; seed < 50; seed++) {
        for (size_t i = 0; i < 50; i++) {
            vectors[i] = i < 45 ? 1e-3F * (float)i : 10 + 0.5F * (float)(i - 45);
        }
        cluster(vectors, 50, 1, 30, seed, labels);
        TEST_ASSERT_EQUAL_UINT64(30, count_used(labels, 50, 30));
    }
}

static void identical_vectors_form_one_cluster(void)
{
    float vectors[20] = {0};
    uint32_t labels[20];
    cluster(vectors, 20, 1, 3, 0, labels);
    TEST_ASSERT_EQUAL_UINT64(1, count_used(labels, 20, 3));
}

static double distance(const float *vector, const double *mean)
{
    double sum = 0;
    for (size_t j = 0; j < LENGTH; j++) {
        sum += ((double)vector[j] - mean[j]) * ((double)vector[j] - mean[j]);
    }
    return sqrt(sum);
}

/* What Lloyd's iterations end with, however few distances they look at: no vector is nearer to another mean, but for the
 * rounding of float distances. */
static void every_vector_ends_nearest_to_its_own_mean(void)
{
    enum { CLUSTERS = 15 };
    float *vectors = malloc((size_t)COUNT * LENGTH * sizeof *vectors);
    uint32_t labels[COUNT];
    double means[CLUSTERS][LENGTH] = {{0}}, sizes[CLUSTERS] = {0};
    TEST_ASSERT_NOT_NULL(vectors);
    for (size_t i = 0; i < (size_t)COUNT * LENGTH; i++) {
        vectors[i] = (float)random_uniform(12, i);
    }
    cluster(vectors, COUNT, LENGTH, CLUSTERS, 3, labels);
    for (size_t i = 0; i < COUNT; i++) {
        sizes[labels[i]]++;
        for (size_t j = 0; j < LENGTH; j++) {
            means[labels[i]][j] += (double)vectors[i * LENGTH + j];
        }
    }
    for (size_t i = 0; i < (size_t)CLUSTERS * LENGTH; i++) {
        means[i / LENGTH][i % LENGTH] /= sizes[i / LENGTH];
    }
    for (size_t i = 0; i < COUNT; i++) {
        double own = distance(vectors + i * LENGTH, means[labels[i]]);
        for (size_t k = 0; k < CLUSTERS; k++) {
            TEST_ASSERT_TRUE(own <= distance(vectors + i * LENGTH, means[k]) * (1 + 1e-6));
        }
    }
    free(vectors);
}

static void a_single_vector_is_a_cluster(void)
{
    float vector[3] = {1, 2, 3};
    uint32_t label = 9;
    cluster(vector, 1, 3, 1, 0, &label);
    TEST_ASSERT_EQUAL_UINT32(0, label);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(separate_clouds_are_found_from_any_seed);
    RUN_TEST(the_same_seed_gives_the_same_labels_on_any_number_of_threads);
    RUN_TEST(another_seed_may_give_other_labels);
    RUN_TEST(as_many_clusters_as_different_vectors_gives_each_its_own);
    RUN_TEST(more_clusters_than_different_vectors_leaves_some_empty);
    RUN_TEST(no_cluster_stays_empty_while_vectors_differ);
    RUN_TEST(identical_vectors_form_one_cluster);
    RUN_TEST(every_vector_ends_nearest_to_its_own_mean);
    RUN_TEST(a_single_vector_is_a_cluster);
    return UNITY_END();
}
