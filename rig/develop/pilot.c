/* From a pilot measurement to the grid spacing and window of a scan: how far the light of a point reaches. */
#include "rig/develop/pilot.h"

#include "rig/develop/develop.h"

#include <math.h>
#include <stdlib.h>
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
    pilot->energy = malloc(pilot->capacity * (size_t)pilot->channels * (size_t)pilot->rings *
                           sizeof *pilot->energy);
    return pilot->energy ? NACRE_OK : nacre_fail_memory(error, "the pilot's responses");
}

void pilot_finish(struct pilot *pilot)
{
    if (pilot) {
        free(pilot->energy);
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

int pilot_add(struct pilot *pilot, const struct nacre_scan_info *info, int x, int y,
              const float *response, struct nacre_error *error)
{
    size_t rings = (size_t)pilot->rings;
    size_t size = (size_t)pilot->channels * rings;
    size_t plane = (size_t)info->window * (size_t)info->window;
    bool whole = true;
    if (pilot->responses == pilot->capacity) {
        double *more = realloc(pilot->energy, 2 * pilot->capacity * size * sizeof *more);
        if (!more) {
            return nacre_fail_memory(error, "the pilot's responses");
        }
        pilot->energy = more;
        pilot->capacity *= 2;
    }
    for (int c = 0; c < pilot->channels; c++) {
        whole = sum_rings(info, x, y, response + (size_t)c * plane,
                          pilot->energy + pilot->responses * size + (size_t)c * rings) &&
                whole;
    }
    pilot->responses += whole ? 1 : 0;
    return NACRE_OK;
}

/* The mean over the responses of a channel's ring. */
static double mean_ring(const struct pilot *pilot, int channel, int ring)
{
    double sum = 0;
    for (size_t i = 0; i < pilot->responses; i++) {
        sum +=
            pilot->energy[(i * (size_t)pilot->channels + (size_t)channel) * (size_t)pilot->rings +
                          (size_t)ring];
    }
    return sum / (double)pilot->responses;
}

/* A channel's tail: the last ring that is surely light, and the share of the light up to it that lies beyond. */
struct tail {
    int last;
    double rate; /* of the fall from ring to ring */
};

static struct tail find_tail(const struct pilot *pilot, int channel)
{
    struct tail tail = {0, 0};
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
static double leak_of(const double *energy, struct tail tail, int half)
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

struct pilot_leak pilot_leak(const struct pilot *pilot, int half)
{
    struct pilot_leak leak = {0, 0};
    for (int c = 0; c < pilot->channels; c++) {
        struct tail tail = find_tail(pilot, c);
        for (size_t i = 0; i < pilot->responses; i++) {
            const double *energy =
                pilot->energy + (i * (size_t)pilot->channels + (size_t)c) * (size_t)pilot->rings;
            double own = leak_of(energy, tail, half);
            leak.mean += own / ((double)pilot->responses * pilot->channels);
            leak.worst = fmax(leak.worst, own);
        }
    }
    return leak;
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

static int gather(const char *path, double noise, struct pilot *pilot, struct nacre_error *error)
{
    struct nacre_scan *scan = NULL;
    float *response = NULL;
    int status = nacre_scan_open(path, &scan, error);
    if (status != NACRE_OK) {
        goto out;
    }
    const struct nacre_scan_info *info = nacre_scan_info(scan);
    status = pilot_init(pilot, info, noise, error);
    if (status != NACRE_OK) {
        goto out;
    }
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
        status = gather(scratch, report.noise, pilot, error);
        (void)unlink(scratch); /* nothing is lost if it stays */
    }
    if (status != NACRE_OK) {
        pilot_finish(pilot);
    }
    return status;
}
