/* A virtual station's scan under a colour wheel with exposures as a given trigger makes them. */
#include "colour_lock.h"

#include "made.h"
#include "rig/virtual/virtual.h"
#include "simulated.h"
#include "tests/files.h"
#include "unity.h"
#include "virtual_scan.h"

#include <math.h>
#include <simavr/sim_avr.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WINDOW = 3, RESPONSE = 3 * WINDOW * WINDOW, TRANSFER_MS = 50 };

#define TURN_NS     (1e9 / COLOUR_LOCK_HZ)
#define TURN_CYCLES (CYCLES_PER_SECOND / COLOUR_LOCK_HZ)

const int colour_lock_turns[COLOUR_LOCK_KINDS] = {1, 4};

static const char plan_text[] =
    "{seed: 5, black_frames: 2, white_frames: 1, dot_spacing: 4, dot_shift: 2, dot_size: 1,\n"
    " grid_spacing: 4, window: 3, exposure_turns: [1, 4]}\n";

static const char sample_text[] =
    "{width: 8, height: 8, pitch_mm: 0.5, thickness_mm: 2, margin_points: 2, base: light,\n"
    " materials: [{name: light, scattering_per_mm: [2.4, 2.3, 2.1],\n"
    "              absorption_per_mm: [0.2, 0.3, 0.6]}]}\n";

/* Nothing but the wheel differs from the ideal. */
static const char station_text[] =
    "sample: {width: 8, height: 8, pitch_mm: 0.5}\n"
    "camera: {driver: virtual, width: 48, height: 48, bits: 16, bayer: RGGB}\n"
    "projector: {driver: virtual, wheel_hz: 30}\n"
    "trigger: {driver: virtual}\n"
    "white_reflectance: 0.9\n"
    "plan: plan.yaml\n"
    "%s"
    "virtual:\n"
    "  sample: sample.yaml\n"
    "  projector:\n"
    "    contrast: 2000\n"
    "    wheel:\n"
    "      segments:\n"
    "        - {color: [1, 0, 0], angle_deg: 120}\n"
    "        - {color: [0, 1, 0], angle_deg: 120}\n"
    "        - {color: [0, 0, 1], angle_deg: 120}\n"
    "  camera: {elevation_deg: 12, pixels_per_point: 5, full_scale_s: 0.25}\n";

/* Devices around the virtual ones. */
struct locked {
    const struct colour_lock_trigger *list;
    int used[COLOUR_LOCK_KINDS];
    struct colour_lock_exposure now;
    struct devices inner;
};

struct locked_camera {
    struct camera base;
    struct locked *locked;
};

struct locked_trigger {
    struct trigger base;
    struct locked *locked;
};

static int arm(struct camera *camera, int64_t exposure_ns, struct nacre_error *error)
{
    struct locked *locked = ((struct locked_camera *)camera)->locked;
    int kind = fabs((double)exposure_ns / TURN_NS - colour_lock_turns[0]) < 0.5 ? 0 : 1;
    locked->now = locked->list->list[kind][locked->used[kind]++ % COLOUR_LOCK_EXPOSURES];
    return locked->inner.camera->ops->arm(locked->inner.camera, exposure_ns + locked->now.off_ns,
                                          error);
}

static int take(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                struct nacre_error *error)
{
    struct camera *inner = ((struct locked_camera *)camera)->locked->inner.camera;
    return inner->ops->take(inner, timeout_ns, frame, error);
}

/* The exposure begins so long after the next turn of the wheel. */
static int fire(struct trigger *trigger, int64_t exposure_ns, int64_t *trigger_ns,
                struct nacre_error *error)
{
    struct locked *locked = ((struct locked_trigger *)trigger)->locked;
    struct devices *inner = &locked->inner;
    double turn = ceil((double)clock_now_ns(inner->clock) / TURN_NS);
    clock_sleep_until_ns(inner->clock, llround(turn * TURN_NS) + locked->now.after_ns);
    return inner->trigger->ops->fire(inner->trigger, exposure_ns + locked->now.off_ns, trigger_ns,
                                     error);
}

/* They belong to the virtual station. */
static void close_camera(struct camera *camera)
{
    (void)camera;
}

static void close_trigger(struct trigger *trigger)
{
    (void)trigger;
}

/* Put a trigger's exposures between the sequence and the devices. */
static void wrap(void *context, struct devices *devices)
{
    static const struct camera_ops camera_ops = {"locked", arm, take, close_camera};
    static const struct trigger_ops trigger_ops = {"locked", fire, close_trigger};
    static struct locked locked;
    static struct locked_camera camera;
    static struct locked_trigger trigger;
    locked = (struct locked){.list = context, .inner = *devices};
    camera = (struct locked_camera){.base = *devices->camera, .locked = &locked};
    camera.base.ops = &camera_ops;
    trigger = (struct locked_trigger){.base = {.ops = &trigger_ops}, .locked = &locked};
    devices->camera = &camera.base;
    devices->trigger = &trigger.base;
}

void colour_lock_scan(const struct colour_lock_trigger *trigger, struct colour_lock_sums *result)
{
    char text[2048];
    struct sequence_result sequence;
    struct develop_report report;
    struct colour_lock_trigger copy = {0};
    char *folder = folder_make();
    virtual_scan_write(folder, "plan.yaml", plan_text);
    virtual_scan_write(folder, "sample.yaml", sample_text);
    (void)snprintf(text, sizeof text, station_text, trigger ? "" : "without: [colour wheel]\n");
    virtual_scan_write(folder, "station.yaml", text);
    if (trigger) {
        copy = *trigger;
    }
    virtual_scan_run_around(folder, wrap, &copy, &sequence, &report);
    float *responses = virtual_scan_load(folder, "scan.exr");
    memset(result, 0, sizeof *result);
    for (int i = 0; i < COLOUR_LOCK_POINTS * RESPONSE; i++) {
        int channel = i % RESPONSE / (WINDOW * WINDOW);
        result->sums[i / RESPONSE][channel] += isnan(responses[i]) ? 0 : (double)responses[i];
    }
    free(responses);
    folder_remove(folder);
}

struct colour_lock_error colour_lock_judge(const struct colour_lock_sums *sums,
                                           const struct colour_lock_sums *truth)
{
    struct colour_lock_error error = {0};
    for (int i = 0; i < COLOUR_LOCK_POINTS; i++) {
        double off[3];
        double mean = 0;
        for (int c = 0; c < 3; c++) {
            off[c] = sums->sums[i][c] / truth->sums[i][c] - 1;
            mean += off[c] / 3;
        }
        for (int c = 0; c < 3; c++) {
            error.rms += off[c] * off[c];
            error.hue_rms += (off[c] - mean) * (off[c] - mean);
            error.worst = fmax(error.worst, fabs(off[c]));
        }
    }
    error.rms = sqrt(error.rms / (3 * COLOUR_LOCK_POINTS));
    error.hue_rms = sqrt(error.hue_rms / (3 * COLOUR_LOCK_POINTS));
    return error;
}

void colour_lock_free(const int64_t *off_ns, int count, uint64_t seed,
                      struct colour_lock_trigger *trigger)
{
    struct made_random random = {.state = seed};
    for (int i = 0; i < COLOUR_LOCK_KINDS * COLOUR_LOCK_EXPOSURES; i++) {
        trigger->list[i / COLOUR_LOCK_EXPOSURES][i % COLOUR_LOCK_EXPOSURES] =
            (struct colour_lock_exposure){.after_ns = (int64_t)(made_uniform(&random) * TURN_NS),
                                          .off_ns = off_ns[i % count]};
    }
}

/* Give `count` exposures and see the pin to its end. */
static void expose(struct simulated *board, int count, int turns)
{
    struct board_event events[4];
    board->edge_count = 0;
    for (int i = 0; i < count; i++) {
        struct board_command command = {
            .command = BOARD_EXPOSE, .id = (uint16_t)i, .turns = (uint16_t)turns};
        TEST_ASSERT_TRUE(simulated_out(board, 1, &command, sizeof command, TRANSFER_MS) >= 0);
        simulated_run(board, (turns + 2) * TURN_CYCLES);
        (void)simulated_in(board, 0x82, events, sizeof events, TRANSFER_MS);
    }
    TEST_ASSERT_EQUAL_UINT64(2 * (size_t)count, board->edge_count);
}

/* The edges of the pin against the turns that the wheel truly made. */
static double note(const struct simulated *board, int turns, struct colour_lock_exposure *list)
{
    double worst_ns = 0;
    size_t at = 0;
    for (int i = 0; i < COLOUR_LOCK_EXPOSURES; i++) {
        double rise = (double)board->edges[2 * i].cycle;
        double fall = (double)board->edges[2 * i + 1].cycle;
        while (at + 1 < board->turn_count && fabs(board->turns[at + 1] - rise) < TURN_CYCLES / 2) {
            at++;
        }
        double after_ns = (rise - board->turns[at]) * 62.5;
        double off_ns =
            (fall - rise - (board->turns[at + (size_t)turns] - board->turns[at])) * 62.5;
        list[i] = (struct colour_lock_exposure){
            .after_ns = llround(after_ns < 0 ? after_ns + TURN_NS : after_ns),
            .off_ns = llround(off_ns)};
        worst_ns = fmax(worst_ns, fabs(off_ns));
        while (at + 1 < board->turn_count && board->turns[at] < fall) {
            at++;
        }
    }
    return worst_ns;
}

double colour_lock_board(double jitter_us, uint64_t seed, struct colour_lock_trigger *trigger)
{
    double worst_ns = 0;
    struct simulated *board = simulated_new();
    TEST_ASSERT_NOT_NULL_MESSAGE(board, "simavr cannot run the firmware");
    TEST_ASSERT_TRUE(simulated_enumerate(board));
    for (int k = 0; k < COLOUR_LOCK_KINDS; k++) {
        board->turn_count = 0;
        simulated_turn(board, (struct wheel){.period = TURN_CYCLES,
                                             .jitter = jitter_us * 16,
                                             .seed = seed + (uint64_t)k});
        simulated_run(board, (8 << BOARD_GAIN_DEFAULT) * TURN_CYCLES);
        expose(board, COLOUR_LOCK_EXPOSURES, colour_lock_turns[k]);
        simulated_run(board, 2 * TURN_CYCLES);
        worst_ns = fmax(worst_ns, note(board, colour_lock_turns[k], trigger->list[k]));
    }
    simulated_free(board);
    return worst_ns;
}
