/* Irradiance at the vertices of a surface, averaged over about one surface point of its material. */
#ifndef RENDER_LOCAL_LIGHT_H
#define RENDER_LOCAL_LIGHT_H

#include "base/progress.h"
#include "nacre/error.h"
#include "render/mesh.h"
#include "render/samples.h"

/* irradiance[vertex][3]: the mean over the samples within radius_mm on the same side, weighted by a cone. Where the
 * samples carry areas their scatter cancels, so that even light stays even; photons give a density. A vertex with no
 * sample that near takes the nearest around, if any is within a radius or two. */
int local_light(const struct mesh *mesh, const struct light_samples *samples, double radius_mm,
                struct progress *progress, float (*irradiance)[3], struct nacre_error *error);

#endif
