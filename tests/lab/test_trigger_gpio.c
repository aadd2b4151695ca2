/* Tests of the GPIO trigger on chips of gpio-sim. */
#include "rig/trigger_gpio.h"

#include "gpio_sim.h"
#include "guest.h"
#include "unity.h"

#include <inttypes.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* The guest's timer can be late by milliseconds when the host is busy; here pulses are only measured against what the
 * other side of the line saw. */
enum { JITTER_NS = 100000000, MS = 1000000 };

static const char *const names[] = {"shutter", "wheel", NULL};
static struct gpio_sim chip;
static struct clock system_clock;
static struct nacre_error error;
static struct trigger *trigger;

void setUp(void)
{
    error.text[0] = '\0';
    system_clock = clock_monotonic();
    chip = gpio_sim_plug("lines", 4, names);
}

void tearDown(void)
{
    if (trigger) {
        trigger->ops->close(trigger);
        trigger = NULL;
    }
    gpio_sim_unplug(&chip);
}

static struct trigger_gpio_settings settings(void)
{
    return (struct trigger_gpio_settings){.output = {.name = "shutter"},
                                          .index_delay_ns = 20 * MS,
                                          .index_limit_ns = 500 * (int64_t)MS,
                                          .jitter_ns = JITTER_NS};
}

static void open_trigger(const struct trigger_gpio_settings *chosen)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, trigger_gpio_new(chosen, &system_clock, &trigger, &error), error.text);
}

static void refuses(const struct trigger_gpio_settings *chosen, const char *text)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger_gpio_new(chosen, &system_clock, &trigger, &error));
    TEST_ASSERT_NULL(trigger);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, text), error.text);
}

static int64_t fire(int64_t exposure_ns)
{
    int64_t trigger_ns = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, trigger->ops->fire(trigger, exposure_ns, &trigger_ns, &error), error.text);
    return trigger_ns;
}

/* The other side of the output. */
struct observer {
    pthread_t thread;
    atomic_bool stop;
    int active;
    /* Around the pulse; 0: not seen. */
    _Atomic int64_t last_idle_ns, first_active_ns, last_active_ns, first_idle_ns;
};

static void *observe(void *context)
{
    struct observer *observer = context;
    while (!observer->stop) {
        int64_t before_ns = clock_now_ns(&system_clock);
        bool active = gpio_sim_level(&chip, 0) == observer->active;
        int64_t after_ns = clock_now_ns(&system_clock);
        if (active) {
            observer->last_active_ns = before_ns;
            if (!observer->first_active_ns) {
                observer->first_active_ns = after_ns;
            }
        } else if (!observer->first_active_ns) {
            observer->last_idle_ns = before_ns;
        } else if (!observer->first_idle_ns) {
            observer->first_idle_ns = after_ns;
        }
        (void)usleep(200);
    }
    return NULL;
}

/* Wait until the observer has seen something, five seconds at most. */
static void wait_seen(const _Atomic int64_t *time_ns)
{
    for (int i = 0; i < 500 && *time_ns == 0; i++) {
        (void)usleep(10000);
    }
}

/* Fire while the output is observed, and check that the two agree. */
static void fire_observed(int64_t exposure_ns, int active)
{
    struct observer observer = {.active = active};
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&observer.thread, NULL, observe, &observer));
    wait_seen(&observer.last_idle_ns);
    int64_t rise_ns = fire(exposure_ns);
    wait_seen(&observer.first_idle_ns);
    observer.stop = true;
    TEST_ASSERT_EQUAL_INT(0, pthread_join(observer.thread, NULL));
    int64_t fall_ns = rise_ns + trigger->pulse.width_ns;
    int64_t doubt_ns = trigger->pulse.doubt_ns;
    TEST_ASSERT_TRUE(observer.last_idle_ns > 0 && observer.first_idle_ns > 0);
    TEST_ASSERT_TRUE(observer.last_idle_ns <= rise_ns + doubt_ns &&
                     rise_ns - doubt_ns <= observer.first_active_ns);
    TEST_ASSERT_TRUE(observer.last_active_ns <= fall_ns + doubt_ns &&
                     fall_ns - doubt_ns <= observer.first_idle_ns);
}

static void pulse_is_seen_when_and_as_long_as_it_says(void)
{
    struct trigger_gpio_settings chosen = settings();
    open_trigger(&chosen);
    TEST_ASSERT_EQUAL_INT(0, gpio_sim_level(&chip, 0));
    fire_observed(150 * MS, 1);
    TEST_ASSERT_INT64_WITHIN(JITTER_NS, 150 * MS, trigger->pulse.width_ns);
    TEST_ASSERT_EQUAL_INT(0, gpio_sim_level(&chip, 0));
}

static void pulse_of_an_active_low_line_is_low(void)
{
    struct trigger_gpio_settings chosen = settings();
    chosen.output.active_low = true;
    open_trigger(&chosen);
    TEST_ASSERT_EQUAL_INT(1, gpio_sim_level(&chip, 0));
    fire_observed(150 * MS, 0);
    TEST_ASSERT_EQUAL_INT(1, gpio_sim_level(&chip, 0));
}

/* How well pulses are timed here is printed, as it depends on the machine; that none is short by more than its own
 * doubt does not. */
static void pulses_are_never_too_short(void)
{
    struct trigger_gpio_settings chosen = settings();
    chosen.jitter_ns = 5000 * (int64_t)MS; /* a busy host's worst is no matter here */
    int64_t worst_ns = 0;
    int64_t sum_ns = 0;
    open_trigger(&chosen);
    for (int i = 0; i < 40; i++) {
        (void)fire(5 * MS);
        int64_t wrong_ns = trigger->pulse.width_ns - 5 * MS;
        TEST_ASSERT_TRUE(wrong_ns >= -trigger->pulse.doubt_ns);
        worst_ns = wrong_ns > worst_ns ? wrong_ns : worst_ns;
        sum_ns += wrong_ns;
    }
    printf("40 pulses of 5 ms were too long by %" PRId64 " us in the mean and %" PRId64
           " us at most\n",
           sum_ns / 40000, worst_ns / 1000);
}

static void pulse_has_priority_while_it_lasts_only(void)
{
    struct trigger_gpio_settings chosen = settings();
    struct sched_param parameters;
    int policy = -1;
    open_trigger(&chosen);
    (void)fire(MS);
    TEST_ASSERT_TRUE(trigger->pulse.realtime);
    TEST_ASSERT_EQUAL_INT(0, pthread_getschedparam(pthread_self(), &policy, &parameters));
    TEST_ASSERT_EQUAL_INT(SCHED_OTHER, policy);
}

static void pulse_does_without_priority_where_it_is_not_allowed(void)
{
    struct trigger_gpio_settings chosen = settings();
    open_trigger(&chosen);
    TEST_ASSERT_EQUAL_INT(0, seteuid(65534));
    (void)fire(MS);
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_FALSE(trigger->pulse.realtime);
}

static void line_is_found_by_chip_and_offset(void)
{
    const char *const chips[] = {chip.path, strrchr(chip.path, '/') + 1, "lines"};
    for (int i = 0; i < 3; i++) {
        struct trigger_gpio_settings chosen = settings();
        chosen.output = (struct gpio_place){.chip = chips[i], .offset = 0, .active_low = true};
        open_trigger(&chosen);
        TEST_ASSERT_EQUAL_INT(1, gpio_sim_level(&chip, 0));
        trigger->ops->close(trigger);
        trigger = NULL;
    }
}

static void line_is_found_among_several_chips(void)
{
    static const char *const other_names[] = {"fan", "lamp", NULL};
    struct trigger_gpio_settings chosen = settings();
    struct gpio_sim other = gpio_sim_plug("others", 2, other_names);
    chosen.output = (struct gpio_place){.name = "lamp", .active_low = true};
    open_trigger(&chosen);
    TEST_ASSERT_EQUAL_INT(1, gpio_sim_level(&other, 1));
    trigger->ops->close(trigger);
    trigger = NULL;
    chosen.output.chip = "lines";
    refuses(&chosen, "GPIO chip lines: has no line called \"lamp\"");
    gpio_sim_unplug(&other);
}

static void lines_that_are_not_there_are_named(void)
{
    struct trigger_gpio_settings chosen = settings();
    chosen.output.name = "flash";
    refuses(&chosen, "GPIO line \"flash\": no chip has a line of this name; `gpioinfo` lists them");
    chosen.output = (struct gpio_place){.chip = "lines", .offset = 4};
    refuses(&chosen, "has no line 4, as it has 4 lines");
    chosen.output = (struct gpio_place){.chip = "gpiochip99"};
    refuses(&chosen, "GPIO chip gpiochip99: is not there");
    chosen.output = (struct gpio_place){.chip = "/dev/nacre/gpio"};
    refuses(&chosen, "GPIO chip /dev/nacre/gpio: is not there");
    chosen.output = (struct gpio_place){.chip = "/dev/null"};
    refuses(&chosen, "GPIO chip /dev/null: is no GPIO chip");
}

static void machine_without_gpio_is_told(void)
{
    struct trigger_gpio_settings chosen = settings();
    gpio_sim_unplug(&chip);
    refuses(&chosen, "the machine has no GPIO chip");
}

static void chip_without_permission_names_the_remedy(void)
{
    struct trigger_gpio_settings by_name = settings();
    struct trigger_gpio_settings by_chip = settings();
    by_chip.output = (struct gpio_place){.chip = chip.path};
    TEST_ASSERT_EQUAL_INT(0, chmod(chip.path, 0600));
    TEST_ASSERT_EQUAL_INT(0, seteuid(65534));
    int first = trigger_gpio_new(&by_name, &system_clock, &trigger, &error);
    struct nacre_error second_error;
    int second = trigger_gpio_new(&by_chip, &system_clock, &trigger, &second_error);
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, first);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, second);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "70-nacre-gpio.rules"), error.text);
    TEST_ASSERT_EQUAL_STRING(error.text, second_error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, chip.path), error.text);
}

static void busy_line_names_its_holder(void)
{
    struct trigger_gpio_settings chosen = settings();
    open_trigger(&chosen);
    struct trigger *first = trigger;
    trigger = NULL;
    refuses(&chosen, "GPIO line 0 (shutter) of ");
    first->ops->close(first);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "is held by \"nacre\""), error.text);
    open_trigger(&chosen);
}

static void chip_that_is_gone_is_told_and_taken_anew(void)
{
    struct trigger_gpio_settings chosen = settings();
    int64_t trigger_ns = 0;
    open_trigger(&chosen);
    gpio_sim_unplug(&chip);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger->ops->fire(trigger, MS, &trigger_ns, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "its chip is gone; plug it in again"),
                                 error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger->ops->fire(trigger, MS, &trigger_ns, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no GPIO chip"), error.text);
    chip = gpio_sim_plug("lines", 4, names);
    (void)fire(MS);
}

/* The colour wheel: its index goes up every 50 ms. */
struct wheel {
    pthread_t thread;
    atomic_bool stop;
    int64_t before_ns[64], after_ns[64]; /* around each edge */
    int count;
};

static void *turn(void *context)
{
    struct wheel *wheel = context;
    while (!wheel->stop && wheel->count < 64) {
        wheel->before_ns[wheel->count] = clock_now_ns(&system_clock);
        gpio_sim_pull(&chip, 1, 1);
        wheel->after_ns[wheel->count++] = clock_now_ns(&system_clock);
        (void)usleep(25000);
        gpio_sim_pull(&chip, 1, 0);
        (void)usleep(25000);
    }
    return NULL;
}

static void pulse_begins_after_the_wheels_index(void)
{
    struct trigger_gpio_settings chosen = settings();
    struct wheel wheel = {.count = 0};
    chosen.index.name = "wheel";
    open_trigger(&chosen);
    /* More edges than the kernel queues have passed when it matters. */
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&wheel.thread, NULL, turn, &wheel));
    (void)usleep(1200000);
    int64_t asked_ns = clock_now_ns(&system_clock);
    int64_t rise_ns = fire(10 * MS);
    wheel.stop = true;
    TEST_ASSERT_EQUAL_INT(0, pthread_join(wheel.thread, NULL));
    bool found = false;
    for (int i = 0; i < wheel.count; i++) {
        int64_t earliest_ns = wheel.before_ns[i] + chosen.index_delay_ns;
        int64_t latest_ns = wheel.after_ns[i] + chosen.index_delay_ns + JITTER_NS;
        found = found ||
                (wheel.after_ns[i] >= asked_ns && rise_ns >= earliest_ns && rise_ns <= latest_ns);
    }
    TEST_ASSERT_TRUE(found);
}

static void late_pulse_fails(void)
{
    struct trigger_gpio_settings chosen = settings();
    struct wheel wheel = {.count = 0};
    int64_t trigger_ns = 0;
    chosen.index.name = "wheel";
    chosen.index_delay_ns = 0;
    chosen.jitter_ns = 0; /* no pulse follows its index at once */
    open_trigger(&chosen);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&wheel.thread, NULL, turn, &wheel));
    int status = trigger->ops->fire(trigger, MS, &trigger_ns, &error);
    wheel.stop = true;
    TEST_ASSERT_EQUAL_INT(0, pthread_join(wheel.thread, NULL));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "us late"), error.text);
    TEST_ASSERT_EQUAL_INT(0, gpio_sim_level(&chip, 0));
}

static void wheel_that_stands_still_is_told_in_time(void)
{
    struct trigger_gpio_settings chosen = settings();
    int64_t trigger_ns = 0;
    chosen.index.name = "wheel";
    open_trigger(&chosen);
    int64_t began_ns = clock_now_ns(&system_clock);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger->ops->fire(trigger, MS, &trigger_ns, &error));
    TEST_ASSERT_TRUE(clock_now_ns(&system_clock) - began_ns < 2 * chosen.index_limit_ns);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "(wheel)"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(
        strstr(error.text, "no index pulse of the colour wheel within 500 ms"), error.text);
}

static void *unplug_soon(void *context)
{
    (void)context;
    (void)usleep(100000);
    gpio_sim_unplug(&chip);
    return NULL;
}

static void chip_that_goes_during_a_wait_is_told_in_time(void)
{
    struct trigger_gpio_settings chosen = settings();
    pthread_t thread;
    int64_t trigger_ns = 0;
    chosen.index.name = "wheel";
    open_trigger(&chosen);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, unplug_soon, NULL));
    int status = trigger->ops->fire(trigger, MS, &trigger_ns, &error);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "its chip is gone"), error.text);
}

static void pulse_of_no_length_is_refused(void)
{
    struct trigger_gpio_settings chosen = settings();
    int64_t trigger_ns = 0;
    open_trigger(&chosen);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, trigger->ops->fire(trigger, 0, &trigger_ns, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "0 ns"), error.text);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(pulse_is_seen_when_and_as_long_as_it_says);
    RUN_TEST(pulse_of_an_active_low_line_is_low);
    RUN_TEST(pulses_are_never_too_short);
    RUN_TEST(pulse_has_priority_while_it_lasts_only);
    RUN_TEST(pulse_does_without_priority_where_it_is_not_allowed);
    RUN_TEST(line_is_found_by_chip_and_offset);
    RUN_TEST(line_is_found_among_several_chips);
    RUN_TEST(lines_that_are_not_there_are_named);
    RUN_TEST(machine_without_gpio_is_told);
    RUN_TEST(chip_without_permission_names_the_remedy);
    RUN_TEST(busy_line_names_its_holder);
    RUN_TEST(chip_that_is_gone_is_told_and_taken_anew);
    RUN_TEST(pulse_begins_after_the_wheels_index);
    RUN_TEST(late_pulse_fails);
    RUN_TEST(wheel_that_stands_still_is_told_in_time);
    RUN_TEST(chip_that_goes_during_a_wait_is_told_in_time);
    RUN_TEST(pulse_of_no_length_is_refused);
    return UNITY_END();
}
