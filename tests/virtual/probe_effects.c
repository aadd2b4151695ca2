/* Takes frames of a virtual station and prints what tells two builds of it apart: the frames' hash and the work that was
 * done for each effect. tests/virtual/effects_cost.py runs it, also under callgrind, which counts take_frames alone.
 * Usage: probe_effects STATION PATTERNS */
#include "rig/virtual/virtual.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

enum { EXPOSURES = 3 };

/* One of 1, 1.5 and 4 turns at 30 Hz. */
static const int64_t exposures_ns[EXPOSURES] = {33333333, 50000000, 133333333};

static int take_frame(struct virtual_station *station, int64_t exposure_ns,
                      struct camera_frame *frame, struct nacre_error *error)
{
    struct camera *camera = virtual_station_camera(station);
    struct trigger *trigger = virtual_station_trigger(station);
    int64_t trigger_ns;
    int status = camera->ops->arm(camera, exposure_ns, error);
    if (status == NACRE_OK) {
        status = trigger->ops->fire(trigger, exposure_ns, &trigger_ns, error);
    }
    return status == NACRE_OK ? camera->ops->take(camera, 2000000000, frame, error) : status;
}

static uint64_t hash_frame(uint64_t hash, const struct camera *camera,
                           const struct camera_frame *frame)
{
    for (int i = 0; i < camera->width * camera->height; i++) {
        hash = (hash ^ frame->raw[i]) * 1099511628211U; /* FNV-1a */
    }
    return hash;
}

/* The frames of one pattern; their hash into *hash. A dropped frame is none. */
__attribute__((noinline, noclone)) static int take_frames(struct virtual_station *station,
                                                          const uint8_t *levels, uint64_t *hash)
{
    struct projector *projector = virtual_station_projector(station);
    struct nacre_error error;
    int64_t flip_ns;
    int status = projector->ops->show(projector, levels, &flip_ns, &error);
    for (int i = 0; i < EXPOSURES && status == NACRE_OK; i++) {
        struct camera_frame frame;
        if (take_frame(station, exposures_ns[i], &frame, &error) == NACRE_OK) {
            *hash = hash_frame(*hash, virtual_station_camera(station), &frame);
        }
    }
    return status;
}

static void print(const struct virtual_station *station, uint64_t hash)
{
    const struct effects *effects = virtual_station_effects(station);
    for (int i = 0; i < EFFECTS; i++) {
        printf("%s: %" PRIu64 "\n", effect_names[i], effects->work[i]);
    }
    printf("frames: %016" PRIx64 "\n", hash);
}

int main(int count, char **arguments)
{
    struct nacre_error error = {0};
    struct station settings = {0};
    struct virtual_station *station = NULL;
    uint64_t hash = 14695981039346656037U;
    int patterns = count == 3 ? (int)strtol(arguments[2], NULL, 10) : 0;
    int status = NACRE_FAILED;
    if (patterns < 1) {
        (void)fprintf(stderr, "usage: %s STATION PATTERNS\n", arguments[0]);
        return 2;
    }
    status = station_read(arguments[1], &settings, &error);
    if (status == NACRE_OK) {
        status = virtual_station_new(&settings, &station, &error);
    }
    size_t points = (size_t)settings.sample.width * (size_t)settings.sample.height;
    uint8_t *levels = calloc(points + 1, 1);
    for (int n = 0; n < patterns && levels && status == NACRE_OK; n++) {
        for (size_t i = 0; i < points; i++) {
            levels[i] = (i + (size_t)n) % 3 == 0 ? 255 : 0;
        }
        virtual_station_begin_pattern(station, (struct pattern){PATTERN_GRID, n});
        virtual_station_set_white_layer(station, n % 2);
        status = take_frames(station, levels, &hash);
    }
    if (status == NACRE_OK && levels) {
        print(station, hash);
    } else {
        (void)fprintf(stderr, "%s\n", error.text);
        status = NACRE_FAILED;
    }
    free(levels);
    virtual_station_free(station);
    station_finish(&settings);
    return status == NACRE_OK ? 0 : 1;
}
