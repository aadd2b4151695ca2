/* Halving sets of points until each is a run. */
#include "halves.h"

#include "render/bundles.h"

struct points {
    const float *positions;
    size_t stride;
};

static float coordinate(struct points points, uint32_t index, int axis)
{
    return points.positions[(size_t)index * points.stride + (size_t)axis];
}

/* Ties are broken by number, so that the order is the same every time. */
static int is_before(struct points points, int axis, uint32_t a, uint32_t b)
{
    float one = coordinate(points, a, axis), two = coordinate(points, b, axis);
    return one < two || (one == two && a < b);
}

/* Hoare's selection: the `left` smallest come first. */
static void select_smallest(struct points points, int axis, uint32_t *order, ptrdiff_t count,
                            ptrdiff_t left)
{
    ptrdiff_t begin = 0, end = count;
    while (end - begin > 1) {
        uint32_t pivot = order[begin + (end - begin) / 2];
        ptrdiff_t i = begin, j = end - 1;
        while (i <= j) {
            while (is_before(points, axis, order[i], pivot)) {
                i++;
            }
            while (is_before(points, axis, pivot, order[j])) {
                j--;
            }
            if (i <= j) {
                uint32_t swapped = order[i];
                order[i++] = order[j];
                order[j--] = swapped;
            }
        }
        if (left <= j) {
            end = j + 1;
        } else if (left > i) {
            begin = i;
        } else {
            return; /* up to j no larger, from i on no smaller than the pivot */
        }
    }
}

void halves_sort(const float *positions, size_t stride, uint32_t *order, size_t count, size_t run)
{
    struct points points = {positions, stride};
    while (count > run) {
        struct bundle_box box = bundles_box(positions, stride, order, count);
        int axis = 0;
        for (int k = 1; k < 3; k++) {
            axis = box.high[k] - box.low[k] > box.high[axis] - box.low[axis] ? k : axis;
        }
        size_t left = (count / run + 1) / 2 * run;
        select_smallest(points, axis, order, (ptrdiff_t)count, (ptrdiff_t)left);
        halves_sort(positions, stride, order, left, run);
        order += left;
        count -= left;
    }
}
