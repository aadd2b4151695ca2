/* Questions to the person at the station, and waiting for the answer. */
#include "rig/person.h"

#include "rig/sequence.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

/* How soon signals are noticed: another thread may have taken the signal, which does not end a wait here. */
enum { ROUND_MS = 100 };

/* Beside what white_layer may return. */
enum { UNANSWERED = SEQUENCE_INSISTED + 1 };

/* What insists, typed before Enter. */
static const char insisting[] = "sure";

/* What answers, in the order of person.before. */
static const int answers[] = {SIGUSR1, SIGUSR2};

/* A signal handler can reach nothing but an object of static storage. Signals are not blocked and read from a descriptor,
 * as libraries start threads of their own before main. */
static volatile sig_atomic_t signalled;

static void note_answer(int number)
{
    signalled = number;
}

int person_begin(struct person *person, struct progress *progress, struct nacre_error *error)
{
    const struct sigaction noting = {.sa_handler = note_answer, .sa_flags = SA_RESTART};
    *person = (struct person){.progress = progress, .terminal = isatty(STDIN_FILENO)};
    for (int i = 0; i < 2; i++) {
        if (sigaction(answers[i], &noting, &person->before[i]) != 0) {
            return nacre_fail_errno(error, errno, "cannot wait for signals");
        }
    }
    return NACRE_OK;
}

void person_end(struct person *person)
{
    for (int i = 0; i < 2; i++) {
        (void)sigaction(answers[i], &person->before[i], NULL); /* as person_begin could */
    }
}

/* Answers to what was not asked yet do not count. */
static void forget_answers(struct person *person)
{
    signalled = 0;
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

static int wait_answer(struct person *person, struct nacre_error *error)
{
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    int answer = UNANSWERED;
    while (answer == UNANSWERED) {
        int found = poll(&input, person->terminal ? 1 : 0, ROUND_MS);
        int status = progress_step(NULL, 0, 0, NULL, error);
        if (status != NACRE_OK) {
            return status;
        }
        if (signalled) {
            answer = signalled == SIGUSR2 ? SEQUENCE_INSISTED : NACRE_OK;
        } else if (found > 0 && input.revents) {
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
