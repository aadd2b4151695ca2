/* Tests of the progress bar, on a pseudo-terminal and off one, of cancelling, and of the clock. */
#include "base/clock.h"
#include "base/progress.h"
#include "unity.h"

#include <math.h>
#include <pty.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

void setUp(void)
{
}

void tearDown(void)
{
}

enum { COLUMNS = 100 };

/* What `work` printed on standard error, which is a terminal of so many columns, or a pipe where columns is 0. The
 * process that ran it must have exited with 0. */
static void run_on_terminal(void (*work)(void), unsigned short columns, char *text, size_t size)
{
    int ends[2] = {-1, -1}, status = 0;
    struct winsize window = {.ws_row = 25, .ws_col = columns};
    size_t used = 0;
    ssize_t got = 0;
    if (columns) {
        TEST_ASSERT_EQUAL_INT(0, openpty(&ends[0], &ends[1], NULL, NULL, &window));
    } else {
        TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    }
    (void)fflush(stdout);
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        (void)dup2(ends[1], STDERR_FILENO);
        work();
        _exit(0);
    }
    (void)close(ends[1]);
    /* The far end of a terminal that was closed gives an error, that of a pipe its end. */
    while (used < size - 1 && (got = read(ends[0], text + used, size - 1 - used)) > 0) {
        used += (size_t)got;
    }
    text[used] = '\0';
    (void)close(ends[0]);
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_TRUE_MESSAGE(WIFEXITED(status) && WEXITSTATUS(status) == 0, text);
}

static void show_half(bool quiet, bool end)
{
    struct progress progress = progress_begin("factoring", quiet);
    progress.started_ns -= 90000000000; /* as if it had begun 90 s ago */
    if (progress_step(&progress, 5, 10, "objective 0.5", NULL) != NACRE_OK) {
        _exit(1);
    }
    if (end) {
        progress_end(&progress);
    }
}

static void show_loud(void)
{
    show_half(false, false);
}

static void show_quietly(void)
{
    show_half(true, true);
}

static void show_and_end(void)
{
    show_half(false, true);
}

static void a_terminal_shows_task_part_time_left_and_detail(void)
{
    char text[4096];
    run_on_terminal(show_loud, COLUMNS, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING(
        "\r\033[Kfactoring [############            ]  50 %, 1 min 30 s left, objective 0.5", text);
}

static void a_narrow_terminal_gets_a_line_that_fits(void)
{
    char text[4096];
    run_on_terminal(show_loud, 20, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("\r\033[Kfactoring [########", text);
}

static void the_end_wipes_the_bar(void)
{
    char text[4096];
    run_on_terminal(show_and_end, COLUMNS, text, sizeof text);
    TEST_ASSERT_TRUE(strlen(text) > 4);
    TEST_ASSERT_EQUAL_STRING("\r\033[K", text + strlen(text) - 4);
}

static void quiet_or_no_terminal_shows_nothing(void)
{
    char text[4096];
    run_on_terminal(show_quietly, COLUMNS, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("", text);
    run_on_terminal(show_and_end, 0, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("", text);
}

static void show_many_steps(void)
{
    struct progress progress = progress_begin("factoring", false);
    struct clock clock = clock_monotonic();
    int64_t end = clock_now_ns(&clock) + 250000000;
    for (int i = 0; clock_now_ns(&clock) < end; i++) {
        (void)progress_step(&progress, i, 1e9, NULL, NULL);
        clock_sleep_until_ns(&clock, clock_now_ns(&clock) + 1000000);
    }
}

static void at_most_ten_lines_a_second_are_drawn(void)
{
    char text[4096];
    int lines = 0;
    run_on_terminal(show_many_steps, COLUMNS, text, sizeof text);
    for (const char *c = text; *c; c++) {
        lines += *c == '\r';
    }
    /* At 0, 100 and 200 ms; on a busy machine fewer. */
    TEST_ASSERT_TRUE(lines >= 1 && lines <= 3);
}

static void show_strange_numbers(void)
{
    static const double cases[][2] = {{0, 0},    {5, 0},   {-1, 10},     {20, 10},
                                      {NAN, 10}, {1, NAN}, {INFINITY, 1}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct progress progress = progress_begin("x", false);
        progress.started_ns -= 90000000000;
        (void)progress_step(&progress, cases[i][0], cases[i][1], NULL, NULL);
    }
}

static void parts_outside_0_to_1_are_drawn_as_the_nearest_end(void)
{
    char text[4096];
    int empty = 0, whole = 0;
    run_on_terminal(show_strange_numbers, COLUMNS, text, sizeof text);
    for (const char *c = text; (c = strchr(c, '%')); c++) {
        empty += strncmp(c - 4, "  0 ", 4) == 0;
        whole += strncmp(c - 4, "100 ", 4) == 0;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(5, empty, text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(2, whole, text);
}

static void a_deadline_stops_a_task_and_is_noted(void)
{
    struct nacre_error error = {""};
    struct clock clock = clock_monotonic();
    struct progress_deadline deadline = {&clock, clock_now_ns(&clock) + INT64_C(3600000000000),
                                         false};
    struct progress progress = progress_begin("lighting", true);
    progress.deadline = &deadline;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, progress_step(&progress, 1, 2, NULL, &error));
    TEST_ASSERT_FALSE(deadline.passed);
    deadline.time_ns = clock_now_ns(&clock);
    TEST_ASSERT_EQUAL_INT(NACRE_CANCELLED, progress_step(&progress, 1, 2, NULL, &error));
    TEST_ASSERT_TRUE(deadline.passed);
    TEST_ASSERT_NOT_NULL(strstr(error.text, "lighting takes longer"));
}

static void interrupt_a_task(void)
{
    struct nacre_error error = {""};
    struct progress progress = progress_begin("factoring", false);
    progress_catch_signals();
    if (progress_interrupted() || progress_step(NULL, 0, 1, NULL, &error) != NACRE_OK) {
        _exit(1);
    }
    (void)raise(SIGTERM);
    if (!progress_interrupted()) {
        _exit(2);
    }
    bool right = progress_step(&progress, 0, 1, NULL, &error) == NACRE_CANCELLED &&
                 strcmp(error.text, "stopped on request") == 0 &&
                 progress_step(NULL, 0, 1, NULL, NULL) == NACRE_CANCELLED;
    _exit(right ? 0 : 3);
}

static void a_signal_cancels_the_next_step_with_or_without_a_bar(void)
{
    char text[4096];
    run_on_terminal(interrupt_a_task, 0, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("", text);
}

static void hang_up_a_task(void)
{
    progress_catch_signals();
    (void)raise(SIGHUP);
    (void)raise(SIGHUP); /* from the shell, too */
    _exit(progress_interrupted() ? 0 : 1);
}

static void hang_up_without_care(void)
{
    (void)signal(SIGHUP, SIG_IGN);
    progress_catch_signals();
    (void)raise(SIGHUP);
    _exit(progress_interrupted() ? 1 : 0);
}

static void a_terminal_that_closes_cancels_unless_that_is_ignored(void)
{
    char text[4096];
    run_on_terminal(hang_up_a_task, 0, text, sizeof text);
    run_on_terminal(hang_up_without_care, 0, text, sizeof text);
}

static void a_zeroed_progress_is_silent_and_ends(void)
{
    struct progress progress = {0};
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, progress_step(&progress, 1, 2, "x", &error));
    progress_end(&progress);
    progress_end(NULL);
    TEST_ASSERT_EQUAL_INT64(0, progress.shown_ns);
}

static void the_clock_never_goes_back_and_sleeps_at_least_as_long(void)
{
    struct clock clock = clock_monotonic();
    int64_t begin = clock_now_ns(&clock), now = begin;
    for (int i = 0; i < 1000; i++) {
        int64_t next = clock_now_ns(&clock);
        TEST_ASSERT_TRUE(next >= now);
        now = next;
    }
    clock_sleep_until_ns(&clock, begin - 5000000000); /* has passed: at once */
    TEST_ASSERT_TRUE(clock_now_ns(&clock) < begin + 5000000000);
    clock_sleep_until_ns(&clock, now + 20000000);
    TEST_ASSERT_TRUE(clock_now_ns(&clock) >= now + 20000000);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_terminal_shows_task_part_time_left_and_detail);
    RUN_TEST(a_narrow_terminal_gets_a_line_that_fits);
    RUN_TEST(the_end_wipes_the_bar);
    RUN_TEST(quiet_or_no_terminal_shows_nothing);
    RUN_TEST(a_deadline_stops_a_task_and_is_noted);
    RUN_TEST(at_most_ten_lines_a_second_are_drawn);
    RUN_TEST(parts_outside_0_to_1_are_drawn_as_the_nearest_end);
    RUN_TEST(a_signal_cancels_the_next_step_with_or_without_a_bar);
    RUN_TEST(a_terminal_that_closes_cancels_unless_that_is_ignored);
    RUN_TEST(a_zeroed_progress_is_silent_and_ends);
    RUN_TEST(the_clock_never_goes_back_and_sleeps_at_least_as_long);
    return UNITY_END();
}
