/* The whole way: a virtual station scans a described sample, develop and factor work on its raw frames, and what they
 * make is compared with the sample's exact responses, which they never saw. */
#include "nacre/evaluate.h"
#include "nacre/material.h"
#include "nacre/scan.h"
#include "tests/cmd/spawn.h"
#include "tests/cmd/stations.h"

#include <jansson.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <unity.h>

static char *folder, *scan_path, *exact_path, *material_path;

void setUp(void)
{
}

void tearDown(void)
{
}

#define RUN(...) spawn_or_abort((const char *const[]){NACRE, __VA_ARGS__, NULL})

/* Scan, develop, factor; and the exact responses. */
static void go_the_whole_way(void)
{
    char *station = path_join(folder, "station.yaml");
    char *sample = path_join(folder, "sample.yaml");
    char *session = path_join(folder, "session");
    stations_write(folder);
    RUN("scan", session, "--station", station);
    RUN("develop", session, "-o", scan_path);
    RUN("factor", scan_path, "-o", material_path, "--terms", "6", "--clusters", "3", "--iterations",
        "100");
    RUN("simulate", sample, "-o", exact_path, "--window", STATION_WINDOW_TEXT);
    free(station);
    free(sample);
    free(session);
}

enum { CENTRE = STATION_WINDOW * STATION_WINDOW / 2 };

struct difference {
    double mean, greatest; /* of ||a - exact|| / ||exact|| over surface points */
    double bias;           /* sum of a over sum of exact, less 1 */
};

static float *response_of(const struct nacre_scan *scan, int x, int y)
{
    struct nacre_error error = {""};
    float *response = calloc(nacre_scan_response_size(nacre_scan_info(scan)), sizeof *response);
    TEST_ASSERT_NOT_NULL(response);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_read(scan, x, y, response, &error),
                                  error.text);
    return response;
}

static struct nacre_scan *open_scan(const char *path)
{
    struct nacre_error error = {""};
    struct nacre_scan *scan = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_open(path, &scan, &error), error.text);
    TEST_ASSERT_EQUAL_INT(STATION_WIDTH, nacre_scan_info(scan)->width);
    TEST_ASSERT_EQUAL_INT(STATION_HEIGHT, nacre_scan_info(scan)->height);
    TEST_ASSERT_EQUAL_INT(STATION_WINDOW, nacre_scan_info(scan)->window);
    TEST_ASSERT_EQUAL_INT(3, nacre_scan_info(scan)->channels);
    return scan;
}

struct sums {
    double square, square_exact, total, total_exact;
};

static struct sums compare(const float *response, const float *exact, size_t size, bool with_centre)
{
    struct sums sums = {0};
    for (size_t i = 0; i < size; i++) {
        if (!with_centre && i % (STATION_WINDOW * STATION_WINDOW) == CENTRE) {
            continue;
        }
        double difference = (double)response[i] - (double)exact[i];
        sums.square += difference * difference;
        sums.square_exact += (double)exact[i] * (double)exact[i];
        sums.total += (double)response[i];
        sums.total_exact += (double)exact[i];
    }
    return sums;
}

/* Of the scan, or of the material where it is not NULL, from the exact responses of the points `shift` further in x. */
static struct difference differ(const struct nacre_material *material, bool with_centre, int shift)
{
    struct difference difference = {0};
    struct nacre_scan *scan = open_scan(scan_path);
    struct nacre_scan *exact = open_scan(exact_path);
    size_t size = nacre_scan_response_size(nacre_scan_info(exact));
    double total = 0, total_exact = 0;
    int count = 0;
    for (int y = 0; y < STATION_HEIGHT; y++) {
        for (int x = 0; x + shift < STATION_WIDTH; x++) {
            float *wanted = response_of(exact, x + shift, y);
            float *found = response_of(scan, x, y);
            if (material) {
                nacre_material_response(material, x, y, found);
            }
            struct sums sums = compare(found, wanted, size, with_centre);
            double relative = sqrt(sums.square / sums.square_exact);
            difference.mean += relative;
            difference.greatest = fmax(difference.greatest, relative);
            total += sums.total;
            total_exact += sums.total_exact;
            count++;
            free(wanted);
            free(found);
        }
    }
    difference.mean /= count;
    difference.bias = total / total_exact - 1;
    nacre_scan_close(scan);
    nacre_scan_close(exact);
    return difference;
}

static struct nacre_material read_material(void)
{
    struct nacre_error error = {""};
    struct nacre_material material = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_read(material_path, &material, &error),
                                  error.text);
    return material;
}

/* What may differ: (1) pixels are 1/4 point wide and see the point's border at an angle that changes over the sample,
 * so that some of the bright centre entry, 0.5 % by the Bayer pattern's phase, is taken for a neighbour's and back:
 * 1 % of the norm; (2) light beyond the window, 0.6 % of a response's energy, falls into the windows of the next lit
 * points; (3) noise, 6e-6 an entry: 6e-6 sqrt(363) / 0.28 = 0.04 %. Together 1.7 % if all fell together. What is lost
 * at one point is found at another, so the sum over all has (2) alone. */
static void developed_responses_are_the_exact_ones(void)
{
    struct difference whole = differ(NULL, true, 0);
    TEST_ASSERT_DOUBLE_WITHIN(0.017, 0, whole.mean);
    TEST_ASSERT_DOUBLE_WITHIN(0.04, 0, whole.greatest);
    TEST_ASSERT_DOUBLE_WITHIN(0.006, 0, whole.bias);
}

/* The entries around the centre have a quarter of its norm, so (1) and (2) weigh four times as much. */
static void developed_surroundings_are_the_exact_ones(void)
{
    struct difference around = differ(NULL, false, 0);
    TEST_ASSERT_DOUBLE_WITHIN(0.07, 0, around.mean);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 0, around.bias);
}

/* The bad twin: the comparison notices responses that belong to the next point. */
static void responses_of_the_next_point_would_be_noticed(void)
{
    TEST_ASSERT_TRUE(differ(NULL, true, 1).mean > 2 * 0.017);
    TEST_ASSERT_TRUE(differ(NULL, false, 1).mean > 2 * 0.07);
}

/* By the triangle inequality at each point: ||material - exact|| <= ||material - scan|| + ||scan - exact||. The
 * material tells the first, relative to the scan's norm, which is the exact one's within `greatest`. */
static void the_material_is_as_near_as_scan_and_factors_allow(void)
{
    struct nacre_material material = read_material();
    struct difference developed = differ(NULL, true, 0);
    struct difference factored = differ(&material, true, 0);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 0, material.error_mean);
    TEST_ASSERT_TRUE(factored.mean <=
                     developed.mean + material.error_mean * (1 + developed.greatest));
    TEST_ASSERT_DOUBLE_WITHIN(0.03, 0, factored.mean);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0, factored.bias);
    nacre_material_finish(&material);
}

/* `nacre error` against what is computed here; it prints six digits or more. */
static void the_error_verb_tells_the_same(void)
{
    struct nacre_material material = read_material();
    struct difference factored = differ(&material, true, 0);
    const char *const arguments[] = {NACRE, "error", exact_path, material_path, "--json", NULL};
    struct spawned run = spawn(arguments, NULL);
    json_t *root = json_loads(run.output, 0, NULL);
    double minimum = 0;
    double mean = 0;
    double maximum = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0,
                                  json_unpack(root, "{s:{s:F, s:F, s:F}}", "error", "min", &minimum,
                                              "mean", &mean, "max", &maximum),
                                  run.output);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, factored.mean, mean);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, factored.greatest, maximum);
    TEST_ASSERT_TRUE(minimum > 0 && minimum <= mean);
    json_decref(root);
    spawned_finish(&run);
    nacre_material_finish(&material);
}

int main(void)
{
    folder = folder_make();
    scan_path = path_join(folder, "scan.exr");
    exact_path = path_join(folder, "exact.exr");
    material_path = path_join(folder, "material.exr");
    go_the_whole_way();
    UNITY_BEGIN();
    RUN_TEST(developed_responses_are_the_exact_ones);
    RUN_TEST(developed_surroundings_are_the_exact_ones);
    RUN_TEST(responses_of_the_next_point_would_be_noticed);
    RUN_TEST(the_material_is_as_near_as_scan_and_factors_allow);
    RUN_TEST(the_error_verb_tells_the_same);
    free(scan_path);
    free(exact_path);
    free(material_path);
    folder_remove(folder);
    return UNITY_END();
}
