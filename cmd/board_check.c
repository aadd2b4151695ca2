/* What nacre doctor says of a trigger board. */
#include "cmd/board_check.h"

#include "rig/trigger_usb.h"

#include <math.h>

static const char name[] = "board";

static void judge(struct checks *checks, const struct board_status *status, double wheel_hz)
{
    double hz = trigger_usb_wheel_hz(status);
    double turns = hz / wheel_hz; /* in one of the station file's */
    double strange = (double)status->missed + (double)status->spurious;
    if (!(status->state & BOARD_LOCKED) || hz <= 0) {
        checks_add(checks, name, CHECK_WRONG,
                   "finds no colour wheel (%d spurious pulses, %d missed); does the projector run, "
                   "and does the photodiode see its index?",
                   status->spurious, status->missed);
        return;
    }
    if (rint(turns) < 1 || fabs(turns - rint(turns)) > 0.005 * rint(turns)) {
        checks_add(checks, name, CHECK_WRONG,
                   "is locked to a wheel of %.3f Hz, where projector.wheel_hz is %g; correct it",
                   hz, wheel_hz);
        return;
    }
    checks_add(checks, name, CHECK_OK,
               "is locked to a wheel of %.3f Hz, gain %d, which takes %.1f s to settle", hz,
               status->settings.gain, (8 << status->settings.gain) / hz);
    if (strange > 0.05 * (double)status->turn) {
        checks_add(checks, name, CHECK_WARNING,
                   "of %u turns %d pulses were missing, and %d came at impossible times; turn the "
                   "trimmer, and shield the photodiode",
                   (unsigned)status->turn, status->missed, status->spurious);
    }
}

void board_check(struct checks *checks, struct trigger *trigger, struct clock *clock,
                 double wheel_hz)
{
    static const int64_t patience_ns = 3000000000;
    static const int64_t round_ns = 50000000;
    struct board_status status;
    struct nacre_error error;
    int64_t end = clock_now_ns(clock) + patience_ns;
    int result = trigger_usb_status(trigger, &status, &error);
    while (result == NACRE_OK && !(status.state & BOARD_LOCKED) && clock_now_ns(clock) < end) {
        clock_sleep_until_ns(clock, clock_now_ns(clock) + round_ns);
        result = trigger_usb_status(trigger, &status, &error);
    }
    if (result == NACRE_OK) {
        judge(checks, &status, wheel_hz);
    } else {
        checks_add_status(checks, name, result, &error);
    }
}
