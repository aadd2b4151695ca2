/* nacre status: what nacred is doing. */
#include "cmd/json_print.h"
#include "cmd/station_follow.h"
#include "cmd/verbs.h"

#include <stdio.h>
#include <string.h>

struct status_settings {
    bool follow, user;
};

static const struct option_spec status_options[] = {
    {.name = "follow",
     .letter = 'f',
     .kind = OPTION_FLAG,
     .offset = offsetof(struct status_settings, follow),
     .sentence = "show progress until no scan is running"},
    STATION_OPTION_USER(status_settings),
    {0}};

static void print_time_left(unsigned seconds)
{
    (void)printf("%-12s %u:%02u:%02u\n", "time left", seconds / 3600, seconds % 3600 / 60,
                 seconds % 60);
}

static void print_view(const struct station_view *view)
{
    (void)printf("%-12s %s\n", "state", view->state);
    if (view->session[0]) {
        (void)printf("%-12s %s/%s\n", "session", view->folder, view->session);
        (void)printf("%-12s %u of %u measured\n", "patterns", view->pattern, view->patterns);
        (void)printf("%-12s %u\n", "retries", view->retries);
    }
    if (station_is_active(view)) {
        print_time_left(view->time_left);
    }
    for (char **name = view->incomplete; name && *name; name++) {
        (void)printf("%-12s %s\n", name == view->incomplete ? "incomplete" : "", *name);
    }
    (void)printf("%-12s %s\n", "message", view->message);
}

/* With --follow, how the scan ended is how we end. */
static int judge(const struct station_view *view, struct nacre_error *error)
{
    bool bad = strcmp(view->state, "failed") == 0 || strcmp(view->state, "cancelled") == 0 ||
               strcmp(view->state, "interrupted") == 0;
    return bad ? nacre_fail(error, "%s", view->message) : NACRE_OK;
}

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct status_settings *settings = values;
    const struct follow follow = {
        .reached = station_reached_end, .quiet = invocation->quiet, .json = invocation->json};
    struct station_view view = {.state = ""};
    sd_bus *bus = NULL;
    int status = station_connect(settings->user, &bus, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = settings->follow ? station_follow(bus, &follow, &view, error)
                              : station_read_view(bus, &view, error);
    if (status != NACRE_OK) {
        goto out;
    }
    if (settings->follow) {
        status = judge(&view, error);
    }
    if (status == NACRE_OK && !invocation->json) {
        print_view(&view);
    } else if (status == NACRE_OK && !settings->follow) {
        status = json_print(station_view_json(&view), error);
    }
out:
    station_view_finish(&view);
    sd_bus_flush_close_unref(bus);
    return status;
}

const struct verb verb_status = {
    .name = "status",
    .operands = "",
    .summary = "show what nacred is doing",
    .text = "Prints the state of nacred, which everybody may ask for: idle, interrupted (a session "
            "lacks patterns), preparing, running, waiting (for somebody to do what the message "
            "says), paused, done, failed or cancelled; the session, its patterns, frames taken "
            "again, and time left.\n\n"
            "With --follow and --json each change is one line. With --follow the exit status is 1 "
            "if the scan failed or was stopped.",
    .options = status_options,
    .settings_size = sizeof(struct status_settings),
    .run = run,
};
