/* nacre resume: go on with a scan that is paused, or with a session that lacks patterns. */
#include "cmd/station_follow.h"
#include "cmd/verbs.h"

struct resume_settings {
    bool detach, user;
};

static const struct option_spec resume_options[] = {
    {.name = "detach",
     .letter = 'd',
     .kind = OPTION_FLAG,
     .offset = offsetof(struct resume_settings, detach),
     .sentence = "return as soon as the devices are open, not at the scan's end"},
    STATION_OPTION_USER(resume_settings),
    {0}};

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct resume_settings *settings = values;
    const char *name = invocation->operand_count > 0 ? invocation->operands[0] : "";
    sd_bus *bus = NULL;
    int status = station_connect(settings->user, &bus, error);
    if (status == NACRE_OK) {
        status = station_call(bus, "Resume", name, NULL, error);
    }
    if (status == NACRE_OK) {
        status = station_follow_scan(bus, settings->detach, invocation, error);
    }
    sd_bus_flush_close_unref(bus);
    return status;
}

const struct verb verb_resume = {
    .name = "resume",
    .operands = "[NAME]",
    .summary = "go on with a scan of nacred that was paused or interrupted",
    .text = "A scan that was paused goes on where it stopped. A session that was interrupted, by "
            "`nacre cancel`, a failure or a power cut, is measured to its end: only patterns that "
            "it lacks are. Without NAME it is the scan that `nacre status` shows. Follows the scan "
            "like `nacre start`.",
    .operand_maximum = 1,
    .options = resume_options,
    .settings_size = sizeof(struct resume_settings),
    .run = run,
};
