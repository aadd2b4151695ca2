/* The program of tests that share one OpenCL device. */
#ifndef TESTS_FACTOR_DEVICE_H
#define TESTS_FACTOR_DEVICE_H

#include "base/opencl.h"

/* Open a device, run what `tests` names and close it again: the result of main, 1 with the reason where there is no device.
 * `file` is __FILE__. */
int device_tests(const char *file, struct opencl *opencl, void (*tests)(void));

#endif
