/* A nacred of the tests in the background: started, listened to as its service manager, ended. */
#ifndef TESTS_DAEMON_SERVICE_H
#define TESTS_DAEMON_SERVICE_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

/* More than a daemon of the tests says; what comes beyond is lost. */
enum { SERVICE_LINES = 2048, SERVICE_LINE_SIZE = 256 };

/* Zeroed: none runs. */
struct service {
    pid_t process;
    int socket; /* what it notifies */
    char path[64];
    pthread_t reader; /* of the socket: a sender waits when nobody reads */
    pthread_mutex_t mutex;
    char (*lines)[SERVICE_LINE_SIZE];
    size_t count, heard;
};

/* Start a program with its arguments (NULL-terminated) and wait until it says that it is ready. watchdog_us > 0: it is
 * to show life so often. Returns false if it ends before. */
bool service_start(struct service *service, const char *const *arguments, long watchdog_us);

/* The next notification that begins with `prefix`, if it comes within the time; NULL: it did not. */
const char *service_hear(struct service *service, const char *prefix, int time_ms);

/* Send a signal and wait for the end; the exit status, or 128 and the signal that ended it. Nothing happens if none
 * runs. */
int service_end(struct service *service, int signal_number);

#endif
