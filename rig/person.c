/* Questions to the person at the station, and waiting for the answer. */
#include "rig/person.h"

#include "rig/sequence.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/signalfd.h>
#include <termios.h>
#include <unistd.h>

/* How soon Ctrl-C is noticed: another thread may have taken the signal, which does not end a wait here. */
enum { ROUND_MS = 100 };

/* Beside what white_layer may return. */
enum { UNANSWERED = SEQUENCE_INSISTED + 1 };

/* What insists, typed before Enter. */
static const char insisting[] = "sure";

int person_begin(struct person *person, struct progress *progress, struct nacre_error *error)
{
    sigset_t wanted;
    *person =
        (struct person){.progress = progress, .terminal = isatty(STDIN_FILENO), .signals = -1};
    (void)sigemptyset(&wanted); /* fail for unknown signals only */
    (void)sigaddset(&wanted, SIGUSR1);
    (void)sigaddset(&wanted, SIGUSR2);
    (void)sigprocmask(SIG_BLOCK, &wanted, &person->before);
    person->signals = signalfd(-1, &wanted, SFD_CLOEXEC | SFD_NONBLOCK);
    if (person->signals < 0) {
        int number = errno;
        person_end(person);
        return nacre_fail_errno(error, number, "cannot wait for signals");
    }
    return NACRE_OK;
}

/* A signal that nobody waits for any longer must not end the program when it is let through. */
static void drop_signals(struct person *person)
{
    struct signalfd_siginfo signal;
    while (read(person->signals, &signal, sizeof signal) == (ssize_t)sizeof signal) {
    }
}

void person_end(struct person *person)
{
    if (person->signals >= 0) {
        drop_signals(person);
        (void)close(person->signals);
        person->signals = -1;
    }
    (void)sigprocmask(SIG_SETMASK, &person->before, NULL);
}

/* Answers to what was not asked yet do not count. */
static void forget_answers(struct person *person)
{
    drop_signals(person);
    if (person->terminal) {
        (void)tcflush(STDIN_FILENO, TCIFLUSH); /* a terminal that is gone is noticed when read */
    }
}

/* A line from the terminal: NACRE_OK, SEQUENCE_INSISTED, or failure. */
static int read_answer(struct nacre_error *error)
{
    char line[64];
    ssize_t length = read(STDIN_FILENO, line, sizeof line);
    if (length < 0 && errno == EINTR) {
        return UNANSWERED;
    }
    if (length <= 0) {
        (void)nacre_fail(error, "the terminal was closed before the question was answered");
        return NACRE_CANCELLED;
    }
    size_t word = strlen(insisting);
    bool insists = (size_t)length > word && memcmp(line, insisting, word) == 0 &&
                   (line[word] == '\n' || line[word] == ' ');
    return insists ? SEQUENCE_INSISTED : NACRE_OK;
}

static int read_signal(struct person *person)
{
    struct signalfd_siginfo signal;
    if (read(person->signals, &signal, sizeof signal) != (ssize_t)sizeof signal) {
        return UNANSWERED;
    }
    return signal.ssi_signo == SIGUSR2 ? SEQUENCE_INSISTED : NACRE_OK;
}

static int wait_answer(struct person *person, struct nacre_error *error)
{
    struct pollfd sources[] = {{.fd = person->signals, .events = POLLIN},
                               {.fd = STDIN_FILENO, .events = POLLIN}};
    int answer = UNANSWERED;
    while (answer == UNANSWERED) {
        int found = poll(sources, person->terminal ? 2 : 1, ROUND_MS);
        int status = progress_step(NULL, 0, 0, NULL, error);
        if (status != NACRE_OK) {
            return status;
        }
        if (found > 0 && sources[0].revents) {
            answer = read_signal(person);
        } else if (found > 0 && sources[1].revents) {
            answer = read_answer(error);
        }
    }
    return answer;
}

static void ask(struct person *person, const char *order)
{
    progress_end(person->progress);
    if (person->terminal) {
        (void)fprintf(stderr, "%s, then press Enter. ", order);
    } else {
        (void)fprintf(stderr, "%s, then send SIGUSR1: kill -USR1 %d\n", order, (int)getpid());
    }
    (void)fflush(stderr);
}

int person_white_layer(void *context, bool on, struct nacre_error *error)
{
    struct person *person = context;
    forget_answers(person);
    ask(person, on ? "Lay the white diffuse layer on the sample"
                   : "Take the white diffuse layer off the sample");
    int answer = wait_answer(person, error);
    if (answer == NACRE_CANCELLED && person->terminal) {
        (void)fputc('\n', stderr);
    }
    return answer;
}

void person_layer_doubted(void *context, const char *why)
{
    struct person *person = context;
    progress_end(person->progress);
    if (person->terminal) {
        (void)fprintf(stderr, "%s. If you are sure that it is right, type \"%s\" before Enter.\n",
                      why, insisting);
    } else {
        (void)fprintf(stderr, "%s. If you are sure that it is right, send SIGUSR2 instead.\n", why);
    }
}
