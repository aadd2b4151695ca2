/* The sensor of the virtual camera: photo-electrons, noise, pedestal, quantisation, saturation. */
#ifndef RIG_VIRTUAL_SENSOR_H
#define RIG_VIRTUAL_SENSOR_H

#include "rig/station.h"

#include <stddef.h>
#include <stdint.h>

/* One exposure of the sensor. What the camera's `electrons` and `read_noise` say makes the noise; 0 is none. */
struct sensor_exposure {
    const struct station_camera *camera;
    const float *signal; /* of every pixel, raw units a second above the pedestal */
    double seconds;      /* of full light */
    double dark;         /* raw units of dark current over the exposure; 0: none */
    uint64_t key;
};

/* Expose `count` pixels. The noise of a pixel depends on the key and its place alone, so frames are the same for any
 * order and number of threads. */
void sensor_expose(const struct sensor_exposure *exposure, size_t count, uint16_t *raw);

/* Expose a single pixel of them again, with the noise it had. */
void sensor_expose_one(const struct sensor_exposure *exposure, size_t pixel, uint16_t *raw);

/* One step of a hash that spreads keys: SplitMix64's finaliser over both. */
uint64_t sensor_key(uint64_t key, uint64_t value);

/* The value that a standard normal variate stays below with probability p, 1e-10 to 1 - 1e-10. */
double sensor_normal(double p);

/* The Poisson variate of `mean` (0 to 50) at probability p in (0, 1), by inversion. */
double sensor_poisson(double mean, double p);

#endif
