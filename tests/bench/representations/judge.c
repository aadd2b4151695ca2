/* Comparing modelled with measured responses. */
#include "judge.h"

#include <math.h>

struct errors judge_errors(const struct sample *s, const float *model)
{
    size_t size = sample_response_size(s), area = (size_t)s->window * (size_t)s->window;
    struct errors mean = {0, 0};
    double counted = 0;
    for (size_t i = 0; i < (size_t)s->width * (size_t)s->height; i++) {
        double miss[2] = {0}, norm[2] = {0};
        for (size_t k = 0; k < size; k++) {
            double value = (double)s->measured[i * size + k];
            double apart = value - (double)model[i * size + k];
            bool centre = k % area == area / 2;
            if (!isnan(value)) {
                miss[centre] += apart * apart;
                norm[centre] += value * value;
            }
        }
        if (norm[0] > 0) {
            mean.whole += sqrt((miss[0] + miss[1]) / (norm[0] + norm[1]));
            mean.without_centre += sqrt(miss[0] / norm[0]);
            counted++;
        }
    }
    mean.whole /= fmax(1, counted);
    mean.without_centre /= fmax(1, counted);
    return mean;
}

/* Sums over entries other than x_o = x_i. */
struct sums {
    double miss, noise, energy;
};

/* Where the noise-free response is known. */
static struct sums sum_exact(const struct sample *s, const float *model)
{
    size_t area = (size_t)s->window * (size_t)s->window;
    struct sums sums = {0, 0, 0};
    for (size_t i = 0; i < sample_size(s); i++) {
        double exact = (double)s->exact[i], measured = (double)s->measured[i];
        if (i % area != area / 2 && !isnan(measured)) {
            double apart = model ? exact - (double)model[i] : 0;
            sums.miss += apart * apart;
            sums.noise += (measured - exact) * (measured - exact);
            sums.energy += exact * exact;
        }
    }
    return sums;
}

/* Of each pair the one that was kept, `forth`, and its counterpart, `back`: on average (back - model)^2 is the error's
 * square plus the noise's, (forth - back)^2 / 2 is the noise's, and forth back is the response's. */
static struct sums sum_pairs(const struct sample *s, const float *model)
{
    size_t size = sample_response_size(s), area = (size_t)s->window * (size_t)s->window;
    int half = s->window / 2;
    struct sums sums = {0, 0, 0};
    for (size_t at = 0; at < sample_size(s); at++) {
        size_t i = at / size, k = at % area;
        int xo = (int)(i % (size_t)s->width) + (int)(k % (size_t)s->window) - half;
        int yo = (int)(i / (size_t)s->width) + (int)(k / (size_t)s->window) - half;
        if (k == area / 2 || isnan(s->kept_measured[at]) || xo < 0 || yo < 0 || xo >= s->width ||
            yo >= s->height) {
            continue;
        }
        size_t counterpart =
            (size_t)(yo * s->width + xo) * size + at % size / area * area + area - 1 - k;
        double forth = (double)s->kept_measured[at], back = (double)s->measured[counterpart];
        if (!isnan(back)) {
            double miss = back - (model ? (double)model[at] : 0);
            sums.miss += miss * miss;
            sums.noise += (forth - back) * (forth - back) / 2;
            sums.energy += forth * back;
        }
    }
    sums.miss -= sums.noise;
    return sums;
}

static struct sums sum_all(const struct sample *s, const float *model)
{
    return s->exact ? sum_exact(s, model) : sum_pairs(s, model);
}

double judge_noise_free(const struct sample *s, const float *model)
{
    struct sums sums = sum_all(s, model);
    return sums.energy > 0 ? sqrt(fmax(0, sums.miss) / sums.energy) : 0;
}

double judge_noise(const struct sample *s)
{
    struct sums sums = sum_all(s, NULL);
    return sums.energy > 0 ? sqrt(sums.noise / sums.energy) : 0;
}
