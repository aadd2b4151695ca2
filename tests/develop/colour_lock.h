/* A virtual station under a colour wheel whose exposures are as a given trigger makes them: the scan's error of colour. */
#ifndef TESTS_DEVELOP_COLOUR_LOCK_H
#define TESTS_DEVELOP_COLOUR_LOCK_H

#include <stdint.h>

enum { COLOUR_LOCK_POINTS = 64, COLOUR_LOCK_EXPOSURES = 128, COLOUR_LOCK_KINDS = 2 };

#define COLOUR_LOCK_HZ 30.0

/* The exposures of the plan, turns. */
extern const int colour_lock_turns[COLOUR_LOCK_KINDS];

/* How one exposure differs from whole turns that begin with the wheel's. */
struct colour_lock_exposure {
    int64_t after_ns; /* a turn's beginning */
    int64_t off_ns;   /* longer than whole turns */
};

/* What a trigger does, for each of the plan's exposures; used in turn. */
struct colour_lock_trigger {
    struct colour_lock_exposure list[COLOUR_LOCK_KINDS][COLOUR_LOCK_EXPOSURES];
};

/* The sum of each developed response, in the order of R G B. */
struct colour_lock_sums {
    double sums[COLOUR_LOCK_POINTS][3];
};

/* Scan and develop in a new folder. NULL: without a wheel. */
void colour_lock_scan(const struct colour_lock_trigger *trigger, struct colour_lock_sums *result);

/* Relative errors against those without a wheel. */
struct colour_lock_error {
    double rms, worst;
    double hue_rms; /* of what is left when each response's brightness is made right */
};

struct colour_lock_error colour_lock_judge(const struct colour_lock_sums *sums,
                                           const struct colour_lock_sums *truth);

/* Pulses that begin anywhere in a turn, of the given errors of length, ns, used in turn. */
void colour_lock_free(const int64_t *off_ns, int count, uint64_t seed,
                      struct colour_lock_trigger *trigger);

/* Pulses of the trigger board in simavr, on a wheel whose index jitters by so many microseconds
 * either way. Returns the largest error of a length, ns. */
double colour_lock_board(double jitter_us, uint64_t seed, struct colour_lock_trigger *trigger);

#endif
