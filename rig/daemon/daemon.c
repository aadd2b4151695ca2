/* The loop of sd-event, and what it waits for: the bus, the job, signals, and the watchdog's next turn. */
#include "rig/daemon/daemon.h"

#include <errno.h>
#include <signal.h>
#include <sys/epoll.h>
#include <systemd/sd-daemon.h>
#include <systemd/sd-event.h>
#include <time.h>

/* What the callbacks share. */
struct service {
    sd_event *event;
    struct job *job;
    struct bus *bus;
    uint64_t watchdog_us; /* of silence after which the manager kills us; 0: never */
    bool stopping;
};

static bool is_active(struct service *service)
{
    struct job_status now;
    job_read(service->job, &now);
    return job_is_active(now.state);
}

/* End the loop when nothing is left to do: when asked to stop, as soon as the job has stopped; when nobody can be heard
 * any more, as soon as the job has ended or waits for somebody. */
static void end_if_due(struct service *service)
{
    struct job_status now;
    job_read(service->job, &now);
    bool held = now.state == JOB_WAITING || now.state == JOB_PAUSED;
    if (service->stopping && !job_is_active(now.state)) {
        (void)sd_event_exit(service->event, 0);
    } else if (bus_is_lost(service->bus) && (held || !job_is_active(now.state))) {
        (void)sd_event_exit(service->event, -ECONNRESET);
    }
}

static int on_job(sd_event_source *source, int file, uint32_t events, void *context)
{
    struct service *service = context;
    (void)source;
    (void)file;
    (void)events;
    job_clear_event(service->job);
    bus_publish(service->bus);
    end_if_due(service);
    return 0;
}

static int on_signal(sd_event_source *source, const struct signalfd_siginfo *info, void *context)
{
    struct service *service = context;
    (void)source;
    (void)info;
    service->stopping = true;
    (void)sd_notify(0, "STOPPING=1");
    if (is_active(service)) {
        (void)job_cancel(service->job, NULL); /* it may have ended by itself */
    }
    bus_publish(service->bus);
    end_if_due(service);
    return 0;
}

/* Say that we live, if the job's thread does too. */
static int on_watchdog(sd_event_source *source, uint64_t due_us, void *context)
{
    (void)due_us;
    struct service *service = context;
    uint64_t turn_us = service->watchdog_us ? service->watchdog_us / 4 : 1000000;
    if (service->watchdog_us && job_is_alive(service->job, (int64_t)service->watchdog_us * 1000)) {
        (void)sd_notify(0, "WATCHDOG=1");
    }
    end_if_due(service); /* the bus may have been lost */
    int result = sd_event_source_set_time_relative(source, turn_us);
    return result < 0 ? result : sd_event_source_set_enabled(source, SD_EVENT_ONESHOT);
}

static int add_sources(struct service *service)
{
    sd_event *event = service->event;
    int result = sd_event_add_signal(event, NULL, SIGTERM, on_signal, service);
    if (result >= 0) {
        result = sd_event_add_signal(event, NULL, SIGINT, on_signal, service);
    }
    if (result >= 0) {
        result = sd_event_add_io(event, NULL, job_event_fd(service->job), EPOLLIN, on_job, service);
    }
    if (result >= 0) {
        result = sd_event_add_time(event, NULL, CLOCK_MONOTONIC, 0, 0, on_watchdog, service);
    }
    if (result >= 0) {
        result = sd_watchdog_enabled(0, &service->watchdog_us);
    }
    return result;
}

/* Signals are for the loop alone: threads inherit what is blocked here. */
static void block_signals(void)
{
    sigset_t signals;
    (void)sigemptyset(&signals);
    (void)sigaddset(&signals, SIGTERM);
    (void)sigaddset(&signals, SIGINT);
    (void)sigprocmask(SIG_BLOCK, &signals, NULL); /* fails for unknown signals only */
}

int daemon_run(const struct bus_settings *settings, const struct job_opener *opener,
               struct nacre_error *error)
{
    struct service service = {0};
    int result;
    block_signals();
    int status = job_new(opener, &service.job, error);
    if (status != NACRE_OK) {
        goto out;
    }
    result = sd_event_new(&service.event);
    if (result < 0) {
        status = nacre_fail_errno(error, -result, "cannot make an event loop");
        goto out;
    }
    status = bus_new(settings, service.job, service.event, &service.bus, error);
    if (status != NACRE_OK) {
        goto out;
    }
    result = add_sources(&service);
    if (result < 0) {
        status = nacre_fail_errno(error, -result, "cannot fill the event loop");
        goto out;
    }
    bus_publish(service.bus);
    (void)sd_notify(0, "READY=1");
    result = sd_event_loop(service.event);
    if (result < 0) {
        status = nacre_fail_errno(error, -result, "the bus was lost, or the event loop failed");
    }
out:
    bus_free(service.bus);
    job_free(service.job);
    sd_event_unref(service.event);
    return status;
}
