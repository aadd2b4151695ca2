/* The method terms behind its seam: its kernels and buffers, reading, writing, saving and loading its state. */
#include "factor/terms.h"

#include "factor/random.h"
#include "factor/terms_steps.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern const struct opencl_source terms_cl;

/* Planes start as a point's norm where its kind is theirs, and as this share of it elsewhere, and with a little chance. */
#define ELSEWHERE 0.3
#define CHANCE    0.1

static size_t plane_floats(const struct terms *m)
{
    const struct layout_sizes *s = &m->layouts[0].sizes;
    return (size_t)s->terms * (size_t)s->height * (size_t)s->width;
}

static size_t number_count(const struct terms *m)
{
    return (size_t)m->data->grid.count * (size_t)m->layouts[0].sizes.terms;
}

static int build(struct terms *m, struct nacre_error *error)
{
    static const char *const names[TERMS_KERNEL_COUNT] = {
        "visit", "descend", "extrapolate", "multiply", "correlate", "sides", "lack"};
    const struct layout *l = &m->layouts[0];
    const struct responses *r = m->problems[0].responses;
    char options[192];
    (void)snprintf(options, sizeof options,
                   "-DLANES=%d -DTERMS=%d -DMASKED=%d -DHALF=%d -DDOWN=%d -DACROSS=%d -DCOLUMNS=%d "
                   "-DWINDOW=%d",
                   r->lanes, l->sizes.terms, r->mask_needed, r->half, TERMS_DOWN, TERMS_ACROSS,
                   TERMS_COLUMNS, l->sizes.window);
    if (opencl_build(l->opencl, &terms_cl, options, &m->program, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    for (int i = 0; i < TERMS_KERNEL_COUNT; i++) {
        cl_int status = CL_SUCCESS;
        m->kernels[i] = clCreateKernel(m->program, names[i], &status);
        if (opencl_check(l->opencl, status, names[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

/* The set that a channel's calls are answered for, or NULL where that is another channel's. */
static struct terms_set *set_of(struct terms *m, int channel)
{
    return terms_data_sets(m->data) > 1 ? &m->sets[channel] : channel == 0 ? &m->sets[0] : NULL;
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
    memcpy(numbers, from, number_count(m) * sizeof *numbers);
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
        memset(m->channels[c].next, 0, number_count(m) * sizeof *m->channels[c].next);
        memset(m->channels[c].good, 0, number_count(m) * sizeof *m->channels[c].good);
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
    float *copy = malloc(plane_floats(m) * sizeof *copy);
    if (!copy) {
        return nacre_fail_memory(error, "the planes");
    }
    for (size_t i = 0; i < plane_floats(m); i++) {
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

/* Saving and loading: the part of a set's state that is no plane, then the model, what waits and the last best step of
 * each side; then the set's curvature, and the channel's kernels. */
struct saved {
    double objective;
    float share, share_limit, damping;
    int32_t accepted, refused, settled, placed, burst;
};

enum { SAVED_PLANES = 3 };

static size_t state_size(const struct method *method)
{
    const struct terms *m = (const struct terms *)method;
    return sizeof(struct saved) + ((size_t)m->sides * SAVED_PLANES * plane_floats(m) +
                                   m->curvature_floats + 2 * number_count(m)) *
                                      sizeof(float);
}

static int save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    const struct terms_set *set = set_of(m, channel);
    float *to = (float *)((char *)state + sizeof(struct saved));
    int status = NACRE_OK;
    memset(state, 0, state_size(method));
    if (set) {
        const struct saved saved = {.objective = set->objective,
                                    .share = set->share,
                                    .share_limit = set->share_limit,
                                    .damping = set->damping,
                                    .accepted = set->accepted,
                                    .refused = set->refused,
                                    .settled = set->settled,
                                    .placed = set->placed,
                                    .burst = set->burst};
        memcpy(state, &saved, sizeof saved);
    }
    for (int i = 0; i < m->sides * SAVED_PLANES; i++, to += plane_floats(m)) {
        const struct terms_track *t = set ? &set->tracks[i / SAVED_PLANES] : NULL;
        if (t && status == NACRE_OK) {
            const cl_mem planes[] = {t->good, t->next, t->last};
            status = layout_read_factor(&m->layouts[0], planes[i % SAVED_PLANES], to, error);
        }
    }
    if (set && status == NACRE_OK) {
        status = opencl_check(m->layouts[0].opencl,
                              clEnqueueReadBuffer(m->layouts[0].opencl->queue, set->curvature,
                                                  CL_TRUE, 0, m->curvature_floats * sizeof *to, to,
                                                  0, NULL, NULL),
                              "cannot read the curvature", error);
    }
    to += m->curvature_floats;
    memcpy(to, m->channels[channel].good, number_count(m) * sizeof *to);
    memcpy(to + number_count(m), m->channels[channel].next, number_count(m) * sizeof *to);
    return status;
}

static int load_state(struct method *method, int channel, const void *state,
                      struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    struct terms_set *set = set_of(m, channel);
    const float *from = (const float *)((const char *)state + sizeof(struct saved));
    struct saved saved;
    int status = NACRE_OK;
    memcpy(&saved, state, sizeof saved);
    if (saved.accepted < 0 || saved.refused < 0 || saved.burst < 0 || !isfinite(saved.share) ||
        !isfinite(saved.share_limit) || !isfinite(saved.damping) || isnan(saved.objective) ||
        (set && saved.damping < 1)) {
        return nacre_fail(error, "the saved state of channel %d is none of terms", channel);
    }
    for (int i = 0; i < m->sides * SAVED_PLANES; i++, from += plane_floats(m)) {
        const struct terms_track *t = set ? &set->tracks[i / SAVED_PLANES] : NULL;
        if (t && status == NACRE_OK) {
            const cl_mem planes[] = {t->good, t->next, t->last};
            status = layout_write_factor(&m->layouts[0], planes[i % SAVED_PLANES], from, error);
        }
    }
    if (set && status == NACRE_OK) {
        status = opencl_check(m->layouts[0].opencl,
                              clEnqueueWriteBuffer(m->layouts[0].opencl->queue, set->curvature,
                                                   CL_TRUE, 0, m->curvature_floats * sizeof *from,
                                                   from, 0, NULL, NULL),
                              "cannot write the curvature", error);
    }
    from += m->curvature_floats;
    memcpy(m->channels[channel].good, from, number_count(m) * sizeof *from);
    memcpy(m->channels[channel].next, from + number_count(m), number_count(m) * sizeof *from);
    if (set) {
        set->objective = saved.objective;
        set->share = saved.share;
        set->share_limit = saved.share_limit;
        set->damping = saved.damping;
        set->accepted = saved.accepted;
        set->refused = saved.refused;
        set->settled = saved.settled;
        set->placed = saved.placed;
        set->burst = saved.burst;
        set->viewed = 0;
    }
    return status == NACRE_OK ? terms_place_kernels(m, channel, m->channels[channel].next, error)
                              : status;
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
    tell(to, "device memory", "%.1f MiB of planes and %.1f MiB of responses",
         5 * (double)m->sides * terms_data_sets(d) *
             (double)(m->layouts[0].factor_floats * sizeof(float)) * 0x1p-20,
         (double)m->sides * 2 * (double)d->copies[0].size * d->responses->channels * 0x1p-20);
}

static void terms_free(struct method *method)
{
    struct terms *m = (struct terms *)method;
    if (m->layouts[0].opencl) {
        (void)clFinish(m->layouts[0].opencl->queue); /* kernels may still read what is freed next */
    }
    for (int c = 0; c < RESPONSES_CHANNELS; c++) {
        for (int side = 0; side < 2; side++) {
            const struct terms_track *t = &m->sets[c].tracks[side];
            layout_release(t->good);
            layout_release(t->next);
            layout_release(t->last);
            layout_release(t->fresh);
            layout_release(t->kept);
            layout_release(m->channels[c].kernels[side]);
            layout_release(m->channels[c].scales[side]);
        }
        layout_release(m->sets[c].curvature);
        layout_release(m->channels[c].sums);
        free(m->channels[c].good);
        free(m->channels[c].next);
    }
    layout_release(m->weights);
    layout_release(m->nothing);
    layout_release(m->gradient);
    layout_release(m->beyond);
    layout_release(m->equations.weighted);
    layout_release(m->equations.plain);
    layout_release(m->equations.correlations);
    layout_release(m->equations.sides);
    layout_release(m->equations.lacks);
    layout_release(m->equations.measured);
    for (int i = 0; i < TERMS_KERNEL_COUNT; i++) {
        if (m->kernels[i]) {
            (void)clReleaseKernel(m->kernels[i]);
        }
    }
    if (m->program) {
        (void)clReleaseProgram(m->program);
    }
    layout_finish(&m->layouts[0]);
    layout_finish(&m->layouts[1]);
    free(m->partials);
    free(m->correlations);
    free(m->right);
    free(m->lacks);
    free(m->measured);
    free(m->sums);
    free(m->staged);
    free(m->window);
    free(m);
}

static const struct method_ops terms_ops = {
    .name = "terms",
    .step = step,
    .measure = measure,
    .read = read_factors,
    .read_kernels = read_kernels,
    .write = write_factors,
    .state_size = state_size,
    .save = save_state,
    .load = load_state,
    .explain = explain,
    .free = terms_free,
};

/* The squared weights of points as a plane with zeros around. */
static int place_weights(struct terms *m, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    const struct layout_sizes *s = &l->sizes;
    size_t stride = (size_t)s->stride, count = (size_t)s->height * stride;
    float *plane = calloc(count, sizeof *plane);
    if (!plane) {
        return nacre_fail_memory(error, "the weights");
    }
    for (size_t y = 0; y < (size_t)s->height; y++) {
        memcpy(plane + y * stride + (size_t)s->pad, m->data->weights + y * (size_t)s->width,
               (size_t)s->width * sizeof *plane);
    }
    int status = layout_make_buffer(l, count * sizeof *plane, plane, false, &m->weights, error);
    if (status == NACRE_OK) {
        status = layout_make_buffer(l, count * sizeof *plane, NULL, false, &m->nothing, error);
    }
    free(plane);
    return status;
}

static int prepare_channel(struct terms *m, int channel, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    size_t area = (size_t)m->data->grid.window * (size_t)m->data->grid.window;
    size_t items = (size_t)l->sizes.blocks * (size_t)l->sizes.height;
    int status = layout_make_buffer(l, 2 * items * sizeof(float), NULL, false,
                                    &m->channels[channel].sums, error);
    m->channels[channel].good = calloc(number_count(m), sizeof(float));
    m->channels[channel].next = calloc(number_count(m), sizeof(float));
    if (!m->channels[channel].good || !m->channels[channel].next) {
        return nacre_fail_memory(error, "the kernels");
    }
    for (int side = 0; side < m->sides && status == NACRE_OK; side++) {
        for (size_t i = 0; i < area; i++) {
            m->window[i] = m->data->scales[channel][side == 0 ? i : area - 1 - i];
        }
        status = layout_make_buffer(l, area * sizeof(float), m->window, false,
                                    &m->channels[channel].scales[side], error);
        if (status == NACRE_OK) {
            status = layout_make_buffer(l, area * (size_t)l->sizes.terms * sizeof(float), NULL,
                                        false, &m->channels[channel].kernels[side], error);
        }
    }
    return status;
}

/* Room for the kernels' equations, on the device and on the host. */
static int prepare_equations(struct terms *m, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    size_t terms = (size_t)l->sizes.terms, pairs = terms * (terms + 1) / 2;
    size_t area = (size_t)m->data->grid.window * (size_t)m->data->grid.window;
    size_t held = pairs < TERMS_PRODUCTS ? pairs : TERMS_PRODUCTS;
    size_t stride = (size_t)l->sizes.stride, height = (size_t)l->sizes.height;
    size_t guarded = height + 2 * (size_t)(l->sizes.window / 2 + TERMS_DOWN);
    bool masked = m->data->copies[0].mask_needed;
    const struct {
        cl_mem *buffer;
        size_t floats;
    } wanted[] = {{&m->equations.weighted, held * guarded * stride},
                  {&m->equations.plain, held * height * stride},
                  {&m->equations.correlations, pairs * area},
                  {&m->equations.sides, terms * area},
                  {&m->equations.lacks, masked ? pairs * area : 1},
                  {&m->equations.measured, masked ? area : 1}};
    int status = NACRE_OK;
    m->equation_size = pairs + terms;
    m->correlations = malloc(pairs * area * sizeof *m->correlations);
    m->right = malloc(terms * area * sizeof *m->right);
    m->lacks = masked ? malloc(pairs * area * sizeof *m->lacks) : NULL;
    m->measured = masked ? malloc(area * sizeof *m->measured) : NULL;
    m->sums = malloc((area * m->equation_size + 1) * sizeof *m->sums);
    if (!m->correlations || !m->right || !m->sums || (masked && (!m->lacks || !m->measured))) {
        return nacre_fail_memory(error, "the method");
    }
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted && status == NACRE_OK; i++) {
        status = layout_make_buffer(l, wanted[i].floats * sizeof(float), NULL, false,
                                    wanted[i].buffer, error);
    }
    return status;
}

static int prepare(struct terms *m, struct nacre_error *error)
{
    const struct layout *l = &m->layouts[0];
    size_t terms = (size_t)l->sizes.terms, padded = (terms + 1) / 2 * 2;
    size_t items = (size_t)l->sizes.blocks * (size_t)l->sizes.height;
    size_t lanes = (size_t)m->data->copies[0].lanes;
    size_t area = (size_t)m->data->grid.window * (size_t)m->data->grid.window;
    m->partials = malloc((2 * items + 1) * sizeof *m->partials);
    m->staged = malloc((area * terms + 1) * sizeof *m->staged); /* never of nothing */
    m->window = malloc(area * sizeof *m->window);
    if (!m->partials || !m->staged || !m->window) {
        return nacre_fail_memory(error, "the method");
    }
    int status = build(m, error);
    if (status == NACRE_OK) {
        status = place_weights(m, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(l, 2 * items * padded * lanes * sizeof(float), NULL, false,
                                    &m->gradient, error);
    }
    if (status == NACRE_OK) {
        status = layout_make_buffer(l, 2 * items * sizeof(float), NULL, false, &m->beyond, error);
    }
    m->curvature_floats = items * TERMS_SQUARES * padded * padded * lanes;
    if (status == NACRE_OK) {
        status = prepare_equations(m, error);
    }
    for (int c = 0; c < m->data->responses->channels && status == NACRE_OK; c++) {
        status = prepare_channel(m, c, error);
    }
    return status;
}

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
    float *values = malloc((plane_floats(m) + 1) * sizeof *values);
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
        status = prepare(m, error);
    }
    for (int i = 0; i < terms_data_sets(m->data) && status == NACRE_OK; i++) {
        status = start_set(m, problem, i, error);
    }
    if (status == NACRE_OK) {
        *method = &m->method;
    } else {
        terms_free(&m->method);
    }
    return status;
}
