/* Prints the error of colour under a spinning wheel for several triggers, as the table of docs/trigger-board.md, and draws
 * it: the trigger board's real firmware in simavr, and GPIO pulses that this machine times as `nacre scan` does. */
#include "colour_lock.h"

#include "rig/trigger_gpio.h"
#include "rig/trigger_gpio_line.h"
#include "unity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PULSES = 60, ROWS = 6, PANELS = 2 };

struct gpio_chip {
    int unused;
};
struct gpio_line {
    bool active;
};

/* A chip with a line that leads nowhere, in place of libgpiod: what is measured is the program's timing. */
static struct gpio_chip no_chip;
static struct gpio_line no_line;

int gpio_chip_open(const char *path, struct gpio_chip **chip)
{
    (void)path;
    *chip = &no_chip;
    return 0;
}

void gpio_chip_close(struct gpio_chip *chip)
{
    (void)chip;
}

const char *gpio_chip_label(struct gpio_chip *chip)
{
    (void)chip;
    return "none";
}

int gpio_chip_line_count(struct gpio_chip *chip)
{
    (void)chip;
    return 1;
}

int gpio_chip_find_line(struct gpio_chip *chip, const char *name)
{
    (void)chip;
    (void)name;
    return 0;
}

void gpio_chip_line_name(struct gpio_chip *chip, int offset, char *name, size_t size)
{
    (void)chip;
    (void)offset;
    (void)snprintf(name, size, "none");
}

void gpio_chip_line_holder(struct gpio_chip *chip, int offset, char *holder, size_t size)
{
    (void)chip;
    (void)offset;
    (void)snprintf(holder, size, "nothing");
}

int gpio_line_take_output(struct gpio_chip *chip, int offset, bool active_low,
                          struct gpio_line **line)
{
    (void)chip;
    (void)offset;
    (void)active_low;
    *line = &no_line;
    return 0;
}

int gpio_line_take_input(struct gpio_chip *chip, int offset, bool active_low,
                         struct gpio_line **line)
{
    return gpio_line_take_output(chip, offset, active_low, line);
}

void gpio_line_free(struct gpio_line *line)
{
    (void)line;
}

int gpio_line_set(struct gpio_line *line, bool active)
{
    line->active = active;
    return 0;
}

int gpio_line_wait(struct gpio_line *line, int64_t timeout_ns, int64_t *edge_ns)
{
    (void)line;
    (void)timeout_ns;
    *edge_ns = 0;
    return 0;
}

struct row {
    const char *name;
    double length_rms_us; /* of the shortest exposure */
    struct colour_lock_sums sums;
    struct colour_lock_error error;
};

/* Lengths of pulses of one turn, less what they should be. */
static void measure_gpio(int64_t *off_ns)
{
    const struct trigger_gpio_settings settings = {.output = {.chip = "/none"},
                                                   .jitter_ns = 1000000000};
    struct clock clock = clock_monotonic();
    struct trigger *trigger = NULL;
    struct nacre_error error;
    const int64_t turn_ns = llround(1e9 / COLOUR_LOCK_HZ);
    int status = trigger_gpio_new(&settings, &clock, &trigger, &error);
    for (int i = 0; i < PULSES && status == NACRE_OK; i++) {
        int64_t began_ns;
        status = trigger->ops->fire(trigger, turn_ns, &began_ns, &error);
        off_ns[i] = trigger->pulse.width_ns - turn_ns;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, status, error.text);
    trigger->ops->close(trigger);
}

static void scan(struct row *row, const char *name, const struct colour_lock_trigger *trigger,
                 const struct colour_lock_sums *truth)
{
    double sum = 0;
    row->name = name;
    for (int i = 0; i < COLOUR_LOCK_EXPOSURES; i++) {
        double off_us = (double)trigger->list[0][i].off_ns * 1e-3;
        sum += off_us * off_us;
    }
    row->length_rms_us = sqrt(sum / COLOUR_LOCK_EXPOSURES);
    colour_lock_scan(trigger, &row->sums);
    row->error = colour_lock_judge(&row->sums, truth);
    (void)printf("| %s | %.1f us | %.4f %% | %.4f %% | %.4f %% |\n", name, row->length_rms_us,
                 row->error.rms * 100, row->error.hue_rms * 100, row->error.worst * 100);
}

/* One dot for each response and channel, on a scale of -5 to 5 per cent. */
static void draw_panel(FILE *file, int number, const struct row *row,
                       const struct colour_lock_sums *truth)
{
    static const char *const colours[3] = {"#c62828", "#2e7d32", "#1565c0"};
    int left = 50 + 330 * number;
    (void)fprintf(file,
                  "<text x='%d' y='22'>%s: %.3f %% rms</text>\n<rect x='%d' y='34' width='310' "
                  "height='240' fill='none' stroke='#999'/>\n<line x1='%d' y1='154' x2='%d' "
                  "y2='154' stroke='#999'/>\n",
                  left, row->name, row->error.rms * 100, left, left, left + 310);
    for (int i = 0; i < COLOUR_LOCK_POINTS; i++) {
        for (int c = 0; c < 3; c++) {
            double off = 100 * (row->sums.sums[i][c] / truth->sums[i][c] - 1);
            (void)fprintf(file, "<circle cx='%.1f' cy='%.1f' r='2' fill='%s'/>\n",
                          left + 5 + i * 4.7 + c, 154 - 24 * fmax(-5, fmin(5, off)), colours[c]);
        }
    }
}

static bool draw(const char *path, const struct row *const rows[PANELS],
                 const struct colour_lock_sums *truth)
{
    FILE *file = fopen(path, "w");
    if (!file) {
        return false;
    }
    (void)fprintf(file, "<svg xmlns='http://www.w3.org/2000/svg' width='700' height='310' "
                        "font-family='sans-serif' font-size='13'>\n<rect width='700' height='310' "
                        "fill='white'/>\n<text x='12' y='40'>5 %%</text>\n<text x='25' y='158'>0"
                        "</text>\n<text x='6' y='276'>-5 %%</text>\n<text x='50' y='298'>error of "
                        "each response's red, green and blue, point by point (64 points)</text>\n");
    for (int i = 0; i < PANELS; i++) {
        draw_panel(file, i, rows[i], truth);
    }
    (void)fprintf(file, "</svg>\n");
    return fclose(file) == 0;
}

void setUp(void)
{
}

void tearDown(void)
{
}

static const char *picture;

static void print_and_draw(void)
{
    static struct colour_lock_sums truth;
    static struct row rows[ROWS];
    static struct colour_lock_trigger trigger;
    int64_t off_ns[PULSES];
    colour_lock_scan(NULL, &truth);
    (void)printf(
        "| trigger | length of a turn, rms | colour, rms | without brightness | largest |\n"
        "| --- | --- | --- | --- | --- |\n");
    (void)colour_lock_board(2, 3, &trigger);
    scan(&rows[0], "board, index +-2 us", &trigger, &truth);
    (void)colour_lock_board(20, 3, &trigger);
    scan(&rows[1], "board, index +-20 us", &trigger, &truth);
    measure_gpio(off_ns);
    colour_lock_free(off_ns, PULSES, 1, &trigger);
    scan(&rows[2], "GPIO as timed here", &trigger, &truth);
    for (int i = 0; i < PULSES; i++) {
        off_ns[i] += 33333;
    }
    colour_lock_free(off_ns, PULSES, 1, &trigger);
    scan(&rows[3], "the same, wheel 0.1 % faster than the file says", &trigger, &truth);
    for (int i = 0; i < PULSES; i++) {
        off_ns[i] = (i % 5 - 2) * 50000;
    }
    colour_lock_free(off_ns, PULSES, 1, &trigger);
    scan(&rows[4], "pulses wrong by up to 100 us", &trigger, &truth);
    /* docs/station.md: 0.5 to 1.8 ms too long in the mean, and at most 3 to 7. */
    for (int i = 0; i < PULSES; i++) {
        off_ns[i] = i % 40 == 7 ? 5000000 : 500000 + i % 14 * 100000;
    }
    colour_lock_free(off_ns, PULSES, 1, &trigger);
    scan(&rows[5], "GPIO of an overloaded machine", &trigger, &truth);
    TEST_ASSERT_TRUE(draw(picture, (const struct row *const[]){&rows[5], &rows[1]}, &truth));
}

int main(int argc, char **argv)
{
    if (argc != 2) {
        (void)fprintf(stderr, "usage: %s PICTURE.svg\n", argv[0]);
        return 2;
    }
    picture = argv[1];
    /* For the assertions of what it calls. */
    UnityBegin(__FILE__);
    if (TEST_PROTECT()) {
        print_and_draw();
    }
    return Unity.CurrentTestFailed != 0;
}
