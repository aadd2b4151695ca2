/* How fast frames of a paper's camera are developed, by stages: 1392 x 1040 pixels, 7 exposures a pattern.
 *
 * Processor time, as it depends least on what else the machine does; two cores develop twice as many patterns a second
 * as one, for they share nothing but the writing of responses. The goal is 10 patterns a second on two cores. What
 * reading and decompressing the files alone takes is the ceiling. */
#include "nacre/exr_file.h"
#include "rig/develop/calibrate.h"
#include "rig/develop/develop.h"
#include "rig/sequence.h"
#include "rig/virtual/virtual.h"
#include "tests/files.h"
#include "timing.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

static const double goal = 10; /* patterns a second */

static const char station_text[] =
    "sample: {width: 300, height: 220, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 1392, height: 1040, bits: 10, bayer: RGGB, pedestal: 32,\n"
    "         read_noise: 0.7, electrons: 15}\n"
    "projector: {driver: virtual, wheel_hz: 30}\ntrigger: {driver: virtual}\n"
    "white_reflectance: 0.95\nplan: plan.yaml\n"
    "virtual:\n  projector: {contrast: 2000, vignetting: 0.2}\n"
    "  camera: {elevation_deg: 20, roll_deg: 1.5, pixels_per_point: 4.4, vignetting: 0.15,\n"
    "           full_scale_s: 0.04, response: [0.62, 1, 0.78]}\n";

static const char plan_text[] =
    "black_frames: 2\nwhite_frames: 1\ndot_spacing: 12\ndot_shift: 12\ngrid_spacing: 21\n"
    "grid_patterns: 8\nwindow: 21\nexposure_turns: [1, 2, 4, 8, 16, 32, 60]\n";

static struct nacre_error error;

static void must(int status)
{
    if (status != NACRE_OK) {
        fail(error.text);
    }
}

static int lay(void *context, bool on, struct nacre_error *unused)
{
    (void)unused;
    virtual_station_set_white_layer(context, on);
    return NACRE_OK;
}

/* Measure a white board. */
static void scan(const char *station, const char *path)
{
    struct session session;
    struct sequence_result result;
    struct virtual_station *simulated = NULL;
    must(session_create(path, station, NULL, false, &session, &error));
    must(virtual_station_new(&session.station, &simulated, &error));
    struct devices devices = {virtual_station_camera(simulated),
                              virtual_station_projector(simulated),
                              virtual_station_trigger(simulated), virtual_station_clock(simulated)};
    struct sequence_operator person = {.context = simulated, .white_layer = lay};
    struct sequence_options options = {0};
    options.tolerance_ns = 2000000;
    must(sequence_run(&devices, &session, &person, &options, NULL, &result, &error));
    virtual_station_free(simulated);
    session_finish(&session);
}

/* Processor seconds of all grids by stage. */
struct stages {
    int patterns;
    double unzip, read, merge, points;
    double bytes; /* of the raw frames, 4 a pixel as in the files */
};

static void time_pattern(const struct session *session, struct pattern pattern,
                         const struct calibration *calibration, struct resampler *resampler,
                         struct stages *stages)
{
    const struct station_camera *camera = &session->station.camera;
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    char *path = session_pattern_path(session, pattern);
    float *radiance = allocate(pixels * sizeof *radiance);
    float *variance = allocate(pixels * sizeof *variance);
    float *reflected = allocate(resampler_size(resampler) * sizeof *reflected);
    struct exr_file file;
    struct pattern_frames frames;
    struct moment began = timing_now();
    must(exr_file_read(path, &file, &error));
    stages->unzip += timing_since(began).processor;
    exr_file_finish(&file);
    began = timing_now();
    must(session_read(session, pattern, &frames, &error));
    stages->read += timing_since(began).processor;
    began = timing_now();
    (void)hdr_merge(&frames, &calibration->noise, radiance, variance);
    stages->merge += timing_since(began).processor;
    began = timing_now();
    black_level_subtract(&calibration->black, radiance);
    must(resampler_apply(resampler, radiance, reflected, &error));
    stages->points += timing_since(began).processor;
    stages->bytes += (double)frames.count * (double)pixels * 4;
    stages->patterns++;
    pattern_frames_finish(&frames);
    free(path);
    free(radiance);
    free(variance);
    free(reflected);
}

static struct stages time_grids(const char *path)
{
    struct session session;
    struct calibration calibration = {0};
    struct resampler *resampler = NULL;
    struct stages stages = {0};
    struct visit_progress progress = {NULL, 0, 1};
    must(session_open(path, &session, &error));
    const struct calibrate_options levels = {.black = BLACK_SUBTRACT, .confidence = 0.99};
    must(calibrate(&session, &levels, &progress, &calibration, &error));
    must(resampler_new(&calibration.flat, &calibration.map, session.station.sample.width,
                       session.station.sample.height, DEMOSAIC_FIT, 0, &resampler, &error));
    for (int n = 0; n < plan_pattern_count(&session.plan, PATTERN_GRID); n++) {
        struct pattern pattern = {PATTERN_GRID, n};
        if (session_has(&session, pattern)) {
            time_pattern(&session, pattern, &calibration, resampler, &stages);
        }
    }
    resampler_free(resampler);
    calibration_finish(&calibration);
    session_finish(&session);
    return stages;
}

static bool print_stages(const struct stages *stages)
{
    double count = stages->patterns;
    double whole = stages->read + stages->merge + stages->points;
    (void)printf("%-34s %8s\n", "processor ms a pattern", "ms");
    (void)printf("%-34s %8.1f  %.0f MB/s\n", "  read and decompress (the ceiling)",
                 1e3 * stages->unzip / count, stages->bytes * 1e-6 / stages->unzip);
    (void)printf("%-34s %8.1f\n", "  check and narrow",
                 1e3 * (stages->read - stages->unzip) / count);
    (void)printf("%-34s %8.1f\n", "  merge exposures", 1e3 * stages->merge / count);
    (void)printf("%-34s %8.1f\n", "  black, flat, surface points", 1e3 * stages->points / count);
    (void)printf("%-34s %8.1f  %.2f of the ceiling\n", "  all", 1e3 * whole / count,
                 whole / stages->unzip);
    (void)printf("%-34s %8.1f  goal %g\n", "patterns a second on 2 cores", 2 * count / whole, goal);
    return 2 * count / whole >= goal;
}

int main(void)
{
    char *folder = folder_make();
    struct develop_options options = {.black = BLACK_SUBTRACT,
                                      .confidence = 0.99,
                                      .demosaic = DEMOSAIC_FIT,
                                      .store = NACRE_FLOAT,
                                      .flat = FLAT_SEPARATE};
    struct develop_report report;
    struct rusage usage;
    char *station = path_join(folder, "station.yaml");
    char *plan = path_join(folder, "plan.yaml");
    char *session = path_join(folder, "session");
    char *output = path_join(folder, "scan.exr");
    text_write(station, station_text);
    text_write(plan, plan_text);
    scan(station, session);
    struct stages stages = time_grids(session);
    bool reached = print_stages(&stages);
    struct moment began = timing_now();
    must(develop_session(session, &options, output, NULL, &report, &error));
    struct moment took = timing_since(began);
    (void)getrusage(RUSAGE_SELF, &usage);
    (void)printf(
        "whole session of %d grids: %.1f s, processor %.1f s (white %.1f, black %.1f, dots "
        "%.1f, map %.1f, grids %.1f s); at most %ld MiB\n",
        report.patterns, took.wall, took.processor, report.white_seconds, report.black_seconds,
        report.dots_seconds, report.map_seconds, report.grid_seconds, usage.ru_maxrss / 1024);
    folder_remove(folder);
    free(station);
    free(plan);
    free(session);
    free(output);
    return reached ? EXIT_SUCCESS : EXIT_FAILURE;
}
