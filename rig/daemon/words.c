/* The operator's words: states, durations and what is left to do. */
#include "rig/daemon/words.h"

#include <stdio.h>

const char *words_state(enum job_state state)
{
    static const char *const names[] = {
        [JOB_IDLE] = "idle",       [JOB_PREPARING] = "preparing", [JOB_RUNNING] = "running",
        [JOB_WAITING] = "waiting", [JOB_PAUSED] = "paused",       [JOB_DONE] = "done",
        [JOB_FAILED] = "failed",   [JOB_CANCELLED] = "cancelled",
    };
    return names[state];
}

static void describe_time(double seconds, char *text, size_t size)
{
    long whole = seconds < 0 ? 0 : seconds > 1e9 ? 1000000000 : (long)(seconds + 0.5);
    if (whole < 60) {
        (void)snprintf(text, size, "%ld s", whole);
    } else if (whole < 3600) {
        (void)snprintf(text, size, "%ld min", (whole + 30) / 60);
    } else {
        (void)snprintf(text, size, "%ld h %02ld min", whole / 3600, whole % 3600 / 60);
    }
}

/* ", 3 frames taken again", or nothing. */
static void describe_retries(size_t retries, char *text, size_t size)
{
    text[0] = '\0';
    if (retries > 0) {
        (void)snprintf(text, size, ", %zu frame%s taken again", retries, retries == 1 ? "" : "s");
    }
}

static void describe_running(const struct job_status *status, const char *retries, char *text,
                             size_t size)
{
    char left[32];
    describe_time(status->seconds_left, left, sizeof left);
    (void)snprintf(text, size, "measuring %s %d, pattern %zu of %zu, %s left%s%s",
                   pattern_kind_names[status->pattern.kind], status->pattern.number,
                   status->done + 1, status->patterns, left, retries,
                   status->stopping  ? "; stopping after it"
                   : status->pausing ? "; pausing after it"
                                     : "");
}

void words_describe(const struct job_status *status, char *text, size_t size)
{
    char retries[48];
    describe_retries(status->retries, retries, sizeof retries);
    switch (status->state) {
    case JOB_IDLE:
        (void)snprintf(text, size, "ready");
        break;
    case JOB_PREPARING:
        (void)snprintf(text, size, "opening the devices for %s", status->name);
        break;
    case JOB_RUNNING:
        describe_running(status, retries, text, size);
        break;
    case JOB_WAITING:
        (void)snprintf(text, size, "%s", status->message);
        break;
    case JOB_PAUSED:
        (void)snprintf(text, size, "paused before pattern %zu of %zu%s; `nacre resume %s` goes on",
                       status->done + 1, status->patterns, retries, status->name);
        break;
    case JOB_DONE:
        (void)snprintf(text, size, "%s is complete: %zu patterns%s", status->name, status->patterns,
                       retries);
        break;
    case JOB_FAILED:
        (void)snprintf(text, size, "%s", status->message);
        break;
    case JOB_CANCELLED:
        (void)snprintf(text, size,
                       "%s was stopped after %zu of %zu patterns; `nacre resume %s` goes on",
                       status->name, status->done, status->patterns, status->name);
        break;
    }
}

/* Bytes of the UTF-8 character at `text`; 0: it is none. */
static int character_length(const unsigned char *text)
{
    int length = text[0] < 0x80                      ? 1
                 : text[0] >= 0xc2 && text[0] < 0xe0 ? 2
                 : text[0] >= 0xe0 && text[0] < 0xf0 ? 3
                 : text[0] >= 0xf0 && text[0] < 0xf5 ? 4
                                                     : 0;
    for (int i = 1; i < length; i++) {
        if ((text[i] & 0xc0) != 0x80) {
            return 0;
        }
    }
    bool overlong = (text[0] == 0xe0 && text[1] < 0xa0) || (text[0] == 0xf0 && text[1] < 0x90);
    bool surrogate = text[0] == 0xed && text[1] >= 0xa0;
    bool beyond = text[0] == 0xf4 && text[1] >= 0x90;
    return overlong || surrogate || beyond ? 0 : length;
}

void words_clean(char *text)
{
    while (*text) {
        int length = character_length((const unsigned char *)text);
        if (length == 0) {
            *text = '?';
            length = 1;
        }
        text += length;
    }
}
