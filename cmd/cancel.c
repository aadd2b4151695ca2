/* nacre cancel: stop nacred's scan. */
#include "cmd/station_follow.h"
#include "cmd/verbs.h"

struct cancel_settings {
    bool user;
};

static const struct option_spec cancel_options[] = {STATION_OPTION_USER(cancel_settings), {0}};

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct cancel_settings *settings = values;
    return station_stop(settings->user, "Cancel", station_reached_end, invocation, error);
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
