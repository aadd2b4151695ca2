/* Adds two vectors, for the test of building and running embedded kernels. */
#ifndef FACTOR
#define FACTOR 1
#endif

kernel void sum(global const float *a, global const float *b, global float *c, const int count)
{
    const int i = get_global_id(0);
    if (i < count) {
        c[i] = a[i] + FACTOR * b[i];
    }
}
