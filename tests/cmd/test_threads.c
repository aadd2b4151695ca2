/* What is simulated is the same, byte for byte, whatever the number of threads, and another for another seed. */
#include "tests/cmd/frames.h"
#include "tests/cmd/spawn.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static char *folder;

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
}

/* Of OpenMP in this program's own loops and of PoCL's device. */
static void set_threads(const char *count)
{
    TEST_ASSERT_EQUAL_INT(0, setenv("OMP_NUM_THREADS", count, 1));
    TEST_ASSERT_EQUAL_INT(0, setenv("POCL_MAX_PTHREAD_COUNT", count, 1));
}

static void write_into(const char *name, const char *text)
{
    char *path = path_join(folder, name);
    text_write(path, text);
    free(path);
}

/* The bytes of a scan by that solver; heap. */
static uint8_t *simulate(const char *tolerance, const char *seed, const char *solver, size_t *size)
{
    char *sample = path_join(folder, "sample.yaml");
    char *output = path_join(folder, "scan.exr");
    const char *const arguments[] = {NACRE,
                                     "simulate",
                                     sample,
                                     "-w",
                                     "3",
                                     "-o",
                                     output,
                                     "--seed",
                                     seed,
                                     "--quiet",
                                     tolerance ? "--tolerance" : NULL,
                                     tolerance,
                                     NULL};
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.output, solver), run.output);
    uint8_t *bytes = file_read(output, size);
    TEST_ASSERT_NOT_NULL(bytes);
    spawned_finish(&run);
    free(sample);
    free(output);
    return bytes;
}

static void expect_same_scans(const char *tolerance, const char *solver)
{
    size_t sizes[2];
    uint8_t *scans[2];
    for (int i = 0; i < 2; i++) {
        set_threads(i == 0 ? "1" : "3");
        scans[i] = simulate(tolerance, "1", solver, &sizes[i]);
    }
    TEST_ASSERT_TRUE(sizes[0] == sizes[1]);
    TEST_ASSERT_EQUAL_MEMORY(scans[0], scans[1], sizes[0]);
    free(scans[0]);
    free(scans[1]);
}

static const char even[] =
    "{width: %d, height: 3, pitch_mm: 0.5, thickness_mm: 2, margin_points: 30,\n"
    " base: light, materials: [{name: light, scattering_per_mm: [2.4, 2.3, 2.1],\n"
    "                           absorption_per_mm: [0.2, 0.3, 0.6]}]";

static void write_sample(int width, const char *more)
{
    char text[1024];
    int length = snprintf(text, sizeof text, even, width);
    TEST_ASSERT_TRUE(length > 0 && length < (int)sizeof text);
    (void)snprintf(text + length, sizeof text - (size_t)length, "%s}\n", more);
    write_into("sample.yaml", text);
}

static void scans_of_each_solver_do_not_depend_on_threads(void)
{
    size_t sizes[2];
    /* So many points that the closed form, which is the same for all, is the cheapest. */
    write_sample(200, "");
    expect_same_scans(NULL, "closed form");
    write_sample(2, ",\n inclusions: [{material: light, bands: {period_mm: 1}}]");
    expect_same_scans(NULL, "diffusion");
    /* Less than what diffusion can hold. */
    expect_same_scans("0.05", "Monte Carlo");
    uint8_t *first = simulate("0.05", "1", "Monte Carlo", &sizes[0]);
    uint8_t *second = simulate("0.05", "2", "Monte Carlo", &sizes[1]);
    TEST_ASSERT_TRUE(sizes[0] != sizes[1] || memcmp(first, second, sizes[0]) != 0);
    free(first);
    free(second);
}

/* So many pixels that their noise is made by several threads. */
static void sessions_do_not_depend_on_threads(void)
{
    char *station = path_join(folder, "station.yaml");
    char *sessions[2] = {path_join(folder, "one"), path_join(folder, "three")};
    write_sample(6, ",\n surface: {roughness: 0.3}");
    write_into("plan.yaml",
               "{seed: 5, black_frames: 1, white_frames: 1, dot_spacing: 3, dot_shift: 3,\n"
               " dot_size: 1, grid_spacing: 3, window: 3, exposure_turns: [1, 8]}\n");
    write_into("station.yaml",
               "sample: {width: 6, height: 3, pitch_mm: 0.5}\n"
               "camera: {driver: virtual, width: 640, height: 420, bits: 10, bayer: RGGB,\n"
               "         pedestal: 16, read_noise: 0.7, electrons: 15}\n"
               "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\n"
               "plan: plan.yaml\n"
               "virtual:\n  sample: sample.yaml\n  seed: 11\n"
               "  projector: {contrast: 2000, lamp: {drift: 0.05, drift_hours: 0.01}}\n"
               "  camera: {pixels_per_point: 100, dark_per_s: 0.4, hot_pixels: 0.001,\n"
               "           hot_per_s: 40}\n");
    for (int i = 0; i < 2; i++) {
        set_threads(i == 0 ? "1" : "3");
        const char *const arguments[] = {NACRE,   "scan",    sessions[i], "--station",
                                         station, "--quiet", NULL};
        struct spawned run = spawn(arguments, NULL);
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
        spawned_finish(&run);
    }
    frames_expect_same(sessions[0], sessions[1]);
    free(station);
    free(sessions[0]);
    free(sessions[1]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(scans_of_each_solver_do_not_depend_on_threads);
    RUN_TEST(sessions_do_not_depend_on_threads);
    return UNITY_END();
}
