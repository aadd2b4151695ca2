/* nacre pause: stop nacred's scan before its next pattern. */
#include "cmd/station_follow.h"
#include "cmd/verbs.h"

#include <string.h>

struct pause_settings {
    bool user;
};

static const struct option_spec pause_options[] = {STATION_OPTION_USER(pause_settings), {0}};

/* A scan that waits for somebody pauses when that is done. */
static bool reached_pause(const struct station_view *view)
{
    return strcmp(view->state, "running") != 0 && strcmp(view->state, "preparing") != 0;
}

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct pause_settings *settings = values;
    return station_stop(settings->user, "Pause", reached_pause, invocation, error);
}

const struct verb verb_pause = {
    .name = "pause",
    .operands = "",
    .summary = "pause nacred's scan before its next pattern",
    .text = "Waits until the pattern in work has been measured. The devices stay open and the lamp "
            "on; `nacre resume` goes on.",
    .options = pause_options,
    .settings_size = sizeof(struct pause_settings),
    .run = run,
};
