/* Writes the samples of the benchmarks as scans, and compares them with others. */
#include "describe.h"
#include "field.h"
#include "timing.h"

#include "factor/layout.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char usage[] =
    "usage: bench_field candle|marble -o SCAN [--size WIDTH HEIGHT K] [--channels 1|3] [--seed N]\n"
    "       bench_field --describe SCAN ...";

static int describe_scans(char **paths, int count)
{
    struct nacre_error error = {0};
    struct opencl opencl;
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        fail(error.text);
    }
    for (int i = 0; i < count; i++) {
        struct nacre_scan *scan = NULL;
        struct responses responses;
        if (nacre_scan_open(paths[i], &scan, &error) != NACRE_OK ||
            responses_load(&responses, scan, 0, layout_lanes(&opencl), RESPONSES_FLOAT, NULL,
                           &error) != NACRE_OK) {
            fail(error.text);
        }
        describe(paths[i], &responses, &opencl);
        responses_finish(&responses);
        nacre_scan_close(scan);
    }
    opencl_close(&opencl);
    return EXIT_SUCCESS;
}

static int number(const char *text)
{
    int value = (int)strtol(text, NULL, 10);
    if (value < 1) {
        fail(usage);
    }
    return value;
}

int main(int argc, char **argv)
{
    const char *path = NULL;
    int marble = argc > 1 && strcmp(argv[1], "marble") == 0, channels = 1, seed = 1;
    int width = marble ? 277 : 212, height = marble ? 277 : 154, window = marble ? 39 : 49;
    if (argc > 2 && strcmp(argv[1], "--describe") == 0) {
        return describe_scans(argv + 2, argc - 2);
    }
    if (argc < 2 || (!marble && strcmp(argv[1], "candle") != 0)) {
        fail(usage);
    }
    for (int i = 2; i < argc; i++) {
        if (strcmp(argv[i], "-o") == 0 && i + 1 < argc) {
            path = argv[++i];
        } else if (strcmp(argv[i], "--channels") == 0 && i + 1 < argc) {
            channels = number(argv[++i]);
        } else if (strcmp(argv[i], "--seed") == 0 && i + 1 < argc) {
            seed = number(argv[++i]);
        } else if (strcmp(argv[i], "--size") == 0 && i + 3 < argc) {
            width = number(argv[++i]);
            height = number(argv[++i]);
            window = number(argv[++i]);
        } else {
            fail(usage);
        }
    }
    if (!path || (channels != 1 && channels != 3) || window % 2 == 0) {
        fail(usage);
    }
    struct field field = field_new(marble ? FIELD_MARBLE : FIELD_CANDLE, width, height, window,
                                   channels, (uint64_t)seed);
    field_write(&field, path);
    field_finish(&field);
    return EXIT_SUCCESS;
}
