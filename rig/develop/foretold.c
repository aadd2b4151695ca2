/* The noise that a pilot's responses would have at other exposures. */
#include "rig/develop/foretold.h"

#include <math.h>
#include <stdbool.h>

/* What an exposure weighs in a pixel's merged radiance: 1 over its variance, raw units a second. The shortest counts as far as
 * it goes; others are left out near saturation. */
static double weight_of(const struct station *station, double turns, bool shortest, double light)
{
    const struct station_camera *camera = &station->camera;
    double full = (double)((1U << (unsigned)camera->bits) - 2) - camera->pedestal;
    double t = turns / station->projector.wheel_hz;
    double raw = fmax(light, 0) * t;
    double shot = camera->electrons > 0 ? raw / camera->electrons : 0;
    double variance = camera->read_noise * camera->read_noise + 1.0 / 12 + shot;
    return shortest || raw + 4 * sqrt(variance) < full ? t * t / variance : 0;
}

static double dark_variance(const struct station *station, double black, const double *turns,
                            size_t count)
{
    double weight = 0;
    for (size_t e = 0; e < count; e++) {
        weight += weight_of(station, turns[e], e == 0, black);
    }
    return 1 / weight;
}

/* The pilot's black frames tell how a pixel's variance becomes an entry's: the fit over mixed pixels, of which each
 * colour has its own number, and white. */
void foretold_init(struct foretold *foretold, const struct pilot *pilot,
                   const struct station *station, const struct plan *plan)
{
    *foretold = (struct foretold){.pilot = pilot, .station = station, .window = plan->window};
    double dark = dark_variance(station, pilot->black, plan->exposure_turns, plan->exposure_count);
    for (int c = 0; c < pilot->channels; c++) {
        double deviation = pilot->channel_noise[c] * pilot->white[c];
        foretold->gain[c] = deviation * deviation / dark;
    }
}

double foretold_dark(const struct foretold *foretold, const double *turns, size_t count)
{
    const struct pilot *pilot = foretold->pilot;
    double sum = 0;
    for (int c = 0; c < pilot->channels; c++) {
        sum += foretold->gain[c] / (pilot->white[c] * pilot->white[c]);
    }
    return sum * foretold->window * foretold->window *
           dark_variance(foretold->station, pilot->black, turns, count);
}

/* Add the variances of a ring's entries, with the first 1, 2 ... exposures, to sums[count]. */
static void add_ring(const struct foretold *foretold, size_t index, int channel, int ring,
                     const double *turns, size_t count, double *sums)
{
    int entries = ring ? 8 * ring : 1;
    double white = foretold->pilot->white[channel];
    double light = pilot_energy(foretold->pilot, index, channel, ring) / entries * white;
    light = fmax(light, 0) + foretold->pilot->black;
    double weight = 0;
    for (size_t e = 0; e < count; e++) {
        weight += weight_of(foretold->station, turns[e], e == 0, light);
        sums[e] += entries * foretold->gain[channel] / (white * white) / weight;
    }
}

void foretold_noise(const struct foretold *foretold, size_t index, const double *turns,
                    size_t count, struct noise *noise)
{
    const struct pilot *pilot = foretold->pilot;
    const struct pilot_place *place = &pilot->places[index];
    int half = foretold->window / 2;
    double centre[FORETOLD_MAXIMUM] = {0};
    double tails[FORETOLD_MAXIMUM] = {0};
    for (int c = 0; c < pilot->channels; c++) {
        for (int ring = 0; ring < pilot->rings && ring <= half; ring++) {
            add_ring(foretold, index, c, ring, turns, count, ring ? tails : centre);
        }
    }
    double power = fmax(place->power, 1e-30);
    double whole = power + fmax(place->centre, 0);
    for (size_t e = 0; e < count; e++) {
        noise[e] = (struct noise){sqrt((centre[e] + tails[e]) / whole), sqrt(tails[e] / power)};
    }
}
