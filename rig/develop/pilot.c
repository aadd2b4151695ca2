/* From a pilot measurement to the grid spacing and window of a scan: how far the light of a point reaches. */
#include "rig/develop/pilot.h"

#include "rig/develop/develop.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* A ring's mean over all responses counts as measured while it is so many of its standard errors. */
static const double certain = 5;

int pilot_init(struct pilot *pilot, const struct nacre_scan_info *info, double noise,
               struct nacre_error *error)
{
    *pilot = (struct pilot){.rings = info->window / 2 + 1,
                            .channels = info->channels,
                            .capacity = 64,
                            .noise = noise > 0 ? noise : 0};
    size_t channels = (size_t)pilot->channels;
    for (int c = 0; c < 3; c++) {
        pilot->channel_noise[c] = pilot->noise;
    }
    /* The corner is nearer than this. */
    pilot->radii = (int)(1.5 * pilot->rings) + 1;
    pilot->energy =
        malloc(pilot->capacity * channels * (size_t)pilot->rings * sizeof *pilot->energy);
    pilot->places = malloc(pilot->capacity * sizeof *pilot->places);
    pilot->fall = calloc(channels * (size_t)pilot->radii, sizeof *pilot->fall);
    pilot->fall_count = calloc(channels * (size_t)pilot->radii, sizeof *pilot->fall_count);
    return pilot->energy && pilot->places && pilot->fall && pilot->fall_count
               ? NACRE_OK
               : nacre_fail_memory(error, "the pilot's responses");
}

void pilot_finish(struct pilot *pilot)
{
    if (pilot) {
        free(pilot->energy);
        free(pilot->places);
        free(pilot->fall);
        free(pilot->fall_count);
        *pilot = (struct pilot){0};
    }
}

static int entries_of(int ring)
{
    return ring ? 8 * ring : 1;
}

/* Energy of one channel's rings; false where a ring has no entry. */
static bool sum_rings(const struct nacre_scan_info *info, int x, int y, const float *response,
                      double *energy)
{
    int half = info->window / 2;
    size_t used[512] = {0};
    for (int ring = 0; ring <= half; ring++) {
        energy[ring] = 0;
    }
    for (int v = -half; v <= half; v++) {
        for (int u = -half; u <= half; u++, response++) {
            bool inside = x + u >= 0 && y + v >= 0 && x + u < info->width && y + v < info->height;
            int ring = abs(u) > abs(v) ? abs(u) : abs(v);
            if (inside && !isnan(*response)) {
                energy[ring] += (double)*response;
                used[ring]++;
            }
        }
    }
    for (int ring = 0; ring <= half; ring++) {
        if (used[ring] == 0) {
            return false;
        }
        energy[ring] *= (double)entries_of(ring) / (double)used[ring];
    }
    return true;
}

static int make_room(struct pilot *pilot, struct nacre_error *error)
{
    size_t capacity = 2 * pilot->capacity;
    size_t size = (size_t)pilot->channels * (size_t)pilot->rings;
    if (pilot->responses < pilot->capacity) {
        return NACRE_OK;
    }
    double *energy = realloc(pilot->energy, capacity * size * sizeof *energy);
    if (!energy) {
        return nacre_fail_memory(error, "the pilot's responses");
    }
    pilot->energy = energy;
    struct pilot_place *places = realloc(pilot->places, capacity * sizeof *places);
    if (!places) {
        return nacre_fail_memory(error, "the pilot's responses");
    }
    pilot->places = places;
    pilot->capacity = capacity;
    return NACRE_OK;
}

/* A channel's entries by their distance; and their squares off the centre, of which noise is taken off. What of a ring lies
 * outside the sample is taken to be as the rest of it. */
static void add_entries(struct pilot *pilot, const struct nacre_scan_info *info, int channel,
                        const float *response, struct pilot_place *place)
{
    int half = info->window / 2;
    double squares[512] = {0};
    size_t used[512] = {0};
    for (int v = -half; v <= half; v++) {
        for (int u = -half; u <= half; u++, response++) {
            int x = place->x + u;
            int y = place->y + v;
            bool inside = x >= 0 && y >= 0 && x < info->width && y < info->height;
            if (inside && !isnan(*response)) {
                double value = (double)*response;
                int ring = abs(u) > abs(v) ? abs(u) : abs(v);
                size_t at = (size_t)channel * (size_t)pilot->radii + (size_t)lround(hypot(u, v));
                pilot->fall[at] += value;
                pilot->fall_count[at]++;
                squares[ring] += value * value - pilot->noise * pilot->noise;
                used[ring]++;
            }
        }
    }
    for (int ring = 1; ring <= half; ring++) {
        place->power += squares[ring] * entries_of(ring) / (double)used[ring];
    }
    place->centre += squares[0];
}

int pilot_add(struct pilot *pilot, const struct nacre_scan_info *info, int x, int y,
              const float *response, struct nacre_error *error)
{
    size_t rings = (size_t)pilot->rings;
    size_t size = (size_t)pilot->channels * rings;
    size_t plane = (size_t)info->window * (size_t)info->window;
    bool whole = true;
    int status = make_room(pilot, error);
    if (status != NACRE_OK) {
        return status;
    }
    for (int c = 0; c < pilot->channels; c++) {
        whole = sum_rings(info, x, y, response + (size_t)c * plane,
                          pilot->energy + pilot->responses * size + (size_t)c * rings) &&
                whole;
    }
    if (whole) {
        struct pilot_place place = {x, y, 0, 0};
        for (int c = 0; c < pilot->channels; c++) {
            add_entries(pilot, info, c, response + (size_t)c * plane, &place);
        }
        pilot->places[pilot->responses++] = place;
    }
    return NACRE_OK;
}

double pilot_energy(const struct pilot *pilot, size_t index, int channel, int ring)
{
    return pilot
        ->energy[(index * (size_t)pilot->channels + (size_t)channel) * (size_t)pilot->rings +
                 (size_t)ring];
}

/* The mean over the responses of a channel's ring. */
static double mean_ring(const struct pilot *pilot, int channel, int ring)
{
    double sum = 0;
    for (size_t i = 0; i < pilot->responses; i++) {
        sum += pilot_energy(pilot, i, channel, ring);
    }
    return sum / (double)pilot->responses;
}

struct pilot_tail pilot_tail(const struct pilot *pilot, int channel)
{
    struct pilot_tail tail = {0, 0};
    while (tail.last + 1 < pilot->rings) {
        int ring = tail.last + 1;
        double error = pilot->noise * sqrt(entries_of(ring) / (double)pilot->responses);
        if (!(mean_ring(pilot, channel, ring) > certain * error)) {
            break;
        }
        tail.last = ring;
    }
    int from = tail.last / 2;
    double above = mean_ring(pilot, channel, tail.last);
    double below = mean_ring(pilot, channel, from);
    tail.rate = tail.last > from && above < below && above > 0
                    ? pow(above / below, 1.0 / (tail.last - from))
                    : 0;
    return tail;
}

/* Share of one response's energy beyond ring `half`. */
static double leak_of(const double *energy, struct pilot_tail tail, int half)
{
    double within = 0;
    double beyond = 0;
    for (int ring = 0; ring <= tail.last; ring++) {
        within += ring <= half ? energy[ring] : 0;
        beyond += ring > half ? energy[ring] : 0;
    }
    double rest = energy[tail.last] * tail.rate / (1 - tail.rate);
    if (half > tail.last) {
        double after = rest * pow(tail.rate, half - tail.last);
        within += rest - after;
        beyond += after;
    } else {
        beyond += rest;
    }
    return within > 0 ? fmax(beyond, 0) / (within + fmax(beyond, 0)) : 1;
}

double pilot_response_leak(const struct pilot *pilot, struct pilot_tail tail, size_t index,
                           int channel, int half)
{
    return leak_of(pilot->energy +
                       (index * (size_t)pilot->channels + (size_t)channel) * (size_t)pilot->rings,
                   tail, half);
}

struct pilot_leak pilot_leak(const struct pilot *pilot, int half)
{
    struct pilot_leak leak = {0, 0};
    for (int c = 0; c < pilot->channels; c++) {
        struct pilot_tail tail = pilot_tail(pilot, c);
        for (size_t i = 0; i < pilot->responses; i++) {
            double own = pilot_response_leak(pilot, tail, i, c, half);
            leak.mean += own / ((double)pilot->responses * pilot->channels);
            leak.worst = fmax(leak.worst, own);
        }
    }
    return leak;
}

/* The radii at which a channel is surely light. */
static int certain_radii(const struct pilot *pilot, const double *fall, const size_t *count)
{
    int radii = 0;
    while (radii < pilot->radii && count[radii] &&
           fall[radii] > certain * pilot->noise * sqrt((double)count[radii])) {
        radii++;
    }
    return radii;
}

int pilot_profile(const struct pilot *pilot, double **profile, size_t *count,
                  struct nacre_error *error)
{
    size_t radii = (size_t)pilot->radii;
    *count = (size_t)pilot->channels * radii;
    *profile = malloc(*count * sizeof **profile);
    if (!*profile) {
        return nacre_fail_memory(error, "the pilot's profile");
    }
    for (int c = 0; c < pilot->channels; c++) {
        double *own = *profile + (size_t)c * radii;
        const double *fall = pilot->fall + (size_t)c * radii;
        const size_t *entries = pilot->fall_count + (size_t)c * radii;
        int last = certain_radii(pilot, fall, entries) - 1;
        if (last < 1) {
            free(*profile);
            *profile = NULL;
            return nacre_fail(error, "the pilot shows no light beside its lit points; scan it with "
                                     "longer exposures");
        }
        for (int r = 0; r <= last; r++) {
            own[r] = fall[r] / (double)entries[r];
        }
        int from = last / 2;
        double rate = pow(own[last] / own[from], 1.0 / (last - from));
        for (int r = last + 1; r < pilot->radii; r++) {
            own[r] = fmax(own[r - 1] * fmin(rate, 1), 1e-30);
        }
    }
    return NACRE_OK;
}

int pilot_choose(const struct pilot *pilot, double bound, int *half, struct nacre_error *error)
{
    if (pilot->responses == 0) {
        return nacre_fail(error, "no response of the pilot was measured in all of its window; scan "
                                 "a pilot with more grids, or with a window of the sample's size");
    }
    for (*half = 0; *half < pilot->rings; (*half)++) {
        if (pilot_leak(pilot, *half).worst <= bound) {
            return NACRE_OK;
        }
    }
    return nacre_fail(error,
                      "the pilot's window of %d points still lets %.2g %% of the energy leak where "
                      "%.2g %% are allowed; scan a pilot with a wider window and grid_spacing",
                      2 * pilot->rings - 1, 100 * pilot_leak(pilot, pilot->rings - 1).worst,
                      100 * bound);
}

static int gather(const char *path, const struct develop_report *report, struct pilot *pilot,
                  struct nacre_error *error)
{
    struct nacre_scan *scan = NULL;
    float *response = NULL;
    int status = nacre_scan_open(path, &scan, error);
    if (status != NACRE_OK) {
        goto out;
    }
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    status = pilot_init(pilot, info, report->noise, error);
    if (status != NACRE_OK) {
        goto out;
    }
    memcpy(pilot->white, report->white, sizeof pilot->white);
    pilot->black = fmax(report->black_level, 0); /* 0, too, where it is NaN */
    memcpy(pilot->channel_noise, report->channel_noise, sizeof pilot->channel_noise);
    response = malloc(nacre_scan_response_size(info) * sizeof *response);
    if (!response) {
        status = nacre_fail_memory(error, "a response");
        goto out;
    }
    for (int i = 0; status == NACRE_OK && i < info->width * info->height; i++) {
        int x = i % info->width;
        int y = i / info->width;
        status = nacre_scan_read(scan, x, y, response, error);
        if (status == NACRE_OK &&
            !isnan(response[(size_t)info->window * (size_t)info->window / 2])) {
            status = pilot_add(pilot, info, x, y, response, error);
        }
    }
out:
    free(response);
    nacre_scan_close(scan);
    return status;
}

int pilot_read(const char *path, const char *scratch, struct progress *progress,
               struct pilot *pilot, struct nacre_error *error)
{
    const struct develop_options options = {.black = BLACK_SUBTRACT,
                                            .confidence = 0.99,
                                            .demosaic = DEMOSAIC_AUTO,
                                            .store = NACRE_FLOAT,
                                            .flat = FLAT_PAPER,
                                            .once = true};
    struct develop_report report;
    *pilot = (struct pilot){0};
    int status = develop_session(path, &options, scratch, progress, &report, error);
    if (status == NACRE_OK) {
        status = gather(scratch, &report, pilot, error);
        (void)unlink(scratch); /* nothing is lost if it stays */
    }
    if (status != NACRE_OK) {
        pilot_finish(pilot);
    }
    return status;
}
