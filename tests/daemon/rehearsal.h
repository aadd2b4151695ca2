/* A virtual station as a job's devices, with a camera that is slow, fails or hangs. */
#ifndef TESTS_DAEMON_REHEARSAL_H
#define TESTS_DAEMON_REHEARSAL_H

#include "rig/daemon/job.h"
#include "stage.h"

#include <pthread.h>

struct rehearsal {
    const char *refusal; /* opening fails with this text; NULL: it does not */
    enum fault fault;    /* at this take; < 0: never */
    int fault_at;
    bool check_layer;                /* which is in doubt here: the sample is a white board, too */
    int slow_ms;                     /* every take lasts so long */
    int hang_at;                     /* this take lasts until rehearsal_release; < 0: none */
    bool hang_closing;               /* closing lasts until rehearsal_release */
    _Atomic int takes;               /* so far */
    struct virtual_station *station; /* while the devices are open */
    /* The rest is its own. */
    struct faulty_camera faulty;
    struct camera camera;
    struct trigger *trigger;
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    _Atomic bool hangs;
    bool released;
};

void rehearsal_init(struct rehearsal *rehearsal);
void rehearsal_finish(struct rehearsal *rehearsal);
struct job_opener rehearsal_opener(struct rehearsal *rehearsal);

/* Wait until the camera hangs; let it go. */
void rehearsal_wait_hanging(struct rehearsal *rehearsal);
void rehearsal_release(struct rehearsal *rehearsal);

#endif
