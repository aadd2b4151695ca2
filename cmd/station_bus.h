/* nacred as the verbs see it over the D-Bus: asking it for something, and what it says of itself. */
#ifndef CMD_STATION_BUS_H
#define CMD_STATION_BUS_H

#include "base/options.h"
#include "nacre/error.h"

#include <jansson.h>
#include <stdbool.h>
#include <systemd/sd-bus.h>

/* The option --user, for the settings of a verb that have a member `user`. */
#define STATION_OPTION_USER(settings)                                                              \
    {                                                                                              \
        .name = "user", .kind = OPTION_FLAG, .offset = offsetof(struct settings, user),            \
        .sentence = "ask a nacred that was started with --user, on the user's own bus"             \
    }

/* Its properties at one moment. */
struct station_view {
    char state[16], session[256], folder[512], kind[16], message[1600];
    unsigned pattern, patterns, retries, time_left; /* seconds */
    char **incomplete;                              /* names, NULL-terminated; heap */
};

/* Connect to the system's bus or the user's; unref with sd_bus_unref. */
int station_connect(bool user, sd_bus **bus, struct nacre_error *error);

/* Call a method that takes up to two strings (NULL: fewer). */
int station_call(sd_bus *bus, const char *method, const char *first, const char *second,
                 struct nacre_error *error);

/* Read all properties; station_view_finish frees. */
int station_read_view(sd_bus *bus, struct station_view *view, struct nacre_error *error);
void station_view_finish(struct station_view *view);

/* Whether a scan is under way. */
bool station_is_active(const struct station_view *view);

/* The view as JSON; NULL when memory runs out. */
json_t *station_view_json(const struct station_view *view);

#endif
