/* One set of sources summed up to another, each place of the texture by itself. */
#ifndef RENDER_SOURCES_MERGE_H
#define RENDER_SOURCES_MERGE_H

#include "render/sources.h"

/* Sum up a set by squares of `size` surface points, and tell it their middles and their variance: the mean along each axis,
 * points^2. Returns 0, or -1 when memory ran out. */
int sources_merge(struct source_set *from, double size, double point_mm, struct source_set *to,
                  float *variance);

#endif
