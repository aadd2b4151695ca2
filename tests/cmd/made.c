/* Small inputs that need no station: a scan by formula, and damaged copies of files. */
#include "tests/cmd/made.h"

#include "nacre/exr_file.h"
#include "nacre/scan.h"
#include "tests/cmd/spawn.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void demand(int status, const struct nacre_error *error)
{
    if (status != NACRE_OK) {
        (void)fprintf(stderr, "%s\n", error->text);
        abort();
    }
}

static float amplitude(int channel, int x, int y)
{
    static const float dark[3] = {0.5F, 0.35F, 0.2F};
    static const float bright[3] = {0.9F, 0.85F, 0.8F};
    return 2 * x + y < MADE_WIDTH + MADE_HEIGHT / 2 ? dark[channel] : bright[channel];
}

float made_response(int channel, int xi, int yi, int xo, int yo)
{
    static const float length[3] = {1.6F, 1.2F, 0.8F}; /* surface points */
    float distance = hypotf((float)(xo - xi), (float)(yo - yi));
    if (xo < 0 || yo < 0 || xo >= MADE_WIDTH || yo >= MADE_HEIGHT) {
        return 0;
    }
    return 0.1F * amplitude(channel, xi, yi) * amplitude(channel, xo, yo) *
           expf(-distance / length[channel]);
}

void made_gained_scan_write(const char *path, double slope)
{
    struct nacre_error error = {""};
    struct nacre_scan_writer *writer = NULL;
    const struct nacre_scan_info info = {.width = MADE_WIDTH,
                                         .height = MADE_HEIGHT,
                                         .window = MADE_WINDOW,
                                         .channels = 3,
                                         .pixel = NACRE_FLOAT,
                                         .pitch_mm = 0.5,
                                         .source = "made by a formula"};
    float response[3][MADE_WINDOW][MADE_WINDOW];
    demand(nacre_scan_create(path, &info, &writer, &error), &error);
    for (int y = 0; y < MADE_HEIGHT; y++) {
        for (int x = 0; x < MADE_WIDTH; x++) {
            for (int c = 0; c < 3; c++) {
                for (int v = 0; v < MADE_WINDOW; v++) {
                    for (int u = 0; u < MADE_WINDOW; u++) {
                        int xo = x + u - MADE_WINDOW / 2, yo = y + v - MADE_WINDOW / 2;
                        response[c][v][u] = (float)exp(slope * (x - xo) / MADE_WIDTH) *
                                            made_response(c, x, y, xo, yo);
                    }
                }
            }
            demand(nacre_scan_write(writer, x, y, &response[0][0][0], &error), &error);
        }
    }
    demand(nacre_scan_commit(writer, &error), &error);
}

void made_scan_write(const char *path)
{
    made_gained_scan_write(path, 0);
}

void made_patch(const char *source, const char *path, const void *from, const void *to, size_t size)
{
    size_t length = 0;
    uint8_t *bytes = file_read(source, &length);
    uint8_t *found = bytes ? memmem(bytes, length, from, size) : NULL;
    if (!found) {
        (void)fprintf(stderr, "%s: nothing to replace\n", source);
        abort();
    }
    memcpy(found, to, size);
    file_write(path, bytes, length);
    free(bytes);
}

void made_truncate(const char *source, const char *path, double fraction)
{
    size_t length = 0;
    uint8_t *bytes = file_read(source, &length);
    file_write(path, bytes, (size_t)(fraction * (double)length));
    free(bytes);
}

void made_untiled_write(const char *path)
{
    static const char *const names[] = {"R", "G", "B"};
    struct nacre_error error = {""};
    struct exr_file file = {0};
    struct exr_part *part = exr_file_add_part(&file, "", 6, 4);
    for (int c = 0; part && c < 3; c++) {
        (void)exr_part_add_plane(part, names[c], NACRE_FLOAT);
    }
    demand(exr_file_write(path, &file, EXR_UNCOMPRESSED, &error), &error);
    exr_file_finish(&file);
}
