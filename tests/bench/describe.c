/* What makes a scan hard or easy to factor, in a few figures. */
#include "describe.h"

#include "timing.h"

#include "factor/factorize.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { RINGS = 5 };

/* Of one channel, means over the points well inside the sample. */
struct profile {
    double centre_share; /* of the squared entries of a response */
    double rings
        [RINGS]; /* mean response over the centre's at a share of the half window, in decades */
};

static const double ring_radii[RINGS] = {0.1, 0.25, 0.5, 0.75, 1};

static void add_point(const struct responses *r, int channel, int x, int y, float *window,
                      struct profile *profile)
{
    int half = r->window / 2, counts[RINGS] = {0};
    double energy = 0, rings[RINGS] = {0};
    responses_get(r, channel, x, y, window);
    double centre = (double)window[r->window * half + half];
    for (int i = 0; i < r->window * r->window; i++) {
        double value = isnan(window[i]) ? 0 : (double)window[i];
        int dx = i % r->window - half, dy = i / r->window - half;
        double radius = hypot(dx, dy);
        energy += value * value;
        for (int ring = 0; ring < RINGS; ring++) {
            if (fabs(radius - fmax(1, ring_radii[ring] * half)) < 0.5) {
                rings[ring] += value;
                counts[ring]++;
            }
        }
    }
    profile->centre_share += centre * centre / energy;
    for (int ring = 0; ring < RINGS; ring++) {
        profile->rings[ring] += rings[ring] / counts[ring] / centre;
    }
}

static void print_profile(const struct responses *r, int channel)
{
    int half = r->window / 2, points = 0;
    float *window = allocate((size_t)r->window * (size_t)r->window * sizeof *window);
    struct profile profile = {0};
    for (int y = half; y < r->height - half; y += 3) {
        for (int x = half; x < r->width - half; x += 3) {
            add_point(r, channel, x, y, window, &profile);
            points++;
        }
    }
    printf("  channel %d: centre %4.1f %% of the energy; decades below the centre at", channel,
           100 * profile.centre_share / points);
    for (int ring = 0; ring < RINGS; ring++) {
        printf(" %.0f: %.2f", fmax(1, ring_radii[ring] * half),
               -log10(profile.rings[ring] / points));
    }
    printf("\n");
    free(window);
}

static void print_errors(const struct responses *r, const struct opencl *opencl)
{
    static const int choices[][2] = {{4, 5}, {8, 5}, {12, 5}, {20, 5}, {12, 1}, {12, 20}};
    for (size_t i = 0; i < sizeof choices / sizeof *choices; i++) {
        struct nacre_error error = {0};
        struct nacre_material material;
        struct factor_summary summary = {0};
        struct factor_options options = factor_options_default();
        options.terms = choices[i][0];
        options.clusters = choices[i][1];
        options.store = FACTOR_STORE_FLOAT;
        if (factorize_responses(r, 1, &options, opencl, NULL, &material, &summary, &error) !=
            NACRE_OK) {
            fail(error.text);
        }
        printf("  T %2d k %2d: error min / mean / max %.4f / %.4f / %.4f, without the centre %.4f; "
               "objective %.3g a point and channel, %d steps, %.1f s\n",
               options.terms, options.clusters, summary.error.whole.minimum,
               summary.error.whole.mean, summary.error.whole.maximum,
               summary.error.without_centre.mean,
               summary.objective / (double)r->measured_count / r->channels, material.iterations,
               summary.seconds_iterating);
        (void)fflush(stdout);
        factor_summary_finish(&summary);
        nacre_material_finish(&material);
    }
}

void describe(const char *name, const struct responses *r, const struct opencl *opencl)
{
    printf("%s: %d x %d, K %d, %d channels\n", name, r->width, r->height, r->window, r->channels);
    for (int c = 0; c < r->channels; c++) {
        print_profile(r, c);
    }
    print_errors(r, opencl);
}
