/* Reading and merging the patterns of one kind in parallel, and taking the results in order. */
#include "rig/develop/visit.h"

#include <stdbool.h>
#include <stdlib.h>

/* One thread's memory. */
struct bench {
    float *radiance, *variance, *result;
};

static bool bench_init(struct bench *bench, size_t pixels, size_t result_size)
{
    *bench = (struct bench){malloc(pixels * sizeof *bench->radiance),
                            malloc(pixels * sizeof *bench->variance),
                            malloc((result_size ? result_size : 1) * sizeof *bench->result)};
    return bench->radiance && bench->variance && bench->result;
}

static void bench_finish(struct bench *bench)
{
    free(bench->radiance);
    free(bench->variance);
    free(bench->result);
}

/* Read, merge and work: the part that runs in parallel. Frees nothing of `frames`. */
static int prepare(const struct session *session, struct pattern pattern,
                   const struct noise_model *noise, const struct visitor *visitor,
                   struct bench *bench, struct pattern_frames *frames, struct merged *merged,
                   struct nacre_error *error)
{
    *merged = (struct merged){.pattern = pattern};
    if (visitor->knows && visitor->knows(visitor->state, pattern)) {
        return NACRE_OK;
    }
    int status = session_read(session, pattern, frames, error);
    if (status != NACRE_OK) {
        return status;
    }
    *merged = (struct merged){pattern, frames, bench->radiance, bench->variance, 0};
    merged->saturated = hdr_merge(frames, noise, bench->radiance, bench->variance);
    return visitor->work ? visitor->work(visitor->state, merged, bench->result, error) : NACRE_OK;
}

static int list_measured(const struct session *session, enum pattern_kind kind, int limit,
                         int *numbers, int *missing)
{
    int count = 0;
    int total = plan_pattern_count(&session->plan, kind);
    int shown = plan_shown_count(&session->plan, kind);
    for (int n = 0; n < total && (limit == 0 || count < limit); n++) {
        if (session_has(session, (struct pattern){kind, n})) {
            numbers[count++] = n;
        }
    }
    *missing = shown > count ? shown - count : 0;
    return count;
}

int visit_patterns(const struct session *session, enum pattern_kind kind, int limit,
                   const struct noise_model *noise, const struct visitor *visitor,
                   struct visit_progress *progress, int *visited, int *missing,
                   struct nacre_error *error)
{
    size_t pixels = (size_t)session->station.camera.width * (size_t)session->station.camera.height;
    int total = plan_pattern_count(&session->plan, kind);
    int status = NACRE_OK; /* of the first pattern that failed; read and written in order only */
    bool stop = false;     /* the same for threads out of order: may come late */
    int *numbers = malloc(((size_t)total + 1) * sizeof *numbers);
    *visited = 0;
    *missing = 0;
    if (!numbers) {
        return nacre_fail_memory(error, "the list of patterns");
    }
    int count = list_measured(session, kind, limit, numbers, missing);
#pragma omp parallel
    {
        struct bench bench;
        bool ready = bench_init(&bench, pixels, visitor->result_size);
#pragma omp for ordered schedule(dynamic, 1)
        for (int i = 0; i < count; i++) {
            struct pattern pattern = {kind, numbers[i]};
            struct pattern_frames frames = {0};
            struct merged merged = {0};
            struct nacre_error own = {""};
            int own_status = NACRE_OK;
            bool skip;
#pragma omp atomic read
            skip = stop;
            if (!skip) {
                own_status = ready ? prepare(session, pattern, noise, visitor, &bench, &frames,
                                             &merged, &own)
                                   : nacre_fail_memory(&own, "a merged pattern");
            }
#pragma omp ordered
            {
                if (status == NACRE_OK && own_status == NACRE_OK) {
                    own_status = visitor->take(visitor->state, &merged, bench.result, &own);
                }
                if (status == NACRE_OK && own_status == NACRE_OK) {
                    (*visited)++;
                    progress->done++;
                    own_status = progress_step(progress->progress, progress->done, progress->total,
                                               pattern_kind_names[kind], &own);
                }
                if (status == NACRE_OK && own_status != NACRE_OK) {
                    status = own_status;
                    if (error) {
                        *error = own;
                    }
#pragma omp atomic write
                    stop = true;
                }
            }
            pattern_frames_finish(&frames);
        }
        bench_finish(&bench);
    }
    free(numbers);
    return status;
}
