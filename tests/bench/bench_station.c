/* How fast the virtual station measures, faster than life: patterns shown, exposed and written by one core, and what that
 * makes of the whole plan.
 *
 *   bench_station STATION PATTERNS
 *
 * Times are processor time of the process, so that other programs on the machine hardly count. */
#include "rig/session.h"
#include "rig/virtual/virtual.h"
#include "tests/files.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <time.h>

struct times {
    double show, first, others, write;
    double bytes;
};

static struct nacre_error error;

static double now(void)
{
    struct timespec time;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time); /* exists on Linux */
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static int expose(struct virtual_station *station, struct exposure *exposure, size_t pixels)
{
    struct camera *camera = virtual_station_camera(station);
    struct trigger *trigger = virtual_station_trigger(station);
    struct camera_frame frame = {0};
    int status = camera->ops->arm(camera, exposure->exposure_ns, &error);
    if (status == NACRE_OK) {
        status = trigger->ops->fire(trigger, exposure->exposure_ns, &exposure->trigger_ns, &error);
    }
    /* A frame that is lost costs its exposure and is taken again. */
    if (status == NACRE_OK &&
        camera->ops->take(camera, exposure->exposure_ns + 2000000000, &frame, &error) == NACRE_OK) {
        for (size_t i = 0; i < pixels; i++) {
            exposure->raw[i] = frame.raw[i];
        }
    }
    return status;
}

static int make_frames(const struct session *session, int number, struct pattern_frames *frames)
{
    const struct station_camera *camera = &session->station.camera;
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    *frames = (struct pattern_frames){.pattern = {PATTERN_GRID, number},
                                      .width = camera->width,
                                      .height = camera->height,
                                      .bits = camera->bits,
                                      .bayer = (enum bayer)camera->bayer,
                                      .count = session->plan.exposure_count};
    frames->exposures = calloc(frames->count, sizeof *frames->exposures);
    for (size_t i = 0; frames->exposures && i < frames->count; i++) {
        frames->exposures[i].exposure_ns = session_exposure_ns(session, i);
        frames->exposures[i].raw = calloc(pixels, sizeof(uint16_t));
        if (!frames->exposures[i].raw) {
            return NACRE_FAILED;
        }
    }
    return frames->exposures ? NACRE_OK : NACRE_FAILED;
}

static int measure(const struct session *session, struct virtual_station *station, int number,
                   uint8_t *levels, struct times *times)
{
    const struct station_sample *sample = &session->station.sample;
    struct projector *projector = virtual_station_projector(station);
    struct pattern_frames frames = {0};
    struct stat file = {0};
    int64_t flip_ns;
    double at[5];
    int status = make_frames(session, number, &frames);
    plan_draw(&session->plan, frames.pattern, sample->width, sample->height, levels);
    virtual_station_begin_pattern(station, frames.pattern);
    at[0] = now();
    if (status == NACRE_OK) {
        status = projector->ops->show(projector, levels, &flip_ns, &error);
    }
    at[1] = now();
    at[2] = at[1];
    for (size_t i = 0; i < frames.count && status == NACRE_OK; i++) {
        status =
            expose(station, &frames.exposures[i], (size_t)frames.width * (size_t)frames.height);
        at[2] = i == 0 ? now() : at[2];
    }
    at[3] = now();
    if (status == NACRE_OK) {
        status = session_write(session, &frames, &error);
    }
    at[4] = now();
    char *path = session_pattern_path(session, frames.pattern);
    if (status == NACRE_OK && path && stat(path, &file) == 0) {
        times->bytes += (double)file.st_size;
    }
    times->show += at[1] - at[0];
    times->first += at[2] - at[1];
    times->others += at[3] - at[2];
    times->write += at[4] - at[3];
    free(path);
    pattern_frames_finish(&frames);
    return status;
}

static void print(const struct session *session, const struct times *sums, int patterns)
{
    const struct plan *plan = &session->plan;
    double all = 0;
    double frames = (double)plan->exposure_count;
    double one = (sums->show + sums->first + sums->others + sums->write) / patterns;
    for (int kind = 0; kind < PATTERN_KINDS; kind++) {
        all += plan_pattern_count(plan, (enum pattern_kind)kind);
    }
    printf("show %.1f ms, light and first exposure %.1f ms, %zu more exposures %.1f ms, "
           "writing %.1f ms, %.2f MiB a pattern\n",
           1e3 * sums->show / patterns, 1e3 * sums->first / patterns, plan->exposure_count - 1,
           1e3 * sums->others / patterns, 1e3 * sums->write / patterns,
           sums->bytes / patterns / 1048576);
    printf("%.1f frames a second on one core; %.0f patterns of %.0f frames: %.1f minutes on two, "
           "%.1f GiB\n",
           frames / one, all, frames, all * one / 2 / 60,
           all * sums->bytes / patterns / 1073741824);
}

int main(int count, char **arguments)
{
    struct session session = {0};
    struct virtual_station *station = NULL;
    struct times sums = {0};
    uint8_t *levels = NULL;
    int patterns = count == 3 ? (int)strtol(arguments[2], NULL, 10) : 0;
    if (patterns < 1) {
        (void)fprintf(stderr, "usage: %s STATION PATTERNS\n", arguments[0]);
        return 2;
    }
    char *folder = folder_make(), *path = path_join(folder, "session");
    int status = session_create(path, arguments[1], NULL, false, &session, &error);
    if (status == NACRE_OK) {
        status = virtual_station_new(&session.station, &station, &error);
    }
    if (status == NACRE_OK) {
        levels =
            malloc((size_t)session.station.sample.width * (size_t)session.station.sample.height);
        status = levels ? NACRE_OK : NACRE_FAILED;
    }
    for (int i = 0; i < patterns && status == NACRE_OK; i++) {
        status = measure(&session, station,
                         i * 97 % (session.plan.grid_spacing * session.plan.grid_spacing), levels,
                         &sums);
    }
    if (status == NACRE_OK) {
        print(&session, &sums, patterns);
    } else {
        (void)fprintf(stderr, "%s\n", error.text);
    }
    free(levels);
    virtual_station_free(station);
    session_finish(&session);
    free(path);
    folder_remove(folder);
    return status == NACRE_OK ? 0 : 1;
}
