/* What lies where in a sample: the shapes of its inclusions. */
#include "rig/virtual/sample.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

static const double PI = 3.14159265358979323846;

/* A random 64-bit number that belongs to a lattice place (SplitMix64's finaliser over the coordinates). */
static uint64_t hash_place(int64_t x, int64_t y, int64_t z, int seed)
{
    uint64_t bits = (uint64_t)x * 0x9e3779b97f4a7c15U + (uint64_t)y * 0xc2b2ae3d27d4eb4fU +
                    (uint64_t)z * 0x165667b19e3779f9U + (uint64_t)seed * 0xd6e8feb86659fd93U;
    bits = (bits ^ (bits >> 30)) * 0xbf58476d1ce4e5b9U;
    bits = (bits ^ (bits >> 27)) * 0x94d049bb133111ebU;
    return bits ^ (bits >> 31);
}

/* Uniform from 0 to 1, `which` of several for the same place. */
static double random_at(int64_t x, int64_t y, int64_t z, int seed, int which)
{
    uint64_t bits = hash_place(x, y, z, seed);
    bits = hash_place((int64_t)bits, which, 0, seed);
    return (double)(bits >> 11) * 0x1p-53;
}

/* Value noise from -1 to 1 with features of size 1: random values on the lattice, blended by quintic steps. */
static double noise(const double place[3], int seed, int which)
{
    int64_t corner[3];
    double blend[3];
    double sum = 0;
    for (int i = 0; i < 3; i++) {
        double below = floor(place[i]);
        double t = place[i] - below;
        corner[i] = (int64_t)below;
        blend[i] = t * t * t * (t * (t * 6 - 15) + 10);
    }
    for (int i = 0; i < 8; i++) {
        int at[3] = {i & 1, i >> 1 & 1, i >> 2};
        double weight = 1;
        for (int j = 0; j < 3; j++) {
            weight *= at[j] ? blend[j] : 1 - blend[j];
        }
        sum += weight *
               random_at(corner[0] + at[0], corner[1] + at[1], corner[2] + at[2], seed, which);
    }
    return 2 * sum - 1;
}

static bool in_vein(const struct sample_vein *vein, const double place[3])
{
    double nearest = INFINITY;
    for (size_t i = 0; i + 3 < vein->point_count; i += 2) {
        const double *from = vein->points_mm + i;
        double along[2] = {from[2] - from[0], from[3] - from[1]};
        double to[2] = {place[0] - from[0], place[1] - from[1]};
        double length2 = along[0] * along[0] + along[1] * along[1];
        double t = length2 > 0 ? (to[0] * along[0] + to[1] * along[1]) / length2 : 0;
        t = fmin(fmax(t, 0), 1);
        nearest = fmin(nearest, hypot(to[0] - t * along[0], to[1] - t * along[1]));
    }
    return nearest <= 0.5 * vein->width_mm;
}

static bool in_bands(const struct sample_bands *bands, const double place[3])
{
    double angle = bands->angle_deg * PI / 180;
    double across = place[1] * cos(angle) - place[0] * sin(angle);
    double turns = (across - bands->start_mm) / bands->period_mm;
    return turns - floor(turns) < bands->fraction;
}

static bool in_checker(const struct sample_checker *checker, const double place[3])
{
    double column = floor((place[0] - checker->origin_mm[0]) / checker->square_mm);
    double row = floor((place[1] - checker->origin_mm[1]) / checker->square_mm);
    return fmod(column + row, 2) == 0;
}

static bool in_cells(const struct sample_cells *cells, const double place[3], int seed)
{
    double nearest = INFINITY;
    double second = INFINITY;
    double chance = 1;
    int64_t column = (int64_t)floor(place[0] / cells->size_mm);
    int64_t row = (int64_t)floor(place[1] / cells->size_mm);
    for (int64_t y = row - 2; y <= row + 2; y++) {
        for (int64_t x = column - 2; x <= column + 2; x++) {
            double dx = ((double)x + random_at(x, y, 0, seed, 0)) * cells->size_mm - place[0];
            double dy = ((double)y + random_at(x, y, 0, seed, 1)) * cells->size_mm - place[1];
            double distance = hypot(dx, dy);
            if (distance < nearest) {
                second = nearest;
                nearest = distance;
                chance = random_at(x, y, 0, seed, 2);
            } else if (distance < second) {
                second = distance;
            }
        }
    }
    /* Half the difference of the distances is how far the seam is, for seams met squarely. */
    return cells->seam_mm > 0 ? second - nearest < cells->seam_mm : chance < cells->fraction;
}

static bool in_clouds(const struct sample_clouds *clouds, const double place[3], int seed)
{
    double sum = 0;
    double variance = 0;
    double size = clouds->size_mm;
    double height = 1;
    for (int i = 0; i < clouds->octaves; i++) {
        double at[3] = {place[0] / size, place[1] / size, place[2] / size};
        sum += height * noise(at, seed, i);
        variance += height * height;
        size *= 0.5;
        height *= 0.5;
    }
    /* The sum's distribution is near a normal one, and that near a logistic curve. Blending leaves of the values'
     * variance, 1/3, the factor 0.7835 (1 - 2 int b (1 - b), b the quintic step) for each axis: 0.16. */
    double share = 1 / (1 + exp(1.702 * sum / (0.4 * sqrt(variance))));
    return share < clouds->fraction;
}

/* The place before the inclusion leant and strayed. */
static void straighten(const struct sample_inclusion *inclusion, const double place_mm[3],
                       double plain[3])
{
    for (int i = 0; i < 3; i++) {
        plain[i] = place_mm[i];
    }
    for (int i = 0; i < 2; i++) {
        plain[i] -= inclusion->lean[i] * place_mm[2];
    }
    if (inclusion->wander_mm > 0) {
        double half = 0.5 * inclusion->wander_size_mm;
        double at[3] = {place_mm[0] / half, place_mm[1] / half, place_mm[2] / half};
        for (int i = 0; i < 2; i++) {
            plain[i] += inclusion->wander_mm * noise(at, inclusion->seed, 100 + i);
        }
    }
}

static bool inside(const struct sample_inclusion *inclusion, const double place_mm[3])
{
    double plain[3];
    if (place_mm[2] < inclusion->depth_mm[0] || place_mm[2] >= inclusion->depth_mm[1]) {
        return false;
    }
    straighten(inclusion, place_mm, plain);
    if (inclusion->vein.line) {
        return in_vein(&inclusion->vein, plain);
    }
    if (inclusion->bands.line) {
        return in_bands(&inclusion->bands, plain);
    }
    if (inclusion->checker.line) {
        return in_checker(&inclusion->checker, plain);
    }
    if (inclusion->cells.line) {
        return in_cells(&inclusion->cells, plain, inclusion->seed);
    }
    if (inclusion->clouds.line) {
        return in_clouds(&inclusion->clouds, plain, inclusion->seed);
    }
    return true;
}

size_t sample_material_at(const struct sample *sample, const double place_mm[3])
{
    for (size_t i = sample->inclusion_count; i-- > 0;) {
        if (inside(&sample->inclusions[i], place_mm)) {
            return sample->inclusions[i].material_index;
        }
    }
    return sample->base_index;
}
