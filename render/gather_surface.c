/* Making what gathers on one object share. */
#include "render/gather_surface.h"

#include "render/gather_device.h"

#include <stdlib.h>

void gather_by_terms(const float *from, size_t planes, size_t terms, float *to)
{
    for (size_t t = 0; t < terms; t++) {
        for (size_t c = 0; c < 3; c++) {
            to[t * 4 + c] = from[(planes == 1 ? 0 : c) * terms + t];
        }
        to[t * 4 + 3] = 0;
    }
}

static int fill_factors(struct gather_surface *surface, const struct appearance *a,
                        struct nacre_error *error)
{
    size_t texels = (size_t)a->width * (size_t)a->height, terms = (size_t)a->terms;
    size_t planes = (size_t)a->factor_channels;
    surface->factors = device_allocate(texels * terms * 4 * sizeof *surface->factors, error);
    if (!surface->factors) {
        return NACRE_FAILED;
    }
#pragma omp parallel for
    for (size_t i = 0; i < texels; i++) {
        gather_by_terms(a->f + i * terms * planes, planes, terms, surface->factors + i * terms * 4);
    }
    return NACRE_OK;
}

int gather_surface_make(struct gather_surface *surface, const struct mesh *mesh,
                        const struct mapping *mapping, const struct appearance *appearance,
                        struct nacre_error *error)
{
    if (surface->made) {
        return NACRE_OK;
    }
    if (receivers_make(&surface->receivers, mesh, mapping, appearance, error) != NACRE_OK ||
        reach_bundle(&surface->bundles, surface->receivers.list, surface->receivers.count, error) !=
            NACRE_OK ||
        fill_factors(surface, appearance, error) != NACRE_OK) {
        gather_surface_finish(surface);
        return NACRE_FAILED;
    }
    surface->made = true;
    return NACRE_OK;
}

int gather_surface_survey(struct gather_surface *surface, const struct mesh *mesh,
                          const struct mapping *mapping, const struct appearance *appearance,
                          bool same_side, struct nacre_error *error)
{
    if (surface->surveyed) {
        return NACRE_OK;
    }
    int status = convolve_patches_make(&surface->patches, mesh, mapping, appearance,
                                       &surface->receivers, same_side, error);
    surface->surveyed = status == NACRE_OK;
    return status;
}

void gather_surface_finish(struct gather_surface *surface)
{
    receivers_finish(&surface->receivers);
    reach_bundles_finish(&surface->bundles);
    convolve_patches_finish(&surface->patches);
    free(surface->factors);
    *surface = (struct gather_surface){0};
}
