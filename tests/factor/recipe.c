/* Made samples for the model with a kernel per term. */
#include "recipe.h"

#include "bench.h"

#include "factor/layout.h"

#include <math.h>
#include <unity.h>

double recipe_plane(const struct recipe *recipe, int term, int x, int y)
{
    if (recipe->homogeneous) {
        return 1;
    }
    if (recipe->checks) {
        return (x / 4 + y / 4) % 2 == term ? 1 : 0.25;
    }
    return term == 0 ? 0.6 + 0.4 * cos(0.5 * x) : 0.6 + 0.4 * sin(0.4 * y);
}

static double entry_of(const struct recipe *recipe, int width, int channel, int x, int y, int dx,
                       int dy)
{
    double distance = hypot(dx, dy), sum = distance == 0 ? 2 : 0;
    for (int t = 0; t < 2; t++) {
        sum += recipe_plane(recipe, t, x, y) * recipe_plane(recipe, t, x + dx, y + dy) *
               exp(-distance * (t ? 1.5 : 0.7) * (1 + 0.3 * channel));
    }
    sum *= exp(-recipe->slope * dx / width);
    return recipe->scale * sum * (recipe->one_way && dx > 0 && dy % 2 == 0 ? 2 : 1);
}

struct sample recipe_make(const struct recipe *recipe, int width, int height, int channels,
                          int window)
{
    struct sample s = sample_new(width, height, channels, window, 5);
    int half = window / 2;
    for (int i = 0; i < width * height * channels * window * window; i++) {
        int at = i % (window * window), c = i / (window * window) % channels;
        int point = i / (window * window) / channels, x = point % width, y = point / width;
        int dx = at % window - half, dy = at / window - half;
        bool inside = x + dx >= 0 && x + dx < width && y + dy >= 0 && y + dy < height;
        double noise = recipe->noise ? 0.05 * sin(12.9898 * i) : 0;
        s.responses[i] =
            inside ? (float)(entry_of(recipe, width, c, x, y, dx, dy) * (1 + noise)) : 0;
    }
    return s;
}

struct factor_options recipe_options(int terms, int iterations)
{
    struct factor_options options = factor_options_default();
    options.model = FACTOR_MODEL_TERMS;
    options.terms = terms;
    options.clusters = 0;
    options.iterations = iterations;
    options.tolerance = 0;
    return options;
}

struct nacre_material recipe_fit(const struct opencl *opencl, const struct sample *sample,
                                 const struct factor_options *options,
                                 struct factor_summary *summary)
{
    struct responses responses = sample_load(sample, layout_lanes(opencl));
    struct nacre_material material = {0};
    struct nacre_error error = {0};
    bench_succeed(
        factorize_responses(&responses, 0.5, options, opencl, NULL, &material, summary, &error),
        &error);
    responses_finish(&responses);
    return material;
}

/* Objectives are summed in double of float32 residuals: 1e-6 is what the contract allows. */
void recipe_check_history(const struct nacre_material *m)
{
    TEST_ASSERT_TRUE(m->history_count > 0);
    for (size_t i = 1; i < m->history_count; i++) {
        TEST_ASSERT_TRUE((double)m->history_objective[i] <=
                         (1 + 1e-6) * (double)m->history_objective[i - 1]);
    }
}
