/* Defocus as a sum over neighbours. */
#include "rig/virtual/spread.h"

#include <math.h>
#include <stdlib.h>

/* Places in a pixel and in the disc, along a side, whose distances make the weights. */
enum { SQUARE = 8, DISC = 24 };

/* Add the disc around a place of the centre pixel to the weights of the points that it falls on. */
static void add_disc(const struct spread *spread, double diameter, double x, double y, double *sums)
{
    int side = 2 * spread->radius + 1;
    for (int i = 0; i < DISC * DISC; i++) {
        double dx = (i % DISC + 0.5) / DISC - 0.5;
        double dy = (i / DISC + 0.5) / DISC - 0.5; // NOLINT(bugprone-integer-division): the row
        if (dx * dx + dy * dy <= 0.25) {
            int column = (int)floor(x + dx * diameter) + spread->radius;
            int row = (int)floor(y + dy * diameter) + spread->radius;
            sums[row * side + column]++;
        }
    }
}

int spread_init(double diameter_points, struct spread *spread, struct nacre_error *error)
{
    int status = NACRE_OK;
    double total = 0;
    spread->radius = (int)ceil(0.5 * diameter_points);
    size_t side = 2 * (size_t)spread->radius + 1;
    double *sums = calloc(side * side, sizeof *sums);
    spread->weights = calloc(side * side, sizeof *spread->weights);
    if (!sums || !spread->weights) {
        status = nacre_fail_memory(error, "the virtual projector");
        goto out;
    }
    for (int i = 0; i < SQUARE * SQUARE; i++) {
        add_disc(spread, diameter_points, (i % SQUARE + 0.5) / SQUARE,
                 (i / SQUARE + 0.5) / SQUARE, // NOLINT(bugprone-integer-division): the row
                 sums);
    }
    for (size_t i = 0; i < side * side; i++) {
        total += sums[i];
    }
    /* Places on the very edge of two points were counted for one of them: make both sides alike. */
    for (size_t i = 0; i < side * side; i++) {
        spread->weights[i] = (float)(0.5 * (sums[i] + sums[side * side - 1 - i]) / total);
    }
out:
    free(sums);
    return status;
}

void spread_finish(struct spread *spread)
{
    free(spread->weights);
    *spread = (struct spread){0};
}

static void add_row(const float *in, float weight, int shift, int width, float *out)
{
    int first = shift < 0 ? -shift : 0;
    int end = shift > 0 ? width - shift : width;
    for (int x = first; x < end; x++) {
        out[x] += weight * in[x + shift];
    }
}

void spread_apply(const struct spread *spread, int width, int height, const float *in, float *out)
{
    int radius = spread->radius;
    const float *weights = spread->weights;
    for (size_t i = 0; i < (size_t)width * (size_t)height; i++) {
        out[i] = 0;
    }
    for (int dy = -radius; dy <= radius; dy++) {
        for (int dx = -radius; dx <= radius; dx++) {
            float weight = *weights++;
            for (int y = dy < 0 ? -dy : 0; y < height && y + dy < height; y++) {
                add_row(in + (size_t)(y + dy) * (size_t)width, weight, dx, width,
                        out + (size_t)y * (size_t)width);
            }
        }
    }
}
