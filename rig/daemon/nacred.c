/* nacred: the daemon that runs scans unattended on the station's real devices. */
#include "rig/daemon/daemon.h"
#include "rig/devices.h"

#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { EXIT_WRONG_USAGE = 2 };

struct settings {
    struct bus_settings bus;
    const char *state; /* the folder below which sessions are kept */
};

static const char help_text[] =
    "nacred - measures samples unattended, at the wish of `nacre start` and its like\n"
    "\n"
    "Usage: nacred [OPTION...]\n"
    "\n"
    "  -s, --station FILE  the station file; default /etc/nacre/station.yaml\n"
    "      --state FOLDER  where sessions are kept, in its folder sessions; default:\n"
    "                      $STATE_DIRECTORY, which systemd sets, or /var/lib/nacre\n"
    "      --user          serve the bus of the user's session, to try it\n"
    "  -h, --help          print this text\n"
    "      --version       print the version\n";

static int open_real(void *context, const struct station *station, struct devices *devices,
                     struct nacre_error *error)
{
    if (station_is_virtual(station)) {
        return nacre_fail(error, "nacred measures with real devices alone, and those of the "
                                 "station file are virtual; use nacre scan");
    }
    return devices_open(station, context, devices, error);
}

static void close_real(void *context, struct devices *devices)
{
    (void)context;
    devices_close(devices);
}

/* Returns the exit status to end with, or -1 to go on. */
static int parse(int argc, char **argv, struct settings *settings)
{
    enum { STATE = 256, USER, VERSION };
    static const struct option options[] = {
        {"station", required_argument, NULL, 's'}, {"state", required_argument, NULL, STATE},
        {"user", no_argument, NULL, USER},         {"help", no_argument, NULL, 'h'},
        {"version", no_argument, NULL, VERSION},   {0}};
    int option;
    while ((option = getopt_long(argc, argv, "s:h", options, NULL)) != -1) {
        switch (option) {
        case 's':
            settings->bus.station = optarg;
            break;
        case STATE:
            settings->state = optarg;
            break;
        case USER:
            settings->bus.user = true;
            break;
        case 'h':
            (void)fputs(help_text, stdout);
            return EXIT_SUCCESS;
        case VERSION:
            (void)puts("nacred " NACRE_VERSION);
            return EXIT_SUCCESS;
        default:
            return EXIT_WRONG_USAGE;
        }
    }
    if (optind < argc) {
        (void)fprintf(stderr, "nacred: '%s' is one argument too many\n", argv[optind]);
        return EXIT_WRONG_USAGE;
    }
    return -1;
}

/* The folder of sessions, made if it is not there; heap. */
static char *make_sessions(const char *state, struct nacre_error *error)
{
    char *path = NULL;
    const char *given = getenv("STATE_DIRECTORY");
    state = state ? state : given ? given : "/var/lib/nacre";
    if (asprintf(&path, "%s/sessions", state) < 0) {
        (void)nacre_fail_memory(error, "a path");
        return NULL;
    }
    if (mkdir(path, 0750) != 0 && errno != EEXIST) {
        (void)nacre_fail_errno(error, errno, "%s: cannot make the folder of sessions", path);
        free(path);
        path = NULL;
    }
    return path;
}

int main(int argc, char **argv)
{
    struct clock clock = clock_monotonic();
    const struct job_opener opener = {
        .context = &clock, .open = open_real, .close = close_real, .check_layer = true};
    struct settings settings = {.bus = {.station = "/etc/nacre/station.yaml"}};
    struct nacre_error error = {""};
    int status = parse(argc, argv, &settings);
    if (status >= 0) {
        return status;
    }
    char *sessions = make_sessions(settings.state, &error);
    settings.bus.sessions = sessions;
    status = sessions ? daemon_run(&settings.bus, &opener, &error) : NACRE_FAILED;
    free(sessions);
    if (status != NACRE_OK) {
        (void)fprintf(stderr, "nacred: %s\n", error.text);
        return EXIT_FAILURE;
    }
    return EXIT_SUCCESS;
}
