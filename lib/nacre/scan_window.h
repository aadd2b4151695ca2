/* What reading and writing a scan share. Private to libnacre. */
#ifndef NACRE_SCAN_WINDOW_H
#define NACRE_SCAN_WINDOW_H

#include "nacre/scan.h"

/* Set the entries of the response of (x, y) that lie outside the sample to 0. */
void scan_window_clear_outside(const struct nacre_scan_info *info, int x, int y, float *response);

#endif
