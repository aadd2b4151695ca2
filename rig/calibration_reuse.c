/* Calibrations that are used again. */
#include "rig/calibration_reuse.h"

#include <stdlib.h>

/* The first dots come first: where taking over is cut short, the rest is measured only if nothing has moved from them. */
static const enum pattern_kind kinds[] = {PATTERN_DOTS, PATTERN_WHITE};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* The stations, but for what has no part in calibrations: the trigger, the sample, the noise's seed. */
static int compare_stations(const struct session *old, const struct session *session,
                            struct nacre_error *error)
{
    char where[256];
    struct station a = old->station; /* borrows its strings */
    const struct station *b = &session->station;
    a.trigger = b->trigger;
    a.plan = b->plan;
    a.camera.tolerance_ms = b->camera.tolerance_ms;
    a.simulated.sample = b->simulated.sample;
    a.simulated.seed = b->simulated.seed;
    if (!settings_same(&station_schema, &a, b, where, sizeof where)) {
        return nacre_fail(error,
                          "%s: its calibration is of another station: %s differs; measure "
                          "calibrations anew (without --calibration)",
                          old->path, where);
    }
    return NACRE_OK;
}

static int compare_plans(const struct session *old, const struct session *session,
                         struct nacre_error *error)
{
    const struct plan *a = &old->plan;
    const struct plan *b = &session->plan;
    const char *where = a->dot_spacing != b->dot_spacing         ? "dot_spacing"
                        : a->dot_shift != b->dot_shift           ? "dot_shift"
                        : a->dot_size != b->dot_size             ? "dot_size"
                        : a->exposure_count != b->exposure_count ? "exposure_turns"
                                                                 : NULL;
    for (size_t i = 0; i < a->exposure_count && !where; i++) {
        where = session_exposure_ns(old, i) != session_exposure_ns(session, i) ? "exposure_turns"
                                                                               : NULL;
    }
    return where ? nacre_fail(error,
                              "%s: its calibration is of another plan: %s differs; use the same, "
                              "or measure calibrations anew (without --calibration)",
                              old->path, where)
                 : NACRE_OK;
}

static int check_complete(const struct session *old, const struct session *session,
                          struct nacre_error *error)
{
    for (int k = 0; k < KINDS; k++) {
        int count = plan_pattern_count(&session->plan, kinds[k]);
        for (int i = 0; i < count; i++) {
            if (!session_has(old, (struct pattern){kinds[k], i})) {
                return nacre_fail(error,
                                  "%s: pattern %s %d was not measured, and its calibration cannot "
                                  "be used; finish it (--resume) or take another session",
                                  old->path, pattern_kind_names[kinds[k]], i);
            }
        }
    }
    return NACRE_OK;
}

int calibration_fits(const struct session *old, const struct session *session,
                     struct nacre_error *error)
{
    int status = compare_stations(old, session, error);
    if (status == NACRE_OK) {
        status = compare_plans(old, session, error);
    }
    return status == NACRE_OK ? check_complete(old, session, error) : status;
}

static int take_over(const struct session *old, const struct session *session,
                     struct pattern pattern, const char *origin, struct nacre_error *error)
{
    struct pattern_frames frames;
    int status = session_read(old, pattern, &frames, error);
    if (status == NACRE_OK) {
        frames.seed = session->plan.seed;
        frames.origin = origin;
        status = session_write(session, &frames, error);
    }
    pattern_frames_finish(&frames);
    return status;
}

int calibration_take_over(const struct session *old, const struct session *session, size_t *count,
                          struct nacre_error *error)
{
    int status = NACRE_OK;
    char *absolute = realpath(old->path, NULL);
    const char *origin = absolute ? absolute : old->path;
    *count = 0;
    for (int k = 0; k < KINDS; k++) {
        int patterns = plan_pattern_count(&session->plan, kinds[k]);
        for (int i = 0; i < patterns && status == NACRE_OK; i++) {
            status = take_over(old, session, (struct pattern){kinds[k], i}, origin, error);
            *count += status == NACRE_OK;
        }
    }
    free(absolute);
    return status;
}
