/* Asking for the white layer until check frames show that it was done. */
#include "rig/sequence_layer.h"

/* How often the person is asked for one change of the layer. */
enum { REQUESTS = 3 };

/* Ask the person, whose time it is. */
static int ask(struct sequence_layer *layer, bool on, struct nacre_error *error)
{
    const struct sequence_operator *person = layer->person;
    int64_t began_ns = clock_now_ns(layer->clock);
    int status = person->white_layer(person->context, on, error);
    layer->person_ns += clock_now_ns(layer->clock) - began_ns;
    return status;
}

/* Ask until a check frame shows that it was done; SEQUENCE_INSISTED where the person insists and may. */
static int ask_and_check(struct sequence_layer *layer, bool on, bool may_insist,
                         struct layer_finding *finding, struct nacre_error *error)
{
    const struct sequence_operator *person = layer->person;
    int status = layer_check_before(&layer->check, error);
    for (int i = 0; i < REQUESTS && status == NACRE_OK; i++) {
        if (i > 0 && person->layer_doubted) {
            person->layer_doubted(person->context, finding->why);
        }
        status = ask(layer, on, error);
        if (status == SEQUENCE_INSISTED && !may_insist) {
            status = NACRE_OK;
        }
        if (status == NACRE_OK) {
            status = layer_check_after(&layer->check, on, finding, error);
        }
        if (status == NACRE_OK &&
            (finding->verdict == LAYER_RIGHT || finding->verdict == LAYER_MOVED)) {
            return NACRE_OK;
        }
    }
    return status == NACRE_OK
               ? nacre_fail(error, "white layer: asked %d times to %s. %s; see to it and resume",
                            REQUESTS, on ? "lay it on" : "take it off", finding->why)
               : status;
}

static int set_checked(struct sequence_layer *layer, bool on, struct nacre_error *error)
{
    struct layer_finding finding = {.why = ""};
    int status = ask_and_check(layer, on, true, &finding, error);
    if (status == NACRE_OK && finding.verdict == LAYER_MOVED) {
        return nacre_fail(
            error, "%s since this session's calibration; put it back, or begin a new session",
            finding.why);
    }
    layer->insisted += status == SEQUENCE_INSISTED;
    return status;
}

int sequence_layer_set(struct sequence_layer *layer, bool on, struct nacre_error *error)
{
    if (layer->known && layer->on == on) {
        return NACRE_OK;
    }
    int status = layer->checked ? set_checked(layer, on, error) : ask(layer, on, error);
    status = status == SEQUENCE_INSISTED ? NACRE_OK : status;
    layer->known = status == NACRE_OK;
    layer->on = on;
    return status;
}

int sequence_layer_verify(struct sequence_layer *layer, const char *source, double *worst_px,
                          struct nacre_error *error)
{
    struct layer_finding finding = {.why = ""};
    int status = ask_and_check(layer, true, false, &finding, error);
    *worst_px = finding.difference.worst_px;
    layer->known = status == NACRE_OK;
    layer->on = true;
    if (status == NACRE_OK && finding.verdict == LAYER_MOVED) {
        return nacre_fail(error,
                          "%s: its calibration does not hold any longer. %s by more than %.2f "
                          "pixels; resume the new session, which measures its own",
                          source, finding.why, layer_moved_px);
    }
    return status;
}

void sequence_layer_finish(struct sequence_layer *layer)
{
    layer_check_finish(&layer->check);
}
