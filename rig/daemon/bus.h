/* The daemon on the D-Bus: its interface, and telling everybody what the job does. */
#ifndef RIG_DAEMON_BUS_H
#define RIG_DAEMON_BUS_H

#include "nacre/error.h"
#include "rig/daemon/job.h"

#include <stdbool.h>
#include <systemd/sd-event.h>

struct bus_settings {
    bool user;            /* the user's bus instead of the system's */
    const char *station;  /* the station file */
    const char *sessions; /* the folder of sessions */
};

struct bus;

/* Connect, offer the interface and take the name. The settings and the job outlive the bus. */
int bus_new(const struct bus_settings *settings, struct job *job, sd_event *event, struct bus **bus,
            struct nacre_error *error);
void bus_free(struct bus *bus); /* NULL is allowed */

/* Look at the job, and tell what has changed: to clients, to the service manager, to the journal. */
void bus_publish(struct bus *bus);

/* Whether the connection broke: nobody can ask for anything any more. */
bool bus_is_lost(const struct bus *bus);

#endif
