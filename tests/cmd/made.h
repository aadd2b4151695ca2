/* Small inputs that need no station: a scan by formula, and damaged copies of files. */
#ifndef TESTS_CMD_MADE_H
#define TESTS_CMD_MADE_H

#include <stddef.h>

enum { MADE_WIDTH = 20, MADE_HEIGHT = 14, MADE_WINDOW = 7 };

/* The formula: two materials with their border at an angle, exponential fall-off, RGB:
 * R_d(x_i, x_o) = a(x_i) a(x_o) e(distance / length) for x_o inside the sample, else 0. */
float made_response(int channel, int xi, int yi, int xo, int yo);

/* Write it as a scan of MADE_WIDTH x MADE_HEIGHT points and a MADE_WINDOW window. */
void made_scan_write(const char *path);

/* The same with gains left in it: times exp(slope (xi - xo) / MADE_WIDTH). */
void made_gained_scan_write(const char *path, double slope);

/* Copy `source` with the first `size` bytes equal to `from` replaced by as many of `to`. */
void made_patch(const char *source, const char *path, const void *from, const void *to,
                size_t size);

/* Copy the first `fraction` of `source`. */
void made_truncate(const char *source, const char *path, double fraction);

/* Write an EXR of scan lines, no tiles: channels R, G, B. */
void made_untiled_write(const char *path);

#endif
