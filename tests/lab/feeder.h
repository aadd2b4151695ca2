/* A camera that sees the screen: at each pulse of the trigger's line it reads back what the card shows, lets the virtual
 * station's sample and camera make a raw frame of it, and feeds that to v4l2loopback. */
#ifndef TESTS_LAB_FEEDER_H
#define TESTS_LAB_FEEDER_H

#include "gpio_sim.h"
#include "nacre/error.h"
#include "screen.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum feeder_fault {
    FEEDER_SOUND,
    FEEDER_LATE,     /* the exposure begins long after the trigger */
    FEEDER_PREVIOUS, /* the exposure ended before the trigger, and shows the pattern before this one */
    FEEDER_REPEATED, /* the frame is delivered a second time */
    FEEDER_LOST,     /* nothing is delivered */
    FEEDER_DAMAGED,  /* the frame is flagged as an error, and its pixels are wrong */
    FEEDER_TORN,     /* the frame ends early */
    FEEDER_SKIPPED   /* a frame that nobody asked for was counted before it */
};

/* What goes wrong at the `pulse`-th pulse, from 1. */
struct feeder_injection {
    int pulse;
    enum feeder_fault fault;
};

enum { FEEDER_BUFFERS = 4 };

/* What is known of a trigger's line, on CLOCK_MONOTONIC. */
struct feeder_line {
    int level;
    unsigned rises;
    long long rise_ns, fall_ns;
};

struct feeder {
    const struct screen *screen;
    const struct gpio_sim *chip;               /* whose line 0 triggers, or NULL */
    bool (*look)(struct feeder_line *);        /* in its place; false: the trigger is gone */
    const struct feeder_injection *injections; /* ended by a pulse of 0; may be NULL */
    int left, top;                             /* of the sample on the screen */
    int pulses, injected;                      /* so far */
    struct virtual_station *station;
    int width, height; /* of the sample */
    /* That the plan has, ascending: what the emulated machine adds to a pulse is taken off. */
    int64_t exposures_ns[2];
    unsigned missed;        /* pulses that came before the one before them was dealt with */
    int64_t stamp_delay_ns; /* from an exposure's end to the frame's stamp */
    int video;              /* of v4l2loopback */
    size_t frame_bytes;
    void *buffers[FEEDER_BUFFERS];
    unsigned written;         /* frames, of which the n-th is in buffer n % FEEDER_BUFFERS */
    uint32_t sequence;        /* the next frame's number */
    unsigned rises;           /* of the line that were dealt with */
    uint8_t *levels, *before; /* [height][width] now, and of the pattern before */
    uint8_t *lit;             /* what lies on the virtual sample */
    bool watching;            /* `levels` were read while the line was up */
};

/* Without a chip the caller sets `look` next. Load v4l2loopback and set the feeder up for the virtual station in the
 * file `station`, whose camera has 8 bits and RGGB. */
void feeder_begin(struct feeder *feeder, const char *station, const struct screen *screen,
                  const struct gpio_sim *chip);
/* Unload it again; its node must not be open any more. One that is zeroed, or finished, is left alone. */
void feeder_finish(struct feeder *feeder);

/* Look at the line, and make the frame of a pulse that has come to its end. To be called every millisecond or so. */
void feeder_step(struct feeder *feeder);

/* The white layer lies on the sample from now on, or does not. */
void feeder_lay_white(struct feeder *feeder, bool on);

/* The camera is gone, while others use it. */
void feeder_unplug(struct feeder *feeder);

#endif
