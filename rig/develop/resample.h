/* From camera pixels to surface points: reflected light per point and colour out of a Bayer frame. */
#ifndef RIG_DEVELOP_RESAMPLE_H
#define RIG_DEVELOP_RESAMPLE_H

#include "nacre/error.h"
#include "rig/develop/camera_map.h"
#include "rig/develop/flat.h"

#include <stddef.h>

enum demosaic {
    /* Fit where the session's frames agree with what it takes for granted, Malvar (area without colours) elsewhere. Not
     * for a resampler: develop_session decides. */
    DEMOSAIC_AUTO,
    /* The least-squares solution of what the pixels of a colour say of the points they see, each pixel that straddles
     * points being the mixture of them. Exact, without interpolation or blur, where light is even over each point and
     * the camera sharp; poor where light changes within points or a blur of half a pixel hides their edges. */
    DEMOSAIC_FIT,
    /* Each point takes the mean of the pixels of a colour that see it, weighted by the share that they see. */
    DEMOSAIC_AREA,
    /* Full colour by Malvar, He and Cutler first (the paper's), then the same mean over all pixels. */
    DEMOSAIC_MALVAR,
};

/* Words in the order of the enum, NULL-terminated. */
extern const char *const demosaic_names[];

/* How well a frame agrees with light that is even over each point; zero-initialised it is empty. */
struct misfit {
    double unexplained,
        all; /* sums of squares over pixels, what noise explains taken off the first */
};

struct resampler;

/* Make ready for frames of the flat field's size and order. `map` is surface to camera; the camera is out of focus by a
 * deviation of `blur` pixels, which DEMOSAIC_FIT takes into account. Keeps neither argument. Fails where more than 1 %
 * of the points are seen by no pixel of some colour. */
int resampler_new(const struct flat *flat, const struct camera_map *map, int surface_width,
                  int surface_height, enum demosaic demosaic, double blur,
                  struct resampler **resampler, struct nacre_error *error);
void resampler_free(struct resampler *resampler); /* NULL is allowed */

/* Floats that resampler_apply fills: channels x points. */
size_t resampler_size(const struct resampler *resampler);

/* reflected[channels][surface height][surface width] of a frame: pi times radiance over the irradiance of a beam, so
 * that the white layer itself gives its reflectance. radiance[height][width] has its black level taken off; NaN where
 * not measured. A point of which less than half of the pixels are left is NaN. Several threads may use one resampler. */
int resampler_apply(const struct resampler *resampler, const float *radiance, float *reflected,
                    struct nacre_error *error);

/* Add a frame with the variance of its pixels to the misfit. The resampler is one for DEMOSAIC_FIT. */
int resampler_add_misfit(const struct resampler *resampler, const float *radiance,
                         const float *variance, struct misfit *misfit, struct nacre_error *error);

#endif
