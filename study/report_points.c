/* Choosing the surface points whose responses the report shows. */
#include "study/report_parts.h"

#include <math.h>
#include <stdlib.h>

/* An error and whose it is. */
struct ranked {
    float error;
    int point;
};

static int compare_ranked(const void *a, const void *b)
{
    const struct ranked *x = a;
    const struct ranked *y = b;
    int order = (x->error > y->error) - (x->error < y->error);
    return order ? order : (x->point > y->point) - (x->point < y->point);
}

/* How far a point is from the sample's border. */
static int margin(const struct nacre_material *m, int point)
{
    int x = point % m->width;
    int y = point / m->width;
    int across = x < m->width - 1 - x ? x : m->width - 1 - x;
    int along = y < m->height - 1 - y ? y : m->height - 1 - y;
    return across < along ? across : along;
}

/* The least distance of a point to those chosen already. */
static double seclusion(const struct report *report, int point)
{
    double least = report->material.width + report->material.height;
    int x = point % report->material.width;
    int y = point / report->material.width;
    for (size_t i = 0; i < REPORT_POINTS; i++) {
        const struct report_point *other = &report->points[i];
        if (other->why) {
            least = fmin(least, hypot(x - other->x, y - other->y));
        }
    }
    return least;
}

/* Of the points within one percent of a place in the order of errors, one whose window the border does not cut, or
 * cuts least, and of those the one farthest from the others that are shown. At both ends of the order there is no
 * choice. */
static int choose_near(const struct report *report, const struct ranked *ranked, size_t count,
                       size_t percent)
{
    const struct nacre_material *m = &report->material;
    size_t centre = (count - 1) * percent / 100;
    size_t spread = percent == 0 || percent == 100 ? 0 : count / 100;
    int radius = m->window / 2;
    int best = ranked[centre].point;
    double best_score = -1;
    for (size_t i = centre - spread; i <= centre + spread; i++) {
        int point = ranked[i].point;
        double score = fmin(margin(m, point), radius) * (m->width + m->height + 1.0) +
                       seclusion(report, point);
        if (score > best_score) {
            best_score = score;
            best = point;
        }
    }
    return best;
}

int report_points_choose(struct report *report, struct nacre_error *error)
{
    static const struct {
        size_t percent;
        const char *why;
    } wanted[REPORT_POINTS] = {
        {0, "least error"},     {25, "lower quartile"},         {50, "median error"},
        {75, "upper quartile"}, {95, "one in twenty is worse"}, {100, "greatest error"},
    };
    static const size_t order[REPORT_POINTS] = {0, 5, 2,
                                                1, 3, 4}; /* those without a choice first */
    const struct error_report *errors = &report->errors;
    size_t count = 0;
    struct ranked *ranked = calloc(errors->points + 1, sizeof *ranked);
    if (!ranked) {
        return nacre_fail_memory(error, "the order of the errors");
    }
    for (size_t i = 0; i < errors->points; i++) {
        if (!isnan(errors->map[i])) {
            ranked[count++] = (struct ranked){errors->map[i], (int)i};
        }
    }
    qsort(ranked, count, sizeof *ranked, compare_ranked);
    report->point_count = count >= REPORT_POINTS ? REPORT_POINTS : 0;
    for (size_t i = 0; i < report->point_count; i++) {
        size_t place = order[i];
        int point = choose_near(report, ranked, count, wanted[place].percent);
        report->points[place] = (struct report_point){.x = point % report->material.width,
                                                      .y = point / report->material.width,
                                                      .why = wanted[place].why};
    }
    free(ranked);
    return NACRE_OK;
}
