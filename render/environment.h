/* Light from all around, infinitely far away: its values by direction, and directions drawn by how much comes from there.
 *
 * A picture is equirectangular: its top row is straight up, its middle column along y, and x is to the right of that.
 * Values between pixel centres are bilinear, as POV-Ray shows them. */
#ifndef RENDER_ENVIRONMENT_H
#define RENDER_ENVIRONMENT_H

#include "base/picture.h"
#include "nacre/error.h"
#include "render/scene.h"
#include "render/vector.h"

struct environment {
    struct picture picture; /* with the colour in it; none where all directions are alike */
    double color[3];        /* where they are */
    double rotation;        /* about z, radians */
    /* By rows and, within each, by columns: the sums up to there of what pixels send, by solid angle. */
    double *row_sums;    /* [height + 1] */
    double *column_sums; /* [height][width + 1] */
    struct vec3 centre;  /* of a sphere round the scene */
    double radius_mm;
};

/* Prepare; reads the picture, in which values below 0 become 0. Zeroed before, or finished. */
int environment_make(struct environment *environment, const struct scene_environment *settings,
                     struct nacre_error *error);
void environment_finish(struct environment *environment);

/* pi times the radiance that comes from a direction (unit). */
void environment_value(const struct environment *environment, struct vec3 direction,
                       double value[3]);

/* A direction by u[2] in [0, 1)^2, and the density by which directions are drawn, per steradian. */
struct vec3 environment_draw(const struct environment *environment, const double u[2]);
double environment_density(const struct environment *environment, struct vec3 direction);

#endif
