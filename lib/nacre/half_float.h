/* HALFs and rounding to them exactly as OpenEXR does when it stores. */
#ifndef NACRE_HALF_FLOAT_H
#define NACRE_HALF_FLOAT_H

#include <stddef.h>

/* The value that a HALF keeps of `value`: the nearest, ties to even; infinite beyond 65519. */
float half_nearest(float value);

/* The same for an array, in place. */
void half_round(float *values, size_t count);

/* `count` HALFs at any address, in this machine's byte order, as floats. */
void half_unpack(const char *halves, size_t count, float *values);

#endif
