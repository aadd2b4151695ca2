/* Rounding to HALF by the routines that OpenEXR itself is built of. */
#include "half_float.h"

#define IMATH_HALF_NO_LOOKUP_TABLE
#include <Imath/half.h>
#include <string.h>

float half_nearest(float value)
{
    return imath_half_to_float(imath_float_to_half(value));
}

void half_round(float *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        values[i] = half_nearest(values[i]);
    }
}

void half_unpack(const char *halves, size_t count, float *values)
{
    for (size_t i = 0; i < count; i++) {
        imath_half_bits_t bits = 0;
        memcpy(&bits, halves + i * sizeof bits, sizeof bits);
        values[i] = imath_half_to_float(bits);
    }
}
