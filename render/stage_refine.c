/* Two halves of light samples on a stage, summed up step by step. */
#include "render/stage_refine.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct halves {
    struct stage *stage;
    const struct render_settings *settings; /* as asked for */
    const struct opencl *opencl;
    struct render_report *report;
    stage_closing *closing;
    void *closing_context;
    size_t *first;           /* of each object's vertices in the sums */
    float (*sums[2])[3];     /* of each half: light times density */
    float (*first_light)[3]; /* of the step under way: the first half's light times density */
    /* Of plain objects, whose soft lights' part goes with their light: all steps, and both halves of the step under way,
     * times density. */
    float (*soft)[3], (*step_soft)[3];
    struct render_object_report *before; /* what the objects' reports said before it */
    double weight;                       /* sum of densities */
};

static bool is_lit(const struct stage_object *object)
{
    return object->light != NULL;
}

static struct refine_outcome count_samples(const struct render_report *report)
{
    struct refine_outcome sum = {0};
    for (size_t i = 0; i < report->object_count; i++) {
        sum.samples += report->objects[i].counts.samples;
        sum.lit += report->objects[i].counts.lit;
    }
    return sum;
}

/* Whether a plain object's light would come out the same again. */
static bool keeps_plain(const struct stage *stage)
{
    return !render_has(&stage->effects, RENDER_BOUNCES);
}

static void clear_light(struct stage *stage)
{
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        struct stage_object *object = &stage->objects[i];
        if (is_lit(object) && (object->translucent || !stage->plain_lit)) {
            memset(object->light, 0, object->mesh.vertex_count * sizeof *object->light);
        }
    }
}

/* Add what the stage's objects have to a list of all their vertices. */
static void add_light(const struct halves *halves, double density, float (*list)[3])
{
    for (size_t i = 0; i < halves->stage->scene->object_count; i++) {
        const struct stage_object *object = &halves->stage->objects[i];
        float(*sum)[3] = list + halves->first[i];
        for (size_t v = 0; is_lit(object) && v < object->mesh.vertex_count; v++) {
            for (int c = 0; c < 3; c++) {
                sum[v][c] += (float)(density * object->light[v][c]);
            }
        }
    }
}

/* The same for the soft lights' part. */
static void add_soft(const struct halves *halves, double density)
{
    for (size_t i = 0; i < halves->stage->scene->object_count; i++) {
        const struct stage_object *object = &halves->stage->objects[i];
        float(*sum)[3] = halves->step_soft + halves->first[i];
        for (size_t v = 0; object->soft && v < object->mesh.vertex_count; v++) {
            for (int c = 0; c < 3; c++) {
                sum[v][c] += (float)(density * object->soft[v][c]);
            }
        }
    }
}

static void add_list(float (*more)[3], size_t count, float (*sum)[3])
{
    for (size_t i = 0; i < count; i++) {
        for (int c = 0; c < 3; c++) {
            sum[i][c] += more[i][c];
        }
    }
}

/* The mean of both halves, for the picture. */
static void set_light(const struct halves *halves)
{
    for (size_t i = 0; i < halves->stage->scene->object_count; i++) {
        struct stage_object *object = &halves->stage->objects[i];
        for (size_t v = 0; is_lit(object) && v < object->mesh.vertex_count; v++) {
            size_t at = halves->first[i] + v;
            for (int c = 0; c < 3; c++) {
                double sum = (double)halves->sums[0][at][c] + halves->sums[1][at][c];
                object->light[v][c] = (float)(sum / (2 * halves->weight));
                if (object->soft) {
                    object->soft[v][c] = (float)(halves->soft[at][c] / (2 * halves->weight));
                }
            }
        }
    }
}

/* Both halves of a step count, or neither. */
static int bake_half(struct halves *halves, const struct refine_step *step, int half,
                     struct progress_deadline *deadline, struct nacre_error *error)
{
    struct stage *stage = halves->stage;
    struct render_settings settings = *halves->settings;
    settings.bake.density = step->density;
    settings.bake.before = step->before;
    settings.bake.tolerance = step->tolerance;
    settings.bake.seed += (uint64_t)half * UINT64_C(0xd1b54a32d192ed03);
    settings.bake.deadline = step->until_ns ? deadline : NULL;
    stage->settings = &settings;
    clear_light(stage);
    int status = stage_bake(stage, halves->opencl, halves->report, error);
    stage->settings = halves->settings;
    if (status == NACRE_OK) {
        stage->plain_lit = keeps_plain(stage);
        add_light(halves, step->density, half ? halves->sums[1] : halves->first_light);
        add_soft(halves, step->density);
    }
    return status;
}

static int bake_step(void *context, const struct refine_step *step, struct refine_outcome *outcome,
                     struct nacre_error *error)
{
    struct halves *halves = context;
    const struct refine_outcome before = count_samples(halves->report);
    size_t objects = halves->report->object_count, vertices = halves->first[objects];
    struct progress_deadline deadline = {halves->settings->goal->clock, step->until_ns, false};
    memcpy(halves->before, halves->report->objects, objects * sizeof *halves->before);
    memset(halves->first_light, 0, vertices * sizeof *halves->first_light);
    memset(halves->step_soft, 0, vertices * sizeof *halves->step_soft);
    for (size_t i = 0; i < halves->report->object_count; i++) {
        halves->report->objects[i].counts.gather.error = 0; /* the largest is kept */
    }
    int status = bake_half(halves, step, 0, &deadline, error);
    if (status == NACRE_OK) {
        status = bake_half(halves, step, 1, &deadline, error);
    }
    if (status == NACRE_CANCELLED && deadline.passed) {
        *outcome = (struct refine_outcome){.cut = true};
        memcpy(halves->report->objects, halves->before, objects * sizeof *halves->before);
        set_light(halves);
        *error = (struct nacre_error){0};
        return NACRE_OK;
    }
    if (status == NACRE_OK) {
        add_list(halves->first_light, vertices, halves->sums[0]);
        add_list(halves->step_soft, vertices, halves->soft);
        halves->weight += step->density;
        const struct refine_outcome all = count_samples(halves->report);
        outcome->samples = (all.samples - before.samples) / 2;
        outcome->lit = (all.lit - before.lit + 1) / 2; /* none only where neither half has one */
        for (size_t i = 0; i < halves->report->object_count; i++) {
            outcome->summed = fmax(outcome->summed, halves->report->objects[i].counts.gather.error);
        }
        set_light(halves);
    }
    return status;
}

/* Half the difference of the halves over their mean, root mean squares over the translucent objects' vertices. */
static double find_noise(void *context)
{
    const struct halves *halves = context;
    double difference = 0, mean = 0;
    for (size_t i = 0; i < halves->stage->scene->object_count; i++) {
        const struct stage_object *object = &halves->stage->objects[i];
        size_t begin = halves->first[i], end = begin + object->mesh.vertex_count;
        for (size_t at = begin; object->translucent && at < end; at++) {
            for (int c = 0; c < 3; c++) {
                double a = halves->sums[0][at][c], b = halves->sums[1][at][c];
                difference += (a - b) * (a - b);
                mean += (a + b) * (a + b);
            }
        }
    }
    return mean > 0 ? sqrt(difference / mean) : 0;
}

static int find_closing(void *context, double *seconds, struct nacre_error *error)
{
    const struct halves *halves = context;
    return halves->closing(halves->closing_context, seconds, error);
}

static int halves_make(struct halves *halves, struct nacre_error *error)
{
    const struct stage *stage = halves->stage;
    size_t objects = stage->scene->object_count;
    halves->first = calloc(objects + 1, sizeof *halves->first);
    for (size_t i = 0; halves->first && i < objects; i++) {
        halves->first[i + 1] = halves->first[i] + stage->objects[i].mesh.vertex_count;
    }
    for (int half = 0; halves->first && half < 2; half++) {
        halves->sums[half] = calloc(halves->first[objects] + 1, sizeof *halves->sums[half]);
    }
    if (halves->first) {
        halves->first_light = calloc(halves->first[objects] + 1, sizeof *halves->first_light);
        halves->soft = calloc(halves->first[objects] + 1, sizeof *halves->soft);
        halves->step_soft = calloc(halves->first[objects] + 1, sizeof *halves->step_soft);
        halves->before = calloc(objects + 1, sizeof *halves->before);
    }
    return halves->first && halves->sums[0] && halves->sums[1] && halves->first_light &&
                   halves->soft && halves->step_soft && halves->before
               ? NACRE_OK
               : nacre_fail_memory(error, "two halves of light");
}

int stage_bake_refined(struct stage *stage, const struct opencl *opencl, stage_closing *closing,
                       void *context, struct render_report *report, struct nacre_error *error)
{
    struct halves halves = {.stage = stage,
                            .settings = stage->settings,
                            .opencl = opencl,
                            .report = report,
                            .closing = closing,
                            .closing_context = context};
    const struct refine_work work = {
        .context = &halves, .bake = bake_step, .noise = find_noise, .closing = find_closing};
    int status = halves_make(&halves, error);
    if (status == NACRE_OK) {
        status = refine_run(stage->settings->goal, &work, &report->refine, error);
    }
    stage->settings = halves.settings;
    free(halves.first);
    free(halves.sums[0]);
    free(halves.sums[1]);
    free(halves.first_light);
    free(halves.soft);
    free(halves.step_soft);
    free(halves.before);
    return status;
}
