/* The progress bar and the flag that a signal sets. */
#include "base/progress.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

enum { BAR_WIDTH = 24, REDRAW_NS = 100000000 };

/* A signal handler can reach nothing but an object of static storage. */
static volatile sig_atomic_t interrupted;

static void note_signal(int number)
{
    if (interrupted) {
        (void)signal(number, SIG_DFL);
        (void)raise(number);
    }
    interrupted = 1;
}

/* A terminal that closes sends it more than once: by the kernel and by its shell. */
static void note_hangup(int number)
{
    (void)number;
    interrupted = 1;
}

void progress_catch_signals(void)
{
    struct sigaction action = {.sa_handler = note_signal, .sa_flags = SA_RESTART}, before = {0};
    (void)sigaction(SIGINT, &action, NULL); /* fails for unknown signals only */
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGHUP, NULL, &before);
    if (before.sa_handler != SIG_IGN) { /* as under nohup */
        action.sa_handler = note_hangup;
        (void)sigaction(SIGHUP, &action, NULL);
    }
}

bool progress_interrupted(void)
{
    return interrupted != 0;
}

static int64_t now_ns(void)
{
    struct clock clock = clock_monotonic();
    return clock_now_ns(&clock);
}

struct progress progress_begin(const char *task, bool quiet)
{
    return (struct progress){
        .task = task, .visible = !quiet && isatty(STDERR_FILENO), .started_ns = now_ns()};
}

static void format_seconds(double seconds, char *text, size_t size)
{
    int whole = (int)(seconds + 0.5);
    if (whole < 60) {
        (void)snprintf(text, size, "%d s", whole);
    } else if (whole < 3600) {
        (void)snprintf(text, size, "%d min %02d s", whole / 60, whole % 60);
    } else {
        (void)snprintf(text, size, "%d h %02d min", whole / 3600, whole % 3600 / 60);
    }
}

/* The columns of the terminal; a longer line would not be wiped. */
static int terminal_width(void)
{
    struct winsize size = {0};
    return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

static void draw(struct progress *progress, double fraction, const char *detail)
{
    double elapsed = (double)(progress->shown_ns - progress->started_ns) * 1e-9;
    char bar[BAR_WIDTH + 1];
    char left[32] = "";
    char line[256];
    int filled = (int)(fraction * BAR_WIDTH);
    memset(bar, ' ', BAR_WIDTH);
    memset(bar, '#', (size_t)filled);
    bar[BAR_WIDTH] = '\0';
    if (fraction > 0.01 && elapsed > 1) {
        format_seconds(elapsed / fraction - elapsed, left, sizeof left);
    }
    (void)snprintf(line, sizeof line, "%s [%s] %3.0f %%%s%s%s%s%s", progress->task, bar,
                   100 * fraction, *left ? ", " : "", left, *left ? " left" : "",
                   detail ? ", " : "", detail ? detail : "");
    (void)fprintf(stderr, "\r\033[K%.*s", terminal_width() - 1, line);
    (void)fflush(stderr);
}

int progress_step(struct progress *progress, double done, double total, const char *detail,
                  struct nacre_error *error)
{
    if (interrupted) {
        (void)nacre_fail(error, "stopped on request");
        return NACRE_CANCELLED;
    }
    struct progress_deadline *deadline = progress ? progress->deadline : NULL;
    if (deadline && clock_now_ns(deadline->clock) >= deadline->time_ns) {
        deadline->passed = true;
        (void)nacre_fail(error, "%s takes longer than there is time for", progress->task);
        return NACRE_CANCELLED;
    }
    if (progress && progress->visible) {
        int64_t now = now_ns();
        double fraction = total > 0 ? done / total : 0;
        if (now - progress->shown_ns >= REDRAW_NS) {
            progress->shown_ns = now;
            draw(progress, fraction > 1 ? 1 : fraction > 0 ? fraction : 0, detail); /* NaN is 0 */
        }
    }
    return NACRE_OK;
}

void progress_end(struct progress *progress)
{
    if (progress && progress->visible && progress->shown_ns) {
        (void)fputs("\r\033[K", stderr);
        (void)fflush(stderr);
    }
}
