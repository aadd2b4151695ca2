/* The method terms behind its seam: starting, stepping, reading and writing. */
#include "factor/terms.h"

#include "factor/random.h"
#include "factor/terms_steps.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Planes start as a point's norm where its kind is theirs, and as this share of it elsewhere, and with a little chance. */
#define ELSEWHERE 0.3
#define CHANCE    0.1

/* The set that a channel's calls are answered for, or NULL where that is another channel's. */
static struct terms_set *set_of(struct terms *m, int channel)
{
    return terms_has_set(m, channel) ? &m->sets[channel] : NULL;
}

/* In the unit that ldexp(objective, exponent of the channel) makes the responses' own. */
static double objective_of(const struct terms *m, int channel, double objective)
{
    const double *constants = m->data->constant;
    double constant = terms_data_sets(m->data) > 1 ? constants[channel]
                                                   : constants[0] + constants[1] + constants[2];
    return ldexp(objective + constant, m->data->exponent - m->data->responses->exponent[channel]);
}

static int step(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    struct terms_set *set = set_of(m, channel);
    int status = set ? terms_advance(m, set, error) : NACRE_OK;
    if (objective) {
        *objective = set ? objective_of(m, channel, set->objective) : 0;
    }
    return status;
}

static int measure(struct method *method, int channel, double *objective, struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    struct terms_set *set = set_of(m, channel);
    int status = set ? terms_view(m, set, error) : NACRE_OK;
    *objective =
        !set ? 0
             : objective_of(m, channel,
                            terms_is_next_better(set) ? set->next_objective : set->objective);
    return status;
}

static int read_factors(struct method *method, int channel, float *f, float *h,
                        struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    struct terms_set *set = set_of(m, channel);
    int status = set ? terms_view(m, set, error) : NACRE_OK;
    bool next = set && terms_is_next_better(set);
    float *to[] = {f, h};
    for (int side = 0; set && side < 2 && side < m->sides && status == NACRE_OK; side++) {
        const struct terms_track *track = &set->tracks[side];
        status = layout_read_factor(&m->layouts[side], next ? track->next : track->good, to[side],
                                    error);
    }
    return status;
}

static int read_kernels(struct method *method, int channel, float *numbers,
                        struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    struct terms_set *set = terms_data_sets(m->data) > 1 ? &m->sets[channel] : &m->sets[0];
    int status = terms_view(m, set, error);
    const float *from =
        terms_is_next_better(set) ? m->channels[channel].next : m->channels[channel].good;
    memcpy(numbers, from, terms_number_count(m) * sizeof *numbers);
    return status;
}

/* Start from the planes in `next`, without kernels. */
static int begin_set(struct terms *m, struct terms_set *set, struct nacre_error *error)
{
    int status = NACRE_OK;
    set->share = 0;
    set->share_limit = 1;
    set->damping = m->sides == 1 ? 2 : 1;
    set->objective = INFINITY;
    set->accepted = set->refused = set->settled = set->viewed = set->placed = set->burst = 0;
    for (int c = set->first; c < set->first + set->count; c++) {
        memset(m->channels[c].next, 0, terms_number_count(m) * sizeof *m->channels[c].next);
        memset(m->channels[c].good, 0, terms_number_count(m) * sizeof *m->channels[c].good);
    }
    for (int side = 0; side < m->sides && status == NACRE_OK; side++) {
        status = terms_copy_planes(m, set->tracks[side].next, set->tracks[side].last, error);
    }
    return status;
}

/* Planes of points of which nothing was measured move nothing and must not weigh. */
static int write_planes(struct terms *m, int side, cl_mem to, const float *values,
                        struct nacre_error *error)
{
    const struct responses *r = m->data->responses;
    size_t points = (size_t)r->width * (size_t)r->height;
    float *copy = malloc(terms_plane_floats(m) * sizeof *copy);
    if (!copy) {
        return nacre_fail_memory(error, "the planes");
    }
    for (size_t i = 0; i < terms_plane_floats(m); i++) {
        bool kept = side == 1 || m->sides == 1 || r->measured[i % points];
        copy[i] = kept ? values[i] : 0;
    }
    int status = layout_write_factor(&m->layouts[side], to, copy, error);
    free(copy);
    return status;
}

static int write_factors(struct method *method, int channel, const float *f, const float *h,
                         struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    struct terms_set *set = set_of(m, channel);
    const float *from[] = {f, h};
    int status = NACRE_OK;
    for (int side = 0; set && side < 2 && side < m->sides && status == NACRE_OK; side++) {
        status = write_planes(m, side, set->tracks[side].next, from[side], error);
    }
    return set && status == NACRE_OK ? begin_set(m, set, error) : status;
}

static void explain(const struct method *method, const struct listener *to)
{
    const struct terms *m = (const struct terms *)method;
    const struct terms_data *d = m->data;
    static const char *const weights[] = {"1 / ||R_i||: relative errors",
                                          "1 / sqrt(mean response)"};
    static const char *const ways[] = {"", "H = F", "H = F but for a smooth gain at both ends",
                                       "F and H, as light goes one way"};
    tell(to, "method",
         "terms: each point's best step, extrapolated with restart, then the kernels'");
    tell(to, "kernels", "%s, %d numbers each and channel", d->grid.radius ? "radial" : "full",
         d->grid.count);
    tell(to, "planes", "%s, %s", d->options.separate ? "of each channel" : "shared by the channels",
         ways[d->options.reciprocity]);
    tell(to, "reciprocity",
         "pairs differ by %.2g %% beyond noise, %.2g %% with the gain divided out",
         100 * d->asymmetry, 100 * d->asymmetry_left);
    tell(to, "weight", "%s", weights[d->options.weight]);
    tell(to, "device memory",
         "%.1f MiB of planes, %.1f MiB of points' normal matrices and %.1f MiB of responses",
         5 * (double)m->sides * terms_data_sets(d) *
             (double)(m->layouts[0].factor_floats * sizeof(float)) * 0x1p-20,
         (double)terms_data_sets(d) * (double)m->curvature_floats * sizeof(float) * 0x1p-20,
         (double)m->sides * 2 * (double)d->copies[0].size * d->responses->channels * 0x1p-20);
}

static void terms_free(struct method *method)
{
    terms_release((struct terms *)method);
}

static const struct method_ops terms_ops = {
    .name = "terms",
    .step = step,
    .measure = measure,
    .read = read_factors,
    .read_kernels = read_kernels,
    .write = write_factors,
    .state_size = terms_state_size,
    .save = terms_save_state,
    .load = terms_load_state,
    .explain = explain,
    .free = terms_free,
};

/* Planes of the kinds of points, values up to about 1. */
static void start_planes(const struct terms *m, const struct problem *p, int set, float *planes)
{
    const struct responses *r = m->data->responses;
    size_t points = (size_t)r->width * (size_t)r->height;
    double brightest = 0;
    uint64_t stream = random_bits(p->seed, 2 * (uint64_t)set);
    for (int i = 0; i < r->width * r->height; i++) {
        double sum = responses_sum(r, set, i % r->width, i / r->width);
        brightest = sum > brightest ? sum : brightest; /* passes over NaN */
    }
    for (size_t i = 0; i < points * (size_t)p->terms; i++) {
        size_t at = i % points, t = i / points;
        double sum =
            responses_sum(r, set, (int)(at % (size_t)r->width), (int)(at / (size_t)r->width));
        double size = sum > 0 && brightest > 0 ? sqrt(sum / brightest) : 0.1;
        double share = p->kinds[at] == t ? 1 : ELSEWHERE;
        planes[i] = (float)(size * (share + CHANCE * random_uniform(stream, i)));
    }
}

static int start_set(struct terms *m, const struct problem *p, int index, struct nacre_error *error)
{
    struct terms_set *set = &m->sets[index];
    int status = NACRE_OK;
    *set = (struct terms_set){
        .first = index, .count = terms_data_sets(m->data) > 1 ? 1 : m->data->responses->channels};
    for (int side = 0; side < m->sides && status == NACRE_OK; side++) {
        struct terms_track *t = &set->tracks[side];
        cl_mem *planes[] = {&t->good, &t->next, &t->last, &t->fresh, &t->kept};
        for (int i = 0; i < 5 && status == NACRE_OK; i++) {
            status = layout_make_factor(&m->layouts[0], planes[i], error);
        }
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(&m->layouts[0], m->curvature_floats * sizeof(float), NULL,
                                    false, &set->curvature, error);
    }
    float *values = malloc((terms_plane_floats(m) + 1) * sizeof *values);
    if (!values) {
        return nacre_fail_memory(error, "the planes");
    }
    start_planes(m, p, index, values);
    for (int side = 0; side < m->sides && status == NACRE_OK; side++) {
        status = write_planes(m, side, set->tracks[side].next, values, error);
    }
    free(values);
    return status == NACRE_OK ? begin_set(m, set, error) : status;
}

int terms_new(const struct opencl *opencl, const struct problem *problem, struct method **method,
              struct nacre_error *error)
{
    struct terms *m = NULL;
    int status = NACRE_OK;
    *method = NULL;
    if (problem->terms > TERMS_MOST) {
        return nacre_fail(error,
                          "%d terms are too many for a kernel each, of which there can be "
                          "%d; use --model clusters",
                          problem->terms, TERMS_MOST);
    }
    m = calloc(1, sizeof *m);
    if (!m) {
        return nacre_fail_memory(error, "the method");
    }
    m->method.ops = &terms_ops;
    m->data = problem->data;
    m->sides = problem->data->copy_count > 1 ? 2 : 1;
    for (int side = 0; side < m->sides && status == NACRE_OK; side++) {
        m->problems[side] = *problem;
        m->problems[side].responses = &problem->data->copies[side];
        status =
            layout_begin(&m->layouts[side], opencl, &m->problems[side], problem->terms, 0, error);
    }
    if (status == NACRE_OK) {
        status = terms_prepare(m, error);
    }
    for (int i = 0; i < terms_data_sets(m->data) && status == NACRE_OK; i++) {
        status = start_set(m, problem, i, error);
    }
    if (status == NACRE_OK) {
        *method = &m->method;
    } else {
        terms_release(m);
    }
    return status;
}
