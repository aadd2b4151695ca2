/* A trigger board in a process of its own, plugged into the kernel's USB by vhci-hcd: the descriptors of the real firmware, and
 * its portable half. simavr is under the GPL, so only test programs link this. */
#ifndef TESTS_LAB_BOARD_SERVER_H
#define TESTS_LAB_BOARD_SERVER_H

#include <stdatomic.h>
#include <stdbool.h>
#include <sys/types.h>

/* What both processes see. Times are CLOCK_MONOTONIC. */
struct board_view {
    atomic_bool ready,
        broken;       /* attached to its end of the connection; it refused what the kernel sent */
    atomic_int level; /* of the trigger's pin */
    atomic_uint rises;
    atomic_llong rise_ns, fall_ns;      /* the last ones */
    atomic_ullong rise_tick, fall_tick; /* the same in the board's cycles */
    atomic_bool wheel_stops;            /* to be set by the test */
};

struct board_server {
    pid_t process; /* 0: not plugged in */
    struct board_view *view;
};

struct board_server_settings {
    int port; /* of vhci-hcd, from 0 */
    double wheel_hz;
    int protocol; /* that the board says it speaks; 0: the truth */
};

/* Plug a board in; the kernel has begun to look at it. vhci-hcd must be loaded. */
struct board_server board_server_plug(struct board_server_settings settings);

/* Pull it out, by killing its process. One that is not plugged in is left alone. */
void board_server_unplug(struct board_server *server);

#endif
