/* The light of a scene's objects: from lights, and from object to object. */
#include "render/stage.h"

#include "base/clock.h"
#include "render/plain.h"

#include <stdlib.h>
#include <string.h>

/* Light on its way between objects. */
struct exchange {
    struct stage *stage;
    const struct opencl *opencl;
    struct render_report *report;
    struct reflector *reflectors; /* of each object: what left it last */
    size_t *first;                /* of each object's vertices in the lists below */
    float (*leaving)[3];          /* what leaves each vertex now */
    float (*left)[3];             /* behind reflectors[].radiosity */
};

static double seconds_since(int64_t start_ns)
{
    struct clock clock = clock_monotonic();
    return (double)(clock_now_ns(&clock) - start_ns) * 1e-9;
}

static int64_t now_ns(void)
{
    struct clock clock = clock_monotonic();
    return clock_now_ns(&clock);
}

struct lighting stage_lighting(const struct stage *stage)
{
    return (struct lighting){.world = stage->world,
                             .lights = stage->lights,
                             .light_count = stage->light_count,
                             .shadows = render_has(&stage->effects, RENDER_SHADOWS),
                             .rays = stage->settings->bake.rays,
                             .seed = stage->settings->bake.seed};
}

static int bake_translucent(struct stage *stage, size_t index, const struct lighting *lighting,
                            const struct opencl *opencl, float (*radiosity)[3],
                            struct render_report *report, struct nacre_error *error)
{
    struct stage_object *object = &stage->objects[index];
    const struct render_object_effects *effects = &stage->effects.objects[index];
    struct bake_counts *counts = &report->objects[index].counts;
    bool again = stage->settings->goal || render_has(&stage->effects, RENDER_BOUNCES);
    struct lit_surface surface = {&object->mesh, &object->mapping, index,
                                  effects->fresnel && render_has(&stage->effects, RENDER_FRESNEL)
                                      ? stage->scene->objects[index].index
                                      : 1,
                                  again ? &object->gathering : NULL};
    double light = counts->light_seconds, gather = counts->gather_seconds;
    int status = bake_object(&surface, &object->appearance, effects, lighting, opencl,
                             &stage->settings->bake, radiosity, counts, error);
    report->light_seconds += counts->light_seconds - light;
    report->gather_seconds += counts->gather_seconds - gather;
    return status;
}

static int bake_plain(struct stage *stage, size_t index, const struct lighting *lighting,
                      enum plain_light which, float (*irradiance)[3], struct render_report *report,
                      struct nacre_error *error)
{
    static const char *const names[] = {"shadows", "lights", "interreflection"};
    const struct stage_object *object = &stage->objects[index];
    struct bake_counts *counts = &report->objects[index].counts;
    struct progress progress = progress_begin(names[which], stage->settings->bake.quiet);
    progress.deadline = stage->settings->bake.deadline;
    int64_t start = now_ns();
    int status =
        plain_light(&object->mesh, 0, lighting, which, &progress, irradiance, &counts->work, error);
    progress_end(&progress);
    report->light_seconds += seconds_since(start);
    return status;
}

/* Where there is both. */
static void add_to(float (*sum)[3], float (*more)[3], size_t count)
{
    for (size_t i = 0; sum && more && i < count; i++) {
        for (int c = 0; c < 3; c++) {
            sum[i][c] += more[i][c];
        }
    }
}

/* What leaves a plain object under light. */
static void reflect(const struct scene_object *object, float (*light)[3], size_t count)
{
    for (size_t i = 0; i < count; i++) {
        for (int c = 0; c < 3; c++) {
            light[i][c] *= (float)object->color[c];
        }
    }
}

/* The soft lights of the scene's list, and the environment, on a plain object. */
static int light_plain(struct stage *stage, size_t index, struct render_report *report,
                       struct nacre_error *error)
{
    const struct stage_object *object = &stage->objects[index];
    struct lighting lighting = stage_lighting(stage);
    int status = NACRE_OK;
    lighting.light_count = stage->scene->light_count;
    if (render_has(&stage->effects, RENDER_SOFT_LIGHT)) {
        status = bake_plain(stage, index, &lighting, PLAIN_SOFT, object->soft, report, error);
    }
    if (status == NACRE_OK && render_has(&stage->effects, RENDER_ENVIRONMENT)) {
        lighting.lights += lighting.light_count;
        lighting.light_count = 1;
        lighting.seed += stage->scene->light_count;
        status = bake_plain(stage, index, &lighting, PLAIN_SOFT, object->light, report, error);
    }
    if (status == NACRE_OK) {
        add_to(object->light, object->soft, object->mesh.vertex_count);
    }
    return status;
}

/* From lights to an object. */
static int light_object(struct stage *stage, size_t index, const struct lighting *lighting,
                        const struct opencl *opencl, struct render_report *report,
                        struct nacre_error *error)
{
    struct stage_object *object = &stage->objects[index];
    if (object->translucent) {
        return bake_translucent(stage, index, lighting, opencl, object->light, report, error);
    }
    return object->light && !stage->plain_lit ? light_plain(stage, index, report, error) : NACRE_OK;
}

static int light_objects(struct stage *stage, const struct lighting *lighting,
                         const struct opencl *opencl, struct render_report *report,
                         struct nacre_error *error)
{
    int status = NACRE_OK;
    for (size_t i = 0; status == NACRE_OK && i < stage->scene->object_count; i++) {
        status = light_object(stage, i, lighting, opencl, report, error);
    }
    return status;
}

/* What leaves the objects under the lights, all of them: POV-Ray's too. */
static int begin_exchange(struct exchange *exchange, struct nacre_error *error)
{
    struct stage *stage = exchange->stage;
    const struct lighting lighting = stage_lighting(stage);
    int status = NACRE_OK;
    for (size_t i = 0; status == NACRE_OK && i < stage->scene->object_count; i++) {
        const struct stage_object *object = &stage->objects[i];
        size_t count = object->mesh.vertex_count;
        float(*left)[3] = exchange->left + exchange->first[i];
        if (object->translucent) {
            add_to(left, object->light, count);
            continue;
        }
        status = bake_plain(stage, i, &lighting, PLAIN_HARD, left, exchange->report, error);
        add_to(left, object->light, count);
        reflect(&stage->scene->objects[i], left, count);
    }
    return status;
}

/* Pass light on once: from what left each object last to what leaves it now, which is added to its light. */
static int exchange_once(struct exchange *exchange, int bounce, struct nacre_error *error)
{
    struct stage *stage = exchange->stage;
    struct lighting lighting = stage_lighting(stage);
    int status = NACRE_OK;
    lighting.light_count = 0;
    lighting.reflectors = exchange->reflectors;
    lighting.seed += (uint64_t)bounce * UINT64_C(0x9e3779b97f4a7c15);
    for (size_t i = 0; status == NACRE_OK && i < stage->scene->object_count; i++) {
        struct stage_object *object = &stage->objects[i];
        float(*now)[3] = exchange->leaving + exchange->first[i];
        size_t count = object->mesh.vertex_count;
        memset(now, 0, count * sizeof *now);
        if (object->translucent && stage->settings->bake.photons == 0) {
            status = bake_translucent(stage, i, &lighting, exchange->opencl, now, exchange->report,
                                      error);
            add_to(object->light, now, count);
        } else if (!object->translucent) {
            status = bake_plain(stage, i, &lighting, PLAIN_SURFACES, now, exchange->report, error);
            add_to(object->light, now, count);
            reflect(&stage->scene->objects[i], now, count);
        }
    }
    float(*now)[3] = exchange->leaving;
    exchange->leaving = exchange->left;
    exchange->left = now;
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        exchange->reflectors[i].radiosity = (const float(*)[3])(now + exchange->first[i]);
    }
    return status;
}

static int exchange_new(struct exchange *exchange, struct nacre_error *error)
{
    const struct stage *stage = exchange->stage;
    size_t objects = stage->scene->object_count;
    size_t vertices = 0;
    for (size_t i = 0; i < objects; i++) {
        vertices += stage->objects[i].mesh.vertex_count;
    }
    exchange->leaving = calloc(vertices + 1, sizeof *exchange->leaving);
    exchange->left = calloc(vertices + 1, sizeof *exchange->left);
    exchange->first = calloc(objects + 1, sizeof *exchange->first);
    exchange->reflectors = calloc(objects + 1, sizeof *exchange->reflectors);
    if (!exchange->leaving || !exchange->left || !exchange->first || !exchange->reflectors) {
        return nacre_fail_memory(error, "the light between objects");
    }
    for (size_t i = 0; i < objects; i++) {
        const struct stage_object *object = &stage->objects[i];
        exchange->first[i + 1] = exchange->first[i] + object->mesh.vertex_count;
        exchange->reflectors[i] = (struct reflector){
            .mesh = &object->mesh,
            .radiosity = (const float(*)[3])(exchange->left + exchange->first[i]),
            .albedo = object->albedo,
            .mapping = object->translucent ? &object->mapping : NULL,
        };
        memcpy(exchange->reflectors[i].color, stage->scene->objects[i].color,
               sizeof exchange->reflectors[i].color);
    }
    return NACRE_OK;
}

static void exchange_finish(struct exchange *exchange)
{
    free(exchange->leaving);
    free(exchange->left);
    free(exchange->first);
    free(exchange->reflectors);
}

/* The reflectance by which translucent objects pass photons on. */
static int find_albedos(struct stage *stage, struct nacre_error *error)
{
    for (size_t i = 0; i < stage->scene->object_count; i++) {
        struct stage_object *object = &stage->objects[i];
        const struct appearance *appearance = &object->appearance;
        if (object->translucent && !object->albedo) {
            object->albedo = calloc((size_t)appearance->width * (size_t)appearance->height * 3,
                                    sizeof *object->albedo);
            if (!object->albedo) {
                return nacre_fail_memory(error, "the material's albedo");
            }
            appearance_albedo(appearance, object->mapping.mirror, object->albedo);
        }
    }
    return NACRE_OK;
}

/* Light from lights, then as often as it is passed on. */
static int bake_with_bounces(struct stage *stage, const struct opencl *opencl,
                             struct render_report *report, struct nacre_error *error)
{
    struct exchange exchange = {.stage = stage, .opencl = opencl, .report = report};
    struct lighting lighting = stage_lighting(stage);
    bool photons = stage->settings->bake.photons > 0;
    int status = photons ? find_albedos(stage, error) : NACRE_OK;
    if (status == NACRE_OK) {
        status = exchange_new(&exchange, error);
    }
    if (status == NACRE_OK) {
        lighting.reflectors = photons ? exchange.reflectors : NULL;
        lighting.bounces = stage->scene->bounces;
        status = light_objects(stage, &lighting, opencl, report, error);
    }
    if (status == NACRE_OK) {
        status = begin_exchange(&exchange, error);
    }
    for (int k = 1; status == NACRE_OK && k <= stage->scene->bounces; k++) {
        status = exchange_once(&exchange, k, error);
    }
    exchange_finish(&exchange);
    return status;
}

int stage_bake(struct stage *stage, const struct opencl *opencl, struct render_report *report,
               struct nacre_error *error)
{
    const struct lighting lighting = stage_lighting(stage);
    return render_has(&stage->effects, RENDER_BOUNCES)
               ? bake_with_bounces(stage, opencl, report, error)
               : light_objects(stage, &lighting, opencl, report, error);
}

int stage_bake_object(struct stage *stage, size_t index, const struct opencl *opencl,
                      struct render_report *report, struct nacre_error *error)
{
    const struct lighting lighting = stage_lighting(stage);
    return render_has(&stage->effects, RENDER_BOUNCES)
               ? bake_with_bounces(stage, opencl, report, error)
               : light_object(stage, index, &lighting, opencl, report, error);
}
