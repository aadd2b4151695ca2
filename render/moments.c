/* Adding up moments from surface points to larger and larger squares. */
#include "render/moments.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A frame: the moment, its three first moments about the node's place, then by lane of one row, in absolute value and
 * times the largest H: the mass, its three first moments and its second; and three colours of what the basis leaves. */
enum { OF_MOMENT = 4, OF_LANES = 5, REST = 3 };

static size_t frame_size(const struct moments *moments)
{
    return OF_MOMENT * moments->size + OF_LANES * moments->lanes + REST;
}

static float *frame_at(const struct moments *moments, int depth)
{
    return moments->frames + (size_t)depth * frame_size(moments);
}

static bool is_per_term(const struct moments *moments)
{
    return moments->appearance->layout == NACRE_KERNEL_PER_TERM;
}

static void sum_kernels(struct moments *moments)
{
    const struct appearance *a = moments->appearance;
    size_t entries = ((size_t)a->window + 2) * ((size_t)a->window + 2);
    size_t count = (size_t)a->kernel_count, terms = (size_t)a->terms;
    for (size_t i = 0; i < count * 3; i++) {
        double sum = 0;
        for (size_t k = 0; k < entries; k++) {
            size_t place = is_per_term(moments) ? k * terms + i / 3 : i / 3 * entries + k;
            sum += a->kernels[place * 4 + i % 3];
        }
        moments->kernel_sums[i] = (float)sum;
    }
}

int moments_begin(struct moments *moments, const struct appearance *appearance, double point_mm)
{
    const struct basis *basis = &appearance->basis;
    size_t lanes = 16 * (size_t)basis->vectors;
    *moments = (struct moments){.appearance = appearance,
                                .to_points = (float)(1 / point_mm),
                                .size = (size_t)basis->rows * lanes,
                                .lanes = lanes,
                                .parts = (size_t)basis->parts,
                                .bound_size = 3 * (size_t)basis->parts + 1};
    moments->lane_color = calloc(lanes, sizeof *moments->lane_color);
    moments->lane_part = calloc(lanes, sizeof *moments->lane_part);
    moments->kernel_sums =
        calloc((size_t)appearance->kernel_count * 3 + 1, sizeof *moments->kernel_sums);
    moments->frames = calloc((CELLS_LEVEL_TOP + 1) * frame_size(moments), sizeof *moments->frames);
    if (!moments->lane_color || !moments->lane_part || !moments->kernel_sums || !moments->frames) {
        return NACRE_FAILED;
    }
    for (size_t l = 0; l < lanes; l++) {
        moments->lane_part[l] = basis_part(basis, is_per_term(moments), (int)l);
        moments->lane_color[l] = (int)(is_per_term(moments) ? l % 4 : l % 16 % 3);
    }
    sum_kernels(moments);
    return NACRE_OK;
}

void moments_end(struct moments *moments)
{
    free(moments->lane_color);
    free(moments->lane_part);
    free(moments->kernel_sums);
    free(moments->frames);
    free(moments->list);
    *moments = (struct moments){0};
}

void moments_open(struct moments *moments, int depth)
{
    memset(frame_at(moments, depth), 0, frame_size(moments) * sizeof *moments->frames);
}

static const float *factors_at(const struct appearance *a, size_t texel, size_t c)
{
    size_t plane = a->factor_channels == 1 ? 0 : c;
    return a->f + (texel * (size_t)a->factor_channels + plane) * (size_t)a->terms;
}

/* Weights of one surface point: by colour sum_t F H_max, and by lane that times |U| (or F H_max of the lane's term). */
struct weights {
    float color[3], rest[3];
    float share[16 * 32]; /* U, with its sign; 1 in layout term */
    float lane[16 * 32];
};

static void weigh(const struct moments *moments, size_t texel, struct weights *weights)
{
    const struct appearance *a = moments->appearance;
    const struct basis *basis = &a->basis;
    size_t terms = (size_t)a->terms, lanes = moments->lanes, mixed = (size_t)a->mixed;
    for (size_t c = 0; c < 3; c++) {
        const float *f = factors_at(a, texel, c);
        weights->color[c] = weights->rest[c] = 0;
        for (size_t t = 0; !is_per_term(moments) && t < terms; t++) {
            weights->color[c] += f[t] * basis->top_h[t * lanes + c];
        }
    }
    if (is_per_term(moments)) {
        for (size_t l = 0; l < lanes; l++) {
            size_t c = l % 4 < 3 ? l % 4 : 0;
            weights->share[l] = l % 4 < 3;
            weights->lane[l] = l % 4 < 3 ? factors_at(a, texel, c)[l / 4] * basis->top_h[l] : 0;
        }
        return;
    }
    memset(weights->share, 0, lanes * sizeof *weights->share);
    for (size_t k = 0; k < mixed; k++) {
        float weight = a->weights[texel * mixed + k];
        size_t id = a->ids[texel * mixed + k];
        for (size_t l = 0; l < lanes; l++) {
            weights->share[l] += weight * basis->share[id * lanes + l];
        }
        for (size_t c = 0; c < 3; c++) {
            weights->rest[c] += weight * weights->color[c] * basis->rest[id * 3 + c];
        }
    }
    for (size_t l = 0; l < lanes; l++) {
        weights->lane[l] = fabsf(weights->share[l]) * weights->color[moments->lane_color[l]];
    }
}

/* First and second moments of the light about a place, by colour, in surface points. */
struct spread {
    float flux[3], first[3][3] /* [axis][colour] */, second[3];
};

static struct spread spread_of(const struct moments *moments, const struct light_sample *samples,
                               const struct cell_node *node, const struct light_sample *whole)
{
    struct spread spread = {{0}, {{0}}, {0}};
    memcpy(spread.flux, whole->flux, sizeof spread.flux);
    if (node->sample_end - node->sample_begin == 1) {
        return spread;
    }
    for (size_t i = node->sample_begin; i < node->sample_end; i++) {
        float square = 0, away[3];
        for (int k = 0; k < 3; k++) {
            away[k] = (samples[i].position[k] - whole->position[k]) * moments->to_points;
            square += away[k] * away[k];
        }
        for (int c = 0; c < 3; c++) {
            for (int k = 0; k < 3; k++) {
                spread.first[k][c] += samples[i].flux[c] * away[k];
            }
            spread.second[c] += samples[i].flux[c] * square;
        }
    }
    return spread;
}

/* mean offset, then squares; see cells.h. Bilinear kernels have kinks at surface points, so that the error grows with the
 * offset itself where it is less than one: hence the root, the mean offset's bound by Cauchy and Schwarz. */
static void bound_squares(const struct moments *moments, const float *mass, const float *second,
                          float *bounds)
{
    for (size_t l = 0; l < moments->lanes; l++) {
        if (moments->lane_part[l] >= 0) {
            float *bound = bounds + moments->parts + (size_t)moments->lane_part[l];
            bound[0] = fmaxf(bound[0], second[l] + sqrtf(mass[l] * second[l]));
            bound[moments->parts] = fmaxf(bound[moments->parts], mass[l]);
        }
    }
}

static void bound_point(const struct moments *moments, const struct spread *spread,
                        const struct weights *weights, float *bounds)
{
    for (size_t l = 0; l < moments->lanes; l++) {
        int c = moments->lane_color[l], part = moments->lane_part[l];
        if (part < 0) {
            continue;
        }
        float first = sqrtf(spread->first[0][c] * spread->first[0][c] +
                            spread->first[1][c] * spread->first[1][c] +
                            spread->first[2][c] * spread->first[2][c]);
        float second = spread->second[c] + sqrtf(spread->second[c] * spread->flux[c]);
        float *bound = bounds + part;
        bound[0] = fmaxf(bound[0], weights->lane[l] * first);
        bound[moments->parts] = fmaxf(bound[moments->parts], weights->lane[l] * second);
        bound[2 * moments->parts] =
            fmaxf(bound[2 * moments->parts], weights->lane[l] * spread->flux[c]);
    }
}

/* Where a child's light lies from its parent's place, in surface points. */
static void shift_of(const struct moments *moments, const struct cell_node *child,
                     const struct cell_node *parent, float shift[3])
{
    for (int k = 0; k < 3; k++) {
        shift[k] = (child->position[k] - parent->position[k]) * moments->to_points;
    }
}

/* Add F U flux, and its first moments, to the rows of a frame. */
static void add_rows(const struct moments *moments, size_t texel, const struct spread *spread,
                     const struct weights *weights, const float shift[3], float *frame)
{
    const struct appearance *a = moments->appearance;
    size_t lanes = moments->lanes, rows = moments->size / lanes;
    float flux[4][16 * 32];
    for (size_t l = 0; l < lanes; l++) {
        int c = moments->lane_color[l] % 3;
        float share = moments->lane_part[l] >= 0 ? weights->share[l] : 0;
        flux[0][l] = share * spread->flux[c];
        for (int k = 0; k < 3; k++) {
            flux[k + 1][l] = share * (spread->first[k][c] + shift[k] * spread->flux[c]);
        }
    }
    for (size_t t = 0; t < rows; t++) {
        float f[16 * 32];
        for (size_t l = 0; l < lanes; l++) {
            size_t c = (size_t)moments->lane_color[l] % 3;
            f[l] = factors_at(a, texel, c)[is_per_term(moments) ? l / 4 : t];
        }
        for (size_t k = 0; k < OF_MOMENT; k++) {
            float *to = frame + k * moments->size + t * lanes;
            for (size_t l = 0; l < lanes; l++) {
                to[l] += f[l] * flux[k][l];
            }
        }
    }
}

static void add_lanes(const struct moments *moments, const struct spread *spread,
                      const struct weights *weights, const float shift[3], float *frame)
{
    size_t lanes = moments->lanes;
    float *to = frame + OF_MOMENT * moments->size;
    float square = shift[0] * shift[0] + shift[1] * shift[1] + shift[2] * shift[2];
    for (size_t l = 0; l < lanes; l++) {
        int c = moments->lane_color[l] % 3;
        float weight = weights->lane[l], mass = weight * spread->flux[c], along = 0;
        for (int k = 0; k < 3; k++) {
            along += shift[k] * spread->first[k][c];
            to[(size_t)(k + 1) * lanes + l] += weight * spread->first[k][c] + shift[k] * mass;
        }
        to[l] += mass;
        to[4 * lanes + l] += weight * (spread->second[c] + 2 * along) + square * mass;
    }
    for (int c = 0; c < 3; c++) {
        to[OF_LANES * lanes + (size_t)c] += weights->rest[c] * spread->flux[c];
    }
}

void moments_point(struct moments *moments, const struct light_sample *samples,
                   const struct cell_node *node, const struct light_sample *whole, int depth,
                   const struct cell_node *parent, float *bounds)
{
    struct weights weights;
    bool above = parent && parent->level > 0;
    memset(bounds, 0, moments->bound_size * sizeof *bounds);
    if (!above && node->sample_end - node->sample_begin == 1) {
        return;
    }
    struct spread spread = spread_of(moments, samples, node, whole);
    weigh(moments, whole->texel, &weights);
    bound_point(moments, &spread, &weights, bounds);
    if (above) {
        float shift[3], *frame = frame_at(moments, depth - 1);
        shift_of(moments, node, parent, shift);
        add_rows(moments, whole->texel, &spread, &weights, shift, frame);
        add_lanes(moments, &spread, &weights, shift, frame);
    }
}

void moments_count(struct moments *moments, const struct light_sample *whole)
{
    const struct appearance *a = moments->appearance;
    size_t terms = (size_t)a->terms, mixed = (size_t)a->mixed, texel = whole->texel;
    size_t columns = (size_t)a->basis.columns;
    for (size_t c = 0; c < 3; c++) {
        const float *f = factors_at(a, texel, c), *h = a->h + (f - a->f);
        double sum = 0, kernel = 0;
        for (size_t t = 0; t < terms; t++) {
            bool used = t < (size_t)a->kernel_count;
            sum += (double)f[t] * h[t] *
                   (is_per_term(moments) && used ? moments->kernel_sums[t * 3 + c] : 1);
        }
        for (size_t k = 0; !is_per_term(moments) && k < mixed; k++) {
            size_t first = a->ids[texel * mixed + k] * columns;
            for (size_t b = 0; b < columns; b++) {
                kernel += a->weights[texel * mixed + k] *
                          moments->kernel_sums[(first + b) * 3 + c] / (double)columns;
            }
        }
        moments->brightness[c] += whole->flux[c] * sum * (is_per_term(moments) ? 1 : kernel);
    }
}

static size_t reserve(struct moments *moments)
{
    if (moments->count == moments->capacity) {
        size_t capacity = 2 * moments->capacity + 1024;
        float *list = aligned_alloc(64, capacity * moments->size * sizeof *list);
        if (!list) {
            return SIZE_MAX;
        }
        if (moments->count > 0) {
            memcpy(list, moments->list, moments->count * moments->size * sizeof *list);
        }
        free(moments->list);
        moments->list = list;
        moments->capacity = capacity;
    }
    return moments->count++;
}

static void bound_means(const struct moments *moments, const float *frame, float *bounds)
{
    const struct basis *basis = &moments->appearance->basis;
    size_t lanes = moments->lanes, size = moments->size;
    float sums[16 * 32] = {0};
    for (size_t i = 0; i < size; i++) {
        float x = frame[size + i], y = frame[2 * size + i], z = frame[3 * size + i];
        sums[i % lanes] += basis->top_h[i] * sqrtf(x * x + y * y + z * z);
    }
    for (size_t l = 0; l < lanes; l++) {
        if (moments->lane_part[l] >= 0) {
            float *bound = bounds + moments->lane_part[l];
            *bound = fmaxf(*bound, sums[l]);
        }
    }
}

/* Add a frame to the one above, whose place is elsewhere. */
static void pass_on(const struct moments *moments, const float *from, const float shift[3],
                    float *to)
{
    size_t size = moments->size, lanes = moments->lanes;
    for (size_t k = 0; k < 3; k++) {
        for (size_t i = 0; i < size; i++) {
            to[(k + 1) * size + i] += from[(k + 1) * size + i] + shift[k] * from[i];
        }
    }
    for (size_t i = 0; i < size; i++) {
        to[i] += from[i];
    }
    from += OF_MOMENT * size;
    to += OF_MOMENT * size;
    float square = shift[0] * shift[0] + shift[1] * shift[1] + shift[2] * shift[2];
    for (size_t l = 0; l < lanes; l++) {
        float along = 0;
        for (size_t k = 0; k < 3; k++) {
            along += shift[k] * from[(k + 1) * lanes + l];
            to[(k + 1) * lanes + l] += from[(k + 1) * lanes + l] + shift[k] * from[l];
        }
        to[l] += from[l];
        to[4 * lanes + l] += from[4 * lanes + l] + 2 * along + square * from[l];
    }
    for (size_t c = 0; c < REST; c++) {
        to[OF_LANES * lanes + c] += from[OF_LANES * lanes + c];
    }
}

size_t moments_close(struct moments *moments, const struct cell_node *node, int depth,
                     const struct cell_node *parent, float *bounds)
{
    const float *frame = frame_at(moments, depth);
    const float *by_lane = frame + OF_MOMENT * moments->size;
    const float *rest = by_lane + OF_LANES * moments->lanes;
    size_t number = reserve(moments);
    if (number == SIZE_MAX) {
        return number;
    }
    memset(bounds, 0, moments->bound_size * sizeof *bounds);
    memcpy(moments->list + number * moments->size, frame, moments->size * sizeof *frame);
    bound_means(moments, frame, bounds);
    bound_squares(moments, by_lane, by_lane + 4 * moments->lanes, bounds);
    bounds[3 * moments->parts] = fmaxf(rest[0], fmaxf(rest[1], rest[2]));
    if (parent) {
        float shift[3];
        shift_of(moments, node, parent, shift);
        pass_on(moments, frame, shift, frame_at(moments, depth - 1));
    }
    return number;
}
