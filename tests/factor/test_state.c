/* Saving and loading a method's state: what goes on from a saved state is what would have been, bit for bit. */
#include "device.h"
#include "sample.h"

#include "factor/hals.h"
#include "factor/layout.h"
#include "factor/update.h"

#include <stdlib.h>
#include <string.h>
#include <unity.h>

enum { WIDTH = 19, HEIGHT = 13, WINDOW = 11, TERMS = 5, CLUSTERS = 2, POINTS = WIDTH * HEIGHT };

static struct opencl opencl;
static struct sample sample;
static struct responses responses;
static uint32_t ids[POINTS];
static float *kernels;
static struct problem problem;
static struct nacre_error error;

/* Holes, two clusters, and a window wide enough for hals's normal matrices to be made of cells. */
void setUp(void)
{
    size_t area = (size_t)WINDOW * WINDOW;
    error = (struct nacre_error){0};
    sample = sample_new(WIDTH, HEIGHT, 3, WINDOW, 3);
    sample_punch_holes(&sample);
    responses = sample_load(&sample, layout_lanes(&opencl));
    kernels = malloc(CLUSTERS * 3 * area * sizeof *kernels);
    TEST_ASSERT_NOT_NULL(kernels);
    for (size_t i = 0; i < CLUSTERS * 3 * area; i++) {
        int dx = abs((int)(i % WINDOW) - WINDOW / 2),
            dy = abs((int)(i % area / WINDOW) - WINDOW / 2);
        kernels[i] = 1e-3F + 0.3F / (float)(1 + (i / area) % 3 + (size_t)(dx * dx + dy * dy));
    }
    for (size_t i = 0; i < POINTS; i++) {
        ids[i] = (uint32_t)((i / 3) % CLUSTERS);
    }
    problem = (struct problem){.responses = &responses,
                               .ids = ids,
                               .kernels = kernels,
                               .clusters = CLUSTERS,
                               .terms = TERMS,
                               .seed = 7};
}

void tearDown(void)
{
    free(kernels);
    responses_finish(&responses);
    sample_finish(&sample);
}

typedef int maker(struct method **method);

static int make_mu(struct method **method)
{
    return update_new(&opencl, &problem, NULL, method, &error);
}

static int make_hals(struct method **method)
{
    return hals_new(&opencl, &problem, NULL, method, &error);
}

static struct method *make(maker *by)
{
    struct method *method = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, by(&method), error.text);
    return method;
}

/* Step all channels; the last objectives. */
static void step(struct method *method, int count, double objectives[3])
{
    for (int i = 0; i < count; i++) {
        for (int c = 0; c < 3; c++) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(
                NACRE_OK, method->ops->step(method, c, &objectives[c], &error), error.text);
        }
    }
}

static void check_same(struct method *a, struct method *b)
{
    enum { COUNT = TERMS * POINTS };
    float *planes = malloc(4 * COUNT * sizeof *planes);
    TEST_ASSERT_NOT_NULL(planes);
    for (int c = 0; c < 3; c++) {
        TEST_ASSERT_EQUAL_INT(NACRE_OK, a->ops->read(a, c, planes, planes + COUNT, &error));
        TEST_ASSERT_EQUAL_INT(NACRE_OK,
                              b->ops->read(b, c, planes + 2 * COUNT, planes + 3 * COUNT, &error));
        TEST_ASSERT_EQUAL_MEMORY(planes, planes + 2 * COUNT, 2 * COUNT * sizeof *planes);
    }
    free(planes);
}

static void transfer(struct method *from, struct method *to)
{
    size_t size = from->ops->state_size(from, 0);
    char *state = malloc(size);
    TEST_ASSERT_NOT_NULL(state);
    TEST_ASSERT_EQUAL_UINT64(size, to->ops->state_size(to, 0));
    for (int c = 0; c < 3; c++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, from->ops->save(from, c, state, &error),
                                      error.text);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, to->ops->load(to, c, state, &error), error.text);
    }
    free(state);
}

/* Interrupted before the first step, in the middle of things, and where hals has refused steps; the copy has gone
 * elsewhere before, so that nothing of its own may survive. */
static void check_continues(maker *by)
{
    static const int moments[] = {0, 1, 2, 7, 40};
    for (size_t i = 0; i < sizeof moments / sizeof *moments; i++) {
        double expected[3] = {0}, continued[3] = {0}, elsewhere[3] = {0};
        struct method *whole = make(by), *first = make(by), *second = make(by);
        step(whole, moments[i] + 9, expected);
        step(first, moments[i], continued);
        step(second, 3, elsewhere);
        transfer(first, second);
        step(second, 9, continued);
        TEST_ASSERT_EQUAL_MEMORY(expected, continued, sizeof expected);
        check_same(whole, second);
        method_free(whole);
        method_free(first);
        method_free(second);
    }
}

static void multiplicative_updates_continue_bit_for_bit(void)
{
    check_continues(make_mu);
}

static void block_coordinate_descent_continues_bit_for_bit(void)
{
    check_continues(make_hals);
}

/* The comparison above can tell: factors alone are not the state of hals. */
static void factors_alone_do_not_continue_hals(void)
{
    enum { COUNT = TERMS * POINTS };
    double expected[3] = {0}, continued[3] = {0};
    float *planes = malloc(2 * COUNT * sizeof *planes);
    struct method *whole = make(make_hals), *second = make(make_hals);
    TEST_ASSERT_NOT_NULL(planes);
    step(whole, 7, expected);
    for (int c = 0; c < 3; c++) {
        TEST_ASSERT_EQUAL_INT(NACRE_OK, whole->ops->read(whole, c, planes, planes + COUNT, &error));
        TEST_ASSERT_EQUAL_INT(NACRE_OK,
                              second->ops->write(second, c, planes, planes + COUNT, &error));
    }
    step(whole, 9, expected);
    step(second, 9, continued);
    TEST_ASSERT_TRUE(expected[0] != continued[0] || expected[1] != continued[1] ||
                     expected[2] != continued[2]);
    method_free(whole);
    method_free(second);
    free(planes);
}

struct heard {
    int lines;
    char text[4096];
};

static void hear(void *data, const char *key, const char *text)
{
    struct heard *heard = data;
    size_t used = strlen(heard->text);
    (void)snprintf(heard->text + used, sizeof heard->text - used, "%s: %s\n", key, text);
    heard->lines++;
}

static void methods_explain_what_they_chose(void)
{
    maker *const makers[] = {make_mu, make_hals};
    for (int i = 0; i < 2; i++) {
        struct heard heard = {0};
        const struct listener listener = {hear, &heard};
        char lanes[32];
        struct method *method = make(makers[i]);
        (void)snprintf(lanes, sizeof lanes, "%d lanes", responses.lanes);
        method->ops->explain(method, &listener);
        method->ops->explain(method, NULL);
        TEST_ASSERT_TRUE(heard.lines >= 3);
        TEST_ASSERT_NOT_NULL(strstr(heard.text, i == 0 ? "method: mu" : "method: hals"));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(heard.text, lanes), heard.text);
        method_free(method);
    }
}

static void tests(void)
{
    RUN_TEST(multiplicative_updates_continue_bit_for_bit);
    RUN_TEST(block_coordinate_descent_continues_bit_for_bit);
    RUN_TEST(factors_alone_do_not_continue_hals);
    RUN_TEST(methods_explain_what_they_chose);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
