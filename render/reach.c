/* Boxes round runs of sources, and round runs of runs, against those round bundles. */
#include "render/reach.h"

#include <math.h>
#include <stdlib.h>

enum { LANES = REACH_LANES, WIDE = 16 };

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

void reach_bundles_finish(struct reach_bundles *bundles)
{
    free(bundles->order);
    free(bundles->boxes);
    *bundles = (struct reach_bundles){0};
}

/* Boxes of runs and of wide runs of WIDE runs each. */
struct boxes {
    size_t run_count, wide_count;
    struct bundle_box *runs, *wide;
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

static struct bundle_box box_of(const struct source *sources, size_t count)
{
    struct bundle_box box = {{HUGE_VALF, HUGE_VALF, HUGE_VALF},
                             {-HUGE_VALF, -HUGE_VALF, -HUGE_VALF}};
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            box.low[k] = fminf(box.low[k], sources[i].position[k]);
            box.high[k] = fmaxf(box.high[k], sources[i].position[k]);
        }
    }
    return box;
}

static int boxes_make(struct boxes *boxes, const struct source_set *sources)
{
    boxes->run_count = (sources->count + LANES - 1) / LANES;
    boxes->wide_count = (boxes->run_count + WIDE - 1) / WIDE;
    boxes->runs = calloc(boxes->run_count + 1, sizeof *boxes->runs);
    boxes->wide = calloc(boxes->wide_count + 1, sizeof *boxes->wide);
    if (!boxes->runs || !boxes->wide) {
        return -1;
    }
    for (size_t i = 0; i < boxes->run_count; i++) {
        size_t left = sources->count - i * LANES;
        boxes->runs[i] = box_of(sources->list + i * LANES, left < LANES ? left : LANES);
    }
    for (size_t i = 0; i < boxes->wide_count; i++) {
        size_t left = boxes->run_count - i * WIDE;
        boxes->wide[i] = join(boxes->runs + i * WIDE, left < WIDE ? left : WIDE);
    }
    return 0;
}

/* The runs of one bundle, counted, and written where `runs` is given. */
static size_t find(const struct boxes *boxes, const struct bundle_box *bundle, double inner,
                   double outer, uint32_t *runs)
{
    size_t count = 0;
    for (size_t i = 0; i < boxes->wide_count; i++) {
        if (bundles_gap(&boxes->wide[i], bundle) >= outer) {
            continue;
        }
        size_t end = (i + 1) * WIDE < boxes->run_count ? (i + 1) * WIDE : boxes->run_count;
        for (size_t j = i * WIDE; j < end; j++) {
            if (bundles_gap(&boxes->runs[j], bundle) < outer &&
                bundles_span(&boxes->runs[j], bundle) > inner) {
                if (runs) {
                    runs[count] = (uint32_t)j;
                }
                count++;
            }
        }
    }
    return count;
}

int reach_make(struct reach *reach, const struct reach_bundles *bundles,
               const struct source_set *sources, double inner, double outer,
               struct nacre_error *error)
{
    struct boxes boxes = {0};
    size_t count = bundles->count, total = 0;
    *reach = (struct reach){.starts = calloc(count + 1, sizeof *reach->starts)};
    if (!reach->starts || boxes_make(&boxes, sources) != 0) {
        goto out;
    }
#pragma omp parallel for schedule(static, 64)
    for (size_t i = 0; i < count; i++) {
        reach->starts[i + 1] = (uint32_t)find(&boxes, &bundles->boxes[i], inner, outer, NULL);
    }
    for (size_t i = 0; i < count; i++) {
        total += reach->starts[i + 1];
        reach->starts[i + 1] = (uint32_t)total;
    }
    reach->runs = total < UINT32_MAX ? calloc(total + 1, sizeof *reach->runs) : NULL;
    if (!reach->runs) {
        goto out;
    }
#pragma omp parallel for schedule(static, 64)
    for (size_t i = 0; i < count; i++) {
        (void)find(&boxes, &bundles->boxes[i], inner, outer, reach->runs + reach->starts[i]);
    }
out:
    free(boxes.runs);
    free(boxes.wide);
    if (!reach->runs) {
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
