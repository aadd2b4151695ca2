/* A reciprocal sample and what a station may spoil of it. */
#include "flawed.h"

#include "factor/random.h"

#include <math.h>

/* Normal deviate of an entry. */
static double deviate(uint64_t number)
{
    double u = random_uniform(31, 2 * number) + 1e-12, v = random_uniform(31, 2 * number + 1);
    return sqrt(-2 * log(u)) * cos(6.283185307179586 * v);
}

struct sample flawed_sample(int width, int height, int window, struct flaws flaws)
{
    struct sample s = sample_new(width, height, 1, window, 5);
    int half = window / 2, area = window * window;
    for (int i = 0; i < width * height * area; i++) {
        int x = i / area % width, y = i / area / width;
        int dx = i % window - half, dy = i / window % window - half, xo = x + dx, yo = y + dy;
        double albedo = (1 + 0.3 * sin(0.3 * x)) * (1 + 0.3 * sin(0.3 * xo));
        double gain = 1 + flaws.gain * ((double)xo / width - 0.5);
        double value =
            gain * albedo * exp(-hypot(dx - flaws.peak_x, dy - flaws.peak_y) / flaws.length);
        value = fmin(value + flaws.noise * deviate((uint64_t)i), flaws.ceiling);
        s.responses[i] = xo < 0 || xo >= width || yo < 0 || yo >= height ? 0 : (float)value;
    }
    return s;
}
