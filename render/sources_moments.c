/* Adding up F U of surface points. */
#include "render/sources_moments.h"

#include <stdlib.h>
#include <string.h>

/* F U of one surface point, times flux[3], added to a moment. */
static void add_texel(const struct appearance *appearance, size_t texel, const float flux[3],
                      float *moment)
{
    size_t terms = (size_t)appearance->terms, planes = (size_t)appearance->factor_channels;
    size_t parts = (size_t)appearance->basis.parts, mixed = (size_t)appearance->mixed;
    const float *f = appearance->f + texel * planes * terms;
    const float *red = f, *green = f + (planes == 3 ? terms : 0), *blue = f + (planes - 1) * terms;
    if (appearance->layout == NACRE_KERNEL_PER_TERM) {
        for (size_t t = 0; t < terms; t++) {
            moment[t * 4] += flux[0] * red[t];
            moment[t * 4 + 1] += flux[1] * green[t];
            moment[t * 4 + 2] += flux[2] * blue[t];
        }
        return;
    }
    for (size_t r = 0; r < parts; r++) {
        float share[3] = {0};
        for (size_t a = 0; a < mixed; a++) {
            size_t place = texel * mixed + a;
            const float *u =
                appearance->basis.share + ((size_t)appearance->ids[place] * parts + r) * 4;
            for (size_t c = 0; c < 3; c++) {
                share[c] += appearance->weights[place] * u[c] * flux[c];
            }
        }
        float *row = moment + r * terms * 4;
        for (size_t t = 0; t < terms; t++) {
            row[t * 4] += share[0] * red[t];
            row[t * 4 + 1] += share[1] * green[t];
            row[t * 4 + 2] += share[2] * blue[t];
        }
    }
}

static float *new_moments(size_t count, size_t size)
{
    size_t bytes = (count * size * sizeof(float) / 64 + 1) * 64;
    float *moments = aligned_alloc(64, bytes);
    if (moments) {
        memset(moments, 0, bytes);
    }
    return moments;
}

enum { BLOCK = 16 };

/* A moment is a whole number of blocks, by which compilers make vectors of it. */
static void add_moment(const float *restrict from, size_t size, float scale, float *restrict to)
{
    for (size_t k = 0; k < size; k += BLOCK) {
        for (size_t j = 0; j < BLOCK; j++) {
            to[k + j] += scale * from[k + j];
        }
    }
}

int moments_sum(struct sources *sources, const struct appearance *appearance, int index,
                const struct lattice *lattice)
{
    size_t size = sources->moment_size;
    float *own = new_moments(1, size), *moments = new_moments(lattice->groups.count, size);
    sources->moments[index] = moments;
    for (size_t i = 0; own && moments && i < lattice->from->count; i++) {
        const float *moment = own;
        if (index > 0) {
            moment = sources->moments[index - 1] + i * size;
        } else {
            memset(own, 0, size * sizeof *own);
            add_texel(appearance, lattice->from->list[i].texel, lattice->from->list[i].flux, own);
        }
        for (size_t k = i * LATTICE_CORNERS; k < (i + 1) * LATTICE_CORNERS; k++) {
            add_moment(moment, size, lattice->shares[k], moments + lattice->links[k] * size);
        }
    }
    bool made = own && moments;
    free(own);
    return made ? 0 : -1;
}

int moments_fill_pyramid(struct sources *sources, const struct appearance *appearance, int index)
{
    const float white[3] = {1, 1, 1};
    size_t side = (size_t)2 << index, size = sources->moment_size;
    size_t width = (size_t)appearance->width, height = (size_t)appearance->height;
    size_t columns = (width + side - 1) / side, rows = (height + side - 1) / side;
    size_t finer = (width + side / 2 - 1) / (side / 2);
    float *pyramid = sources->pyramid[index] = new_moments(columns * rows, size);
    if (!pyramid) {
        return -1;
    }
    for (size_t i = 0; i < columns * rows; i++) {
        size_t x = i % columns * side, y = i / columns * side;
        size_t right = x + side < width ? x + side : width;
        size_t bottom = y + side < height ? y + side : height;
        size_t step = index > 0 ? side / 2 : 1;
        for (size_t v = y; v < bottom; v += step) {
            for (size_t u = x; u < right; u += step) {
                if (index == 0) {
                    add_texel(appearance, v * width + u, white, pyramid + i * size);
                    continue;
                }
                size_t wide = u + step < width ? step : width - u;
                size_t high = v + step < height ? step : height - v;
                add_moment(sources->pyramid[index - 1] + (v / step * finer + u / step) * size, size,
                           (float)(wide * high), pyramid + i * size);
            }
        }
        for (size_t k = 0; k < size; k++) {
            pyramid[i * size + k] /= (float)((right - x) * (bottom - y));
        }
    }
    return 0;
}
