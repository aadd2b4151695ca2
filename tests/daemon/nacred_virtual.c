/* nacred with a virtual station in place of real devices, for tests: the same loop, bus and job.
 * nacred_virtual STATION STATE [SLOW_MS [HANG_AT]] */
#include "rehearsal.h"
#include "rig/daemon/daemon.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

int main(int argc, char **argv)
{
    static char sessions[512];
    static struct rehearsal rehearsal;
    struct bus_settings settings = {.user = true, .sessions = sessions};
    struct nacre_error error = {""};
    if (argc < 3) {
        (void)fprintf(stderr, "usage: %s STATION STATE [SLOW_MS [HANG_AT]]\n", argv[0]);
        return 2;
    }
    settings.station = argv[1];
    (void)snprintf(sessions, sizeof sessions, "%s/sessions", argv[2]);
    (void)mkdir(sessions, 0750); /* may be there */
    rehearsal_init(&rehearsal);
    rehearsal.slow_ms = argc > 3 ? (int)strtol(argv[3], NULL, 10) : 0;
    rehearsal.hang_at = argc > 4 ? (int)strtol(argv[4], NULL, 10) : -1;
    struct job_opener opener = rehearsal_opener(&rehearsal);
    int status = daemon_run(&settings, &opener, &error);
    rehearsal_finish(&rehearsal);
    if (status != NACRE_OK) {
        (void)fprintf(stderr, "nacred_virtual: %s\n", error.text);
    }
    return status == NACRE_OK ? 0 : 1;
}
