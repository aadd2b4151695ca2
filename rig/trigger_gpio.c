/* The trigger on a GPIO line. */
#include "rig/trigger_gpio.h"

#include <errno.h>
#include <inttypes.h>
#include <pthread.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>

/* Before an edge is due the clock is watched for this long, as waking up takes its time. */
static const int64_t watch_ns = 150000;
/* More than the kernel queues of one line's edges. */
enum { QUEUED_EDGES = 64, PRIORITY = 40 };

struct gpio_trigger {
    struct trigger base;
    struct clock *clock;
    struct trigger_gpio_settings settings; /* with strings of our own */
    struct gpio_pin output, index;         /* closed after they failed */
};

/* An edge that we made: it happened at `at_ns`, give or take `doubt_ns`. */
struct edge {
    int64_t at_ns, doubt_ns;
};

/* How a thread was scheduled before it was given priority. */
struct schedule {
    int policy;
    struct sched_param parameters;
    bool changed;
};

/* Without the right to it, pulses are as long as the system lets them be, which is measured. */
static struct schedule take_priority(void)
{
    struct schedule before = {0};
    const struct sched_param wanted = {.sched_priority = PRIORITY};
    if (pthread_getschedparam(pthread_self(), &before.policy, &before.parameters) == 0) {
        before.changed = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted) == 0;
    }
    return before;
}

static void give_priority_back(const struct schedule *before)
{
    if (before->changed) {
        (void)pthread_setschedparam(pthread_self(), before->policy, &before->parameters);
    }
}

static bool has_index(const struct gpio_trigger *trigger)
{
    return trigger->settings.index.name || trigger->settings.index.chip;
}

static void drop(struct gpio_trigger *trigger)
{
    gpio_pin_close(&trigger->output);
    gpio_pin_close(&trigger->index);
}

/* Take the lines if they are not. */
static int connect(struct gpio_trigger *trigger, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (!trigger->output.line) {
        status = gpio_pin_open(&trigger->settings.output, GPIO_OUTPUT, &trigger->output, error);
    }
    if (status == NACRE_OK && has_index(trigger) && !trigger->index.line) {
        status = gpio_pin_open(&trigger->settings.index, GPIO_INPUT, &trigger->index, error);
    }
    return status;
}

/* Fail for a line that a call failed on, and let go of the lines. */
static int fail_line(struct gpio_trigger *trigger, const struct gpio_pin *pin, int number,
                     struct nacre_error *error)
{
    int status =
        number == ENODEV
            ? nacre_fail(error, "%s: its chip is gone; plug it in again, or load its driver",
                         pin->what)
            : nacre_fail_errno(error, number, "%s: the pulse failed", pin->what);
    drop(trigger);
    return status;
}

/* Wait for the colour wheel; edges that came before now count for nothing. */
static int wait_index(struct gpio_trigger *trigger, int64_t *edge_ns, struct nacre_error *error)
{
    const struct gpio_pin *pin = &trigger->index;
    int64_t began_ns = clock_now_ns(trigger->clock);
    int64_t left_ns = trigger->settings.index_limit_ns;
    int number = 0;
    for (int i = 0; i < QUEUED_EDGES && number == 0; i++) {
        number = gpio_line_wait(pin->line, left_ns, edge_ns);
        if (number == 0 && *edge_ns >= began_ns) {
            return NACRE_OK;
        }
        left_ns = began_ns + trigger->settings.index_limit_ns - clock_now_ns(trigger->clock);
        left_ns = left_ns > 0 ? left_ns : 0;
    }
    if (number != 0 && number != ETIMEDOUT) {
        return fail_line(trigger, pin, number, error);
    }
    return nacre_fail(error,
                      "%s: no index pulse of the colour wheel within %" PRId64
                      " ms; does the projector run, and is the sensor connected?",
                      pin->what, trigger->settings.index_limit_ns / 1000000);
}

/* Switch the output when it is due, at once if that has passed. */
static int switch_at(struct gpio_trigger *trigger, int64_t due_ns, bool active, struct edge *edge)
{
    int64_t before_ns = clock_now_ns(trigger->clock);
    if (due_ns - watch_ns > before_ns) {
        clock_sleep_until_ns(trigger->clock, due_ns - watch_ns);
        before_ns = clock_now_ns(trigger->clock);
    }
    while (before_ns < due_ns) {
        before_ns = clock_now_ns(trigger->clock);
    }
    int number = gpio_line_set(trigger->output.line, active);
    edge->doubt_ns = (clock_now_ns(trigger->clock) - before_ns) / 2;
    edge->at_ns = before_ns + edge->doubt_ns;
    return number;
}

/* Whether the pulse was as it should be. */
static int judge(const struct gpio_trigger *trigger, int64_t exposure_ns, int64_t late_ns,
                 struct nacre_error *error)
{
    int64_t limit_ns = trigger->settings.jitter_ns;
    int64_t wrong_ns = trigger->base.pulse.width_ns - exposure_ns;
    if (late_ns > limit_ns) {
        return nacre_fail(error,
                          "%s: the pulse began %" PRId64 " us late, more than %" PRId64 " us",
                          trigger->output.what, late_ns / 1000, limit_ns / 1000);
    }
    if (wrong_ns > limit_ns || wrong_ns < -limit_ns) {
        return nacre_fail(error,
                          "%s: the pulse was %" PRId64 " us too long, more than %" PRId64 " us",
                          trigger->output.what, wrong_ns / 1000, limit_ns / 1000);
    }
    return NACRE_OK;
}

/* One pulse that begins at `due_ns`. */
static int pulse(struct gpio_trigger *trigger, int64_t due_ns, int64_t exposure_ns,
                 struct nacre_error *error)
{
    struct edge rise;
    struct edge fall;
    int number = switch_at(trigger, due_ns, true, &rise);
    if (number == 0) {
        /* The line follows a call by as much as it did before. */
        number = switch_at(trigger, rise.at_ns + exposure_ns - rise.doubt_ns, false, &fall);
    }
    if (number != 0) {
        return fail_line(trigger, &trigger->output, number, error);
    }
    trigger->base.pulse = (struct trigger_pulse){.rise_ns = rise.at_ns,
                                                 .width_ns = fall.at_ns - rise.at_ns,
                                                 .doubt_ns = rise.doubt_ns + fall.doubt_ns};
    return judge(trigger, exposure_ns, rise.at_ns - due_ns, error);
}

static int fire(struct trigger *base, int64_t exposure_ns, int64_t *trigger_ns,
                struct nacre_error *error)
{
    struct gpio_trigger *trigger = (struct gpio_trigger *)base;
    int64_t due_ns = 0;
    base->pulse = (struct trigger_pulse){0};
    if (exposure_ns <= 0) {
        return nacre_fail(error, "trigger gpio: cannot give a pulse of %" PRId64 " ns",
                          exposure_ns);
    }
    int status = connect(trigger, error);
    if (status != NACRE_OK) {
        return status;
    }
    struct schedule before = take_priority();
    if (has_index(trigger)) {
        status = wait_index(trigger, &due_ns, error);
        due_ns += trigger->settings.index_delay_ns;
    } else {
        due_ns = clock_now_ns(trigger->clock);
    }
    if (status == NACRE_OK) {
        status = pulse(trigger, due_ns, exposure_ns, error);
    }
    give_priority_back(&before);
    base->pulse.realtime = before.changed;
    *trigger_ns = base->pulse.rise_ns;
    return status;
}

static void free_place(struct gpio_place *place)
{
    free((char *)place->name);
    free((char *)place->chip);
}

static int copy_place(struct gpio_place *place, const struct gpio_place *from,
                      struct nacre_error *error)
{
    *place = *from;
    place->name = from->name ? strdup(from->name) : NULL;
    place->chip = from->chip ? strdup(from->chip) : NULL;
    bool good = (place->name || !from->name) && (place->chip || !from->chip);
    return good ? NACRE_OK : nacre_fail_memory(error, "a GPIO line's name");
}

static void trigger_close(struct trigger *base)
{
    struct gpio_trigger *trigger = (struct gpio_trigger *)base;
    drop(trigger);
    free_place(&trigger->settings.output);
    free_place(&trigger->settings.index);
    free(trigger);
}

int trigger_gpio_new(const struct trigger_gpio_settings *settings, struct clock *clock,
                     struct trigger **trigger, struct nacre_error *error)
{
    static const struct trigger_ops ops = {.name = "gpio", .fire = fire, .close = trigger_close};
    struct gpio_trigger *made = calloc(1, sizeof *made);
    if (!made) {
        return nacre_fail_memory(error, "a GPIO trigger");
    }
    made->base.ops = &ops;
    made->clock = clock;
    made->settings = *settings;
    int output = copy_place(&made->settings.output, &settings->output, error);
    int index = copy_place(&made->settings.index, &settings->index, error);
    int status = output == NACRE_OK ? index : output;
    if (status == NACRE_OK) {
        status = connect(made, error);
    }
    if (status != NACRE_OK) {
        trigger_close(&made->base);
        made = NULL;
    }
    *trigger = made ? &made->base : NULL;
    return status;
}
