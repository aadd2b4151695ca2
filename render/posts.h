/* Posts: places on a lattice over the texture at which light is summed up for all receivers around them.
 *
 * A lattice of spacing s has posts at (k + 3/4) s. A receiver takes the sums of the 3 x 3 posts around it by quadratic
 * B-splines, whose weights sum to 1: so nothing jumps, and what they blur (variance s^2 / 4) the kernels are corrected for.
 * A post is placed and turned as the receivers around it are, whose mean place in the texture need not be its own. Posts of
 * one lattice are the receivers of the next, coarser one. */
#ifndef RENDER_POSTS_H
#define RENDER_POSTS_H

#include "nacre/error.h"
#include "render/receivers.h"

#include <stddef.h>
#include <stdint.h>

enum { POSTS_A_RECEIVER = 9 };

struct posts {
    size_t count;
    struct receiver *list;
    uint32_t *links; /* [receivers][9] */
    float *weights;  /* [receivers][9] */
};

/* Posts of a lattice of `spacing` surface points for some receivers. */
int posts_make(struct posts *posts, const struct receiver *receivers, size_t count, double spacing,
               double point_mm, struct nacre_error *error);
void posts_finish(struct posts *posts);

#endif
