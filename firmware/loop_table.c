/* Prints what accuracy costs in time: the loop's errors and settling for each gain, simulated with the firmware's own
 * loop, as the table of docs/trigger-board.md. */
#include "firmware/loop.h"

#include "firmware/protocol.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>

#define PERIOD (16e6 / 30)

/* Turns measured per figure; the standard error of an rms is then 1 %. */
enum { TURNS = 5000, SETTLE_MAX = 4000 };

/* Uniform in [-1, 1). */
static double uniform(uint64_t *seed)
{
    *seed = *seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (double)(*seed >> 11) * 0x1p-52 - 1;
}

struct run {
    struct loop loop;
    uint64_t seed;
    double turn_at, period, jitter, slowing; /* ticks; ticks a turn */
};

/* The wheel turns once. Returns the error of the loop's prediction, made before the pulse, of when the turn begins. */
static double turn(struct run *run)
{
    run->turn_at += run->period;
    run->period += run->slowing;
    double error = (double)run->loop.next / 65536 - run->turn_at;
    loop_index(&run->loop, (uint64_t)(run->turn_at + run->jitter * uniform(&run->seed) + 0.5));
    return error;
}

/* Locked, by pulses with jitter. */
static struct run begin(uint8_t gain, double jitter, uint64_t seed)
{
    struct run run = {.seed = seed, .turn_at = 1e6, .period = PERIOD, .jitter = jitter};
    loop_start(&run.loop, gain, 8);
    while (!run.loop.locked) {
        (void)turn(&run);
    }
    return run;
}

/* Root mean square of the error of one turn's length, ticks, once settled. */
static double length_rms(uint8_t gain, double jitter)
{
    struct run run = begin(gain, jitter, 1);
    double sum = 0;
    for (int i = 0; i < 40 << gain; i++) {
        (void)turn(&run);
    }
    double before = turn(&run);
    for (int i = 0; i < TURNS; i++) {
        double error = turn(&run);
        sum += (error - before) * (error - before);
        before = error;
    }
    return sqrt(sum / TURNS);
}

/* Turns until each turn's length is within 100 ppm for good, after the wheel's speed has jumped by 0.1 %. */
static int settling_turns(uint8_t gain)
{
    struct run run = begin(gain, 0, 1);
    int last = 0;
    for (int i = 0; i < 40 << gain; i++) {
        (void)turn(&run);
    }
    run.period *= 1.001;
    double before = turn(&run);
    for (int i = 1; i <= SETTLE_MAX; i++) {
        double error = turn(&run);
        last = fabs(error - before) > 100e-6 * PERIOD ? i : last;
        before = error;
    }
    return last;
}

/* The lag behind a wheel that slows by 100 ppm a second, ticks. */
static double lag(uint8_t gain)
{
    struct run run = begin(gain, 0, 1);
    double error = 0;
    run.slowing = 100e-6 * PERIOD / 30;
    for (int i = 0; i < 60 << gain; i++) {
        error = turn(&run);
    }
    return -error;
}

int main(void)
{
    (void)printf("| gain | phase, period | length, +-2 us | length, +-20 us | length, +-100 us | "
                 "settles in | time at 30 Hz "
                 "| lag at 100 ppm/s |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n");
    for (uint8_t gain = BOARD_GAIN_MIN; gain <= BOARD_GAIN_MAX; gain++) {
        const double jitters[] = {32, 320, 1600};
        (void)printf("| %d%s | 1/%d, 1/%d |", gain, gain == BOARD_GAIN_DEFAULT ? " (default)" : "",
                     1 << gain, 1 << (2 * gain + 2));
        for (int i = 0; i < 3; i++) {
            (void)printf(" %.1f ppm |", length_rms(gain, jitters[i]) / PERIOD * 1e6);
        }
        int turns = settling_turns(gain);
        (void)printf(" %d turns | %.2f s |", turns, turns / 30.0);
        (void)printf(" %.1f us |\n", lag(gain) / 16);
    }
    return 0;
}
