/* Boxes round runs of sources, and round runs of runs, against those round bundles. */
#include "render/reach.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = REACH_LANES, WIDE = 8, DEPTH = 12 };

int reach_bundle(struct reach_bundles *bundles, const struct receiver *receivers, size_t count,
                 struct nacre_error *error)
{
    size_t stride = sizeof *receivers / sizeof(float), padded = (count + LANES - 1) / LANES * LANES;
    *bundles = (struct reach_bundles){.count = padded / LANES,
                                      .order = calloc(padded + 1, sizeof *bundles->order),
                                      .boxes = calloc(padded / LANES + 1, sizeof *bundles->boxes)};
    for (size_t i = 0; bundles->order && i < count; i++) {
        bundles->order[i] = (uint32_t)i;
    }
    if (!bundles->order || !bundles->boxes ||
        (count > 0 && bundles_order(receivers[0].position, stride, bundles->order, count) != 0)) {
        reach_bundles_finish(bundles);
        return nacre_fail_memory(error, "the mesh's receivers");
    }
    for (size_t i = count; i < padded; i++) {
        bundles->order[i] = bundles->order[count - 1];
    }
    for (size_t i = 0; i < bundles->count; i++) {
        bundles->boxes[i] =
            bundles_box(receivers[0].position, stride, bundles->order + i * LANES, LANES);
    }
    return NACRE_OK;
}

/* Whether the bundle that began at `first` must end before `next`. */
static bool is_apart(const struct receiver *first, const struct receiver *next, double apart)
{
    double square = 0;
    for (int k = 0; k < 3; k++) {
        double away = (double)first->position[k] - next->position[k];
        square += away * away;
    }
    return square > apart * apart;
}

int reach_bundle_some(struct reach_bundles *bundles, const struct receiver *receivers,
                      const struct reach_bundles *all, const bool *wanted, double apart,
                      struct nacre_error *error)
{
    size_t stride = sizeof *receivers / sizeof(float), count = 0, most = 0;
    for (size_t i = 0; i < all->count * LANES; i++) {
        most += wanted[all->order[i]];
    }
    *bundles = (struct reach_bundles){.order = calloc(most * LANES + 1, sizeof *bundles->order),
                                      .boxes = calloc(most + 1, sizeof *bundles->boxes)};
    if (!bundles->order || !bundles->boxes) {
        reach_bundles_finish(bundles);
        return nacre_fail_memory(error, "the mesh's receivers");
    }
    for (size_t i = 0; i < all->count * LANES; i++) {
        uint32_t index = all->order[i];
        if (!wanted[index] || (i > 0 && index == all->order[i - 1])) {
            continue;
        }
        const uint32_t *first = bundles->order + count / LANES * LANES;
        while (count % LANES > 0 && is_apart(&receivers[*first], &receivers[index], apart)) {
            bundles->order[count] = bundles->order[count - 1];
            count++;
        }
        bundles->order[count++] = index;
    }
    while (count % LANES > 0) {
        bundles->order[count] = bundles->order[count - 1];
        count++;
    }
    bundles->count = count / LANES;
    for (size_t i = 0; i < bundles->count; i++) {
        bundles->boxes[i] =
            bundles_box(receivers[0].position, stride, bundles->order + i * LANES, LANES);
    }
    return NACRE_OK;
}

void reach_bundles_finish(struct reach_bundles *bundles)
{
    free(bundles->order);
    free(bundles->boxes);
    *bundles = (struct reach_bundles){0};
}

/* A tree over the runs: each level's boxes are round WIDE of the one before. */
struct boxes {
    int depth;
    size_t counts[DEPTH];
    struct bundle_box *lists[DEPTH];
};

static struct bundle_box join(const struct bundle_box *boxes, size_t count)
{
    struct bundle_box box = boxes[0];
    for (size_t i = 1; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            box.low[k] = fminf(box.low[k], boxes[i].low[k]);
            box.high[k] = fmaxf(box.high[k], boxes[i].high[k]);
        }
    }
    return box;
}

static size_t smaller(size_t a, size_t b)
{
    return a < b ? a : b;
}

static int boxes_make(struct boxes *boxes, const struct source_set *sources)
{
    size_t stride = sizeof *sources->list / sizeof(float);
    *boxes = (struct boxes){.counts = {(sources->count + LANES - 1) / LANES}};
    for (size_t count = boxes->counts[0]; boxes->depth < DEPTH; count = (count + WIDE - 1) / WIDE) {
        struct bundle_box *list = calloc(count + 1, sizeof *list);
        const struct bundle_box *finer = boxes->depth > 0 ? boxes->lists[boxes->depth - 1] : NULL;
        size_t below = finer ? boxes->counts[boxes->depth - 1] : sources->count;
        if (!list) {
            return -1;
        }
        for (size_t i = 0; i < count; i++) {
            list[i] = finer ? join(finer + i * WIDE, smaller(below - i * WIDE, WIDE))
                            : bundles_box(sources->list[i * LANES].position, stride, NULL,
                                          smaller(below - i * LANES, LANES));
        }
        boxes->lists[boxes->depth] = list;
        boxes->counts[boxes->depth++] = count;
        if (count <= WIDE) {
            break;
        }
    }
    return 0;
}

static void boxes_finish(struct boxes *boxes)
{
    for (int i = 0; i < DEPTH; i++) {
        free(boxes->lists[i]);
    }
}

/* Runs found for bundles that follow each other. */
struct found {
    uint32_t *runs;
    size_t count, capacity; /* 0: memory ran out */
};

struct search {
    const struct boxes *boxes;
    const struct bundle_box *bundle;
    float inner_square, outer_square;
    struct found *found;
};

/* Does nothing once memory has run out. */
static void add_run(struct found *found, uint32_t run)
{
    if (found->count == found->capacity && found->capacity > 0) {
        uint32_t *larger = realloc(found->runs, 2 * found->capacity * sizeof *larger);
        found->runs = larger ? larger : found->runs;
        found->capacity *= larger ? 2 : 0;
    }
    if (found->capacity > 0) {
        found->runs[found->count++] = run;
    }
}

static void look(struct search *search, int depth, size_t begin, size_t end)
{
    const struct bundle_box *list = search->boxes->lists[depth], *b = search->bundle;
    for (size_t i = begin; i < end; i++) {
        float gap = 0, span = 0;
        for (int k = 0; k < 3; k++) {
            float below = b->low[k] - list[i].high[k], above = list[i].low[k] - b->high[k];
            float away = below > above ? below : above, most = below < above ? below : above;
            gap += away > 0 ? away * away : 0;
            span += most * most;
        }
        if (gap >= search->outer_square || span < search->inner_square) {
            continue;
        }
        if (depth > 0) {
            look(search, depth - 1, i * WIDE,
                 smaller((i + 1) * WIDE, search->boxes->counts[depth - 1]));
            continue;
        }
        add_run(search->found, (uint32_t)i);
    }
}

enum { CHUNK = 64 /* bundles */ };

/* Find the runs of a chunk's bundles; their numbers go to reach->starts. */
static void find(const struct boxes *boxes, const struct reach_bundles *bundles, size_t chunk,
                 double inner, double outer, struct found *found, struct reach *reach)
{
    size_t begin = chunk * CHUNK, end = smaller(begin + CHUNK, bundles->count);
    struct search search = {.boxes = boxes,
                            .inner_square = (float)(inner * inner),
                            .outer_square = (float)(outer * outer),
                            .found = found};
    *found = (struct found){.capacity = 4096, .runs = malloc(4096 * sizeof *found->runs)};
    found->capacity *= found->runs != NULL;
    for (size_t i = begin; i < end && found->capacity > 0; i++) {
        size_t before = found->count;
        search.bundle = &bundles->boxes[i];
        look(&search, boxes->depth - 1, 0, boxes->counts[boxes->depth - 1]);
        reach->starts[i + 1] = (uint32_t)(found->count - before);
    }
}

/* The chunks' runs behind each other. */
static int join_runs(const struct found *chunks, size_t count, size_t bundles, struct reach *reach)
{
    size_t total = 0, at = 0;
    for (size_t i = 0; i < count; i++) {
        total += chunks[i].count;
        if (chunks[i].capacity == 0) {
            return -1;
        }
    }
    reach->runs = total < UINT32_MAX ? malloc((total + 1) * sizeof *reach->runs) : NULL;
    if (!reach->runs) {
        return -1;
    }
    for (size_t i = 0; i < count; i++) {
        memcpy(reach->runs + at, chunks[i].runs, chunks[i].count * sizeof *reach->runs);
        at += chunks[i].count;
    }
    for (size_t i = 0; i < bundles; i++) {
        reach->starts[i + 1] += reach->starts[i];
    }
    return 0;
}

int reach_make(struct reach *reach, const struct reach_bundles *bundles,
               const struct source_set *sources, double inner, double outer,
               struct nacre_error *error)
{
    struct boxes boxes = {0};
    size_t count = (bundles->count + CHUNK - 1) / CHUNK;
    struct found *chunks = calloc(count + 1, sizeof *chunks);
    int status = -1;
    *reach = (struct reach){.starts = calloc(bundles->count + 1, sizeof *reach->starts)};
    if (!chunks || !reach->starts || boxes_make(&boxes, sources) != 0) {
        goto out;
    }
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t i = 0; i < count; i++) {
        find(&boxes, bundles, i, inner, outer, &chunks[i], reach);
    }
    status = join_runs(chunks, count, bundles->count, reach);
out:
    for (size_t i = 0; chunks && i < count; i++) {
        free(chunks[i].runs);
    }
    free(chunks);
    boxes_finish(&boxes);
    if (status != 0) {
        reach_finish(reach);
        return nacre_fail_memory(error, "finding the light near the mesh");
    }
    return NACRE_OK;
}

void reach_finish(struct reach *reach)
{
    free(reach->starts);
    free(reach->runs);
    *reach = (struct reach){0};
}
