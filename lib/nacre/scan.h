/* scan.exr: the measured responses R_d(x_i, x_o) of a planar sample, read and written point by point.
 *
 * Light enters at surface point x_i and leaves at x_o. The response of x_i = (x, y) is a K x K window, K odd, row by
 * row: entry (u, v) is R_d(x_i, x_o) with x_o = (x + u - (K-1)/2, y + v - (K-1)/2). R_d has no unit: pi times the
 * radiance that leaves x_o towards the camera, over the irradiance of a beam that covers x_i alone; divided by pitch^2
 * it is in 1/mm^2. Entries whose x_o lies outside the sample are 0 and are no data. NaN: could not be measured.
 * The file's layout is described in docs/formats.md. */
#ifndef NACRE_SCAN_H
#define NACRE_SCAN_H

#include "nacre/error.h"
#include "nacre/pixel.h"

#include <stdbool.h>
#include <stddef.h>

struct nacre_scan_info {
    int width, height;      /* surface points */
    int window;             /* K, odd */
    int channels;           /* 3 (R, G, B) or 1 (Y) */
    enum nacre_pixel pixel; /* NACRE_HALF or NACRE_FLOAT */
    bool compress;          /* ZIP: pays for HALF only. Ignored when reading */
    double pitch_mm;        /* between neighbouring surface points */
    char source[256];       /* what made it */
};

/* Floats of one response: channels x K x K. */
size_t nacre_scan_response_size(const struct nacre_scan_info *info);

struct nacre_scan;        /* an open scan, for reading */
struct nacre_scan_writer; /* a scan being written */

/* Open a scan. Responses are read on demand, so a scan may be larger than memory. The caller closes it.
 * Refused, with a text that names the file and what is wrong: no EXR, no tiles, tiles that are not K x K with K odd,
 * nacre.format missing or unknown, channels other than R G B or Y, pixel types other than HALF and FLOAT, a pitch
 * that is not positive, an incomplete file. */
int nacre_scan_open(const char *path, struct nacre_scan **scan, struct nacre_error *error);
const struct nacre_scan_info *nacre_scan_info(const struct nacre_scan *scan);
const char *nacre_scan_path(const struct nacre_scan *scan);

/* Read the response of surface point (x, y) into response[channels][K][K]. Several threads may read one scan. */
int nacre_scan_read(const struct nacre_scan *scan, int x, int y, float *response,
                    struct nacre_error *error);
void nacre_scan_close(struct nacre_scan *scan); /* NULL is allowed */

/* Begin a scan that appears at `path` when it is committed. */
int nacre_scan_create(const char *path, const struct nacre_scan_info *info,
                      struct nacre_scan_writer **writer, struct nacre_error *error);

/* Write the response of (x, y), each point at most once, in any order, one thread at a time. Entries outside the
 * sample are stored as 0 whatever they hold. Compressing is put off until several responses wait, and uses all cores;
 * a failure may be that of an earlier point, which the text names. */
int nacre_scan_write(struct nacre_scan_writer *writer, int x, int y, const float *response,
                     struct nacre_error *error);

/* Mark every point that was not written as not measured (NaN), then give the file its name. The writer is gone
 * afterwards, whether this succeeds or not. */
int nacre_scan_commit(struct nacre_scan_writer *writer, struct nacre_error *error);

/* Drop an uncommitted scan; no file is left. NULL is allowed. */
void nacre_scan_discard(struct nacre_scan_writer *writer);

#endif
