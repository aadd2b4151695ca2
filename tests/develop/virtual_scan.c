/* A virtual station's scan from its files to developed responses. */
#include "virtual_scan.h"

#include "nacre/scan.h"
#include "rig/virtual/sample.h"
#include "rig/virtual/transport.h"
#include "rig/virtual/virtual.h"
#include "tests/files.h"
#include "unity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct nacre_error error;

static void must(int status)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, status, error.text);
}

void virtual_scan_write(const char *folder, const char *name, const char *text)
{
    char *path = path_join(folder, name);
    text_write(path, text);
    free(path);
}

static int lay(void *context, bool on, struct nacre_error *unused)
{
    (void)unused;
    virtual_station_set_white_layer(context, on);
    return NACRE_OK;
}

static int begin(void *context, const struct sequence_moment *moment, struct nacre_error *unused)
{
    (void)unused;
    virtual_station_begin_pattern(context, moment->pattern);
    return NACRE_OK;
}

static void measure(const char *folder, void (*wrap)(void *context, struct devices *),
                    void *context, struct sequence_result *result)
{
    char *path = path_join(folder, "session");
    char *station = path_join(folder, "station.yaml");
    struct session session;
    struct virtual_station *simulated = NULL;
    must(session_create(path, station, NULL, false, &session, &error));
    must(virtual_station_new(&session.station, &simulated, &error));
    struct devices devices = {.camera = virtual_station_camera(simulated),
                              .projector = virtual_station_projector(simulated),
                              .trigger = virtual_station_trigger(simulated),
                              .clock = virtual_station_clock(simulated)};
    if (wrap) {
        wrap(context, &devices);
    }
    struct sequence_operator person = {
        .context = simulated, .white_layer = lay, .pattern_begins = begin};
    struct sequence_options options = {.retries = 20, .tolerance_ns = 2000000};
    must(sequence_run(&devices, &session, &person, &options, NULL, result, &error));
    virtual_station_free(simulated);
    session_finish(&session);
    free(path);
    free(station);
}

void virtual_scan_measure(const char *folder, struct sequence_result *result)
{
    measure(folder, NULL, NULL, result);
}

void virtual_scan_run(const char *folder, struct sequence_result *result,
                      struct develop_report *report)
{
    virtual_scan_run_around(folder, NULL, NULL, result, report);
}

void virtual_scan_run_around(const char *folder, void (*wrap)(void *context, struct devices *),
                             void *context, struct sequence_result *result,
                             struct develop_report *report)
{
    struct develop_options options = {.black = BLACK_SUBTRACT,
                                      .confidence = 0.99,
                                      .demosaic = DEMOSAIC_AUTO,
                                      .store = NACRE_FLOAT,
                                      .flat = FLAT_SEPARATE};
    char *path = path_join(folder, "session");
    char *output = path_join(folder, "scan.exr");
    measure(folder, wrap, context, result);
    must(develop_session(path, &options, output, NULL, report, &error));
    free(path);
    free(output);
}

void virtual_scan_exact(const char *folder, int window)
{
    struct sample sample;
    struct transport *transport = NULL;
    char *path = path_join(folder, "sample.yaml");
    char *output = path_join(folder, "exact.exr");
    must(sample_read(path, &sample, &error));
    must(transport_new(&sample, &transport, &error));
    must(transport_write_scan(transport, window, output, NULL, &error));
    transport_free(transport);
    sample_finish(&sample);
    free(path);
    free(output);
}

float *virtual_scan_load(const char *folder, const char *name)
{
    struct nacre_scan *scan;
    char *path = path_join(folder, name);
    must(nacre_scan_open(path, &scan, &error));
    struct nacre_scan_info info = *nacre_scan_info(scan);
    size_t size = (size_t)info.channels * (size_t)info.window * (size_t)info.window;
    float *all = calloc((size_t)info.width * (size_t)info.height, size * sizeof *all);
    TEST_ASSERT_NOT_NULL(all);
    for (int i = 0; i < info.width * info.height; i++) {
        must(nacre_scan_read(scan, i % info.width, i / info.width, all + (size_t)i * size, &error));
    }
    nacre_scan_close(scan);
    free(path);
    return all;
}

bool virtual_scan_source_names(const char *folder, const char *words)
{
    struct nacre_scan *scan;
    char *path = path_join(folder, "scan.exr");
    must(nacre_scan_open(path, &scan, &error));
    bool found = strstr(nacre_scan_info(scan)->source, words) != NULL;
    nacre_scan_close(scan);
    free(path);
    return found;
}
