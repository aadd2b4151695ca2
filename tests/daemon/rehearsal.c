/* Virtual devices for jobs. */
#include "rehearsal.h"

#include <stddef.h>
#include <stdlib.h>
#include <unistd.h>

static struct rehearsal *rehearsal_of(struct camera *camera)
{
    return (struct rehearsal *)(void *)((char *)camera - offsetof(struct rehearsal, camera));
}

static int arm(struct camera *camera, int64_t exposure_ns, struct nacre_error *error)
{
    struct camera *inner = &rehearsal_of(camera)->faulty.base;
    return inner->ops->arm(inner, exposure_ns, error);
}

/* Stay in the call until the test says otherwise. */
static void hang(struct rehearsal *rehearsal)
{
    (void)pthread_mutex_lock(&rehearsal->mutex);
    rehearsal->hangs = true;
    (void)pthread_cond_broadcast(&rehearsal->changed);
    while (!rehearsal->released) {
        (void)pthread_cond_wait(&rehearsal->changed, &rehearsal->mutex);
    }
    (void)pthread_mutex_unlock(&rehearsal->mutex);
}

static int take(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                struct nacre_error *error)
{
    struct rehearsal *rehearsal = rehearsal_of(camera);
    struct camera *inner = &rehearsal->faulty.base;
    if (rehearsal->takes++ == rehearsal->hang_at) {
        hang(rehearsal);
    }
    (void)usleep((useconds_t)rehearsal->slow_ms * 1000);
    return inner->ops->take(inner, timeout_ns, frame, error);
}

static void close_camera(struct camera *camera)
{
    struct camera *inner = &rehearsal_of(camera)->faulty.base;
    inner->ops->close(inner);
}

static int open_virtual(void *context, const struct station *station, struct devices *devices,
                        struct nacre_error *error)
{
    static const struct camera_ops ops = {"rehearsal", arm, take, close_camera};
    struct rehearsal *rehearsal = context;
    *devices = (struct devices){0};
    if (rehearsal->refusal) {
        return nacre_fail(error, "%s", rehearsal->refusal);
    }
    int status = virtual_station_new(station, &rehearsal->station, error);
    if (status != NACRE_OK) {
        return status;
    }
    rehearsal->faulty = faulty_camera(virtual_station_camera(rehearsal->station), rehearsal->fault,
                                      rehearsal->fault_at);
    rehearsal->camera = rehearsal->faulty.base;
    rehearsal->camera.ops = &ops;
    *devices = (struct devices){.camera = &rehearsal->camera,
                                .projector = virtual_station_projector(rehearsal->station),
                                .trigger = virtual_station_trigger(rehearsal->station),
                                .clock = virtual_station_clock(rehearsal->station)};
    return NACRE_OK;
}

static void close_virtual(void *context, struct devices *devices)
{
    struct rehearsal *rehearsal = context;
    *devices = (struct devices){0};
    if (rehearsal->hang_closing) {
        hang(rehearsal);
    }
    virtual_station_free(rehearsal->station);
    rehearsal->station = NULL;
}

static void lay_white_layer(void *context, bool on)
{
    struct rehearsal *rehearsal = context;
    virtual_station_set_white_layer(rehearsal->station, on);
}

void rehearsal_init(struct rehearsal *rehearsal)
{
    *rehearsal = (struct rehearsal){.fault = FAULT_LOST, .fault_at = -1, .hang_at = -1};
    (void)pthread_mutex_init(&rehearsal->mutex, NULL);
    (void)pthread_cond_init(&rehearsal->changed, NULL);
}

void rehearsal_finish(struct rehearsal *rehearsal)
{
    (void)pthread_cond_destroy(&rehearsal->changed);
    (void)pthread_mutex_destroy(&rehearsal->mutex);
}

struct job_opener rehearsal_opener(struct rehearsal *rehearsal)
{
    return (struct job_opener){rehearsal, open_virtual, close_virtual, lay_white_layer,
                               rehearsal->check_layer};
}

void rehearsal_wait_hanging(struct rehearsal *rehearsal)
{
    (void)pthread_mutex_lock(&rehearsal->mutex);
    while (!rehearsal->hangs) {
        (void)pthread_cond_wait(&rehearsal->changed, &rehearsal->mutex);
    }
    (void)pthread_mutex_unlock(&rehearsal->mutex);
}

void rehearsal_release(struct rehearsal *rehearsal)
{
    (void)pthread_mutex_lock(&rehearsal->mutex);
    rehearsal->released = true;
    (void)pthread_cond_broadcast(&rehearsal->changed);
    (void)pthread_mutex_unlock(&rehearsal->mutex);
}
