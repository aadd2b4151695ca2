/* A whole scan by `nacre scan` in the lab's guest, in which a feeder is the camera and sees the screen, and a person obeys: its
 * settings, its run, and the scan of a virtual station that it must equal. */
#ifndef TESTS_LAB_WHOLE_H
#define TESTS_LAB_WHOLE_H

#include "feeder.h"
#include "screen.h"

#include <stdbool.h>
#include <sys/types.h>

/* Where all is; a text, to be joined to others. */
#define WHOLE         "/run/whole"
#define WHOLE_STATION "/run/whole/station.yaml"
#define WHOLE_VIRTUAL "/run/whole/virtual.yaml"

/* Of the plan: 1 white, 4 dots, 2 black, 16 grids. */
enum { WHOLE_PATTERNS = 23, WHOLE_EXPOSURES = 2 * WHOLE_PATTERNS };

struct whole {
    struct screen screen;
    struct feeder feeder;
    pid_t child; /* the program while it runs; 0: it does not */
    int forgets; /* the question after which the person says that it is done, and it is not; 0: none */
};

/* What is the station's own of two that measure the same. */
struct whole_station {
    int tolerance_ms, stamp_delay_ms;
    const char *trigger; /* what stands behind the key */
};

/* The folder with station.yaml, virtual.yaml, plan.yaml and sample.yaml; the screen must be plugged in. */
void whole_write(const struct whole *whole, const struct whole_station *station);

/* Another file of such a station. */
void whole_write_station(const struct whole *whole, const char *path,
                         const struct whole_station *station);

/* The camera, whose stamps come 10 ms late, at the trigger's line of a chip or what `look` tells. */
void whole_plug_camera(struct whole *whole, const struct gpio_sim *chip,
                       bool (*look)(struct feeder_line *));

/* The same plan on the same sample without any device, measured and developed. */
void whole_scan_virtual(void);

/* What happens when so many pulses of the run have come: called until it returns true. NULL: nothing. */
struct whole_event {
    int pulse;
    bool (*happen)(void);
};

/* How a run of the program ended. whole_outcome_finish frees. */
struct whole_outcome {
    int status; /* exit status, or 128 + the signal that killed it */
    char *output, *errors;
    int asked;  /* how often the person was asked for the layer */
    int pulses; /* of the trigger */
    double seconds;
};

/* Run the program, being the sample, the camera and the person; no pulse may be missed. */
struct whole_outcome whole_run(struct whole *whole, const char *const *arguments,
                               struct whole_event event);
void whole_outcome_finish(struct whole_outcome *outcome);

/* Scan into a session by station.yaml with --json, going on with one that is there. */
struct whole_outcome whole_scan(struct whole *whole, const char *session, const char *retries,
                                struct whole_event event);

/* The session's frames are those of the virtual scan bit for bit, and so is what is developed from them. */
void whole_expect_same_as_virtual(const char *session);

/* For tearDown: a program that is still running when its test has failed is killed. */
void whole_end(struct whole *whole);

#endif
