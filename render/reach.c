/* Walking the tree of light samples for each bundle. */
#include "render/reach.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Of an offset, the part that may stand on the surface where its direction is to be told. */
static const double steep_most = 0.95;

/* How many half windows a square may be away in the texture. Beyond one the gather reads F by the offset: a surface point
 * that on an uncut texture is the sample's own, or near it. What that may change is in the bound. */
static const double border = 1.33;

struct numbers {
    uint32_t *list;
    size_t count, capacity;
    bool failed;
};

/* One bundle's walk. */
struct walk {
    const struct cells *cells;
    const struct basis *basis;
    const struct reach_bundle *bundle;
    const struct receivers *receivers;
    const uint32_t *order;
    double point_mm, half, allowed, bound;
    bool same_side;
    struct numbers points, squares;
};

static void append(struct numbers *numbers, uint32_t number)
{
    if (numbers->count == numbers->capacity) {
        size_t capacity = 2 * numbers->capacity + 256;
        uint32_t *list = realloc(numbers->list, capacity * sizeof *list);
        if (!list) {
            numbers->failed = true;
            return;
        }
        numbers->list = list;
        numbers->capacity = capacity;
    }
    numbers->list[numbers->count++] = number;
}

static double distance(const float a[3], const float b[3])
{
    double x = (double)a[0] - b[0], y = (double)a[1] - b[1], z = (double)a[2] - b[2];
    return sqrt(x * x + y * y + z * z);
}

static double gap_to(const struct bundle_box *box, const float p[3])
{
    double square = 0;
    for (int k = 0; k < 3; k++) {
        double away = fmax(fmax((double)box->low[k] - p[k], (double)p[k] - box->high[k]), 0);
        square += away * away;
    }
    return sqrt(square);
}

/* Largest part of the offset's length, at any receiver of the bundle and any sample of the node, that stands on the
 * surface; `near` is the least distance. */
static double steepness(const struct reach_bundle *bundle, const struct cell_node *node,
                        double near)
{
    double along = 0, length = 0;
    for (int k = 0; k < 3; k++) {
        double o = (double)node->position[k] - bundle->centre[k];
        along += o * bundle->normal[k];
        length += o * o;
    }
    double turned = distance(bundle->normal, node->normal);
    return (fabs(along) + bundle->flat_mm + node->flat_mm + turned * node->radius_mm +
            sqrt(length) * bundle->apart) /
           near;
}

/* Whether the bundle and the node lie within `reach` surface points of each other in the texture. */
static bool within_texture(const struct reach_bundle *b, const struct cell_node *node, double reach)
{
    return node->chart == b->chart && (double)b->high_x - node->x + node->half_x < reach &&
           (double)node->x - b->low_x + node->half_x < reach &&
           (double)b->high_y - node->y + node->half_y < reach &&
           (double)node->y - b->low_y + node->half_y < reach;
}

/* Bound of the error of taking a node as a whole. With m_i >= 0 the samples' flux F H, at offsets o_i, and o that of
 * their mean place, the error is sum m_i (g(o_i) - g(o)), for each basis kernel
 *   <= |g'| |sum m_i (o_i - o)| + max |g''| / 2 sum m_i |o_i - o|^2.
 * The offset's length is the distance in space. Its direction is the surface's: either places change offsets at a rate of
 * `stretch` at most, and so by their second power; or, where they stand steeply, g may change by its whole swing. */
static double bound_of(const struct walk *walk, const struct cell_node *node, double near)
{
    const struct basis *basis = walk->basis;
    const struct reach_bundle *bundle = walk->bundle;
    size_t parts = (size_t)basis->parts, last = (size_t)basis->steps - 1;
    const float *bounds =
        walk->cells->bounds + (size_t)(node - walk->cells->nodes) * (3 * parts + 1);
    double here = near / walk->point_mm, nearest = (near - node->radius_mm) / walk->point_mm;
    size_t at = (size_t)(fmax(here, 0) * BASIS_STEPS_A_POINT);
    size_t from = (size_t)(fmax(nearest, 0) * BASIS_STEPS_A_POINT);
    at = at < last ? at : last;
    from = from < last ? from : last;
    const float *slope = basis->slope + from * parts, *bend = basis->bend + from * parts;
    const float *swing = basis->swing + from * parts;
    double mean = 0, squares = 0, turned = 0, swung = 0, all = 0;
    for (size_t p = 0; p < parts; p++) {
        mean += (double)bounds[p] * slope[p];
        squares += (double)bounds[parts + p] * bend[p] / 2;
        turned += (double)bounds[parts + p] * slope[p];
        swung += (double)bounds[2 * parts + p] * swing[p];
        all += (double)bounds[2 * parts + p] * basis->size[from * parts + p];
    }
    double any = mean + squares + turned / here / 2 + swung, even = HUGE_VAL;
    double steep = steepness(bundle, node, near);
    if (steep < steep_most && bundle->scale > 0) {
        double stretch = 1 / (bundle->scale * sqrt(1 - steep * steep));
        double turn =
            1.5 * stretch * stretch * (bundle->scale > 0.99F ? fmin(1, 2 * steep + 0.02) : 1);
        even = stretch * mean + stretch * stretch * squares + turn * turned / here;
    }
    double bound = fmin(any, even) + (double)bounds[3 * parts] * basis->left[at];
    return node->level <= 0 || within_texture(bundle, node, walk->half) ? bound : bound + 2 * all;
}

/* Of all pairs of a receiver and a sample, whether they look the same way: 1 all do, -1 none does, 0 else. */
static int facing(const struct reach_bundle *bundle, const struct cell_node *node)
{
    double cosine = 0,
           slack = (double)bundle->apart + node->apart + (double)bundle->apart * node->apart;
    for (int k = 0; k < 3; k++) {
        cosine += (double)bundle->normal[k] * node->normal[k];
    }
    return cosine > slack ? 1 : cosine < -slack ? -1 : 0;
}

static bool is_whole(struct walk *walk, const struct cell_node *node, double near)
{
    bool single = node->sample_end - node->sample_begin == 1 && node->level <= 0;
    if (single) {
        return true;
    }
    if (walk->allowed <= 0 || near <= node->radius_mm ||
        (node->level > 0 && !within_texture(walk->bundle, node, border * walk->half)) ||
        (walk->same_side && facing(walk->bundle, node) <= 0)) {
        return false;
    }
    double bound = bound_of(walk, node, near);
    if (!(bound <= walk->allowed)) {
        return false;
    }
    walk->bound += bound;
    return true;
}

static double dot(const float a[3], const double b[3])
{
    return (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2];
}

/* Whether no receiver of the bundle has any sample of the node in its window. */
static bool is_outside(const struct walk *walk, const struct cell_node *node, double near)
{
    const struct reach_bundle *bundle = walk->bundle;
    double offset[3], length = 0, reach = walk->half * walk->point_mm;
    double slack = (double)node->radius_mm + bundle->radius_mm;
    if (near - node->radius_mm >= 1.4143 * reach) {
        return true;
    }
    for (int k = 0; k < 3; k++) {
        offset[k] = (double)bundle->centre[k] - node->position[k];
        length += offset[k] * offset[k];
    }
    length = sqrt(length);
    if (length + slack < reach || near <= node->radius_mm) {
        return false;
    }
    /* One by one: where the node's place lies in a receiver's window, give or take the node's size. */
    for (uint32_t i = bundle->begin; i < bundle->end; i++) {
        const struct receiver *to = &walk->receivers->list[walk->order[i]];
        double square = 0;
        for (int k = 0; k < 3; k++) {
            offset[k] = (double)to->position[k] - node->position[k];
            square += offset[k] * offset[k];
        }
        double a = dot(to->along_x, offset), b = dot(to->along_y, offset), across = a * a + b * b;
        if (across < 0.1 * square) {
            return false;
        }
        double scale = sqrt(square / across);
        slack = reach + 1.3 * scale * node->radius_mm;
        if (fabs(a) * scale < slack && fabs(b) * scale < slack) {
            return false;
        }
    }
    return true;
}

static void visit(struct walk *walk, size_t index)
{
    const struct cell_node *node = &walk->cells->nodes[index];
    double near = gap_to(&walk->bundle->box, node->position);
    if (is_outside(walk, node, near) || (walk->same_side && facing(walk->bundle, node) < 0)) {
        return;
    }
    if (is_whole(walk, node, near)) {
        append(node->level > 0 ? &walk->squares : &walk->points, node->source);
    } else if (node->child_begin < node->child_end) {
        for (size_t i = node->child_begin; i < node->child_end; i++) {
            visit(walk, i);
        }
    } else {
        for (uint32_t i = node->sample_begin; i < node->sample_end; i++) {
            append(&walk->points, i);
        }
    }
}

/* Length of the shorter direction of an orthogonal frame, 0 of another. */
static float frame_scale(const struct receiver *r)
{
    float xx = 0, yy = 0, xy = 0;
    for (int k = 0; k < 3; k++) {
        xx += r->along_x[k] * r->along_x[k];
        yy += r->along_y[k] * r->along_y[k];
        xy += r->along_x[k] * r->along_y[k];
    }
    float least =
        (xx + yy) / 2 - sqrtf((xx - yy) * (xx - yy) / 4 + xy * xy); /* of the two squares */
    return least > 0 ? sqrtf(least) : 0;
}

static void measure(struct reach_bundle *bundle, const struct receivers *receivers,
                    const uint32_t *order)
{
    double normal[3] = {0}, length = 0;
    size_t stride = sizeof *receivers->list / sizeof(float), count = bundle->end - bundle->begin;
    bundle->box = bundles_box(receivers->list[0].position, stride, order + bundle->begin, count);
    bundle->low_x = bundle->low_y = HUGE_VALF;
    bundle->high_x = bundle->high_y = -HUGE_VALF;
    bundle->scale = 1;
    for (size_t i = bundle->begin; i < bundle->end; i++) {
        const struct receiver *r = &receivers->list[order[i]];
        bundle->low_x = fminf(bundle->low_x, r->along_x[3]);
        bundle->high_x = fmaxf(bundle->high_x, r->along_x[3]);
        bundle->low_y = fminf(bundle->low_y, r->along_y[3]);
        bundle->high_y = fmaxf(bundle->high_y, r->along_y[3]);
        bundle->scale = fminf(bundle->scale, frame_scale(r));
        bundle->chart = r->chart;
        for (int k = 0; k < 3; k++) {
            normal[k] += r->normal[k];
        }
    }
    for (int k = 0; k < 3; k++) {
        bundle->centre[k] = (bundle->box.low[k] + bundle->box.high[k]) / 2;
        length += normal[k] * normal[k];
    }
    for (int k = 0; k < 3; k++) {
        bundle->normal[k] = (float)(length > 0 ? normal[k] / sqrt(length) : 0);
    }
    for (size_t i = bundle->begin; i < bundle->end; i++) {
        const struct receiver *r = &receivers->list[order[i]];
        float off = 0;
        for (int k = 0; k < 3; k++) {
            off += (r->position[k] - bundle->centre[k]) * bundle->normal[k];
        }
        bundle->flat_mm = fmaxf(bundle->flat_mm, fabsf(off));
        bundle->radius_mm = fmaxf(bundle->radius_mm, (float)distance(r->position, bundle->centre));
        bundle->apart = fmaxf(bundle->apart, (float)distance(r->normal, bundle->normal));
    }
}

/* Receivers by chart, and in space within each. */
static int make_bundles(struct reach *reach, const struct receivers *receivers)
{
    size_t count = receivers->count, stride = sizeof *receivers->list / sizeof(float), placed = 0;
    reach->order = calloc(count + 1, sizeof *reach->order);
    reach->bundles = calloc(count + 1, sizeof *reach->bundles);
    if (!reach->order || !reach->bundles) {
        return NACRE_FAILED;
    }
    for (int64_t chart = INT64_MIN; placed < count;) {
        size_t begin = placed;
        int64_t next = INT64_MAX;
        for (size_t i = 0; i < count; i++) {
            int64_t own = receivers->list[i].chart;
            next = own > chart && own < next ? own : next;
        }
        chart = next;
        for (size_t i = 0; i < count; i++) {
            if (receivers->list[i].chart == chart) {
                reach->order[placed++] = (uint32_t)i;
            }
        }
        bundles_sort(receivers->list[0].position, stride, reach->order + begin, placed - begin,
                     REACH_LANES);
        for (; begin < placed; begin += REACH_LANES) {
            struct reach_bundle *bundle = &reach->bundles[reach->bundle_count++];
            bundle->begin = (uint32_t)begin;
            bundle->end = (uint32_t)(placed - begin < REACH_LANES ? placed : begin + REACH_LANES);
            measure(bundle, receivers, reach->order);
        }
    }
    return NACRE_OK;
}

/* Join the bundles' lists. */
static uint32_t *join(const struct numbers *numbers, size_t count, uint32_t *starts)
{
    size_t total = 0;
    for (size_t i = 0; i < count; i++) {
        total += numbers[i].count;
    }
    uint32_t *list = total < UINT32_MAX ? calloc(total + 1, sizeof *list) : NULL;
    for (size_t i = 0; list && i < count; i++) {
        if (numbers[i].count > 0) {
            memcpy(list + starts[i], numbers[i].list, numbers[i].count * sizeof *list);
        }
        starts[i + 1] = starts[i] + (uint32_t)numbers[i].count;
    }
    return list;
}

static bool walk_all(struct reach *reach, const struct walk *common, struct numbers *points,
                     struct numbers *squares)
{
    bool failed = false;
#pragma omp parallel for schedule(dynamic, 16) reduction(|| : failed)
    for (size_t i = 0; i < reach->bundle_count; i++) {
        struct walk walk = *common;
        walk.bundle = &reach->bundles[i];
        walk.order = reach->order;
        for (size_t root = 0; root < walk.cells->root_count; root++) {
            visit(&walk, root);
        }
        points[i] = walk.points;
        squares[i] = walk.squares;
        reach->bounds[i] = walk.bound;
        failed = failed || walk.points.failed || walk.squares.failed;
    }
    return !failed;
}

int reach_make(struct reach *reach, const struct receivers *receivers, const struct cells *cells,
               const struct appearance *appearance, double point_mm, bool same_side, double allowed,
               struct nacre_error *error)
{
    int status = NACRE_FAILED;
    double half = appearance->window / 2 + 1; /* NOLINT: K is odd */
    struct walk walk = {.cells = cells,
                        .receivers = receivers,
                        .basis = &appearance->basis,
                        .point_mm = point_mm,

                        .half = half,
                        .allowed = allowed,
                        .same_side = same_side};
    struct numbers *points = NULL, *squares = NULL;
    *reach = (struct reach){0};
    if (make_bundles(reach, receivers) == NACRE_OK) {
        points = calloc(reach->bundle_count + 1, sizeof *points);
        squares = calloc(reach->bundle_count + 1, sizeof *squares);
        reach->bounds = calloc(reach->bundle_count + 1, sizeof *reach->bounds);
        reach->point_starts = calloc(reach->bundle_count + 1, sizeof *reach->point_starts);
        reach->square_starts = calloc(reach->bundle_count + 1, sizeof *reach->square_starts);
    }
    if (points && squares && reach->bounds && reach->point_starts && reach->square_starts &&
        walk_all(reach, &walk, points, squares)) {
        reach->points = join(points, reach->bundle_count, reach->point_starts);
        reach->squares = join(squares, reach->bundle_count, reach->square_starts);
        status = reach->points && reach->squares ? NACRE_OK : NACRE_FAILED;
    }
    for (size_t i = 0; points && squares && i < reach->bundle_count; i++) {
        free(points[i].list);
        free(squares[i].list);
    }
    free(points);
    free(squares);
    if (status != NACRE_OK) {
        reach_finish(reach);
        return nacre_fail_memory(error, "the lists of light samples in reach");
    }
    return NACRE_OK;
}

void reach_finish(struct reach *reach)
{
    free(reach->bundles);
    free(reach->order);
    free(reach->point_starts);
    free(reach->points);
    free(reach->square_starts);
    free(reach->squares);
    free(reach->bounds);
    *reach = (struct reach){0};
}
