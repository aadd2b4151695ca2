/* Which factorization to study next. */
#include "study/tradeoff_plan.h"

#include "study/tradeoff_front.h"

#include <math.h>

static const int terms_levels[] = {1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64};
static const int cluster_levels[] = {1, 2, 5, 12, 32, 100};

enum {
    TERMS_LEVELS = sizeof terms_levels / sizeof *terms_levels,
    CLUSTER_LEVELS = sizeof cluster_levels / sizeof *cluster_levels,
    SHAPED_MOST = 32, /* terms with a kernel each */
};

/* No material above this share of its responses, as in the search of nacre factor. */
#define MOST_SHARE 0.25

/* More terms are tried as long as the last ones lowered the error by this share. */
#define WORTHWHILE 0.02

/* A window is tried where what it leaves out is at most this share of the error. */
#define LEFT_OUT 0.5

/* Kernels' epsilons that are tried. */
#define EPSILON_FACTOR 10.0

static const struct tradeoff_setting seeds[] = {
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_KERNEL, 2, 2, 0, 1e-5, -1},
    {FACTOR_MODEL_TERMS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_RESPONSE, 2, 0, 0, 1e-5, -1},
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_KERNEL, 4, 5, 0, 1e-5, 0},
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_RESPONSE, 4, 5, 0, 1e-5, -1},
    {FACTOR_MODEL_TERMS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_RESPONSE, 4, 0, 0, 1e-5, -1},
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_MU, FACTOR_WEIGHT_KERNEL, 4, 5, 0, 1e-5, -1},
    {FACTOR_MODEL_TERMS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_KERNEL, 4, 0, 0, 1e-5, -1},
};

enum { SEEDS = sizeof seeds / sizeof *seeds };

bool tradeoff_looks_at(int iterations)
{
    for (int look = 3; look <= iterations; look *= 2) {
        if (look == iterations) {
            return true;
        }
    }
    return false;
}

static bool is_family(const struct tradeoff_setting *a, const struct tradeoff_setting *b)
{
    return a->model == b->model && a->method == b->method && a->weight == b->weight &&
           a->window == b->window && a->epsilon == b->epsilon;
}

static bool was_run(const struct tradeoff *t, const struct tradeoff_setting *s)
{
    for (int i = 0; i < t->run_count; i++) {
        const struct tradeoff_setting *other = &t->runs[i].setting;
        if (is_family(other, s) && other->terms == s->terms && other->clusters == s->clusters &&
            (other->parent < 0) == (s->parent < 0)) {
            return true;
        }
    }
    return false;
}

/* Bytes of the paper's model with half floats; with a kernel per term it is far smaller. */
static double bytes_of(const struct tradeoff *t, const struct tradeoff_setting *s)
{
    double points = (double)t->width * t->height;
    return t->channels * (4.0 * s->terms * points + 4.0 * s->clusters * s->window * s->window);
}

static bool is_possible(const struct tradeoff *t, const struct tradeoff_setting *s)
{
    bool shaped = s->model == FACTOR_MODEL_TERMS;
    return s->terms >= 1 && (!shaped || s->terms <= SHAPED_MOST) &&
           (size_t)s->clusters <= t->measured_points &&
           (shaped || bytes_of(t, s) <= MOST_SHARE * t->measured_bytes) && !was_run(t, s);
}

/* A run's arithmetic, up to a factor; multiplicative updates take many more iterations. */
static double cost_of(const struct tradeoff_setting *s)
{
    double area = (double)s->window * s->window, terms = s->terms;
    if (s->model == FACTOR_MODEL_TERMS) {
        return area * (4 + 2 * terms * (1 + terms / 8));
    }
    return area * (8 + (s->method == FACTOR_METHOD_MU ? 8 * terms : terms * (1 + terms / 60)) *
                           (s->weight == FACTOR_WEIGHT_RESPONSE ? 2 : 1));
}

/* By the run most like it: of its family where there is one. */
static double predict(const struct tradeoff *t, const struct tradeoff_setting *s)
{
    double seconds = 0, nearest = INFINITY;
    for (int i = 0; i < t->run_count; i++) {
        const struct tradeoff_run *run = &t->runs[i];
        if (run->failed) {
            continue;
        }
        double ratio = cost_of(s) / cost_of(&run->setting);
        double distance = fabs(log(ratio)) + (is_family(&run->setting, s) ? 0 : 10);
        if (distance < nearest) {
            nearest = distance;
            seconds = run->seconds * ratio;
        }
    }
    return seconds;
}

/* The run with most terms below those of `s` that it can start from; -1 where there is none. A stage costs what it took,
 * so runs that were started themselves are as good. */
static int find_parent(const struct tradeoff *t, const struct tradeoff_setting *s)
{
    int best = -1;
    for (int i = 0; i < t->run_count; i++) {
        const struct tradeoff_setting *other = &t->runs[i].setting;
        if (t->runs[i].kept && t->runs[i].depth < FACTOR_STAGES - 1 && is_family(other, s) &&
            other->terms < s->terms && other->clusters <= s->clusters &&
            (best < 0 || other->terms > t->runs[best].setting.terms)) {
            best = i;
        }
    }
    return best;
}

static bool find_seed(const struct tradeoff *t, double seconds, struct tradeoff_setting *next,
                      double *predicted)
{
    for (int i = 0; i < SEEDS; i++) {
        struct tradeoff_setting s = seeds[i];
        s.window = t->window;
        if (s.model == FACTOR_MODEL_CLUSTERS && (size_t)s.clusters > t->measured_points) {
            s.clusters = (int)t->measured_points;
        }
        s.parent = s.parent < 0 ? -1 : find_parent(t, &s);
        *predicted = predict(t, &s);
        if (is_possible(t, &s) && *predicted <= seconds) {
            *next = s;
            return true;
        }
    }
    return false;
}

/* The level `step` above the one at or next to `value`; 0 where there is none. */
static int neighbour(const int *levels, int count, int value, int step)
{
    int at = 0;
    while (at < count - 1 && levels[at] < value) {
        at++;
    }
    at += step;
    return at < 0 || at >= count ? 0 : levels[at];
}

static bool is_on_front(const struct tradeoff *t, int run)
{
    for (int i = 0; i < t->point_count; i++) {
        if (t->points[i].run == run && (t->points[i].quickest || t->points[i].smallest)) {
            return true;
        }
    }
    return false;
}

/* Whether as many terms as this run has have brought something beyond fewer. */
static bool has_gained(const struct tradeoff *t, const struct tradeoff_run *run)
{
    for (int i = 0; i < t->run_count; i++) {
        const struct tradeoff_run *other = &t->runs[i];
        if (is_family(&other->setting, &run->setting) &&
            other->setting.terms < run->setting.terms &&
            other->best_error <= (1 + WORTHWHILE) * run->best_error) {
            return false;
        }
    }
    return true;
}

static bool is_best(const struct tradeoff *t, int run)
{
    const struct tradeoff_run *runs = t->runs;
    for (int i = 0; i < t->run_count; i++) {
        if (runs[i].setting.model == runs[run].setting.model &&
            runs[i].best_error < runs[run].best_error) {
            return false;
        }
    }
    return true;
}

/* The next smaller window, where it leaves out little beside the run's error; 0 where there is none. */
static int smaller_window(const struct tradeoff *t, const struct tradeoff_run *run)
{
    for (int i = 0; i < t->window_count; i++) {
        if (t->windows[i].window < run->setting.window) {
            return t->windows[i].left_out <= LEFT_OUT * run->best_error ? t->windows[i].window : 0;
        }
    }
    return 0;
}

enum { NEIGHBOURS = 9 };

/* How many seconds each is worth waiting for, beside a change of weight: more terms lower the error most. */
static const double promise[NEIGHBOURS] = {4, 1, 2, 1, 1, 0.25, 0.25, 0.5, 1};

/* What differs from a run by one step in one thing; zero terms where there is no such setting. */
static void list_neighbours(const struct tradeoff *t, int index,
                            struct tradeoff_setting list[NEIGHBOURS])
{
    const struct tradeoff_run *run = &t->runs[index];
    bool clustered = run->setting.model == FACTOR_MODEL_CLUSTERS;
    for (int i = 0; i < NEIGHBOURS; i++) {
        list[i] = run->setting;
    }
    int terms = run->setting.terms, clusters = run->setting.clusters;
    list[0].terms = has_gained(t, run) ? neighbour(terms_levels, TERMS_LEVELS, terms, 1) : 0;
    list[1].terms = neighbour(terms_levels, TERMS_LEVELS, terms, -1);
    list[2].clusters = neighbour(cluster_levels, CLUSTER_LEVELS, clusters, 1);
    list[3].clusters = neighbour(cluster_levels, CLUSTER_LEVELS, clusters, -1);
    for (int i = 2; i < 4; i++) {
        list[i].terms = clustered && list[i].clusters > 0 ? terms : 0;
    }
    list[4].weight =
        run->setting.weight == FACTOR_WEIGHT_KERNEL ? FACTOR_WEIGHT_RESPONSE : FACTOR_WEIGHT_KERNEL;
    list[5].epsilon *= EPSILON_FACTOR;
    list[6].epsilon /= EPSILON_FACTOR;
    if (!clustered || run->setting.epsilon != seeds[0].epsilon || !is_best(t, index)) {
        list[5].terms = list[6].terms = 0;
    }
    list[8].window = smaller_window(t, run);
    list[8].terms = list[8].window > 0 ? terms : 0;
    /* The paper's model gains by starting from fewer terms, a kernel per term does not: the other is looked at, too, but
     * for the best alone. */
    for (int i = 0; i < NEIGHBOURS; i++) {
        list[i].parent = clustered && list[i].terms > 0 ? find_parent(t, &list[i]) : -1;
    }
    int started = find_parent(t, &list[7]);
    list[7].parent = run->setting.parent < 0 ? started : -1;
    if (!is_best(t, index) || started < 0) {
        list[7].terms = 0;
    }
}

static double least_error(const struct tradeoff *t, enum factor_model model)
{
    double least = INFINITY;
    for (int i = 0; i < t->run_count; i++) {
        least = t->runs[i].setting.model == model ? fmin(least, t->runs[i].best_error) : least;
    }
    return least;
}

static bool find_neighbour(const struct tradeoff *t, double seconds, struct tradeoff_setting *next,
                           double *predicted)
{
    double best = INFINITY;
    for (int i = 0; i < t->run_count; i++) {
        struct tradeoff_setting list[NEIGHBOURS];
        if (!is_on_front(t, i)) {
            continue;
        }
        list_neighbours(t, i, list);
        /* Who is far from the best of the model is on the front for being quick: it matters less. */
        double interest = least_error(t, t->runs[i].setting.model) / t->runs[i].best_error;
        for (int j = 0; j < NEIGHBOURS; j++) {
            double needed = predict(t, &list[j]);
            double price = needed / (promise[j] * interest * interest);
            if (is_possible(t, &list[j]) && needed <= seconds && price < best) {
                *next = list[j];
                *predicted = needed;
                best = price;
            }
        }
    }
    return isfinite(best);
}

bool tradeoff_next(const struct tradeoff *t, double seconds, struct tradeoff_setting *next,
                   double *predicted)
{
    if (t->run_count == TRADEOFF_RUNS || t->point_count + 64 > TRADEOFF_POINTS) {
        return false;
    }
    return find_seed(t, seconds, next, predicted) || find_neighbour(t, seconds, next, predicted);
}

bool tradeoff_is_dominated(const struct tradeoff *t, int run)
{
    const struct tradeoff_point *last = NULL, *before = NULL;
    for (int i = 0; i < t->point_count; i++) {
        if (t->points[i].run == run) {
            before = last;
            last = &t->points[i];
        }
    }
    if (!before) {
        return false;
    }
    double hope = last->error - 2 * fmax(0, before->error - last->error);
    return tradeoff_rival(t, run, TRADEOFF_BYTES, last->bytes) <= hope &&
           tradeoff_rival(t, run, TRADEOFF_SECONDS, last->seconds) <= hope;
}
