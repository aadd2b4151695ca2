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

/* Uniform from 0 to 1, `which` of several for the place with that hash. */
static double random_of(uint64_t place, int seed, int which)
{
    return (double)(hash_place((int64_t)place, which, 0, seed) >> 11) * 0x1p-53;
}

/* Two fields of value noise from -1 to 1 with features of size 1, or one: random values on the lattice, blended by
 * quintic steps. */
static void noises(const double place[3], int seed, int which, int count, double *values)
{
    int64_t corner[3];
    double blend[3];
    double sums[2] = {0};
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
        uint64_t hash = hash_place(corner[0] + at[0], corner[1] + at[1], corner[2] + at[2], seed);
        for (int j = 0; j < count; j++) {
            sums[j] += weight * random_of(hash, seed, which + j);
        }
    }
    for (int j = 0; j < count; j++) {
        values[j] = 2 * sums[j] - 1;
    }
}

/* `reach_mm`: of half its width and, for a place that may stray, how far. */
static bool is_near_vein(const struct sample_vein *vein, const double place[3], double reach_mm)
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
    return nearest <= reach_mm;
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

/* The two nearest of the scattered points so far. */
struct nearest {
    double first, second; /* distances */
    uint64_t hash;        /* of the first one's lattice place */
};

/* Look at the point of lattice place (x, y), unless its square is farther away than what is known. */
static void look_at_cell(const struct sample_cells *cells, const double place[3], int seed,
                         int64_t x, int64_t y, struct nearest *nearest)
{
    double corner[2] = {(double)x * cells->size_mm - place[0],
                        (double)y * cells->size_mm - place[1]};
    double gap_x = fmax(fmax(corner[0], -corner[0] - cells->size_mm), 0);
    double gap_y = fmax(fmax(corner[1], -corner[1] - cells->size_mm), 0);
    if (gap_x * gap_x + gap_y * gap_y >= nearest->second * nearest->second) {
        return;
    }
    uint64_t hash = hash_place(x, y, 0, seed);
    double distance = hypot(corner[0] + random_of(hash, seed, 0) * cells->size_mm,
                            corner[1] + random_of(hash, seed, 1) * cells->size_mm);
    if (distance < nearest->first) {
        nearest->second = nearest->first;
        nearest->first = distance;
        nearest->hash = hash;
    } else if (distance < nearest->second) {
        nearest->second = distance;
    }
}

static bool in_cells(const struct sample_cells *cells, const double place[3], int seed)
{
    /* Near ones first, so that most of the far ones need no look. */
    static const int order[5] = {0, -1, 1, -2, 2};
    struct nearest nearest = {.first = INFINITY, .second = INFINITY};
    int64_t column = (int64_t)floor(place[0] / cells->size_mm);
    int64_t row = (int64_t)floor(place[1] / cells->size_mm);
    for (int i = 0; i < 25; i++) {
        look_at_cell(cells, place, seed, column + order[i % 5], row + order[i / 5], &nearest);
    }
    /* Half the difference of the distances is how far the seam is, for seams met squarely. */
    return cells->seam_mm > 0 ? nearest.second - nearest.first < cells->seam_mm
                              : random_of(nearest.hash, seed, 2) < cells->fraction;
}

static bool in_clouds(const struct sample_clouds *clouds, const double place[3], int seed)
{
    double sum = 0;
    double variance = 0;
    double size = clouds->size_mm;
    double height = 1;
    for (int i = 0; i < clouds->octaves; i++) {
        double at[3] = {place[0] / size, place[1] / size, place[2] / size};
        double value;
        noises(at, seed, i, 1, &value);
        sum += height * value;
        variance += height * height;
        size *= 0.5;
        height *= 0.5;
    }
    /* The sum's distribution is near a normal one, and that near a logistic curve. Blending leaves of the values'
     * variance, 1/3, the factor 0.7835 (1 - 2 int b (1 - b), b the quintic step) for each axis: 0.16. */
    double share = 1 / (1 + exp(1.702 * sum / (0.4 * sqrt(variance))));
    return share < clouds->fraction;
}

static bool in_map(const struct sample_map *map, const double place[3])
{
    const struct picture *picture = &map->picture;
    double x = (place[0] - map->origin_mm[0]) / map->size_mm[0];
    double y = (place[1] - map->origin_mm[1]) / map->size_mm[1];
    if (!(x >= 0 && x < 1 && y >= 0 && y < 1) || !picture->rgb) {
        return false;
    }
    size_t column = (size_t)(x * picture->width);
    size_t row = (size_t)(y * picture->height);
    const float *rgb = picture->rgb + 3 * (row * (size_t)picture->width + column);
    return ((double)rgb[0] + (double)rgb[1] + (double)rgb[2]) / 3 > map->above;
}

/* The place before the inclusion leant. */
static void straighten(const struct sample_inclusion *inclusion, const double place_mm[3],
                       double plain[3])
{
    for (int i = 0; i < 3; i++) {
        plain[i] = place_mm[i];
    }
    for (int i = 0; i < 2; i++) {
        plain[i] -= inclusion->lean[i] * place_mm[2];
    }
}

/* And before it strayed, by at most wander_mm in x and in y. */
static void lead_back(const struct sample_inclusion *inclusion, const double place_mm[3],
                      double plain[3])
{
    if (inclusion->wander_mm > 0) {
        double half = 0.5 * inclusion->wander_size_mm;
        double at[3] = {place_mm[0] / half, place_mm[1] / half, place_mm[2] / half};
        double astray[2];
        noises(at, inclusion->seed, 100, 2, astray);
        for (int i = 0; i < 2; i++) {
            plain[i] += inclusion->wander_mm * astray[i];
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
        /* Most places are too far from a vein to ask how it strays. */
        double half_mm = 0.5 * inclusion->vein.width_mm;
        double astray_mm = 1.4143 * inclusion->wander_mm;
        if (!is_near_vein(&inclusion->vein, plain, half_mm + astray_mm)) {
            return false;
        }
        lead_back(inclusion, place_mm, plain);
        return is_near_vein(&inclusion->vein, plain, half_mm);
    }
    lead_back(inclusion, place_mm, plain);
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
    if (inclusion->map.line) {
        return in_map(&inclusion->map, plain);
    }
    return true;
}

size_t sample_inclusion_at(const struct sample *sample, const double place_mm[3])
{
    for (size_t i = sample->inclusion_count; i-- > 0;) {
        if (inside(&sample->inclusions[i], place_mm)) {
            return i;
        }
    }
    return sample->inclusion_count;
}

size_t sample_material_at(const struct sample *sample, const double place_mm[3])
{
    size_t i = sample_inclusion_at(sample, place_mm);
    return i < sample->inclusion_count ? sample->inclusions[i].material_index : sample->base_index;
}
