/* Checks and their verdicts. */
#include "cmd/checks.h"

#include "base/clock.h"

#include <pthread.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static const char *const verdicts[] = {"ok", "warning", "wrong"};

void checks_finish(struct checks *checks)
{
    free(checks->list);
    *checks = (struct checks){0};
}

void checks_add(struct checks *checks, const char *name, enum check_verdict verdict,
                const char *format, ...)
{
    struct check *list = realloc(checks->list, (checks->count + 1) * sizeof *list);
    va_list arguments;
    if (!list) {
        return;
    }
    checks->list = list;
    struct check *check = &list[checks->count++];
    check->name = name;
    check->verdict = verdict;
    va_start(arguments, format);
    (void)vsnprintf(check->text, sizeof check->text, format, arguments);
    va_end(arguments);
}

void checks_add_status(struct checks *checks, const char *name, int status,
                       const struct nacre_error *error)
{
    if (status == NACRE_OK) {
        checks_add(checks, name, CHECK_OK, "ready");
    } else {
        checks_add(checks, name, CHECK_WRONG, "%s", error->text);
    }
}

/* How late sleeping ends: exposures and flips are waited for so. */
static void check_clock(struct checks *checks)
{
    enum { SLEEPS = 20 };
    static const int64_t sleep_ns = 2000000;
    static const double limit_ms = 2;
    struct clock clock = clock_monotonic();
    double worst_ms = 0;
    for (int i = 0; i < SLEEPS; i++) {
        int64_t until_ns = clock_now_ns(&clock) + sleep_ns;
        clock_sleep_until_ns(&clock, until_ns);
        double late_ms = (double)(clock_now_ns(&clock) - until_ns) * 1e-6;
        worst_ms = late_ms > worst_ms ? late_ms : worst_ms;
    }
    checks_add(checks, "clock", worst_ms > limit_ms ? CHECK_WARNING : CHECK_OK,
               "sleeping ends up to %.2f ms late%s", worst_ms,
               worst_ms > limit_ms ? "; the machine is busy with other work" : "");
}

static void check_priority(struct checks *checks, bool times_pulses)
{
    const struct sched_param wanted = {.sched_priority = 40};
    struct sched_param before;
    int policy = 0;
    if (!times_pulses) {
        checks_add(checks, "priority", CHECK_OK, "not needed, as no pulses are timed here");
        return;
    }
    bool allowed = pthread_getschedparam(pthread_self(), &policy, &before) == 0 &&
                   pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted) == 0;
    if (allowed) {
        (void)pthread_setschedparam(pthread_self(), policy, &before);
    }
    checks_add(checks, "priority", allowed ? CHECK_OK : CHECK_WARNING,
               allowed ? "pulses are timed with real-time priority"
                       : "no right to real-time priority, and other programs delay pulses; add "
                         "\"@nacre - rtprio 40\" to /etc/security/limits.conf and log in again");
}

void checks_of_machine(struct checks *checks, bool times_pulses)
{
    check_clock(checks);
    check_priority(checks, times_pulses);
}

size_t checks_count(const struct checks *checks, enum check_verdict verdict)
{
    size_t count = 0;
    for (size_t i = 0; i < checks->count; i++) {
        count += checks->list[i].verdict == verdict;
    }
    return count;
}

void checks_print(const struct checks *checks)
{
    for (size_t i = 0; i < checks->count; i++) {
        const struct check *check = &checks->list[i];
        (void)printf("%-8s %-10s %s\n", verdicts[check->verdict], check->name, check->text);
    }
}

json_t *checks_as_json(const struct checks *checks)
{
    json_t *list = json_array();
    for (size_t i = 0; i < checks->count && list; i++) {
        const struct check *check = &checks->list[i];
        if (json_array_append_new(list,
                                  json_pack("{s:s, s:s, s:s}", "check", check->name, "verdict",
                                            verdicts[check->verdict], "text", check->text)) != 0) {
            json_decref(list);
            list = NULL;
        }
    }
    return list;
}
