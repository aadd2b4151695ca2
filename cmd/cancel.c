/* nacre cancel: stop nacred's scan. */
#include "cmd/json_print.h"
#include "cmd/station_follow.h"
#include "cmd/verbs.h"

#include <stdio.h>

struct cancel_settings {
    bool user;
};

static const struct option_spec cancel_options[] = {STATION_OPTION_USER(cancel_settings), {0}};

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct cancel_settings *settings = values;
    const struct follow follow = {.reached = station_reached_end, .quiet = invocation->quiet};
    struct station_view view = {.state = ""};
    sd_bus *bus = NULL;
    int status = station_connect(settings->user, &bus, error);
    if (status == NACRE_OK) {
        status = station_call(bus, "Cancel", NULL, NULL, error);
    }
    if (status == NACRE_OK) {
        status = station_follow(bus, &follow, &view, error);
    }
    if (status == NACRE_OK && invocation->json) {
        status = json_print(station_view_json(&view), error);
    } else if (status == NACRE_OK) {
        (void)puts(view.message); /* options_run looks after standard output */
    }
    station_view_finish(&view);
    sd_bus_flush_close_unref(bus);
    return status;
}

const struct verb verb_cancel = {
    .name = "cancel",
    .operands = "",
    .summary = "stop nacred's scan",
    .text = "Waits until the pattern in work has been measured, and the devices are closed. What "
            "was measured stays; `nacre resume NAME` measures the rest.",
    .options = cancel_options,
    .settings_size = sizeof(struct cancel_settings),
    .run = run,
};
