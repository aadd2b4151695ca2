/* The interface org.nacre.Station1: what clients may ask, and what they are told. */
#include "rig/daemon/bus.h"

#include "rig/daemon/journal.h"
#include "rig/daemon/names.h"
#include "rig/daemon/sessions.h"
#include "rig/daemon/words.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <syslog.h>
#include <systemd/sd-bus.h>
#include <systemd/sd-daemon.h>

/* Room for a job's message and what to do about it. */
enum { MESSAGE_SIZE = 1400 };

/* The properties, as sd-bus reads them. */
struct shown {
    const char *state, *session, *sessions, *kind, *message;
    uint32_t pattern, patterns, retries, time_left;
};

struct bus {
    const struct bus_settings *settings;
    struct job *job;
    sd_bus *connection;
    struct job_status status; /* as last published */
    struct incomplete *incomplete;
    size_t incomplete_count;
    char message[MESSAGE_SIZE];
    char session[JOB_NAME_SIZE];
    struct shown shown;
};

static int refuse(sd_bus_error *answer, const char *name, struct nacre_error *error)
{
    words_clean(error->text);
    return sd_bus_error_set(answer, name, error->text);
}

/* Clients that asked for something find it in the properties as soon as they are answered. */
static int agree(struct bus *bus, sd_bus_message *message)
{
    bus_publish(bus);
    return sd_bus_reply_method_return(message, "");
}

static bool is_active(struct bus *bus)
{
    struct job_status now;
    job_read(bus->job, &now);
    return job_is_active(now.state);
}

/* What is wrong with a plan's text, by its own name. */
static int check_plan(const char *text, struct nacre_error *error)
{
    struct plan plan = {0};
    int status = plan_parse(STATION_PLAN_NAME, text, strlen(text), &plan, error);
    plan_finish(&plan);
    return status;
}

static int begin(struct bus *bus, const char *name, const struct job_order *order,
                 sd_bus_message *message, sd_bus_error *answer)
{
    struct nacre_error error = {""};
    bus_publish(bus); /* the end of the last job, before it is forgotten */
    if (job_start(bus->job, order, &error) != NACRE_OK) {
        return refuse(answer, STATION_ERROR_FAILED, &error);
    }
    if (name != bus->session) {
        (void)snprintf(bus->session, sizeof bus->session, "%s", name);
    }
    return agree(bus, message);
}

static int start(sd_bus_message *message, void *context, sd_bus_error *answer)
{
    struct bus *bus = context;
    struct nacre_error error = {""};
    const char *name;
    const char *plan;
    int result = sd_bus_message_read(message, "ss", &name, &plan);
    if (result < 0) {
        return result;
    }
    if (sessions_check_name(name, &error) != NACRE_OK) {
        return refuse(answer, STATION_ERROR_BAD_NAME, &error);
    }
    if (is_active(bus)) {
        return sd_bus_error_setf(answer, STATION_ERROR_BUSY,
                                 "%s is being measured; wait for it or stop it (nacre cancel)",
                                 bus->session);
    }
    if (*plan && check_plan(plan, &error) != NACRE_OK) {
        return refuse(answer, STATION_ERROR_BAD_PLAN, &error);
    }
    char *path = sessions_path(bus->settings->sessions, name);
    if (!path) {
        return -ENOMEM;
    }
    enum session_found found = sessions_find(path);
    const struct job_order order = {.path = path,
                                    .station = bus->settings->station,
                                    .plan = *plan ? plan : NULL,
                                    .unfinished = found == SESSION_UNFINISHED};
    result = found == SESSION_THERE
                 ? sd_bus_error_setf(answer, STATION_ERROR_SESSION_EXISTS,
                                     "there is a session %s already; go on with it (nacre resume "
                                     "%s) or choose another name",
                                     name, name)
                 : begin(bus, name, &order, message, answer);
    free(path);
    return result;
}

/* Go on with the job that is paused. */
static int go_on(struct bus *bus, const char *name, sd_bus_message *message, sd_bus_error *answer)
{
    struct nacre_error error = {""};
    if (*name && strcmp(name, bus->session) != 0) {
        return sd_bus_error_setf(answer, STATION_ERROR_BUSY,
                                 "%s is being measured; wait for it or stop it (nacre cancel)",
                                 bus->session);
    }
    if (job_resume(bus->job, &error) != NACRE_OK) {
        return refuse(answer, STATION_ERROR_NOTHING_TO_DO, &error);
    }
    return agree(bus, message);
}

static int resume(sd_bus_message *message, void *context, sd_bus_error *answer)
{
    struct bus *bus = context;
    struct nacre_error error = {""};
    const char *name;
    int result = sd_bus_message_read(message, "s", &name);
    if (result < 0) {
        return result;
    }
    if (is_active(bus)) {
        return go_on(bus, name, message, answer);
    }
    name = *name ? name : bus->session;
    if (!*name) {
        return sd_bus_error_set(answer, STATION_ERROR_NOTHING_TO_DO,
                                "no session is incomplete; begin one with nacre start");
    }
    if (sessions_check_name(name, &error) != NACRE_OK) {
        return refuse(answer, STATION_ERROR_BAD_NAME, &error);
    }
    char *path = sessions_path(bus->settings->sessions, name);
    if (!path) {
        return -ENOMEM;
    }
    const struct job_order order = {.path = path};
    result =
        sessions_find(path) == SESSION_THERE
            ? begin(bus, name, &order, message, answer)
            : sd_bus_error_setf(answer, STATION_ERROR_NO_SUCH_SESSION,
                                "there is no session %s; begin it with nacre start %s", name, name);
    free(path);
    return result;
}

/* The methods that take nothing. */
static int ask(struct bus *bus, int (*request)(struct job *, struct nacre_error *),
               sd_bus_message *message, sd_bus_error *answer)
{
    struct nacre_error error = {""};
    if (request(bus->job, &error) != NACRE_OK) {
        return refuse(answer, STATION_ERROR_NOTHING_TO_DO, &error);
    }
    return agree(bus, message);
}

static int pause_job(sd_bus_message *message, void *context, sd_bus_error *answer)
{
    return ask(context, job_pause, message, answer);
}

static int cancel(sd_bus_message *message, void *context, sd_bus_error *answer)
{
    return ask(context, job_cancel, message, answer);
}

static int confirm(sd_bus_message *message, void *context, sd_bus_error *answer)
{
    return ask(context, job_confirm, message, answer);
}

static int insist(sd_bus_message *message, void *context, sd_bus_error *answer)
{
    return ask(context, job_insist, message, answer);
}

static int get_incomplete(sd_bus *connection, const char *path, const char *interface,
                          const char *property, sd_bus_message *reply, void *context,
                          sd_bus_error *answer)
{
    struct bus *bus = context;
    (void)connection;
    (void)path;
    (void)interface;
    (void)property;
    (void)answer;
    int result = sd_bus_message_open_container(reply, 'a', "s");
    for (size_t i = 0; i < bus->incomplete_count && result >= 0; i++) {
        result = sd_bus_message_append(reply, "s", bus->incomplete[i].name);
    }
    return result < 0 ? result : sd_bus_message_close_container(reply);
}

/* Who may call what is said by the bus's policy, not by sd-bus: hence UNPRIVILEGED. */
static const sd_bus_vtable interface[] = {
    SD_BUS_VTABLE_START(0),
    SD_BUS_METHOD_WITH_ARGS("Start", SD_BUS_ARGS("s", name, "s", plan), SD_BUS_NO_RESULT, start,
                            SD_BUS_VTABLE_UNPRIVILEGED),
    SD_BUS_METHOD_WITH_ARGS("Pause", SD_BUS_NO_ARGS, SD_BUS_NO_RESULT, pause_job,
                            SD_BUS_VTABLE_UNPRIVILEGED),
    SD_BUS_METHOD_WITH_ARGS("Resume", SD_BUS_ARGS("s", name), SD_BUS_NO_RESULT, resume,
                            SD_BUS_VTABLE_UNPRIVILEGED),
    SD_BUS_METHOD_WITH_ARGS("Cancel", SD_BUS_NO_ARGS, SD_BUS_NO_RESULT, cancel,
                            SD_BUS_VTABLE_UNPRIVILEGED),
    SD_BUS_METHOD_WITH_ARGS("Confirm", SD_BUS_NO_ARGS, SD_BUS_NO_RESULT, confirm,
                            SD_BUS_VTABLE_UNPRIVILEGED),
    SD_BUS_METHOD_WITH_ARGS("Insist", SD_BUS_NO_ARGS, SD_BUS_NO_RESULT, insist,
                            SD_BUS_VTABLE_UNPRIVILEGED),
    SD_BUS_SIGNAL_WITH_ARGS("Asked", SD_BUS_ARGS("s", message), 0),
    SD_BUS_SIGNAL_WITH_ARGS("Finished", SD_BUS_ARGS("s", name, "b", ok, "s", message), 0),
    SD_BUS_PROPERTY("State", "s", NULL, offsetof(struct bus, shown.state),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("Session", "s", NULL, offsetof(struct bus, shown.session),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("Sessions", "s", NULL, offsetof(struct bus, shown.sessions),
                    SD_BUS_VTABLE_PROPERTY_CONST),
    SD_BUS_PROPERTY("Kind", "s", NULL, offsetof(struct bus, shown.kind),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("Pattern", "u", NULL, offsetof(struct bus, shown.pattern),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("Patterns", "u", NULL, offsetof(struct bus, shown.patterns),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("Retries", "u", NULL, offsetof(struct bus, shown.retries),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("TimeLeft", "u", NULL, offsetof(struct bus, shown.time_left),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("Message", "s", NULL, offsetof(struct bus, shown.message),
                    SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_PROPERTY("Incomplete", "as", get_incomplete, 0, SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
    SD_BUS_VTABLE_END};

static void refresh_incomplete(struct bus *bus)
{
    struct nacre_error error = {""};
    incomplete_free(bus->incomplete, bus->incomplete_count);
    if (sessions_list_incomplete(bus->settings->sessions, &bus->incomplete, &bus->incomplete_count,
                                 &error) != NACRE_OK) {
        journal_write(LOG_WARNING, &bus->status, error.text);
    }
}

/* Before the first job: what an earlier daemon left undone. */
static void show_interrupted(struct bus *bus)
{
    const struct incomplete *last = &bus->incomplete[0];
    size_t others = bus->incomplete_count - 1;
    int used = snprintf(bus->message, sizeof bus->message,
                        "%s lacks %zu of %zu patterns; `nacre resume %s` goes on", last->name,
                        last->patterns - last->done, last->patterns, last->name);
    if (others > 0) {
        (void)snprintf(bus->message + used, sizeof bus->message - (size_t)used,
                       "; %zu more session%s incomplete", others, others == 1 ? " is" : "s are");
    }
    (void)snprintf(bus->session, sizeof bus->session, "%s", last->name);
    bus->shown.state = "interrupted";
    bus->shown.pattern = (uint32_t)last->done;
    bus->shown.patterns = (uint32_t)last->patterns;
}

/* A failure is told with the way on, if there is something to go on with. */
static void add_remedy(struct bus *bus)
{
    char *path = sessions_path(bus->settings->sessions, bus->session);
    size_t used = strlen(bus->message);
    if (path && sessions_find(path) == SESSION_THERE) {
        (void)snprintf(bus->message + used, sizeof bus->message - used,
                       "; then `nacre resume %s` goes on", bus->session);
    }
    free(path);
}

/* Make the properties from the status. */
static void show(struct bus *bus)
{
    const struct job_status *status = &bus->status;
    bool measuring =
        status->state == JOB_RUNNING || status->state == JOB_WAITING || status->state == JOB_PAUSED;
    bus->shown = (struct shown){.state = words_state(status->state),
                                .session = bus->session,
                                .sessions = bus->settings->sessions,
                                .kind = measuring ? pattern_kind_names[status->pattern.kind] : "",
                                .message = bus->message,
                                .pattern = (uint32_t)status->done,
                                .patterns = (uint32_t)status->patterns,
                                .retries = (uint32_t)status->retries,
                                .time_left = (uint32_t)status->seconds_left};
    words_describe(status, bus->message, sizeof bus->message);
    if (status->state == JOB_FAILED) {
        add_remedy(bus);
    }
    if (status->state == JOB_IDLE && bus->incomplete_count > 0) {
        show_interrupted(bus);
    }
    words_clean(bus->message);
}

static int emit(struct bus *bus, const char *const *names)
{
    return sd_bus_emit_properties_changed_strv(bus->connection, STATION_OBJECT, STATION_INTERFACE,
                                               (char **)(size_t)names);
}

/* Tell clients which properties are others than `before`; `anew`: state and session are told in any case. */
static void emit_changes(struct bus *bus, bool anew, const struct shown *before,
                         const char *message_before)
{
    const struct shown *now = &bus->shown;
    const char *names[10] = {NULL};
    size_t count = 0;
    if (anew || strcmp(now->state, before->state) != 0) {
        names[count++] = "State";
        names[count++] = "Session";
        names[count++] = "Patterns";
        names[count++] = "Incomplete";
    }
    if (strcmp(now->kind, before->kind) != 0) {
        names[count++] = "Kind";
    }
    if (now->pattern != before->pattern) {
        names[count++] = "Pattern";
    }
    if (now->retries != before->retries) {
        names[count++] = "Retries";
    }
    if (now->time_left != before->time_left) {
        names[count++] = "TimeLeft";
    }
    if (strcmp(bus->message, message_before) != 0) {
        names[count++] = "Message";
    }
    if (count > 0) {
        (void)emit(bus, names); /* a lost connection is noticed elsewhere */
    }
}

/* What is more than a number that changed. */
static void tell_event(struct bus *bus)
{
    enum job_state state = bus->status.state;
    bool over = state == JOB_DONE || state == JOB_FAILED || state == JOB_CANCELLED;
    if (state == JOB_WAITING) {
        (void)sd_bus_emit_signal(bus->connection, STATION_OBJECT, STATION_INTERFACE, "Asked", "s",
                                 bus->message);
    }
    if (over) {
        (void)sd_bus_emit_signal(bus->connection, STATION_OBJECT, STATION_INTERFACE, "Finished",
                                 "sbs", bus->session, state == JOB_DONE, bus->message);
    }
    journal_write(state == JOB_FAILED            ? LOG_ERR
                  : over || state == JOB_WAITING ? LOG_NOTICE
                                                 : LOG_INFO,
                  &bus->status, bus->message);
}

void bus_publish(struct bus *bus)
{
    const struct job_status before = bus->status;
    const struct shown shown = bus->shown;
    char message[MESSAGE_SIZE];
    (void)snprintf(message, sizeof message, "%s", bus->message);
    job_read(bus->job, &bus->status);
    enum job_state state = bus->status.state;
    bool begun = bus->status.number != before.number; /* it may have failed already */
    if ((begun || job_is_active(before.state)) && !job_is_active(state)) {
        refresh_incomplete(bus);
    }
    show(bus);
    (void)sd_notifyf(0, "STATUS=%s", bus->message); /* where there is no manager, nobody asks */
    bool asked = state == JOB_WAITING && strcmp(bus->message, message) != 0;
    emit_changes(bus, begun, &shown, message);
    if (begun || asked || state != before.state) {
        tell_event(bus);
    } else if (bus->status.retries > before.retries) {
        journal_write(LOG_WARNING, &bus->status, bus->message);
    }
}

bool bus_is_lost(const struct bus *bus)
{
    return sd_bus_is_open(bus->connection) <= 0;
}

static int connect_to(struct bus *bus, sd_event *event, struct nacre_error *error)
{
    bool user = bus->settings->user;
    int result = user ? sd_bus_open_user(&bus->connection) : sd_bus_open_system(&bus->connection);
    if (result < 0) {
        return nacre_fail_errno(error, -result, "the %s bus: cannot connect; is dbus running?",
                                user ? "user's" : "system");
    }
    result = sd_bus_add_object_vtable(bus->connection, NULL, STATION_OBJECT, STATION_INTERFACE,
                                      interface, bus);
    if (result >= 0) {
        result = sd_bus_attach_event(bus->connection, event, SD_EVENT_PRIORITY_NORMAL);
    }
    if (result < 0) {
        return nacre_fail_errno(error, -result, "the bus: cannot offer %s", STATION_INTERFACE);
    }
    result = sd_bus_request_name(bus->connection, STATION_SERVICE, 0);
    if (result < 0) {
        return nacre_fail_errno(error, -result,
                                "the bus: cannot take the name %s; another nacred may hold it, or "
                                "this user may not (see nacred's policy for the bus)",
                                STATION_SERVICE);
    }
    return NACRE_OK;
}

int bus_new(const struct bus_settings *settings, struct job *job, sd_event *event, struct bus **bus,
            struct nacre_error *error)
{
    int status = NACRE_OK;
    struct bus *made = calloc(1, sizeof *made);
    if (!made) {
        status = nacre_fail_memory(error, "the bus");
        goto out;
    }
    made->settings = settings;
    made->job = job;
    status = sessions_list_incomplete(settings->sessions, &made->incomplete,
                                      &made->incomplete_count, error);
    if (status != NACRE_OK) {
        goto out;
    }
    show(made);
    status = connect_to(made, event, error);
    if (status != NACRE_OK) {
        goto out;
    }
    journal_write(made->incomplete_count > 0 ? LOG_NOTICE : LOG_INFO, &made->status, made->message);
out:
    if (status != NACRE_OK) {
        bus_free(made);
        made = NULL;
    }
    *bus = made;
    return status;
}

void bus_free(struct bus *bus)
{
    if (!bus) {
        return;
    }
    sd_bus_flush_close_unref(bus->connection);
    incomplete_free(bus->incomplete, bus->incomplete_count);
    free(bus);
}
