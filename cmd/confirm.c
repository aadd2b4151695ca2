/* nacre confirm: tell nacred that what it asked for is done. */
#include "cmd/station_bus.h"
#include "cmd/verbs.h"

struct confirm_settings {
    bool insist, user;
};

static const struct option_spec confirm_options[] = {
    {.name = "insist",
     .kind = OPTION_FLAG,
     .offset = offsetof(struct confirm_settings, insist),
     .sentence = "it is so, whatever the frame that checks it shows"},
    STATION_OPTION_USER(confirm_settings),
    {0}};

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct confirm_settings *settings = values;
    sd_bus *bus = NULL;
    (void)invocation;
    int status = station_connect(settings->user, &bus, error);
    if (status == NACRE_OK) {
        status = station_call(bus, settings->insist ? "Insist" : "Confirm", NULL, NULL, error);
    }
    sd_bus_flush_close_unref(bus);
    return status;
}

const struct verb verb_confirm = {
    .name = "confirm",
    .operands = "",
    .summary = "tell nacred that the white layer lies, or is off, as it asked",
    .text = "A scan waits twice at least for somebody: the white diffuse layer must lie on the "
            "sample for some patterns and be off for others. `nacre status` shows what is asked.",
    .options = confirm_options,
    .settings_size = sizeof(struct confirm_settings),
    .run = run,
};
