/* What goes wrong with single frames of the virtual station, for the sequencer to notice. */
#ifndef RIG_VIRTUAL_FAULTS_H
#define RIG_VIRTUAL_FAULTS_H

#include "rig/virtual/effects.h"
#include "rig/virtual/settings.h"

#include <stdint.h>

enum frame_fault {
    FRAME_SOUND,
    FRAME_DROPPED, /* the camera counts it and does not deliver it */
    FRAME_LATE,    /* it begins late after its trigger */
    FRAME_STRAY    /* something started it before the trigger did, by half of its exposure */
};

/* What happens to a frame; `key` is all that tells it from others. */
enum frame_fault faults_draw(const struct effects *effects, const struct virtual_settings *settings,
                             uint64_t key);

#endif
