/* Lines of the journal. */
#include "rig/daemon/journal.h"

#include "rig/daemon/words.h"

#include <stdio.h>
#include <stdlib.h>
#define SD_JOURNAL_SUPPRESS_LOCATION
#include <systemd/sd-journal.h>

void journal_write(int priority, const struct job_status *status, const char *text)
{
    /* systemd sets this for services whose standard error is the journal. */
    if (!getenv("JOURNAL_STREAM")) {
        (void)fprintf(stderr, "nacred: %s\n", text);
        return;
    }
    (void)sd_journal_send("MESSAGE=%s", text, "PRIORITY=%i", priority, "NACRE_STATE=%s",
                          words_state(status->state), "NACRE_SESSION=%s", status->name,
                          "NACRE_PATTERN=%zu", status->done, "NACRE_PATTERNS=%zu", status->patterns,
                          "NACRE_RETRIES=%zu", status->retries, NULL); /* nobody to tell */
}
