/* Talking to nacred, and saying what went wrong with it. */
#include "cmd/station_bus.h"

#include "rig/daemon/names.h"

#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int station_connect(bool user, sd_bus **bus, struct nacre_error *error)
{
    int result = user ? sd_bus_open_user(bus) : sd_bus_open_system(bus);
    if (result < 0) {
        return nacre_fail_errno(error, -result,
                                "cannot reach nacred, as there is no %s D-Bus (install and start "
                                "the package dbus, or measure with nacre scan)",
                                user ? "user's" : "system");
    }
    return NACRE_OK;
}

static bool begins_with(const char *text, const char *beginning)
{
    return strncmp(text, beginning, strlen(beginning)) == 0;
}

/* One sentence for what the bus or nacred answered. */
static int explain(const sd_bus_error *answer, int result, struct nacre_error *error)
{
    const char *name = answer->name ? answer->name : "";
    const char *text = answer->message ? answer->message : "";
    if (begins_with(name, "org.nacre.Error.")) {
        return nacre_fail(error, "%s", text);
    }
    if (strcmp(name, SD_BUS_ERROR_ACCESS_DENIED) == 0) {
        return nacre_fail(error, "only members of the group nacre may tell nacred what to do; as "
                                 "root add yourself (adduser USER nacre) and log in again");
    }
    if (strcmp(name, SD_BUS_ERROR_SERVICE_UNKNOWN) == 0 ||
        strcmp(name, SD_BUS_ERROR_NAME_HAS_NO_OWNER) == 0 ||
        begins_with(name, "org.freedesktop.DBus.Error.Spawn") ||
        begins_with(name, "org.freedesktop.systemd1.")) {
        return nacre_fail(error, "nacred is not running; start it (systemctl start nacred), and "
                                 "see journalctl -u nacred if it does not stay");
    }
    if (strcmp(name, SD_BUS_ERROR_NO_REPLY) == 0 || result == -ECONNRESET) {
        return nacre_fail(error, "nacred stopped before it answered; see journalctl -u nacred");
    }
    return *text ? nacre_fail(error, "nacred: %s", text)
                 : nacre_fail_errno(error, -result, "nacred cannot be asked");
}

int station_call(sd_bus *bus, const char *method, const char *first, const char *second,
                 struct nacre_error *error)
{
    sd_bus_error answer = SD_BUS_ERROR_NULL;
    const char *types = second ? "ss" : first ? "s" : "";
    int status = NACRE_OK;
    int result = sd_bus_call_method(bus, STATION_SERVICE, STATION_OBJECT, STATION_INTERFACE, method,
                                    &answer, NULL, types, first, second);
    if (result < 0) {
        status = explain(&answer, result, error);
    }
    sd_bus_error_free(&answer);
    return status;
}

/* A property of type s and where its text goes, or of type u. */
struct place {
    const char *name;
    size_t offset, size; /* size 0: unsigned */
};

static int read_value(sd_bus_message *reply, const struct place *place, struct station_view *view)
{
    void *target = (char *)view + place->offset;
    const char *text = NULL;
    uint32_t number = 0;
    int result;
    if (place->size > 0) {
        result = sd_bus_message_read(reply, "v", "s", &text);
        (void)snprintf(target, place->size, "%s", text ? text : "");
    } else {
        result = sd_bus_message_read(reply, "v", "u", &number);
        *(unsigned *)target = number;
    }
    return result;
}

static int read_incomplete(sd_bus_message *reply, struct station_view *view)
{
    int result = sd_bus_message_enter_container(reply, 'v', "as");
    if (result >= 0) {
        result = sd_bus_message_read_strv(reply, &view->incomplete);
    }
    return result < 0 ? result : sd_bus_message_exit_container(reply);
}

/* One entry of the dictionary; properties that this program does not know are skipped. */
static int read_property(sd_bus_message *reply, struct station_view *view)
{
    static const struct place places[] = {
        {"State", offsetof(struct station_view, state), sizeof view->state},
        {"Session", offsetof(struct station_view, session), sizeof view->session},
        {"Sessions", offsetof(struct station_view, folder), sizeof view->folder},
        {"Kind", offsetof(struct station_view, kind), sizeof view->kind},
        {"Message", offsetof(struct station_view, message), sizeof view->message},
        {"Pattern", offsetof(struct station_view, pattern), 0},
        {"Patterns", offsetof(struct station_view, patterns), 0},
        {"Retries", offsetof(struct station_view, retries), 0},
        {"TimeLeft", offsetof(struct station_view, time_left), 0},
    };
    const char *name;
    int result = sd_bus_message_read(reply, "s", &name);
    if (result < 0) {
        return result;
    }
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        if (strcmp(places[i].name, name) == 0) {
            return read_value(reply, &places[i], view);
        }
    }
    return strcmp(name, "Incomplete") == 0 ? read_incomplete(reply, view)
                                           : sd_bus_message_skip(reply, "v");
}

static int read_properties(sd_bus_message *reply, struct station_view *view)
{
    int result = sd_bus_message_enter_container(reply, 'a', "{sv}");
    while (result >= 0) {
        result = sd_bus_message_enter_container(reply, 'e', "sv");
        if (result <= 0) {
            break;
        }
        result = read_property(reply, view);
        if (result >= 0) {
            result = sd_bus_message_exit_container(reply);
        }
    }
    return result;
}

int station_read_view(sd_bus *bus, struct station_view *view, struct nacre_error *error)
{
    sd_bus_error answer = SD_BUS_ERROR_NULL;
    sd_bus_message *reply = NULL;
    int status = NACRE_OK;
    *view = (struct station_view){.state = ""};
    int result =
        sd_bus_call_method(bus, STATION_SERVICE, STATION_OBJECT, "org.freedesktop.DBus.Properties",
                           "GetAll", &answer, &reply, "s", STATION_INTERFACE);
    if (result >= 0) {
        result = read_properties(reply, view);
    }
    if (result < 0) {
        status = explain(&answer, result, error);
        station_view_finish(view);
    }
    sd_bus_message_unref(reply);
    sd_bus_error_free(&answer);
    return status;
}

void station_view_finish(struct station_view *view)
{
    for (char **name = view->incomplete; name && *name; name++) {
        free(*name);
    }
    free(view->incomplete);
    view->incomplete = NULL;
}

bool station_is_active(const struct station_view *view)
{
    static const char *const states[] = {"preparing", "running", "waiting", "paused"};
    for (size_t i = 0; i < sizeof states / sizeof *states; i++) {
        if (strcmp(view->state, states[i]) == 0) {
            return true;
        }
    }
    return false;
}

json_t *station_view_json(const struct station_view *view)
{
    json_t *incomplete = json_array();
    for (char **name = view->incomplete; name && *name; name++) {
        (void)json_array_append_new(incomplete, json_string(*name)); /* out of memory: left out */
    }
    return json_pack("{s:s, s:s, s:s, s:s, s:I, s:I, s:I, s:I, s:s, s:o}", "state", view->state,
                     "session", view->session, "sessions", view->folder, "kind", view->kind,
                     "pattern", (json_int_t)view->pattern, "patterns", (json_int_t)view->patterns,
                     "retries", (json_int_t)view->retries, "seconds_left",
                     (json_int_t)view->time_left, "message", view->message, "incomplete",
                     incomplete);
}
