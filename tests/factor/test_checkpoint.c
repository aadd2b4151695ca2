/* Checkpoints: the file, and runs that go on from it as if they had never stopped. */
#include "bench.h"
#include "device.h"
#include "outcome.h"
#include "paced.h"

#include "factor/checkpoint.h"
#include "tests/files.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

enum { WIDTH = 15, HEIGHT = 12, WINDOW = 9 };

static struct opencl opencl;
static char *folder, *path; /* of the checkpoint */
static struct nacre_error error;

void setUp(void)
{
    error = (struct nacre_error){0};
    folder = folder_make();
    path = path_join(folder, "checkpoint");
}

void tearDown(void)
{
    free(path);
    folder_remove(folder);
}

/* The checkpoint, with a 0 behind it. */
static char *read_all(size_t *size)
{
    char *bytes = (char *)file_read(path, size);
    TEST_ASSERT_NOT_NULL_MESSAGE(bytes, path);
    return bytes;
}

static const char identity[] = "scan: 3 x 4\nterms: 12\n";

static void write_small(void)
{
    struct blob blob = {0};
    for (int i = 0; i < 100; i++) {
        blob_put(&blob, &i, sizeof i);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, checkpoint_write(path, identity, &blob, &error));
    blob_finish(&blob);
}

static void what_was_put_is_got_back(void)
{
    struct blob blob = {0};
    int value = -1;
    write_small();
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, checkpoint_read(path, identity, &blob, &error),
                                  error.text);
    for (int i = 0; i < 100; i++) {
        blob_get(&blob, &value, sizeof value);
        TEST_ASSERT_EQUAL_INT(i, value);
    }
    TEST_ASSERT_EQUAL_UINT64(0, blob_left(&blob));
    TEST_ASSERT_FALSE(blob.failed);
    blob_get(&blob, &value, sizeof value);
    TEST_ASSERT_TRUE(blob.failed);
    blob_finish(&blob);
}

static void no_file_is_no_state(void)
{
    struct blob blob = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, checkpoint_read(path, identity, &blob, &error));
    TEST_ASSERT_EQUAL_UINT64(0, blob.size);
}

static void expect_refused(const char *ours, const char *why)
{
    struct blob blob = {0};
    error = (struct nacre_error){0};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, checkpoint_read(path, ours, &blob, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
    TEST_ASSERT_NULL(blob.bytes);
}

/* Every byte of it: magic, sizes, sum, identity, state. */
static void a_damaged_file_is_refused(void)
{
    size_t size = 0;
    write_small();
    char *bytes = read_all(&size);
    for (size_t i = 0; i < size; i += i < 80 ? 1 : 13) {
        bytes[i] = (char)(bytes[i] ^ 0x10);
        file_write(path, bytes, size);
        /* The rest of the magic's room is filled with zeros and is not looked at. */
        if (i < strlen("nacre checkpoint 1\n") || i >= 24) {
            expect_refused(identity, "checkpoint");
        }
        bytes[i] = (char)(bytes[i] ^ 0x10);
    }
    free(bytes);
}

static void a_file_cut_short_or_too_long_is_refused(void)
{
    size_t size = 0;
    write_small();
    char *bytes = read_all(&size);
    file_write(path, bytes, 10);
    expect_refused(identity, "no checkpoint");
    file_write(path, bytes, size / 2);
    expect_refused(identity, "cut short");
    file_write(path, bytes, size - 1);
    expect_refused(identity, "cut short");
    file_write(path, bytes, size + 1);
    expect_refused(identity, "longer");
    file_write(path, "hello", 5);
    expect_refused(identity, "no checkpoint");
    file_write(path, "", 0);
    expect_refused(identity, "no checkpoint");
    free(bytes);
}

static void another_run_is_refused_by_what_differs(void)
{
    write_small();
    expect_refused("scan: 3 x 4\nterms: 16\n", "there \"terms: 12\", here \"terms: 16\"");
    expect_refused("scan: 3 x 5\nterms: 12\n", "there \"scan: 3 x 4\", here \"scan: 3 x 5\"");
    expect_refused("scan: 3 x 4\n", "there \"terms: 12\", here \"\"");
    expect_refused("scan: 3 x 4\nterms: 12\nmore\n", "here \"more\"");
}

static struct outcome run(const struct sample *sample, const struct factor_options *options)
{
    return outcome_of(sample, options, &opencl, &error);
}

static void check_same(const struct outcome *expected, const struct outcome *actual)
{
    const struct nacre_material *a = &expected->material, *b = &actual->material;
    size_t plane = (size_t)a->width * (size_t)a->height;
    size_t count = plane * (size_t)a->terms * (size_t)a->channels;
    TEST_ASSERT_EQUAL_INT(expected->status, actual->status);
    TEST_ASSERT_EQUAL_INT(a->terms, b->terms);
    TEST_ASSERT_EQUAL_INT(a->clusters, b->clusters);
    TEST_ASSERT_EQUAL_INT(a->iterations, b->iterations);
    TEST_ASSERT_EQUAL_INT(a->pixel, b->pixel);
    TEST_ASSERT_EQUAL_MEMORY(a->f, b->f, count * sizeof *a->f);
    TEST_ASSERT_EQUAL_MEMORY(a->h, b->h, count * sizeof *a->h);
    TEST_ASSERT_EQUAL_MEMORY(a->ids, b->ids, plane * sizeof *a->ids);
    TEST_ASSERT_EQUAL_MEMORY(a->kernels, b->kernels,
                             (size_t)(a->clusters * a->channels * WINDOW * WINDOW) *
                                 sizeof *a->kernels);
    TEST_ASSERT_EQUAL_MEMORY(&a->error_mean, &b->error_mean, sizeof a->error_mean);
    TEST_ASSERT_EQUAL_UINT64(a->history_count, b->history_count);
    TEST_ASSERT_EQUAL_MEMORY(a->history_objective, b->history_objective,
                             a->history_count * sizeof *a->history_objective);
    TEST_ASSERT_EQUAL_INT(expected->summary.search.count, actual->summary.search.count);
}

/* Keep what the checkpoint was before an iteration. */
struct keeping {
    int moments[8];
    int kept;
};

static void kept_path(char *to, size_t size, int i)
{
    (void)snprintf(to, size, "%s/kept-%d", folder, i);
}

static void keep(void *data, int iteration)
{
    struct keeping *keeping = data;
    char to[640];
    size_t size = 0;
    if (keeping->moments[keeping->kept] == iteration) {
        char *bytes = read_all(&size);
        kept_path(to, sizeof to, keeping->kept++);
        file_write(to, bytes, size);
        free(bytes);
    }
}

static struct factor_options simple(struct paced *paced, enum factor_method method)
{
    struct factor_options options = factor_options_default();
    paced_begin(paced, &opencl, method);
    paced_apply(paced, &options);
    options.terms = 3;
    options.clusters = 2;
    options.iterations = 24;
    options.tolerance = 0;
    options.checkpoint = path;
    options.checkpoint_seconds = 0;
    return options;
}

/* Run whole, keeping the checkpoints of some moments; then go on from each. */
static void check_resumes(const struct sample *sample, struct factor_options *options,
                          struct paced *paced, struct keeping *keeping, int count)
{
    paced->before = keep;
    paced->data = keeping;
    struct outcome whole = run(sample, options);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, whole.status, error.text);
    TEST_ASSERT_FALSE(whole.summary.continued);
    TEST_ASSERT_EQUAL_INT_MESSAGE(count, keeping->kept, "the run was over before");
    paced->before = NULL;
    for (int i = 0; i < count; i++) {
        char from[640];
        kept_path(from, sizeof from, i);
        TEST_ASSERT_EQUAL_INT(0, rename(from, path));
        paced->iterations = 0;
        struct outcome again = run(sample, options);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, again.status, error.text);
        TEST_ASSERT_TRUE(again.summary.continued);
        check_same(&whole, &again);
        outcome_finish(&again);
    }
    outcome_finish(&whole);
}

static void runs_of_both_methods_and_weights_continue_bit_for_bit(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 3, WINDOW, 3);
    sample_punch_holes(&sample);
    for (int i = 0; i < 4; i++) {
        struct keeping keeping = {.moments = {1, 2, 7, 24}};
        struct paced paced;
        struct factor_options options = simple(&paced, (enum factor_method)(i % 2));
        options.weight = (enum factor_weight)(i / 2);
        (void)unlink(path);
        check_resumes(&sample, &options, &paced, &keeping, 4);
        TEST_ASSERT_EQUAL_INT(1, paced.iterations); /* the last only had the 24th to do */
    }
    sample_finish(&sample);
}

/* In the first attempt, in later ones of the climb, and after the error was first held. */
static void a_search_continues_bit_for_bit(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 1, WINDOW, 3);
    struct keeping keeping = {.moments = {3, 9, 16, 27, 34}};
    struct paced paced;
    struct factor_options options = simple(&paced, FACTOR_METHOD_HALS);
    options.terms = options.clusters = options.iterations = 0;
    options.tolerance = 3e-3;
    options.error = 0.02;
    check_resumes(&sample, &options, &paced, &keeping, 5);
    sample_finish(&sample);
}

static void a_run_that_is_stopped_writes_its_state_and_the_best_so_far(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 3, WINDOW, 3);
    for (int method = 0; method < 2; method++) {
        struct paced paced;
        struct factor_options options = simple(&paced, (enum factor_method)method);
        (void)unlink(path);
        options.checkpoint = NULL;
        struct outcome whole = run(&sample, &options);
        options.checkpoint = path;
        options.checkpoint_seconds = 1e9;
        paced.iterations = 0;
        paced.cancel_at = 9;
        struct outcome stopped = run(&sample, &options);
        TEST_ASSERT_EQUAL_INT(NACRE_CANCELLED, stopped.status);
        TEST_ASSERT_NOT_NULL(stopped.material.f);
        TEST_ASSERT_EQUAL_INT(8, stopped.material.iterations);
        TEST_ASSERT_EQUAL_STRING("request", stopped.summary.stopped_by);
        TEST_ASSERT_EQUAL_INT(0, access(path, F_OK));
        paced.cancel_at = 0;
        struct outcome again = run(&sample, &options);
        TEST_ASSERT_EQUAL_INT(24, paced.iterations); /* 8 before, 16 after */
        check_same(&whole, &again);
        outcome_finish(&whole);
        outcome_finish(&stopped);
        outcome_finish(&again);
    }
    sample_finish(&sample);
}

static void note_file(void *data, int iteration)
{
    int *first = data;
    if (*first == 0 && access(path, F_OK) == 0) {
        *first = iteration;
    }
}

/* One term takes 1 s an iteration: 3 s each. 10 s have passed before the fifth. */
static void checkpoints_come_when_their_time_has_passed(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 1, WINDOW, 3);
    struct paced paced;
    struct factor_options options = simple(&paced, FACTOR_METHOD_MU);
    int first = 0;
    options.checkpoint_seconds = 10;
    paced.seconds_per_term = 1;
    paced.before = note_file;
    paced.data = &first;
    struct outcome outcome = run(&sample, &options);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, outcome.status);
    TEST_ASSERT_EQUAL_INT(5, first);
    outcome_finish(&outcome);
    sample_finish(&sample);
}

static void expect_run_refused(const struct sample *sample, const struct factor_options *options,
                               const char *why)
{
    struct outcome outcome = run(sample, options);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, outcome.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL(outcome.material.f);
    outcome_finish(&outcome);
}

static void another_scan_and_other_options_are_refused(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 1, WINDOW, 3);
    struct sample smaller = sample_new(WIDTH - 1, HEIGHT, 1, WINDOW, 3);
    struct paced paced;
    struct factor_options options = simple(&paced, FACTOR_METHOD_HALS), other;
    paced.cancel_at = 5;
    struct outcome stopped = run(&sample, &options);
    TEST_ASSERT_EQUAL_INT(NACRE_CANCELLED, stopped.status);
    outcome_finish(&stopped);
    paced.cancel_at = 0;
    other = options;
    other.terms = 4;
    expect_run_refused(&sample, &other, "there \"terms: 3\", here \"terms: 4\"");
    other = options;
    other.seed = 1;
    expect_run_refused(&sample, &other, "here \"seed: 1\"");
    other = options;
    other.error = 0.02;
    expect_run_refused(&sample, &other, "here \"error: 0.02\"");
    expect_run_refused(&smaller, &options, "here \"scan: 14 x 12");
    sample_at(&sample, 5, 5)[40] *= 1.0001F;
    expect_run_refused(&sample, &options, "contents");
    sample_finish(&sample);
    sample_finish(&smaller);
}

/* Sizes and sum are right, but the state is not one: its head says that there is a best attempt, and nothing follows. */
static void a_state_that_contradicts_itself_is_refused(void)
{
    struct sample sample = sample_new(WIDTH, HEIGHT, 1, WINDOW, 3);
    struct paced paced;
    struct factor_options options = simple(&paced, FACTOR_METHOD_HALS);
    size_t size = 0;
    paced.cancel_at = 5;
    struct outcome stopped = run(&sample, &options);
    outcome_finish(&stopped);
    paced.cancel_at = 0;
    char *bytes = read_all(&size), ours[2048];
    uint64_t identity_size = 0;
    memcpy(&identity_size, bytes + 24, sizeof identity_size);
    TEST_ASSERT_TRUE(identity_size < sizeof ours);
    memcpy(ours, bytes + 48, identity_size);
    ours[identity_size] = '\0';
    for (int cut = 0; cut < 3; cut++) {
        struct blob blob = {0};
        blob_put(&blob, bytes + 48 + identity_size,
                 cut == 0   ? 8
                 : cut == 1 ? (size - 48 - identity_size) / 2
                            : size - 48 - identity_size - 4);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, checkpoint_write(path, ours, &blob, &error));
        blob_finish(&blob);
        expect_run_refused(&sample, &options, "contradict");
    }
    free(bytes);
    sample_finish(&sample);
}

static void tests(void)
{
    RUN_TEST(what_was_put_is_got_back);
    RUN_TEST(no_file_is_no_state);
    RUN_TEST(a_damaged_file_is_refused);
    RUN_TEST(a_file_cut_short_or_too_long_is_refused);
    RUN_TEST(another_run_is_refused_by_what_differs);
    RUN_TEST(runs_of_both_methods_and_weights_continue_bit_for_bit);
    RUN_TEST(a_search_continues_bit_for_bit);
    RUN_TEST(a_run_that_is_stopped_writes_its_state_and_the_best_so_far);
    RUN_TEST(checkpoints_come_when_their_time_has_passed);
    RUN_TEST(another_scan_and_other_options_are_refused);
    RUN_TEST(a_state_that_contradicts_itself_is_refused);
}

int main(void)
{
    return device_tests(__FILE__, &opencl, tests);
}
