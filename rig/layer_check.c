/* Check frames of the white layer, and what they say. */
#include "rig/layer_check.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Two frames of one state differ by what lamp and wheel do from minute to minute, some hundredths. A translucent sample
 * spreads each dot over its neighbourhood and takes away most of its contrast: on the virtual station gains are 0.22, and 0.55
 * where dots saturate on the layer. Between these limits nothing is claimed. */
static const double same_gain = 0.12, same_rest = 0.1;
static const double changed_gain = 0.25, changed_rest = 0.2;

/* A quarter of a pixel is a sixteenth of a surface point at 4 pixels a point, and what dots' centres, which are known to
 * some hundredths, tell safely. */
const double layer_moved_px = 0.25;

/* More pixels at full scale than these would hide dots. */
static const double saturated_share = 0.001;
static const double saturated_limit = 0.5;

static size_t pixels_of(const struct layer_check *check)
{
    const struct camera *camera = check->exposer->devices->camera;
    return (size_t)camera->width * (size_t)camera->height;
}

static int full_scale_of(const struct layer_check *check)
{
    return (1 << check->exposer->devices->camera->bits) - 1;
}

void layer_check_remember(struct layer_check *check, const struct pattern_frames *frames)
{
    size_t pixels = pixels_of(check);
    if (frames->pattern.kind != PATTERN_DOTS || frames->pattern.number != 0 || frames->count == 0 ||
        !check->frames) {
        return;
    }
    size_t index = frames->count - 1; /* the longest has the least noise */
    while (index > 0 && frame_saturation(frames->exposures[index].raw, pixels,
                                         full_scale_of(check)) > saturated_share) {
        index--;
    }
    memcpy(check->frames, frames->exposures[index].raw, pixels * sizeof *check->frames);
    check->exposure_ns = frames->exposures[index].exposure_ns;
    check->known = check->on_layer = true;
}

int layer_check_begin(struct layer_check *check, struct exposer *exposer,
                      const struct session *session, uint8_t *levels, struct nacre_error *error)
{
    *check = (struct layer_check){.exposer = exposer, .session = session};
    check->levels = levels;
    check->frames = calloc(3 * pixels_of(check), sizeof *check->frames);
    return check->frames ? NACRE_OK : nacre_fail_memory(error, "check frames");
}

int layer_check_recall(struct layer_check *check, const struct session *from,
                       struct nacre_error *error)
{
    const struct pattern first = {PATTERN_DOTS, 0};
    struct pattern_frames frames;
    if (!session_has(from, first)) {
        return NACRE_OK;
    }
    int status = session_read(from, first, &frames, error);
    if (status == NACRE_OK) {
        layer_check_remember(check, &frames);
        pattern_frames_finish(&frames);
    }
    return status;
}

void layer_check_finish(struct layer_check *check)
{
    free(check->frames);
    *check = (struct layer_check){0};
}

/* Take frame number `index` of the three. */
static int expose(struct layer_check *check, size_t index, int64_t flip_ns,
                  struct nacre_error *error)
{
    struct exposure exposure = {.exposure_ns = check->exposure_ns,
                                .flip_ns = flip_ns,
                                .raw = check->frames + index * pixels_of(check)};
    return exposer_expose(check->exposer, &exposure, error);
}

static int show(struct layer_check *check, int64_t *flip_ns, struct nacre_error *error)
{
    const struct projector *projector = check->exposer->devices->projector;
    plan_draw(&check->session->plan, (struct pattern){PATTERN_DOTS, 0}, projector->width,
              projector->height, check->levels);
    return exposer_show(check->exposer, check->levels, flip_ns, error);
}

/* Exposures of the dots that are shown. */
typedef int look_fn(struct layer_check *check, int64_t flip_ns, struct nacre_error *error);

/* Show the dots and look at them; again from the beginning where they did not stay on the glass. */
static int show_and_look(struct layer_check *check, look_fn *look, struct nacre_error *error)
{
    struct exposer *exposer = check->exposer;
    struct projector *projector = exposer->devices->projector;
    for (int tries = exposer->retries;; tries--) {
        int64_t flip_ns = 0;
        int status = show(check, &flip_ns, error);
        if (status == NACRE_OK) {
            status = look(check, flip_ns, error);
        }
        if (status != NACRE_OK || !projector->ops->confirm) {
            return status;
        }
        status = projector->ops->confirm(projector, error);
        if (status != NACRE_FAILED || tries == 0) {
            return status;
        }
        exposer->retaken[RETAKE_SHOW]++;
    }
}

/* The longest exposure of the plan that does not saturate, which has the least noise. */
static int find_exposure(struct layer_check *check, int64_t flip_ns, struct nacre_error *error)
{
    size_t index = check->session->plan.exposure_count;
    double saturation = 1;
    int status = NACRE_OK;
    while (status == NACRE_OK && index > 0 && saturation > saturated_share) {
        check->exposure_ns = session_exposure_ns(check->session, --index);
        status = expose(check, 0, flip_ns, error);
        saturation = frame_saturation(check->frames, pixels_of(check), full_scale_of(check));
    }
    return status;
}

int layer_check_before(struct layer_check *check, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (!check->known || !check->on_layer) {
        check->exposer->checking = true;
        status = show_and_look(check, find_exposure, error);
        check->exposer->checking = false;
        check->known = status == NACRE_OK;
        check->on_layer = false;
    }
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "check frame of the white layer");
    }
    return status;
}

enum layer_verdict layer_judge(const struct frame_difference *difference, bool on, bool on_layer)
{
    double gain = fabs(difference->gain - 1);
    bool told = isfinite(difference->doubt) && difference->saturated < saturated_limit;
    bool same = told && gain <= same_gain && difference->rest <= same_rest &&
                difference->doubt <= same_rest;
    bool changed = told && (gain >= changed_gain || (difference->rest >= changed_rest &&
                                                     difference->rest >= 2 * difference->doubt));
    if (on_layer && on) {
        bool moved = told && gain <= same_gain && difference->worst_px > layer_moved_px;
        return moved ? LAYER_MOVED : same ? LAYER_RIGHT : changed ? LAYER_WRONG : LAYER_UNCLEAR;
    }
    /* Of a layer laid on dots are brighter and sharper than before, of one taken off less so. */
    bool right_way = on_layer || (difference->gain > 1) == on;
    return changed ? (right_way ? LAYER_RIGHT : LAYER_WRONG) : same ? LAYER_WRONG : LAYER_UNCLEAR;
}

static void explain(bool on, bool on_layer, struct layer_finding *finding)
{
    const struct frame_difference *d = &finding->difference;
    enum layer_verdict verdict = finding->verdict;
    char *why = finding->why;
    size_t size = sizeof finding->why;
    double gain = 100 * d->gain;
    double rest = 100 * d->rest;
    if (verdict == LAYER_MOVED) {
        (void)snprintf(why, size,
                       "Dots lie up to %.2f pixels from where they were (in the mean %.2f to the "
                       "right, %.2f down): camera, projector or sample has moved",
                       d->worst_px, d->right_px, d->down_px);
    } else if (verdict == LAYER_UNCLEAR) {
        (void)snprintf(why, size,
                       "From the check frame it cannot be told whether the white layer is %s: "
                       "contrast %.0f %% of what it was, %.0f %% of the picture different, %.0f %% "
                       "of it saturated",
                       on ? "on" : "off", gain, rest, 100 * d->saturated);
    } else if (on && on_layer) {
        (void)snprintf(why, size,
                       "The check frame does not look as it did with the white layer on: contrast "
                       "%.0f %% of what it was, %.0f %% of the picture different",
                       gain, rest);
    } else if (fabs(d->gain - 1) > changed_gain) {
        (void)snprintf(
            why, size,
            "The dots have %.0f %% of the contrast that they had before, as if the white "
            "layer had been %s",
            gain, on ? "taken off" : "laid on");
    } else {
        (void)snprintf(why, size,
                       "The check frame shows no change: the white layer %s, or the sample looks "
                       "just like it",
                       on ? "was not laid on, or was on before" : "is still on");
    }
}

static int expose_twice(struct layer_check *check, int64_t flip_ns, struct nacre_error *error)
{
    int status = expose(check, 1, flip_ns, error);
    return status == NACRE_OK ? expose(check, 2, flip_ns, error) : status;
}

int layer_check_after(struct layer_check *check, bool on, struct layer_finding *finding,
                      struct nacre_error *error)
{
    const struct camera *camera = check->exposer->devices->camera;
    size_t pixels = pixels_of(check);
    check->exposer->checking = true;
    int status = show_and_look(check, expose_twice, error);
    check->exposer->checking = false;
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "check frame of the white layer");
    }
    if (status != NACRE_OK) {
        return status;
    }
    const struct frame_pair pair = {.before = check->frames,
                                    .now = check->frames + pixels,
                                    .again = check->frames + 2 * pixels,
                                    .width = camera->width,
                                    .height = camera->height,
                                    .full_scale = full_scale_of(check)};
    finding->difference = frame_compare(&pair);
    finding->verdict = layer_judge(&finding->difference, on, check->on_layer);
    explain(on, check->on_layer, finding);
    if (!check->on_layer && finding->verdict == LAYER_WRONG) {
        /* What was done was the opposite, or nothing: that is what the next deed changes. */
        memcpy(check->frames, pair.now, pixels * sizeof *check->frames);
    }
    return NACRE_OK;
}
