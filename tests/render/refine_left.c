/* How much of the time that was asked for a run may leave. */
#include "refine_left.h"

#include <math.h>

double refine_left_at_most(const struct refine_report *told, double closing_s)
{
    const struct refine_try *last = &told->steps[told->count - 1];
    double before = told->count > 1 ? last[-1].density : 0, all = last->density / 2;
    double rate = last->seconds / ((last->density - before) / 2);
    return 1.2 * rate * fmax(0.2 * all, told->steps[0].density / 2) + 0.15 * closing_s;
}
