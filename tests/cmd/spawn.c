/* Running the built programs as a user does, and looking at what they print and leave behind. */
#include "tests/cmd/spawn.h"

#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

/* A test that cannot set itself up must not go on. */
static void demand(bool held, const char *what)
{
    if (!held) {
        perror(what);
        abort();
    }
}

static char *read_descriptor(int descriptor)
{
    struct stat status;
    demand(fstat(descriptor, &status) == 0, "fstat");
    size_t size = (size_t)status.st_size;
    char *text = calloc(1, size + 1);
    demand(text && pread(descriptor, text, size, 0) == (ssize_t)size, "pread");
    return text;
}

static int temporary(void)
{
    int descriptor = memfd_create("output", MFD_CLOEXEC);
    demand(descriptor >= 0, "memfd_create");
    return descriptor;
}

_Noreturn static void become(const char *const *arguments, int output, int errors,
                             size_t file_limit)
{
    (void)dup2(output, STDOUT_FILENO);
    (void)dup2(errors, STDERR_FILENO);
    if (file_limit) {
        struct rlimit limit = {.rlim_cur = file_limit, .rlim_max = file_limit};
        (void)setrlimit(RLIMIT_FSIZE, &limit);
        (void)signal(SIGXFSZ, SIG_IGN); /* so that write fails with EFBIG instead */
    }
    (void)execv(arguments[0], (char **)(size_t)arguments);
    perror(arguments[0]);
    _exit(99);
}

static void sleep_us(int64_t time_us)
{
    struct timespec wait = {.tv_sec = time_us / 1000000, .tv_nsec = time_us % 1000000 * 1000};
    (void)nanosleep(&wait, NULL);
}

/* Send the signal as the circumstances want; a file that never comes is waited for in vain for a minute. */
static void interrupt(pid_t child, const struct circumstances *around)
{
    for (int i = 0; around->interrupt_path && i < 30000; i++) {
        if (access(around->interrupt_path, F_OK) == 0) {
            break;
        }
        sleep_us(2000);
    }
    if (around->interrupt_path || around->interrupt_ms || around->interrupt_us) {
        sleep_us((int64_t)around->interrupt_ms * 1000 + around->interrupt_us);
        (void)kill(child, around->signal ? around->signal : SIGINT);
    }
}

struct spawned spawn(const char *const *arguments, const struct circumstances *around)
{
    static const struct circumstances none = {0};
    struct spawned run = {0};
    int output = temporary();
    int errors = temporary();
    int status = 0;
    (void)fflush(stdout);
    around = around ? around : &none;
    pid_t child = fork();
    demand(child >= 0, "fork");
    if (child == 0) {
        become(arguments, output, errors, around->file_limit);
    }
    interrupt(child, around);
    demand(waitpid(child, &status, 0) == child, "waitpid");
    run.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    run.output = read_descriptor(output);
    run.errors = read_descriptor(errors);
    (void)close(output);
    (void)close(errors);
    return run;
}

void spawned_finish(struct spawned *run)
{
    free(run->output);
    free(run->errors);
    *run = (struct spawned){0};
}

void spawn_or_abort(const char *const *arguments)
{
    struct spawned run = spawn(arguments, NULL);
    if (run.status != 0) {
        (void)fprintf(stderr, "%s %s: exit status %d\n%s%s", arguments[0], arguments[1], run.status,
                      run.output, run.errors);
        abort();
    }
    spawned_finish(&run);
}
