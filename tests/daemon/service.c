/* Running daemons in the background. */
#include "service.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static void *read_socket(void *context)
{
    struct service *service = context;
    char text[4096];
    ssize_t size;
    while ((size = recv(service->socket, text, sizeof text - 1, 0)) > 0) {
        text[size] = '\0';
        (void)pthread_mutex_lock(&service->mutex);
        if (service->count < SERVICE_LINES) {
            (void)snprintf(service->lines[service->count++], SERVICE_LINE_SIZE, "%.250s", text);
        }
        (void)pthread_mutex_unlock(&service->mutex);
    }
    return NULL;
}

static void open_socket(struct service *service)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)snprintf(service->path, sizeof service->path, "/tmp/nacre-notify-%d", (int)getpid());
    (void)unlink(service->path); /* of an earlier one */
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", service->path);
    service->socket = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    service->lines = calloc(SERVICE_LINES, sizeof *service->lines);
    if (!service->lines ||
        bind(service->socket, (struct sockaddr *)&address, sizeof address) != 0) {
        perror(service->path);
        abort();
    }
    (void)pthread_mutex_init(&service->mutex, NULL);
    (void)pthread_create(&service->reader, NULL, read_socket, service);
}

bool service_start(struct service *service, const char *const *arguments, long watchdog_us)
{
    char text[32];
    open_socket(service);
    (void)fflush(NULL);
    service->process = fork();
    if (service->process == 0) {
        (void)setenv("NOTIFY_SOCKET", service->path, 1);
        (void)snprintf(text, sizeof text, "%ld", watchdog_us);
        if (watchdog_us > 0) {
            (void)setenv("WATCHDOG_USEC", text, 1);
        }
        (void)execv(arguments[0], (char **)(size_t)arguments);
        perror(arguments[0]);
        _exit(99);
    }
    /* Slow machines and sanitizers take their time; a program that ended says so by its status. */
    for (int i = 0; i < 600; i++) {
        if (service_hear(service, "READY=1", 100)) {
            return true;
        }
        siginfo_t ended = {0};
        if (waitid(P_PID, (id_t)service->process, &ended, WEXITED | WNOHANG | WNOWAIT) == 0 &&
            ended.si_pid != 0) {
            return false;
        }
    }
    return false;
}

static long now_ms(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

/* The next line that begins so among those that came; NULL: none. */
static const char *find_line(struct service *service, const char *prefix)
{
    const char *found = NULL;
    (void)pthread_mutex_lock(&service->mutex);
    while (!found && service->heard < service->count) {
        const char *line = service->lines[service->heard++];
        found = strncmp(line, prefix, strlen(prefix)) == 0 ? line : NULL;
    }
    (void)pthread_mutex_unlock(&service->mutex);
    return found;
}

const char *service_hear(struct service *service, const char *prefix, int time_ms)
{
    long end_ms = now_ms() + time_ms;
    const char *found = find_line(service, prefix);
    while (!found && now_ms() < end_ms) {
        (void)usleep(5000);
        found = find_line(service, prefix);
    }
    return found;
}

int service_end(struct service *service, int signal_number)
{
    int status = 0;
    if (service->process <= 0) {
        return 0;
    }
    (void)kill(service->process, signal_number); /* it may have ended */
    (void)waitpid(service->process, &status, 0);
    (void)shutdown(service->socket, SHUT_RDWR); /* ends the reader */
    (void)pthread_join(service->reader, NULL);
    (void)pthread_mutex_destroy(&service->mutex);
    free(service->lines);
    (void)close(service->socket);
    (void)unlink(service->path);
    *service = (struct service){0};
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}
