/* Following a scan of nacred until something is reached, with its words on the terminal. */
#ifndef CMD_STATION_FOLLOW_H
#define CMD_STATION_FOLLOW_H

#include "cmd/station_bus.h"

struct follow {
    bool (*reached)(const struct station_view *view);
    bool quiet; /* no progress; questions are shown all the same */
    bool json;  /* every change as one line of JSON on standard output */
    bool ask;   /* where standard input is a terminal, Enter there confirms */
};

/* Ends with the view in which it was reached (station_view_finish frees it); fails when nacred cannot be asked any more;
 * NACRE_CANCELLED when the user wants to look no longer, which stops no scan. */
int station_follow(sd_bus *bus, const struct follow *follow, struct station_view *view,
                   struct nacre_error *error);

/* Ready-made ends: no scan is under way; the devices are open or have failed. */
bool station_reached_end(const struct station_view *view);
bool station_reached_devices(const struct station_view *view);

/* Call a method that stops the scan, follow it until that is `reached`, and print nacred's words or, with --json, its
 * properties. */
int station_stop(bool user, const char *method, bool (*reached)(const struct station_view *view),
                 const struct invocation *invocation, struct nacre_error *error);

/* Follow a scan that was begun or resumed, to its end or (`detach`) until it runs, and print what came of it. */
int station_follow_scan(sd_bus *bus, bool detach, const struct invocation *invocation,
                        struct nacre_error *error);

#endif
