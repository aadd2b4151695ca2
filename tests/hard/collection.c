/* The collection of hard cases. */
#include "collection.h"

#include "factor/random.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

/* One entry of a sample as it is visited: light enters at (x, y) and leaves at (x + dx, y + dy). */
struct entry {
    float *value;
    int x, y, dx, dy, channel;
    uint64_t number;
};

/* Call `change` for each entry whose ends both lie inside the sample. */
static void for_entries(struct sample *s, void (*change)(const struct sample *, struct entry))
{
    int half = s->window / 2, area = s->window * s->window;
    for (int i = 0; i < s->width * s->height * s->channels * area; i++) {
        struct entry e = {.value = &s->responses[i],
                          .x = i / (area * s->channels) % s->width,
                          .y = i / (area * s->channels) / s->width,
                          .dx = i % s->window - half,
                          .dy = i / s->window % s->window - half,
                          .channel = i / area % s->channels,
                          .number = (uint64_t)i};
        int xo = e.x + e.dx, yo = e.y + e.dy;
        if (xo >= 0 && xo < s->width && yo >= 0 && yo < s->height) {
            change(s, e);
        }
    }
}

static size_t size_of(const struct sample *s)
{
    return (size_t)s->channels * (size_t)s->window * (size_t)s->window;
}

static void blacken_a_response(struct sample *s)
{
    memset(sample_at(s, 5, 4), 0, size_of(s) * sizeof(float));
}

static void blacken_all(struct sample *s)
{
    memset(s->responses, 0,
           (size_t)s->width * (size_t)s->height * size_of(s) * sizeof *s->responses);
}

static void blacken_a_channel(struct sample *s)
{
    size_t area = (size_t)s->window * (size_t)s->window;
    for (int i = 0; i < s->width * s->height; i++) {
        memset(s->responses + (size_t)i * size_of(s) + area, 0, area * sizeof(float));
    }
}

static void leave_one_bright_point(struct sample *s)
{
    float *kept = sample_at(s, 6, 5);
    for (int y = 0; y < s->height; y++) {
        for (int x = 0; x < s->width; x++) {
            float *response = sample_at(s, x, y);
            memset(response, 0, (response == kept ? 0 : size_of(s)) * sizeof(float));
        }
    }
}

static void darken_vein(const struct sample *s, struct entry e)
{
    (void)s;
    /* In energy: in and out of a vein 1/1300 each. */
    float in = e.x == 4 ? 0.02774F : 1, out = e.x + e.dx == 4 ? 0.02774F : 1;
    *e.value *= in * out;
}

static void make_vein(struct sample *s)
{
    for_entries(s, darken_vein);
}

static void fall_by_five_decades(const struct sample *s, struct entry e)
{
    int half = s->window / 2;
    double far = hypot(half, half);
    *e.value =
        (float)(pow(10, -5 * hypot(e.dx, e.dy) / far) * (0.7 + 0.6 * random_uniform(21, e.number)));
}

static void make_steep(struct sample *s)
{
    for_entries(s, fall_by_five_decades);
}

static void fall_from(const struct sample *s, struct entry e, double peak_x, double peak_y)
{
    (void)s;
    double length = e.x < 6 ? 0.8 : 1.5;
    *e.value = (float)(exp(-hypot(e.dx - peak_x, e.dy - peak_y) / length) *
                       (0.98 + 0.04 * random_uniform(22, e.number)));
}

static void fall_from_a_fraction(const struct sample *s, struct entry e)
{
    fall_from(s, e, 0.4, -0.3);
}

static void fall_from_afar(const struct sample *s, struct entry e)
{
    fall_from(s, e, 2, 1);
}

static void misalign_by_a_fraction(struct sample *s)
{
    for_entries(s, fall_from_a_fraction);
}

static void misalign_by_pixels(struct sample *s)
{
    for_entries(s, fall_from_afar);
}

static void saturate_entry(const struct sample *s, struct entry e)
{
    (void)s;
    *e.value = fminf(*e.value, 0.05F);
}

static void saturate(struct sample *s)
{
    for_entries(s, saturate_entry);
}

static void subtract_black(const struct sample *s, struct entry e)
{
    (void)s;
    *e.value += 0.02F * (float)(random_uniform(23, e.number) - 0.5);
}

static void make_negative(struct sample *s)
{
    for_entries(s, subtract_black);
}

static void lose_entry(const struct sample *s, struct entry e)
{
    (void)s;
    if (random_uniform(24, e.number) < 0.3) {
        *e.value = NAN;
    }
}

static void lose_entries(struct sample *s)
{
    for_entries(s, lose_entry);
}

static void lose_response(const struct sample *s, struct entry e)
{
    if (random_uniform(25, (uint64_t)e.y * (uint64_t)s->width + (uint64_t)e.x) < 0.4) {
        *e.value = NAN;
    }
}

static void lose_responses(struct sample *s)
{
    for_entries(s, lose_response);
}

static void lose_row_entry(const struct sample *s, struct entry e)
{
    (void)s;
    if (e.y == 5 || e.y + e.dy == 3) { /* one row in, another out */
        *e.value = NAN;
    }
}

static void lose_a_row(struct sample *s)
{
    for_entries(s, lose_row_entry);
}

static void cut_tail(const struct sample *s, struct entry e)
{
    (void)s;
    if (*e.value < 0.02F) {
        *e.value = 0;
    }
}

static void cut_tails(struct sample *s)
{
    for_entries(s, cut_tail);
}

static void repeat_one(const struct sample *s, struct entry e)
{
    (void)s;
    *e.value = (float)exp(-hypot(e.dx, e.dy));
}

static void make_all_the_same(struct sample *s)
{
    for_entries(s, repeat_one);
}

/* Points left of the middle are one material, points right of it another, those on it half of each. */
static void divide_a_pixel(const struct sample *s, struct entry e)
{
    double distance = hypot(e.dx, e.dy), sharp = 1.5 * exp(-distance / 0.5);
    double soft = 0.4 * exp(-distance / 2.0);
    int middle = s->width / 2;
    int crosses = (e.x - middle) * (e.x + e.dx - middle) < 0;
    double share = e.x < middle ? 1 : e.x == middle ? 0.5 : 0;
    *e.value = (float)((share * sharp + (1 - share) * soft) * (crosses ? 0.1 : 1));
}

static void make_a_sharp_edge(struct sample *s)
{
    for_entries(s, divide_a_pixel);
}

static void blend(const struct sample *s, struct entry e)
{
    double share = (double)e.x / (s->width - 1), distance = hypot(e.dx, e.dy);
    *e.value = (float)((1 - share) * exp(-distance / 0.5) + share * 0.4 * exp(-distance / 2.0));
}

static void make_a_slow_transition(struct sample *s)
{
    for_entries(s, blend);
}

static void differ_by_little(const struct sample *s, struct entry e)
{
    (void)s;
    double length = e.x % 2 ? 1.0 : 1.0001;
    *e.value = (float)exp(-hypot(e.dx, e.dy) / length);
}

static void make_two_alike(struct sample *s)
{
    for_entries(s, differ_by_little);
}

static void make_denormal(struct sample *s)
{
    sample_scale(s, 1e-20F);
    sample_scale(s, 1e-20F);
}

static void make_a_spike(struct sample *s)
{
    float *response = sample_at(s, 7, 3);
    for (size_t i = 0; i < size_of(s); i++) {
        response[i] *= 1e5F;
    }
}

/* Kernels of columns far from each other, which normal matrices summed over cells of points cannot tell apart. */
static void alternate(const struct sample *s, struct entry e)
{
    (void)s;
    double length = e.x % 2 ? 0.3 : 4;
    *e.value = (float)(exp(-hypot(e.dx, e.dy) / length) * (0.5 + random_uniform(26, e.number)));
}

static void alternate_columns(struct sample *s)
{
    for_entries(s, alternate);
}

static void show_two_responses(const struct sample *s, struct entry e)
{
    (void)s;
    *e.value = (float)exp(-hypot(e.dx, e.dy) / (e.x < 6 ? 0.7 : 1.4));
}

static void make_two_kinds(struct sample *s)
{
    for_entries(s, show_two_responses);
}

static void keep_noise_alone(const struct sample *s, struct entry e)
{
    (void)s;
    *e.value = (float)(random_uniform(27, e.number) - 0.5);
}

static void make_noise(struct sample *s)
{
    for_entries(s, keep_noise_alone);
}

static void plant_infinities(struct sample *s)
{
    sample_at(s, 2, 2)[3] = INFINITY;
    sample_at(s, 9, 7)[8] = -INFINITY;
}

/* Sizes are small, as each case runs in double precision too; numbers of terms are few, as each is compiled. */
const struct hard_case hard_cases[] = {
    {"ordinary", "Nothing: what the others are compared with.", 12, 10, 1, 7, 4, 2, 0, 0, NULL, 0},
    {"dark response", "One response is 0 throughout.", 12, 10, 1, 7, 4, 2, 0, 0, blacken_a_response,
     0},
    {"dark sample", "Every response is 0: there is no scale.", 12, 10, 1, 7, 4, 2, 0, 0,
     blacken_all, 0},
    {"dark channel", "One colour channel is 0 throughout.", 12, 10, 3, 7, 4, 2, 0, 0,
     blacken_a_channel, 0},
    {"one bright point", "All responses but one are 0.", 12, 10, 1, 7, 4, 2, 0, 0,
     leave_one_bright_point, 0},
    {"vein", "The points of a vein hold 1/1300 of the mean energy.", 12, 10, 1, 7, 4, 2, 0, 0,
     make_vein, 0},
    {"five decades", "A response falls to 1e-5 of its peak.", 14, 12, 1, 11, 4, 2, 0, 0, make_steep,
     0},
    {"peak off by a fraction", "The peak is half a pixel from the centre.", 12, 10, 1, 7, 4, 2, 0,
     0, misalign_by_a_fraction, 0},
    {"peak off by pixels", "The peak is 2.2 pixels from the centre.", 12, 10, 1, 7, 4, 2, 0, 0,
     misalign_by_pixels, 0},
    {"saturated", "A plateau stands where the camera saturated.", 12, 10, 1, 7, 4, 2, 0, 0,
     saturate, 0},
    {"negative values", "Black subtraction left values below 0.", 12, 10, 1, 7, 4, 2, 0, 0,
     make_negative, 0},
    {"noise alone", "Every entry is noise around 0: weights follow kernels that mean nothing.", 12,
     10, 1, 7, 4, 2, 0, 0, make_noise, 3},
    {"entries missing", "Three entries in ten were not measured.", 12, 10, 1, 7, 4, 2, 0, 0,
     lose_entries, 0},
    {"responses missing", "Four responses in ten were not measured.", 12, 10, 1, 7, 4, 2, 0, 0,
     lose_responses, 0},
    {"row missing", "No light entered in one row and none was seen to leave in another.", 12, 10, 1,
     7, 4, 2, 0, 0, lose_a_row, 0},
    {"infinite entries", "Some entries are infinite.", 12, 10, 1, 7, 4, 2, 0, 0, plant_infinities,
     0},
    {"zeros in the tails", "More than half of all entries are exactly 0.", 12, 10, 1, 7, 4, 2, 0, 0,
     cut_tails, 0},
    {"rank 1, 20 terms", "All responses are the same: nineteen terms have nothing to do.", 12, 10,
     1, 7, 20, 2, 0, 0, make_all_the_same, 0},
    {"terms above points", "There are 20 terms for 12 points.", 4, 3, 1, 5, 20, 2, 0, 0, NULL, 0},
    {"clusters above responses", "Five clusters are asked of two different responses.", 12, 10, 1,
     7, 4, 5, 0, 0, make_two_kinds, 0},
    {"window above sample", "The window reaches past the sample on every side.", 6, 5, 1, 25, 4, 2,
     0, 0, NULL, 0},
    {"1 x 1", "There is one point.", 1, 1, 1, 7, 4, 1, 0, 0, NULL, 0},
    {"1 x n", "Points lie in one row.", 17, 1, 1, 7, 4, 2, 0, 0, NULL, 0},
    {"edge through a pixel", "A sharp edge between two materials runs through points.", 13, 10, 1,
     7, 4, 2, 0, 0, make_a_sharp_edge, 0},
    {"slow transition", "One material turns into another from side to side.", 13, 10, 1, 7, 4, 2, 0,
     0, make_a_slow_transition, 0},
    {"two alike", "Two clusters differ by 1e-4.", 12, 10, 1, 7, 4, 2, 0, 0, make_two_alike, 0},
    {"denormals", "Values are of the order of 1e-40, below what floats hold fully.", 12, 10, 1, 7,
     4, 2, 0, 0, make_denormal, 0},
    {"spike", "One response is 1e5 times the others.", 12, 10, 1, 7, 4, 2, 0, 0, make_a_spike, 0},
    {"alternating columns", "Wide and narrow responses alternate: extrapolation overshoots.", 24,
     17, 1, 15, 4, 2, 60, 0, alternate_columns, 0},
    {"epsilon 1e-8", "Kernels are all but 0 in the tails.", 12, 10, 1, 7, 4, 2, 0, 1e-8, make_steep,
     0},
    {"epsilon 1e-1", "A tenth of the peak is added to each kernel.", 12, 10, 1, 7, 4, 2, 0, 1e-1,
     NULL, 0},
    {"10,000 iterations", "Roundings have time to add up.", 7, 6, 1, 5, 4, 2, 10000, 0,
     make_negative, 0},
};
const size_t hard_case_count = sizeof hard_cases / sizeof *hard_cases;

const struct hard_case *hard_case_of(const char *name)
{
    for (size_t i = 0; i < hard_case_count; i++) {
        if (strcmp(hard_cases[i].name, name) == 0) {
            return &hard_cases[i];
        }
    }
    TEST_FAIL_MESSAGE(name);
    return NULL;
}

struct sample hard_sample(const struct hard_case *hard)
{
    struct sample sample = sample_new(hard->width, hard->height, hard->channels, hard->window, 5);
    if (hard->change) {
        hard->change(&sample);
    }
    return sample;
}

int hard_steps(const struct hard_case *hard)
{
    return hard->steps ? hard->steps : 40;
}

double hard_error(const struct hard_case *hard)
{
    return hard->error > 0 ? hard->error : 1;
}

double hard_epsilon(const struct hard_case *hard)
{
    return hard->epsilon > 0 ? hard->epsilon : 1e-5;
}
