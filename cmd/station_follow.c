/* Waiting for changes of nacred, for Enter, and for Ctrl-C. */
#include "cmd/station_follow.h"

#include "base/progress.h"
#include "cmd/json_print.h"
#include "rig/daemon/names.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

/* The state is asked for so often even if nothing is heard: whoever took nacred down sends no signals. */
enum { ROUND_MS = 1000 };

/* What is on the terminal. */
struct screen {
    const struct follow *follow;
    bool terminal;      /* standard error is one */
    bool line;          /* a line of progress stands there */
    char asked[1600];   /* the question that was shown last */
    char printed[1600]; /* state and message that JSON was printed for */
};

static bool is_waiting(const struct station_view *view)
{
    return strcmp(view->state, "waiting") == 0;
}

bool station_reached_end(const struct station_view *view)
{
    return !station_is_active(view);
}

bool station_reached_devices(const struct station_view *view)
{
    return strcmp(view->state, "preparing") != 0;
}

static void wipe(struct screen *screen)
{
    if (screen->line) {
        (void)fputs("\r\033[K", stderr);
        (void)fflush(stderr);
        screen->line = false;
    }
}

/* The words of nacred, on one line. */
static void show_line(struct screen *screen, const struct station_view *view)
{
    struct winsize size = {0};
    int width = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
    (void)fprintf(stderr, "\r\033[K%.*s", width - 1, view->message);
    (void)fflush(stderr);
    screen->line = true;
}

/* A question is shown once; what was typed before it does not answer it. */
static void show_question(struct screen *screen, const struct station_view *view, bool enter)
{
    if (strcmp(screen->asked, view->message) != 0) {
        (void)snprintf(screen->asked, sizeof screen->asked, "%s", view->message);
        wipe(screen);
        if (enter) {
            (void)tcflush(STDIN_FILENO,
                          TCIFLUSH); /* a terminal that is gone is noticed when read */
        }
        (void)fprintf(stderr, "%s: %s\n", view->message,
                      enter ? "press Enter here, or run nacre confirm" : "run nacre confirm");
    }
}

static int show(struct screen *screen, const struct station_view *view, bool enter,
                struct nacre_error *error)
{
    if (screen->follow->json && strcmp(screen->printed, view->message) != 0) {
        json_t *object = station_view_json(view);
        (void)snprintf(screen->printed, sizeof screen->printed, "%s", view->message);
        if (!object) {
            return nacre_fail_memory(error, "the state");
        }
        (void)json_dumpf(object, stdout, JSON_COMPACT); /* puts fails, too */
        json_decref(object);
        if (puts("") < 0 || fflush(stdout) != 0) {
            return nacre_fail_errno(error, errno, "cannot write to standard output");
        }
    }
    if (is_waiting(view)) {
        show_question(screen, view, enter);
    } else {
        screen->asked[0] = '\0';
        if (screen->terminal && !screen->follow->quiet && station_is_active(view)) {
            show_line(screen, view);
        }
    }
    return NACRE_OK;
}

/* Somebody pressed Enter: confirmed, or insisted with the word that nacre scan takes too. */
static int answer(sd_bus *bus, struct nacre_error *error)
{
    char line[64];
    ssize_t length = read(STDIN_FILENO, line, sizeof line);
    if (length <= 0) {
        return length < 0 && errno == EINTR
                   ? NACRE_OK
                   : nacre_fail(error, "the terminal was closed; the scan waits for nacre confirm");
    }
    bool insists =
        length > 4 && strncmp(line, "sure", 4) == 0 && (line[4] == '\n' || line[4] == ' ');
    return station_call(bus, insists ? "Insist" : "Confirm", NULL, NULL, error);
}

/* Wait for a signal of nacred, a line of the terminal, or the round's end. */
static int wait_for_news(sd_bus *bus, bool enter, struct nacre_error *error)
{
    struct pollfd sources[] = {{.fd = sd_bus_get_fd(bus), .events = POLLIN},
                               {.fd = STDIN_FILENO, .events = POLLIN}};
    int found = poll(sources, enter ? 2 : 1, ROUND_MS);
    int result;
    do {
        result = sd_bus_process(bus, NULL);
    } while (result > 0);
    if (result < 0) {
        return nacre_fail_errno(error, -result, "the D-Bus was lost; the scan may go on");
    }
    return found > 0 && enter && sources[1].revents ? answer(bus, error) : NACRE_OK;
}

static int follow_changes(sd_bus *bus, struct screen *screen, struct station_view *view,
                          struct nacre_error *error)
{
    bool enter = screen->follow->ask && screen->terminal && isatty(STDIN_FILENO);
    for (;;) {
        int status = station_read_view(bus, view, error);
        if (status != NACRE_OK) {
            return status;
        }
        status = show(screen, view, enter, error);
        if (status != NACRE_OK || screen->follow->reached(view)) {
            return status;
        }
        status = wait_for_news(bus, enter && is_waiting(view), error);
        if (status != NACRE_OK) {
            return status;
        }
        if (progress_interrupted()) {
            (void)nacre_fail(error,
                             "%s is still being measured; nacre status --follow shows it again, "
                             "nacre cancel stops it",
                             view->session);
            return NACRE_CANCELLED;
        }
        station_view_finish(view);
    }
}

/* What arrives wakes the poll; what it says is read by station_read_view. */
static int note_change(sd_bus_message *message, void *context, sd_bus_error *answer_error)
{
    (void)message;
    (void)context;
    (void)answer_error;
    return 0;
}

int station_follow(sd_bus *bus, const struct follow *follow, struct station_view *view,
                   struct nacre_error *error)
{
    struct screen screen = {.follow = follow, .terminal = isatty(STDERR_FILENO)};
    *view = (struct station_view){.state = ""};
    int result = sd_bus_match_signal(bus, NULL, STATION_SERVICE, STATION_OBJECT,
                                     "org.freedesktop.DBus.Properties", "PropertiesChanged",
                                     note_change, NULL);
    if (result < 0) {
        return nacre_fail_errno(error, -result, "nacred cannot be followed");
    }
    int status = follow_changes(bus, &screen, view, error);
    wipe(&screen);
    if (status != NACRE_OK) {
        station_view_finish(view);
    }
    return status;
}

/* What came of a scan, when it ended or was left alone. */
static int judge(const struct station_view *view, const struct invocation *invocation,
                 struct nacre_error *error)
{
    bool good = station_is_active(view) || strcmp(view->state, "done") == 0;
    if (strcmp(view->state, "interrupted") == 0 || strcmp(view->state, "idle") == 0) {
        return nacre_fail(error, "nacred was restarted meanwhile: %s", view->message);
    }
    if (!good) {
        return nacre_fail(error, "%s", view->message);
    }
    if (invocation->json) {
        return json_print(station_view_json(view), error);
    }
    (void)puts(view->message); /* options_run looks after standard output */
    if (strcmp(view->state, "done") == 0) {
        (void)printf("frames in %s/%s\n", view->folder, view->session);
    }
    return NACRE_OK;
}

int station_stop(bool user, const char *method, bool (*reached)(const struct station_view *view),
                 const struct invocation *invocation, struct nacre_error *error)
{
    const struct follow follow = {.reached = reached, .quiet = invocation->quiet};
    struct station_view view = {.state = ""};
    sd_bus *bus = NULL;
    int status = station_connect(user, &bus, error);
    if (status == NACRE_OK) {
        status = station_call(bus, method, NULL, NULL, error);
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

int station_follow_scan(sd_bus *bus, bool detach, const struct invocation *invocation,
                        struct nacre_error *error)
{
    const struct follow follow = {.reached = detach ? station_reached_devices : station_reached_end,
                                  .quiet = invocation->quiet,
                                  .ask = true};
    struct station_view view;
    int status = station_follow(bus, &follow, &view, error);
    if (status != NACRE_OK) {
        return status;
    }
    status = judge(&view, invocation, error);
    station_view_finish(&view);
    return status;
}
