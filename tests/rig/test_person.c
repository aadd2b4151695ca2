/* Tests of asking the person at the station, on a terminal and by signals. */
#include "rig/person.h"
#include "rig/sequence.h"
#include "unity.h"

#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

/* Long enough for a busy machine; only a test that fails waits so long. */
enum { PATIENCE_MS = 20000 };
/* Exit status of the child: its answer and this, so that none is 0. */
enum { ANSWERS = 50, SETUP_FAILED = 99 };

static pid_t child;
static int messages; /* what the child prints */
static int typing;   /* the terminal; -1: the child has none */
static char said[1024];

void setUp(void)
{
    child = -1;
    messages = typing = -1;
    said[0] = '\0';
}

void tearDown(void)
{
    if (child > 0) {
        (void)kill(child, SIGKILL);
        (void)waitpid(child, NULL, 0);
    }
    if (messages >= 0) {
        (void)close(messages);
    }
}

/* What the child does: ask, once `go` tells it to. */
static void ask_once(int go, bool on, const char *doubt)
{
    struct person person;
    struct nacre_error error;
    char byte;
    progress_catch_signals();
    if (person_begin(&person, NULL, &error) != NACRE_OK ||
        write(STDERR_FILENO, "ready\n", 6) != 6 || read(go, &byte, 1) != 1) {
        _exit(SETUP_FAILED);
    }
    if (doubt) {
        person_layer_doubted(&person, doubt);
    }
    int answer = person_white_layer(&person, on, &error);
    person_end(&person);
    _exit(ANSWERS + answer);
}

/* Read what the child says until it has said `text`. */
static void wait_for(const char *text)
{
    size_t length = strlen(said);
    while (!strstr(said, text)) {
        struct pollfd source = {.fd = messages, .events = POLLIN};
        TEST_ASSERT_EQUAL_INT_MESSAGE(1, poll(&source, 1, PATIENCE_MS), said);
        ssize_t got = read(messages, said + length, sizeof said - 1 - length);
        TEST_ASSERT_TRUE_MESSAGE(got > 0, said);
        length += (size_t)got;
        said[length] = '\0';
    }
}

/* Start the child, let `before` happen while it asks nothing, and let it ask. */
static void begin_asking(bool terminal, bool on, const char *doubt, void (*before)(void))
{
    int go[2];
    int ends[2];
    TEST_ASSERT_EQUAL_INT(0, pipe(go));
    if (terminal) {
        child = forkpty(&messages, NULL, NULL, NULL);
        typing = messages;
    } else {
        TEST_ASSERT_EQUAL_INT(0, pipe(ends));
        child = fork();
        messages = ends[0];
    }
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        if (!terminal) {
            (void)dup2(ends[1], STDERR_FILENO);
            (void)dup2(open("/dev/null", O_RDONLY | O_CLOEXEC), STDIN_FILENO);
        }
        ask_once(go[0], on, doubt);
    }
    if (!terminal) {
        (void)close(ends[1]);
    }
    wait_for("ready");
    if (before) {
        before();
    }
    TEST_ASSERT_EQUAL_INT(1, write(go[1], "g", 1));
    (void)close(go[0]);
    (void)close(go[1]);
    wait_for(terminal ? "Enter. " : "kill -USR1");
}

static void type(const char *text)
{
    TEST_ASSERT_EQUAL_INT(strlen(text), write(typing, text, strlen(text)));
}

static void ends_with(int answer)
{
    int status = 0;
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    child = -1;
    TEST_ASSERT_TRUE(WIFEXITED(status));
    TEST_ASSERT_EQUAL_INT(answer, WEXITSTATUS(status) - ANSWERS);
}

/* Ten of the rounds after which the child looks for what may have ended its waiting. */
static void is_still_waiting(void)
{
    (void)usleep(1000000);
    TEST_ASSERT_EQUAL_INT(0, waitpid(child, NULL, WNOHANG));
}

static void enter_confirms(void)
{
    begin_asking(true, true, NULL, NULL);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(said, "Lay the white diffuse layer on the sample"), said);
    is_still_waiting();
    type("\n");
    ends_with(NACRE_OK);
}

static void the_other_direction_is_asked_for(void)
{
    begin_asking(true, false, NULL, NULL);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(said, "Take the white diffuse layer off"), said);
    type("yes\n");
    ends_with(NACRE_OK);
}

static void type_enter(void)
{
    type("\n");
    (void)usleep(100000); /* until the terminal has it */
}

static void enter_before_the_question_does_not_count(void)
{
    begin_asking(true, true, NULL, type_enter);
    is_still_waiting();
    type("\n");
    ends_with(NACRE_OK);
}

static void doubt_is_said_and_the_person_may_insist(void)
{
    begin_asking(true, false, "The layer is still there", NULL);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(said, "The layer is still there. If you are sure"), said);
    type("sure\n");
    ends_with(SEQUENCE_INSISTED);
}

static void words_that_only_begin_like_it_do_not_insist(void)
{
    begin_asking(true, false, "The layer is still there", NULL);
    type("surely not\n");
    ends_with(NACRE_OK);
}

static void interrupt_stops(void)
{
    begin_asking(true, true, NULL, NULL);
    type("\003"); /* Ctrl-C */
    ends_with(NACRE_CANCELLED);
}

static void closed_input_stops(void)
{
    begin_asking(true, true, NULL, NULL);
    type("\004"); /* Ctrl-D */
    ends_with(NACRE_CANCELLED);
}

static void signal_child(void)
{
    TEST_ASSERT_EQUAL_INT(0, kill(child, SIGUSR1));
}

static void without_a_terminal_a_signal_confirms(void)
{
    char command[64];
    begin_asking(false, true, NULL, NULL);
    (void)snprintf(command, sizeof command, "kill -USR1 %d", (int)child);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(said, command), said);
    is_still_waiting();
    signal_child();
    ends_with(NACRE_OK);
}

static void signal_before_the_question_does_not_count(void)
{
    begin_asking(false, true, NULL, signal_child);
    is_still_waiting();
    signal_child();
    ends_with(NACRE_OK);
}

static void another_signal_insists(void)
{
    begin_asking(false, true, "Nothing has changed", NULL);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(said, "Nothing has changed. If you are sure"), said);
    TEST_ASSERT_EQUAL_INT(0, kill(child, SIGUSR2));
    ends_with(SEQUENCE_INSISTED);
}

static void without_a_terminal_an_interrupt_stops(void)
{
    begin_asking(false, true, NULL, NULL);
    TEST_ASSERT_EQUAL_INT(0, kill(child, SIGINT));
    ends_with(NACRE_CANCELLED);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(enter_confirms);
    RUN_TEST(the_other_direction_is_asked_for);
    RUN_TEST(enter_before_the_question_does_not_count);
    RUN_TEST(doubt_is_said_and_the_person_may_insist);
    RUN_TEST(words_that_only_begin_like_it_do_not_insist);
    RUN_TEST(interrupt_stops);
    RUN_TEST(closed_input_stops);
    RUN_TEST(without_a_terminal_a_signal_confirms);
    RUN_TEST(signal_before_the_question_does_not_count);
    RUN_TEST(another_signal_insists);
    RUN_TEST(without_a_terminal_an_interrupt_stops);
    return UNITY_END();
}
