/* Saving and loading the state of the method terms.
 *
 * A channel that planes are shared through has the set's: what is no plane; then the model, what waits and the last best step
 * of each side; then the curvature. All channels have their kernels, behind that. */
#include "factor/terms_steps.h"

#include <math.h>
#include <string.h>

struct saved {
    double objective;
    float share, share_limit, damping;
    int32_t accepted, refused, settled, placed, burst;
};

enum { SAVED_PLANES = 3 };

static size_t set_bytes(const struct terms *m)
{
    size_t planes = (size_t)m->sides * SAVED_PLANES * terms_plane_floats(m);
    return sizeof(struct saved) + (planes + m->curvature_floats) * sizeof(float);
}

size_t terms_state_size(const struct method *method, int channel)
{
    const struct terms *m = (const struct terms *)method;
    size_t kernels = 2 * terms_number_count(m) * sizeof(float);
    return kernels + (terms_has_set(m, channel) ? set_bytes(m) : 0);
}

static cl_mem saved_planes(const struct terms_set *set, int i)
{
    const struct terms_track *t = &set->tracks[i / SAVED_PLANES];
    const cl_mem planes[] = {t->good, t->next, t->last};
    return planes[i % SAVED_PLANES];
}

static int save_set(struct terms *m, const struct terms_set *set, void *state,
                    struct nacre_error *error)
{
    struct layout *l = &m->layouts[0];
    const struct saved saved = {.objective = set->objective,
                                .share = set->share,
                                .share_limit = set->share_limit,
                                .damping = set->damping,
                                .accepted = set->accepted,
                                .refused = set->refused,
                                .settled = set->settled,
                                .placed = set->placed,
                                .burst = set->burst};
    float *to = (float *)((char *)state + sizeof saved);
    int status = NACRE_OK;
    memset(state, 0, sizeof saved);
    memcpy(state, &saved, sizeof saved);
    for (int i = 0; i < m->sides * SAVED_PLANES && status == NACRE_OK; i++) {
        status = layout_read_factor(l, saved_planes(set, i), to, error);
        to += terms_plane_floats(m);
    }
    return status == NACRE_OK
               ? opencl_check(l->opencl,
                              clEnqueueReadBuffer(l->opencl->queue, set->curvature, CL_TRUE, 0,
                                                  m->curvature_floats * sizeof *to, to, 0, NULL,
                                                  NULL),
                              "cannot read the curvature", error)
               : status;
}

int terms_save_state(struct method *method, int channel, void *state, struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    size_t count = terms_number_count(m);
    bool has_set = terms_has_set(m, channel);
    float *to = (float *)((char *)state + (has_set ? set_bytes(m) : 0));
    memcpy(to, m->channels[channel].good, count * sizeof *to);
    memcpy(to + count, m->channels[channel].next, count * sizeof *to);
    return has_set ? save_set(m, &m->sets[channel], state, error) : NACRE_OK;
}

static int load_set(struct terms *m, struct terms_set *set, int channel, const void *state,
                    struct nacre_error *error)
{
    struct layout *l = &m->layouts[0];
    const float *from = (const float *)((const char *)state + sizeof(struct saved));
    struct saved saved;
    int status = NACRE_OK;
    memcpy(&saved, state, sizeof saved);
    if (saved.accepted < 0 || saved.refused < 0 || saved.burst < 0 || !isfinite(saved.share) ||
        !isfinite(saved.share_limit) || !isfinite(saved.damping) || isnan(saved.objective) ||
        saved.damping < 1) {
        return nacre_fail(error, "the saved state of channel %d is none of terms", channel);
    }
    for (int i = 0; i < m->sides * SAVED_PLANES && status == NACRE_OK; i++) {
        status = layout_write_factor(l, saved_planes(set, i), from, error);
        from += terms_plane_floats(m);
    }
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
    return status == NACRE_OK
               ? opencl_check(l->opencl,
                              clEnqueueWriteBuffer(l->opencl->queue, set->curvature, CL_TRUE, 0,
                                                   m->curvature_floats * sizeof *from, from, 0,
                                                   NULL, NULL),
                              "cannot write the curvature", error)
               : status;
}

int terms_load_state(struct method *method, int channel, const void *state,
                     struct nacre_error *error)
{
    struct terms *m = (struct terms *)method;
    size_t count = terms_number_count(m);
    bool has_set = terms_has_set(m, channel);
    const float *from = (const float *)((const char *)state + (has_set ? set_bytes(m) : 0));
    int status = has_set ? load_set(m, &m->sets[channel], channel, state, error) : NACRE_OK;
    if (status != NACRE_OK) {
        return status;
    }
    memcpy(m->channels[channel].good, from, count * sizeof *from);
    memcpy(m->channels[channel].next, from + count, count * sizeof *from);
    return terms_place_kernels(m, channel, m->channels[channel].next, error);
}
