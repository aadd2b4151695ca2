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

extern char **environ;

enum { LOOK_NS = 20000000 };

/* Start povray in `folder` with all it says going to povray.log there. */
static int start(const char *folder, int width, int height, bool baked, pid_t *pid,
                 struct nacre_error *error)
{
    char w[16], h[16], threads[24];
    long processors = sysconf(_SC_NPROCESSORS_ONLN);
    (void)snprintf(w, sizeof w, "+W%d", width);
    (void)snprintf(h, sizeof h, "+H%d", height);
    (void)snprintf(threads, sizeof threads, "+WT%ld",
                   processors < 1    ? 1
                   : processors > 64 ? 64
                                     : processors);
    const char *const arguments[] = {"povray",
                                     "+I" POV_MAIN,
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
                                     baked ? "Declare=" POV_BAKED "=1" : "Declare=" POV_BAKED "=0",
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
    return number == 0
               ? NACRE_OK
               : nacre_fail_errno(error, number, "cannot run povray (Debian: apt install povray)");
}

/* Wait for the process to end and pass on its status; end it when the user asks to stop. */
static int wait_for(pid_t pid, struct progress *progress, int *result, struct nacre_error *error)
{
    for (;;) {
        struct timespec look = {.tv_nsec = LOOK_NS};
        pid_t ended = waitpid(pid, result, WNOHANG);
        if (ended == pid) {
            return NACRE_OK;
        }
        if (ended < 0 && errno != EINTR) {
            return nacre_fail_errno(error, errno, "cannot wait for povray");
        }
        int stopped = progress_step(progress, 0, 1, NULL, error);
        if (stopped != NACRE_OK) {
            (void)kill(pid, SIGTERM);
            (void)waitpid(pid, result, 0);
            return stopped;
        }
        (void)nanosleep(&look, NULL);
    }
}

/* The lines of povray.log that tell of an error, or its last lines; one line in `text`. */
static void read_message(const char *folder, char *text, size_t size)
{
    char *path = NULL, line[512];
    char last[512] = "it said nothing";
    size_t used = 0;
    FILE *file = asprintf(&path, "%s/povray.log", folder) < 0 ? NULL : fopen(path, "r");
    while (file && fgets(line, sizeof line, file)) {
        char *end = line + strcspn(line, "\r\n");
        *end = '\0';
        if (*line) {
            memcpy(last, line, sizeof last);
        }
        if ((strcasestr(line, "error") || strcasestr(line, "cannot")) && used + 3 < size) {
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
    free(path);
}

int povray_render(const char *folder, int width, int height, bool baked, struct progress *progress,
                  struct picture *picture, struct nacre_error *error)
{
    pid_t pid;
    int result;
    char *path = NULL, message[512];
    int status = start(folder, width, height, baked, &pid, error);
    status = status == NACRE_OK ? wait_for(pid, progress, &result, error) : status;
    if (status != NACRE_OK) {
        return status;
    }
    if (!WIFEXITED(result) || WEXITSTATUS(result) != 0) {
        read_message(folder, message, sizeof message);
        return nacre_fail(error, "povray failed: %s", message);
    }
    if (asprintf(&path, "%s/picture.exr", folder) < 0) {
        return nacre_fail_memory(error, "the name of povray's picture");
    }
    status = picture_read(path, picture, error);
    free(path);
    if (status == NACRE_OK && (picture->width != width || picture->height != height)) {
        picture_finish(picture);
        status = nacre_fail(error, "povray made a picture of another size than was asked for");
    }
    return status;
}
