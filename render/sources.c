/* Summing up light by places in the texture. */
#include "render/sources.h"

#include "render/bundles.h"
#include "render/groups.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* Light of one place in the texture is parted where it is farther spread in space than this many sides of the square, or
 * where its normals' mean is shorter than this. */
static const double widest = SOURCES_WIDEST, straightest = 0.85;

/* What is added up of one group. */
struct heap {
    double weight, position[3], normal[3], x, y, flux[3], square, radius_square;
    int32_t chart;
    uint32_t texel;
    bool parted;
};

/* One set being summed up to the next. */
struct merge {
    const struct source_set *from;
    double size; /* of the squares, points */
    double point_mm;
    uint32_t *numbers; /* of each source's group */
    struct groups groups;
    struct heap *heaps;
};

static double brightness(const float flux[3])
{
    return (double)flux[0] + (double)flux[1] + (double)flux[2];
}

static int32_t cell_of(double x, double size)
{
    return (int32_t)fmin(fmax(floor(x / size), -1e9), 1e9);
}

static struct group_key key_of(const struct merge *merge, const struct source *source)
{
    return (struct group_key){source->chart, cell_of((double)source->x, merge->size),
                              cell_of((double)source->y, merge->size), 0};
}

static void add_to_heap(struct heap *heap, const struct source *source)
{
    double weight = brightness(source->flux);
    heap->weight += weight;
    heap->x += weight * (double)source->x;
    heap->y += weight * (double)source->y;
    for (int k = 0; k < 3; k++) {
        heap->position[k] += weight * (double)source->position[k];
        heap->normal[k] += weight * (double)source->normal[k];
        heap->flux[k] += (double)source->flux[k];
    }
    heap->chart = source->chart;
    heap->texel = source->texel;
}

static void measure(struct heap *heap, const struct source *source)
{
    double square = 0;
    for (int k = 0; k < 3; k++) {
        double away = (double)source->position[k] - heap->position[k];
        square += away * away;
    }
    heap->square += brightness(source->flux) * square;
    heap->radius_square = fmax(heap->radius_square, square);
}

/* Sum up the sources by their numbers. */
static int fill_heaps(struct merge *merge)
{
    free(merge->heaps);
    merge->heaps = calloc(merge->groups.count + 1, sizeof *merge->heaps);
    if (!merge->heaps) {
        return -1;
    }
    for (size_t i = 0; i < merge->from->count; i++) {
        add_to_heap(&merge->heaps[merge->numbers[i]], &merge->from->list[i]);
    }
    for (size_t i = 0; i < merge->groups.count; i++) {
        struct heap *heap = &merge->heaps[i];
        double scale = heap->weight > 0 ? 1 / heap->weight : 0;
        heap->x *= scale;
        heap->y *= scale;
        for (int k = 0; k < 3; k++) {
            heap->position[k] *= scale;
            heap->normal[k] *= scale;
        }
    }
    for (size_t i = 0; i < merge->from->count; i++) {
        measure(&merge->heaps[merge->numbers[i]], &merge->from->list[i]);
    }
    return 0;
}

static bool must_part(const struct merge *merge, const struct heap *heap)
{
    double most = widest * merge->size * merge->point_mm, length = 0;
    for (int k = 0; k < 3; k++) {
        length += heap->normal[k] * heap->normal[k];
    }
    return heap->radius_square > most * most || length < straightest * straightest;
}

/* Groups by place in the texture; those that are not compact once more by place in space. */
static int group(struct merge *merge)
{
    bool any = false;
    if (groups_begin(&merge->groups, merge->from->count / 2) != 0) {
        return -1;
    }
    struct group_key last = {0};
    for (size_t i = 0; i < merge->from->count; i++) { /* often in the group of the one before */
        struct group_key key = key_of(merge, &merge->from->list[i]);
        bool same = i > 0 && key.kind == last.kind && key.x == last.x && key.y == last.y;
        merge->numbers[i] = same ? merge->numbers[i - 1] : groups_number(&merge->groups, key);
        last = key;
        if (merge->numbers[i] == GROUPS_FULL) {
            return -1;
        }
    }
    if (fill_heaps(merge) != 0) {
        return -1;
    }
    for (size_t i = 0; i < merge->groups.count; i++) {
        merge->heaps[i].parted = must_part(merge, &merge->heaps[i]);
        any = any || merge->heaps[i].parted;
    }
    if (!any) {
        return 0;
    }
    groups_end(&merge->groups);
    if (groups_begin(&merge->groups, merge->from->count / 2) != 0) {
        return -1;
    }
    for (size_t i = 0; i < merge->from->count; i++) {
        const struct source *source = &merge->from->list[i];
        struct group_key key = key_of(merge, source);
        key.part =
            merge->heaps[merge->numbers[i]].parted
                ? groups_part(source->position, source->normal, merge->size * merge->point_mm)
                : 0;
        merge->numbers[i] = groups_number(&merge->groups, key);
        if (merge->numbers[i] == GROUPS_FULL) {
            return -1;
        }
    }
    return fill_heaps(merge);
}

static struct source source_of(const struct heap *heap)
{
    struct source source = {
        .x = (float)heap->x, .y = (float)heap->y, .chart = heap->chart, .texel = heap->texel};
    double length = 0;
    for (int k = 0; k < 3; k++) {
        length += heap->normal[k] * heap->normal[k];
    }
    for (int k = 0; k < 3; k++) {
        source.position[k] = source.middle[k] = (float)heap->position[k];
        source.normal[k] = (float)(heap->normal[k] / (length > 0 ? sqrt(length) : 1));
        source.flux[k] = (float)heap->flux[k];
    }
    return source;
}

/* Sum up a set by squares of `size` points, and tell it their middles and their variance. */
static int merge_set(struct source_set *from, double size, double point_mm, struct source_set *to,
                     float *variance)
{
    double square = 0, weight = 0;
    struct merge merge = {.from = from,
                          .size = size,
                          .point_mm = point_mm,
                          .numbers = calloc(from->count + 1, sizeof *merge.numbers)};
    int status = merge.numbers ? group(&merge) : -1;
    if (status == 0) {
        to->count = merge.groups.count;
        to->list = calloc(to->count + 1, sizeof *to->list);
        status = to->list ? 0 : -1;
    }
    for (size_t i = 0; status == 0 && i < to->count; i++) {
        to->list[i] = source_of(&merge.heaps[i]);
        square += merge.heaps[i].square;
        weight += merge.heaps[i].weight;
    }
    *variance = weight > 0 ? (float)(square / weight / (2 * point_mm * point_mm)) : 0;
    for (size_t i = 0; status == 0 && i < from->count; i++) {
        memcpy(from->list[i].middle, to->list[merge.numbers[i]].position,
               sizeof from->list[i].middle);
    }
    groups_end(&merge.groups);
    free(merge.numbers);
    free(merge.heaps);
    return status;
}

void source_set_finish(struct source_set *set)
{
    free(set->list);
    *set = (struct source_set){0};
}

int sources_take(struct source_set *set, const struct light_samples *samples,
                 struct nacre_error *error)
{
    uint32_t *order = calloc(samples->count + 1, sizeof *order);
    *set = (struct source_set){0};
    set->list = calloc(samples->count + 1, sizeof *set->list);
    for (size_t i = 0; order && set->list && i < samples->count; i++) {
        if (brightness(samples->list[i].flux) > 0) {
            order[set->count++] = (uint32_t)i;
        }
    }
    if (!order || !set->list ||
        (set->count > 0 &&
         bundles_order(samples->list[0].position, sizeof *samples->list / sizeof(float), order,
                       set->count) != 0)) {
        free(order);
        source_set_finish(set);
        return nacre_fail_memory(error, "the light samples");
    }
    for (size_t i = 0; i < set->count; i++) {
        const struct light_sample *sample = &samples->list[order[i]];
        struct source *source = &set->list[i];
        *source = (struct source){
            .x = sample->x, .y = sample->y, .chart = sample->chart, .texel = sample->texel};
        memcpy(source->position, sample->position, sizeof source->position);
        memcpy(source->normal, sample->normal, sizeof source->normal);
        memcpy(source->flux, sample->flux, sizeof source->flux);
    }
    free(order);
    return NACRE_OK;
}

/* F U of one surface point, times flux[3], added to a moment. */
static void add_texel(const struct appearance *appearance, size_t texel, const float flux[3],
                      float *moment)
{
    size_t terms = (size_t)appearance->terms, planes = (size_t)appearance->factor_channels;
    size_t parts = (size_t)appearance->basis.parts, mixed = (size_t)appearance->mixed;
    const float *f = appearance->f + texel * planes * terms;
    const float *red = f, *green = f + (planes == 3 ? terms : 0), *blue = f + (planes - 1) * terms;
    if (appearance->layout == NACRE_KERNEL_PER_TERM) {
        for (size_t t = 0; t < terms; t++) {
            moment[t * 4] += flux[0] * red[t];
            moment[t * 4 + 1] += flux[1] * green[t];
            moment[t * 4 + 2] += flux[2] * blue[t];
        }
        return;
    }
    for (size_t r = 0; r < parts; r++) {
        float share[3] = {0};
        for (size_t a = 0; a < mixed; a++) {
            size_t place = texel * mixed + a;
            const float *u =
                appearance->basis.share + ((size_t)appearance->ids[place] * parts + r) * 4;
            for (size_t c = 0; c < 3; c++) {
                share[c] += appearance->weights[place] * u[c] * flux[c];
            }
        }
        float *row = moment + r * terms * 4;
        for (size_t t = 0; t < terms; t++) {
            row[t * 4] += share[0] * red[t];
            row[t * 4 + 1] += share[1] * green[t];
            row[t * 4 + 2] += share[2] * blue[t];
        }
    }
}

static float *new_moments(size_t count, size_t size)
{
    size_t bytes = (count * size * sizeof(float) / 64 + 1) * 64;
    float *moments = aligned_alloc(64, bytes);
    if (moments) {
        memset(moments, 0, bytes);
    }
    return moments;
}

enum { CORNERS = 4, BLOCK = 16 };

/* A moment is a whole number of blocks, by which compilers make vectors of it. */
static void add_moment(const float *restrict from, size_t size, float scale, float *restrict to)
{
    for (size_t k = 0; k < size; k += BLOCK) {
        for (size_t j = 0; j < BLOCK; j++) {
            to[k + j] += scale * from[k + j];
        }
    }
}

/* What is known of a node's surroundings: sums over its sources, places counted from the node's own in the texture. */
struct node {
    struct group_key key;
    double weight, x, y, xx, xy, yy, position[3], by_x[3], by_y[3], normal[3], flux[3];
    bool parted;
};

/* A lattice of nodes to which sources are handed out by bilinear weights. */
struct lattice {
    const struct source_set *from;
    double size, point_mm;
    uint32_t *links; /* [sources][4] */
    float *shares;
    struct groups groups;
    struct node *nodes;
};

static struct group_key corner_of(const struct lattice *lattice, const struct source *source,
                                  size_t k, float *share)
{
    double x = (double)source->x / lattice->size - 0.5, y = (double)source->y / lattice->size - 0.5;
    double fx = x - floor(x), fy = y - floor(y);
    *share = (float)((k % 2 ? fx : 1 - fx) * (k / 2 ? fy : 1 - fy));
    return (struct group_key){source->chart, cell_of(x, 1) + (int32_t)(k % 2),
                              cell_of(y, 1) + (int32_t)(k / 2), 0};
}

/* Sources between the same nodes have the same four: they are looked up once for the first of them, as long as no nodes are
 * parted. */
static int link_source(struct lattice *lattice, struct groups *cells, uint32_t *firsts, size_t i)
{
    const struct source *source = &lattice->from->list[i];
    uint32_t *links = &lattice->links[i * CORNERS];
    struct group_key keys[CORNERS];
    for (size_t k = 0; k < CORNERS; k++) {
        keys[k] = corner_of(lattice, source, k, &lattice->shares[i * CORNERS + k]);
    }
    if (!lattice->nodes) {
        size_t before = cells->count;
        uint32_t cell = groups_number(cells, keys[0]);
        if (cell == GROUPS_FULL) {
            return -1;
        }
        if (cells->count == before) {
            memcpy(links, &lattice->links[firsts[cell] * (size_t)CORNERS], CORNERS * sizeof *links);
            return 0;
        }
        firsts[cell] = (uint32_t)i;
    }
    double cube = 2 * lattice->size * lattice->point_mm;
    for (size_t k = 0; k < CORNERS; k++) {
        if (lattice->nodes && lattice->nodes[links[k]].parted) {
            keys[k].part = groups_part(source->position, source->normal, cube);
        }
        links[k] = groups_number(&lattice->groups, keys[k]);
        if (links[k] == GROUPS_FULL) {
            return -1;
        }
    }
    return 0;
}

static int link_nodes(struct lattice *lattice)
{
    struct groups cells = {0};
    uint32_t *firsts = calloc(lattice->from->count + 1, sizeof *firsts);
    groups_end(&lattice->groups);
    int status = firsts && groups_begin(&lattice->groups, lattice->from->count / 4) == 0 &&
                         groups_begin(&cells, lattice->from->count / 4) == 0
                     ? 0
                     : -1;
    for (size_t i = 0; status == 0 && i < lattice->from->count; i++) {
        status = link_source(lattice, &cells, firsts, i);
    }
    groups_end(&cells);
    free(firsts);
    if (status == 0) {
        free(lattice->nodes);
        lattice->nodes = calloc(lattice->groups.count + 1, sizeof *lattice->nodes);
    }
    return status == 0 && lattice->nodes ? 0 : -1;
}

static void add_to_node(struct node *node, double size, float share, const struct source *source)
{
    double weight = (double)share + 1e-4; /* a node at the rim needs a place, too */
    double x = (double)source->x / size - 0.5 - node->key.x;
    double y = (double)source->y / size - 0.5 - node->key.y;
    node->weight += weight;
    node->x += weight * x;
    node->y += weight * y;
    node->xx += weight * x * x;
    node->xy += weight * x * y;
    node->yy += weight * y * y;
    for (int k = 0; k < 3; k++) {
        node->position[k] += weight * (double)source->position[k];
        node->by_x[k] += weight * x * (double)source->position[k];
        node->by_y[k] += weight * y * (double)source->position[k];
        node->normal[k] += weight * (double)source->normal[k];
        node->flux[k] += (double)share * (double)source->flux[k];
    }
}

static void fill_nodes(struct lattice *lattice)
{
    for (size_t i = 0; i < lattice->from->count * CORNERS; i++) {
        struct node *node = &lattice->nodes[lattice->links[i]];
        const struct source *source = &lattice->from->list[i / CORNERS];
        float share;
        if (!(node->weight > 0)) {
            node->key = corner_of(lattice, source, i % CORNERS, &share);
        }
        add_to_node(node, lattice->size, lattice->shares[i], source);
    }
}

/* The node as a source, placed where the plane through its sources has it; where they lie on a line or a point, at their
 * middle. */
static struct source source_at(const struct lattice *lattice, const struct node *node)
{
    double w = node->weight, x = node->x / w, y = node->y / w, length = 0;
    double xx = node->xx / w - x * x, xy = node->xy / w - x * y, yy = node->yy / w - y * y;
    double determinant = xx * yy - xy * xy;
    bool flat = determinant > 1e-4;
    struct source source = {.x = (float)((node->key.x + 0.5) * lattice->size),
                            .y = (float)((node->key.y + 0.5) * lattice->size),
                            .chart = node->key.kind};
    for (int k = 0; k < 3; k++) {
        double p = node->position[k] / w, n = node->normal[k] / w;
        double px = node->by_x[k] / w - x * p, py = node->by_y[k] / w - y * p;
        double along_x = flat ? (yy * px - xy * py) / determinant : 0;
        double along_y = flat ? (xx * py - xy * px) / determinant : 0;
        source.position[k] = (float)(p - x * along_x - y * along_y);
        source.normal[k] = (float)n;
        source.flux[k] = (float)node->flux[k];
        length += n * n;
    }
    for (int k = 0; k < 3; k++) {
        source.normal[k] /= (float)(length > 0 ? sqrt(length) : 1);
    }
    return source;
}

static void place_nodes(const struct lattice *lattice, struct source_set *to)
{
    to->count = lattice->groups.count;
    for (size_t i = 0; i < to->count; i++) {
        to->list[i] = source_at(lattice, &lattice->nodes[i]);
    }
}

/* Mark nodes whose sources are too far from them or turned too differently. */
static bool must_part_nodes(struct lattice *lattice, const struct source_set *nodes)
{
    double most = 2 * widest * lattice->size * lattice->point_mm;
    bool any = false;
    for (size_t i = 0; i < nodes->count; i++) {
        double length = 0;
        for (int k = 0; k < 3; k++) {
            double n = lattice->nodes[i].normal[k] / lattice->nodes[i].weight;
            length += n * n;
        }
        lattice->nodes[i].parted = length < straightest * straightest;
    }
    for (size_t i = 0; i < lattice->from->count * CORNERS; i++) {
        const float *p = lattice->from->list[i / CORNERS].position;
        const float *q = nodes->list[lattice->links[i]].position;
        double x = (double)p[0] - q[0], y = (double)p[1] - q[1], z = (double)p[2] - q[2];
        struct node *node = &lattice->nodes[lattice->links[i]];
        node->parted = node->parted || x * x + y * y + z * z > most * most;
        any = any || node->parted;
    }
    return any;
}

/* Nodes of a lattice for some sources. */
static int lattice_make(struct lattice *lattice, struct source_set *to)
{
    size_t links = lattice->from->count * CORNERS;
    lattice->links = calloc(links + 1, sizeof *lattice->links);
    lattice->shares = calloc(links + 1, sizeof *lattice->shares);
    for (int pass = 0; pass < 2; pass++) {
        if (!lattice->links || !lattice->shares || link_nodes(lattice) != 0) {
            return -1;
        }
        fill_nodes(lattice);
        free(to->list);
        to->list = calloc(lattice->groups.count + 1, sizeof *to->list);
        if (!to->list) {
            return -1;
        }
        place_nodes(lattice, to);
        if (pass > 0 || !must_part_nodes(lattice, to)) {
            break;
        }
    }
    return 0;
}

static void lattice_finish(struct lattice *lattice)
{
    groups_end(&lattice->groups);
    free(lattice->links);
    free(lattice->shares);
    free(lattice->nodes);
}

static int sum_moments(struct sources *sources, const struct appearance *appearance, int index,
                       const struct lattice *lattice)
{
    size_t size = sources->moment_size;
    float *own = new_moments(1, size), *moments = new_moments(lattice->groups.count, size);
    sources->moments[index] = moments;
    for (size_t i = 0; own && moments && i < lattice->from->count; i++) {
        const float *moment = own;
        if (index > 0) {
            moment = sources->moments[index - 1] + i * size;
        } else {
            memset(own, 0, size * sizeof *own);
            add_texel(appearance, lattice->from->list[i].texel, lattice->from->list[i].flux, own);
        }
        for (size_t k = i * CORNERS; k < (i + 1) * CORNERS; k++) {
            add_moment(moment, size, lattice->shares[k], moments + lattice->links[k] * size);
        }
    }
    bool made = own && moments;
    free(own);
    return made ? 0 : -1;
}

static int sum_squares(struct sources *sources, const struct appearance *appearance, int index,
                       double point_mm)
{
    struct lattice lattice = {.from = index > 0 ? &sources->squares[index - 1] : &sources->points,
                              .size = (double)(2 << index),
                              .point_mm = point_mm};
    int status = lattice_make(&lattice, &sources->squares[index]);
    if (status == 0) {
        status = sum_moments(sources, appearance, index, &lattice);
    }
    lattice_finish(&lattice);
    return status;
}

/* Means over squares of the material; at the border of what there is of them. */
static int fill_pyramid(struct sources *sources, const struct appearance *appearance, int index)
{
    const float white[3] = {1, 1, 1};
    size_t side = (size_t)2 << index, size = sources->moment_size;
    size_t width = (size_t)appearance->width, height = (size_t)appearance->height;
    size_t columns = (width + side - 1) / side, rows = (height + side - 1) / side;
    size_t finer = (width + side / 2 - 1) / (side / 2);
    float *pyramid = sources->pyramid[index] = new_moments(columns * rows, size);
    if (!pyramid) {
        return -1;
    }
    for (size_t i = 0; i < columns * rows; i++) {
        size_t x = i % columns * side, y = i / columns * side;
        size_t right = x + side < width ? x + side : width;
        size_t bottom = y + side < height ? y + side : height;
        size_t step = index > 0 ? side / 2 : 1;
        for (size_t v = y; v < bottom; v += step) {
            for (size_t u = x; u < right; u += step) {
                if (index == 0) {
                    add_texel(appearance, v * width + u, white, pyramid + i * size);
                    continue;
                }
                size_t wide = u + step < width ? step : width - u;
                size_t high = v + step < height ? step : height - v;
                add_moment(sources->pyramid[index - 1] + (v / step * finer + u / step) * size, size,
                           (float)(wide * high), pyramid + i * size);
            }
        }
        for (size_t k = 0; k < size; k++) {
            pyramid[i * size + k] /= (float)((right - x) * (bottom - y));
        }
    }
    return 0;
}

int sources_extend(struct sources *sources, struct source_set *samples,
                   const struct appearance *appearance, const struct levels *levels,
                   double point_mm, struct nacre_error *error)
{
    size_t parts =
        appearance->layout == NACRE_KERNEL_PER_TERM ? 1 : (size_t)appearance->basis.parts;
    int status = 0;
    sources->moment_size = parts * (size_t)appearance->terms * 4;
    if (levels->merges && !sources->points.list) {
        status = merge_set(samples, 1, point_mm, &sources->points, &sources->variance);
    }
    for (int i = sources->count; status == 0 && i < levels->count; i++) {
        status = sum_squares(sources, appearance, i, point_mm);
        if (status == 0) {
            status = fill_pyramid(sources, appearance, i);
        }
        sources->count += status == 0;
    }
    return status == 0 ? NACRE_OK : nacre_fail_memory(error, "summing up the light samples");
}

void sources_finish(struct sources *sources)
{
    source_set_finish(&sources->points);
    for (int i = 0; i < LEVELS_MAXIMUM; i++) {
        free(sources->squares[i].list);
        free(sources->moments[i]);
        free(sources->pyramid[i]);
    }
    *sources = (struct sources){0};
}
