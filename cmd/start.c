/* nacre start: begin a scan that nacred runs. */
#include "cmd/station_follow.h"
#include "cmd/verbs.h"
#include "rig/daemon/names.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* A plan is a few lines. */
enum { LARGEST_PLAN = 1 << 20 };

struct start_settings {
    const char *plan;
    bool detach, user;
};

static const struct option_spec start_options[] = {
    {.name = "plan",
     .letter = 'p',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct start_settings, plan),
     .sentence = "the plan file, instead of the one that nacred's station file names"},
    {.name = "detach",
     .letter = 'd',
     .kind = OPTION_FLAG,
     .offset = offsetof(struct start_settings, detach),
     .sentence = "return as soon as the devices are open, not at the scan's end"},
    STATION_OPTION_USER(start_settings),
    {0}};

/* The text of a file; heap. */
static char *read_text(const char *path, struct nacre_error *error)
{
    char *text = NULL;
    char *whole = NULL;
    FILE *file = fopen(path, "re");
    if (!file) {
        (void)nacre_fail_errno(error, errno, "%s: cannot open the plan file", path);
        goto out;
    }
    text = malloc(LARGEST_PLAN + 1);
    if (!text) {
        (void)nacre_fail_memory(error, path);
        goto out;
    }
    size_t size = fread(text, 1, LARGEST_PLAN + 1, file);
    if (ferror(file)) {
        (void)nacre_fail_errno(error, errno, "%s: cannot read the plan file", path);
    } else if (size == 0 || size > LARGEST_PLAN) {
        (void)nacre_fail(error, "%s: is no plan file: it is %s", path,
                         size == 0 ? "empty" : "larger than 1 MiB");
    } else if (memchr(text, '\0', size)) {
        (void)nacre_fail(error, "%s: is no plan file: it holds bytes that are no text", path);
    } else {
        text[size] = '\0';
        whole = text;
        text = NULL;
    }
out:
    if (file) {
        (void)fclose(file); /* was only read */
    }
    free(text);
    return whole;
}

/* nacred knows the plan's text alone: say the file's name where it says "plan". */
static void name_plan(const char *path, struct nacre_error *error)
{
    static const char prefix[] = STATION_PLAN_NAME ":";
    if (path && strncmp(error->text, prefix, sizeof prefix - 1) == 0) {
        struct nacre_error inner = *error;
        (void)nacre_fail(error, "%s%s", path, inner.text + sizeof prefix - 2);
    }
}

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct start_settings *settings = values;
    sd_bus *bus = NULL;
    char *plan = NULL;
    int status = NACRE_OK;
    if (settings->plan) {
        plan = read_text(settings->plan, error);
        status = plan ? NACRE_OK : NACRE_FAILED;
    }
    if (status == NACRE_OK) {
        status = station_connect(settings->user, &bus, error);
    }
    if (status != NACRE_OK) {
        goto out;
    }
    status = station_call(bus, "Start", invocation->operands[0], plan ? plan : "", error);
    if (status != NACRE_OK) {
        name_plan(settings->plan, error);
        goto out;
    }
    status = station_follow_scan(bus, settings->detach, invocation, error);
out:
    sd_bus_flush_close_unref(bus);
    free(plan);
    return status;
}

const struct verb verb_start = {
    .name = "start",
    .operands = "NAME",
    .summary = "begin a scan that nacred runs",
    .text = "Tells the daemon nacred to measure the sample at its station and to keep the frames "
            "in the session NAME, then follows the scan to its end. Ctrl-C ends the following, "
            "not the scan. When the scan waits for somebody to lay or lift the white diffuse "
            "layer, Enter confirms that it is done; so does `nacre confirm` from anywhere.\n\n"
            "Names are of letters, digits and the characters . _ - and do not begin with a dot. "
            "Only root and members of the group nacre may start scans.",
    .operand_minimum = 1,
    .operand_maximum = 1,
    .options = start_options,
    .settings_size = sizeof(struct start_settings),
    .run = run,
};
