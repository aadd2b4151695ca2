/* Running povray: start, wait, read its picture or its message. */
#include "render/povray.h"

#include "render/pov.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { LOOK_NS = 20000000 };

static int fail_start(int number, struct nacre_error *error)
{
    return nacre_fail_errno(error, number, "cannot run povray (Debian: apt install povray)");
}

int povray_probe(struct nacre_error *error)
{
    const char *at = getenv("PATH");
    bool found = !at; /* the system's own path, which posix_spawnp knows */
    while (at && !found) {
        int length = (int)strcspn(at, ":");
        char *path = NULL;
        if (asprintf(&path, "%.*s/povray", length ? length : 1, length ? at : ".") < 0) {
            return nacre_fail_memory(error, "the name of a program");
        }
        found = access(path, X_OK) == 0;
        free(path);
        at = at[length] ? at + length + 1 : NULL;
    }
    return found ? NACRE_OK : fail_start(ENOENT, error);
}

/* Start povray in `folder` with all it says going to povray.log there. */
static int start(const char *folder, int width, int height, bool baked, pid_t *pid,
                 struct nacre_error *error)
{
    char w[16], h[16], threads[24];
    long online = sysconf(_SC_NPROCESSORS_ONLN), most = 64;
    long processors = online < 1 ? 1 : online > most ? most : online;
    (void)snprintf(w, sizeof w, "+W%d", width);
    (void)snprintf(h, sizeof h, "+H%d", height);
    (void)snprintf(threads, sizeof threads, "+WT%ld", processors);
    static const char input[] = "+I" POV_MAIN;
    static const char own[] = "Declare=" POV_BAKED "=1", povrays[] = "Declare=" POV_BAKED "=0";
    const char *const arguments[] = {"povray",
                                     input,
                                     "+Opicture.exr",
                                     "+FE",
                                     "+A0.1",
                                     "+AM2",
                                     "+R2",
                                     "-J",
                                     "-D",
                                     "-P",
                                     w,
                                     h,
                                     threads,
                                     baked ? own : povrays,
                                     NULL};
    posix_spawn_file_actions_t actions;
    int number = posix_spawn_file_actions_init(&actions);
    if (number == 0) {
        number = posix_spawn_file_actions_addchdir_np(&actions, folder);
        number = number ? number
                        : posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
        number = number ? number
                        : posix_spawn_file_actions_addopen(&actions, 1, "povray.log",
                                                           O_WRONLY | O_CREAT | O_TRUNC, 0666);
        number = number ? number : posix_spawn_file_actions_adddup2(&actions, 1, 2);
        number =
            number ? number
                   : posix_spawnp(pid, "povray", &actions, NULL, (char *const *)arguments, environ);
        (void)posix_spawn_file_actions_destroy(&actions);
    }
    return number == 0 ? NACRE_OK : fail_start(number, error);
}

/* The share of the pixels that povray says it has rendered. */
static double rendered(int log)
{
    char text[200] = "";
    double done = 0, total = 0;
    off_t size = lseek(log, 0, SEEK_END);
    off_t from = size > (off_t)sizeof text ? size - (off_t)sizeof text + 1 : 0;
    if (size > 0 && pread(log, text, sizeof text - 1, from) > 0) {
        for (const char *at = text; (at = strstr(at, "Rendered ")) != NULL; at++) {
            char *end = NULL;
            double pixels = strtod(at + strlen("Rendered "), &end);
            if (strncmp(end, " of ", 4) == 0) {
                done = pixels;
                total = strtod(end + 4, NULL);
            }
        }
    }
    return total > 0 ? done / total : 0;
}

/* Wait for the process to end and pass on its status; end it when the user asks to stop. */
static int wait_for(pid_t pid, int log, struct progress *progress, int *result,
                    struct nacre_error *error)
{
    for (;;) {
        struct timespec look = {.tv_nsec = LOOK_NS};
        pid_t ended = waitpid(pid, result, WNOHANG);
        if (ended == pid) { /* perhaps by the same Ctrl-C, which goes to both */
            return progress_step(progress, 1, 1, NULL, error);
        }
        if (ended < 0 && errno != EINTR) {
            return nacre_fail_errno(error, errno, "cannot wait for povray");
        }
        int stopped = progress_step(progress, rendered(log), 1, NULL, error);
        if (stopped != NACRE_OK) {
            (void)kill(pid, SIGTERM);
            (void)waitpid(pid, result, 0);
            return stopped;
        }
        (void)nanosleep(&look, NULL);
    }
}

/* Not every file it looks for has to be there. */
static bool tells_of_error(const char *line)
{
    return (strcasestr(line, "error") || strcasestr(line, "cannot")) &&
           !strstr(line, "configuration file");
}

static void make_printable(char *line)
{
    line[strcspn(line, "\r\n")] = '\0';
    for (; *line; line++) {
        *line = (char)(*line >= ' ' && *line <= '~' ? *line : '?');
    }
}

/* What povray.log says of an error, or its last line; one line in `text`. */
static void read_message(int log, char *text, size_t size)
{
    char line[512], last[512] = "it said nothing";
    size_t used = 0;
    FILE *file = lseek(log, 0, SEEK_SET) == 0 ? fdopen(dup(log), "r") : NULL;
    while (file && fgets(line, sizeof line, file)) {
        make_printable(line);
        if (*line) {
            memcpy(last, line, sizeof last);
        }
        if (tells_of_error(line) && used + 3 < size) {
            used += (size_t)snprintf(text + used, size - used, "%s%s", used ? "; " : "", line);
            used = used < size ? used : size - 1;
        }
    }
    if (used == 0) {
        (void)snprintf(text, size, "%s", last);
    }
    if (file) {
        (void)fclose(file);
    }
}

int povray_render(const char *folder, int width, int height, bool baked, struct progress *progress,
                  struct picture *picture, struct nacre_error *error)
{
    pid_t pid = 0;
    int result = 0, log = -1, status = NACRE_FAILED;
    char *log_path = NULL, *picture_path = NULL, message[512];
    *picture = (struct picture){0};
    if (asprintf(&log_path, "%s/povray.log", folder) < 0 ||
        asprintf(&picture_path, "%s/picture.exr", folder) < 0) {
        log_path = picture_path = NULL; /* undefined where asprintf failed */
        (void)nacre_fail_memory(error, "the names of povray's files");
        goto out;
    }
    (void)unlink(picture_path); /* an older one must not be taken for what povray makes now */
    if (start(folder, width, height, baked, &pid, error) != NACRE_OK) {
        goto out;
    }
    log = open(log_path, O_RDONLY | O_CLOEXEC); /* without it there is no bar and no message */
    status = wait_for(pid, log, progress, &result, error);
    if (status == NACRE_OK && WIFSIGNALED(result)) {
        status = nacre_fail(error, "povray was ended by signal %d (%s)", WTERMSIG(result),
                            sigdescr_np(WTERMSIG(result)));
    } else if (status == NACRE_OK && WEXITSTATUS(result) != 0) {
        read_message(log, message, sizeof message);
        status = nacre_fail(error, "povray failed: %s", message);
    }
    if (status == NACRE_OK && picture_read(picture_path, picture, error) != NACRE_OK) {
        status = nacre_fail_within(error, "povray left no picture that can be read");
    }
    if (status == NACRE_OK && (picture->width != width || picture->height != height)) {
        picture_finish(picture);
        status = nacre_fail(error, "povray made a picture of another size than was asked for");
    }
out:
    if (log >= 0) {
        (void)close(log);
    }
    free(log_path);
    free(picture_path);
    return status;
}

double povray_trace_seconds(const char *folder)
{
    char *path = NULL, line[256];
    double seconds = 0;
    FILE *file = NULL;
    if (asprintf(&path, "%s/povray.log", folder) < 0) {
        path = NULL; /* undefined where asprintf failed */
    }
    file = path ? fopen(path, "r") : NULL;
    while (file && fgets(line, sizeof line, file)) {
        const char *named = strstr(line, "Trace Time:"), *bracket = strchr(line, '(');
        seconds = named && bracket ? strtod(bracket + 1, NULL) : seconds;
    }
    if (file) {
        (void)fclose(file);
    }
    free(path);
    return seconds;
}
