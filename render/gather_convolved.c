/* Choosing what is convolved, and checking it. */
#include "render/gather_convolved.h"

#include "render/convolve.h"
#include "render/convolve_cost.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TRIES = 6 };

static bool worthwhile(const struct gather_convolved *convolved)
{
    return convolve_worthwhile(convolved->served.count, convolved->stock->receivers.count);
}

static bool pays(const struct gather_convolved *convolved, int fine)
{
    const struct gather_stock *stock = convolved->stock;
    struct gather_cost cost = convolved->without;
    size_t served = convolved->served.count, count = stock->receivers.count;
    double ns = convolve_cost_ns(&convolved->patches, count, stock->gather->mapping,
                                 stock->gather->appearance, convolved->how.planes, fine,
                                 (double)stock->samples.count);
    double both = convolve_both_ns(served, count, ns, cost.plain, cost.summed);
    return stock->gather->way == GATHER_CONVOLVED
               ? isfinite(ns) && worthwhile(convolved)
               : convolve_pays(served, count, both, fmin(cost.plain, cost.summed));
}

static int run(struct gather_convolved *convolved, struct progress *progress,
               struct nacre_error *error)
{
    const struct gather_stock *stock = convolved->stock;
    const struct convolve convolve = {stock->gather->mapping, stock->gather->appearance,
                                      &stock->receivers, &stock->samples, &convolved->patches};
    return convolve_run(&convolve, &convolved->how, convolved->fine, progress, convolved->light,
                        error);
}

int gather_convolved_make(struct gather_convolved *convolved, const struct gather_stock *stock,
                          struct gather_cost cost, struct progress *progress,
                          struct nacre_error *error)
{
    const struct gather *gather = stock->gather;
    size_t count = stock->receivers.count;
    *convolved = (struct gather_convolved){.stock = stock, .fine = 1, .without = cost};
    convolved->how = convolve_light(gather->appearance, &stock->samples);
    if (!convolved->how.suits || gather->way == GATHER_SUMMED || !(gather->tolerance > 0)) {
        return NACRE_OK;
    }
    if (gather_surface_survey(stock->surface, gather->mesh, gather->mapping, gather->appearance,
                              gather->same_side, error) != NACRE_OK ||
        convolve_patches_copy(&convolved->patches, &stock->surface->patches, count, error) !=
            NACRE_OK) {
        return NACRE_FAILED;
    }
    convolve_leave_out(&convolved->patches, count, gather->mapping, gather->appearance,
                       convolved->how.planes, convolved->fine);
    convolved->served = convolve_serve(&convolved->patches, count, gather->tolerance);
    if (!pays(convolved, convolved->fine)) {
        convolved->served.count = 0;
        return NACRE_OK;
    }
    convolved->light = calloc(count + 1, sizeof *convolved->light);
    return convolved->light ? run(convolved, progress, error)
                            : nacre_fail_memory(error, "the light in the texture");
}

void gather_convolved_finish(struct gather_convolved *convolved)
{
    convolve_patches_finish(&convolved->patches);
    reach_bundles_finish(&convolved->rest);
    free(convolved->light);
    *convolved = (struct gather_convolved){0};
}

void gather_convolved_put(const struct gather_convolved *convolved, float (*light)[3])
{
    size_t count = convolved->served.count > 0 ? convolved->stock->receivers.count : 0;
    for (size_t i = 0; i < count; i++) {
        if (gather_convolved_serves(convolved, i)) {
            memcpy(light[convolved->stock->receivers.vertices[i]], convolved->light[i],
                   sizeof *light);
        }
    }
}

static int bundle_rest(struct gather_convolved *convolved, struct nacre_error *error)
{
    const struct gather_stock *stock = convolved->stock;
    size_t count = stock->receivers.count;
    bool *wanted = calloc(count + 1, sizeof *wanted);
    if (!wanted) {
        return nacre_fail_memory(error, "the receivers of light");
    }
    for (size_t i = 0; i < count; i++) {
        wanted[i] = !gather_convolved_serves(convolved, i);
    }
    double apart = 16 * stock->gather->mapping->point_mm;
    int status = reach_bundle_some(&convolved->rest, stock->receivers.list,
                                   &stock->stages[0].bundles, wanted, apart, error);
    free(wanted);
    return status;
}

/* What is off, with the vertices that are not served as they should be. */
static double measure(const struct gather_convolved *convolved, const struct gather_probe *probe,
                      float (*exact)[3], float (*light)[3])
{
    memcpy(light, exact, convolved->stock->gather->mesh->vertex_count * sizeof *light);
    gather_convolved_put(convolved, light);
    return gather_probe_error(probe, light, exact);
}

/* Misfits that are too small to explain what is off leave the lattice. */
static bool is_coarse(const struct gather_convolved *convolved, double off)
{
    return convolved->fine < CONVOLVE_FINEST && 2 * convolved->served.misfit < off &&
           pays(convolved, convolved->fine + 1);
}

int gather_convolved_check(struct gather_convolved *convolved, const struct gather_probe *probe,
                           struct progress *progress, float (*exact)[3], float (*light)[3],
                           double *off, struct nacre_error *error)
{
    size_t count = convolved->stock->receivers.count;
    double tolerance = convolved->stock->gather->tolerance, most = tolerance;
    int status = NACRE_OK;
    for (int i = 0; i < TRIES && convolved->served.count > 0; i++) {
        size_t before = convolved->served.count;
        /* The others' light is not known yet, and is to have its share. */
        double limit = before < count ? sqrt(0.5) * tolerance : tolerance;
        *off = measure(convolved, probe, exact, light);
        if (*off <= limit) {
            return before < count ? bundle_rest(convolved, error) : NACRE_OK;
        }
        if (is_coarse(convolved, *off)) {
            convolved->fine++;
            status = run(convolved, progress, error);
            if (status != NACRE_OK) {
                return status;
            }
            continue;
        }
        most = fmin(most, convolved->served.misfit) * fmin(fmax(0.9 * limit / *off, 0.1), 0.7);
        convolved->served = convolve_serve(&convolved->patches, count, most);
        if (convolved->served.count == before || !worthwhile(convolved)) {
            break;
        }
    }
    convolved->served.count = 0;
    *off = 0;
    return NACRE_OK;
}
