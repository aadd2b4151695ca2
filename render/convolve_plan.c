/* Choosing blocks: few, and few receivers of differently mirrored tiles in one. */
#include "render/convolve_plan.h"

#include "render/convolve_fft.h"

#include <math.h>

enum { LARGEST = 640 /* transforms then stay in the cache */, STEPS = 8 };

/* Floats of a block's planes, light's and what leaves: 512 MiB. The gather needs no such room. */
static const double most_floats = 0x1p27;

struct candidate {
    struct convolve_axis axis;
    bool mixed; /* a block may have receivers on tiles that are mirrored and others that are not */
};

/* The end of the tile that a surface point lies on. */
static int tile_end(int at, int tile)
{
    int number = at >= 0 ? at / tile : -((-at + tile - 1) / tile);
    return (number + 1) * tile;
}

/* Blocks of at most `step`, that end with tiles where `aligned`. Returns false where there are too many. */
static bool cut(struct convolve_axis *axis, int begin, int size, int step, int tile, bool aligned,
                int margin, int fine)
{
    int at = begin, longest = 0;
    axis->count = 0;
    while (at < begin + size && axis->count < CONVOLVE_AXIS_BLOCKS) {
        int end = at + step < begin + size ? at + step : begin + size;
        int border = tile_end(at, tile);
        end = aligned && border < end ? border : end;
        longest = end - at > longest ? end - at : longest;
        axis->starts[axis->count++] = at;
        at = end;
    }
    axis->starts[axis->count] = at;
    axis->size = fft_size(longest * fine + margin);
    return at == begin + size && axis->size <= LARGEST;
}

static int list_cuts(struct candidate *list, int begin, int size, int tile, bool mirror, int margin,
                     int fine)
{
    int count = 0;
    for (int parts = 1; parts <= STEPS; parts++) {
        int step = (size + parts - 1) / parts;
        struct candidate *next = &list[count];
        next->mixed = mirror && tile_end(begin, tile) < begin + size;
        count += cut(&next->axis, begin, size, step, tile, false, margin, fine);
        next = &list[count];
        next->mixed = false;
        count += mirror && cut(&next->axis, begin, size, (tile + parts - 1) / parts, tile, true,
                               margin, fine);
    }
    return count;
}

void convolve_plan(struct convolve_plan *plan, const struct convolve_patch *patch,
                   const struct mapping *mapping, const struct appearance *appearance,
                   struct convolve_planes planes, int fine)
{
    int reach = appearance->window / 2 * fine + CONVOLVE_TAIL, margin = 2 * reach + 4;
    struct candidate across[2 * STEPS + 1], down[2 * STEPS + 1];
    int columns =
        list_cuts(across, patch->x, patch->width, mapping->width, mapping->mirror, margin, fine);
    int rows =
        list_cuts(down, patch->y, patch->height, mapping->height, mapping->mirror, margin, fine);
    *plan = (struct convolve_plan){.fine = fine, .reach = reach, .points = HUGE_VAL};
    for (int i = 0; i < columns * rows; i++) {
        const struct candidate *x = &across[i / rows], *y = &down[i % rows];
        double blocks = (double)x->axis.count * y->axis.count;
        double floats = (double)x->axis.size * y->axis.size;
        floats *= planes.in + planes.out * (1 + x->mixed) * (1 + y->mixed);
        double points = blocks * floats;
        if (points < plan->points && floats <= most_floats) {
            plan->x = x->axis;
            plan->y = y->axis;
            plan->points = points;
        }
    }
}
