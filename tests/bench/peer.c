/* The updates as one would write them in C with OpenMP in an afternoon. */
#include "peer.h"

#include <stdlib.h>
#include <string.h>

enum { TERMS = 64 };

/* One point's sums over its window. */
static void add_pairs(const struct peer *p, bool of_h, int x, int y, float *numerator,
                      float *denominator)
{
    int half = p->window / 2, terms = p->terms;
    const float *own = (of_h ? p->h : p->f) + ((long)y * p->width + x) * terms;
    const float *others = of_h ? p->f : p->h;
    for (int dy = -half; dy <= half; dy++) {
        int oy = of_h ? y - dy : y + dy;
        if (oy < 0 || oy >= p->height) {
            continue;
        }
        for (int dx = -half; dx <= half; dx++) {
            int ox = of_h ? x - dx : x + dx;
            if (ox < 0 || ox >= p->width) {
                continue;
            }
            long lit = of_h ? (long)oy * p->width + ox : (long)y * p->width + x;
            long entry = (long)(dy + half) * p->window + dx + half;
            const float *other = others + ((long)oy * p->width + ox) * terms;
            float response = p->responses[lit * p->window * p->window + entry], product = 0;
            for (int t = 0; t < terms; t++) {
                product += own[t] * other[t];
            }
            product *= p->kernels[p->ids[lit] * p->window * p->window + entry];
            for (int t = 0; t < terms; t++) {
                numerator[t] += response * other[t];
                denominator[t] += product * other[t];
            }
        }
    }
}

void peer_update(struct peer *p, bool of_h)
{
    float *factor = of_h ? p->h : p->f;
#pragma omp parallel for schedule(dynamic)
    for (int y = 0; y < p->height; y++) {
        for (int x = 0; x < p->width; x++) {
            float numerator[TERMS] = {0}, denominator[TERMS] = {0};
            float *own = factor + ((long)y * p->width + x) * p->terms;
            add_pairs(p, of_h, x, y, numerator, denominator);
            for (int t = 0; t < p->terms; t++) {
                own[t] *= numerator[t] / (denominator[t] + 1e-30F);
            }
        }
    }
}
