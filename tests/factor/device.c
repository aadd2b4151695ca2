/* The program of tests that share one OpenCL device. */
#include "device.h"

#include <stdio.h>
#include <unity.h>

int device_tests(const char *file, struct opencl *opencl, void (*tests)(void))
{
    struct nacre_error error = {0};
    if (opencl_open(NULL, opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "%s\n", error.text);
        return 1;
    }
    UnityBegin(file);
    tests();
    opencl_close(opencl);
    return UnityEnd();
}
