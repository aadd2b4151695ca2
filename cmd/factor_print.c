/* What nacre factor says of its result, for people and as JSON. */
#include "cmd/factor_print.h"

#include "cmd/error_print.h"
#include "cmd/json_print.h"
#include "factor/words.h"

#include <stdio.h>

static bool chose(const struct factor_summary *s)
{
    return s->search.count > 1 ||
           (s->search.count == 1 && s->search.terms * s->search.clusters == 0);
}

/* A kernel per term has no clusters. */
static void print_tries(const struct factor_summary *s, bool clustered)
{
    const char *head = clustered ? " clusters" : "";
    printf("%-26s %5s%s %10s %8s %9s %8s  %s\n", "tried", "terms", head, "iterations", "error",
           "MiB", "seconds", "ended by");
    for (int i = 0; i < s->search.count; i++) {
        const struct search_try *t = &s->search.tries[i];
        char clusters[16] = "";
        if (clustered) {
            (void)snprintf(clusters, sizeof clusters, " %8d", t->clusters);
        }
        printf("%-26s %5d%s %10d %7.3f%s %9.4g %8.2f  %s\n", "", t->terms, clusters, t->iterations,
               100 * t->error, t->verified ? "%" : "*", t->bytes * 0x1p-20, t->seconds, t->ended);
    }
    printf("%-26s %% of all points, as stored; * of a few points, while iterating\n", "");
}

/* As --kernels and --planes say it. */
static const char *kernels_word(const struct nacre_material *m)
{
    return m->radii > 0 ? "radial" : "full";
}

static const char *planes_word(const struct nacre_material *m)
{
    return m->channels > 1 && m->factor_channels > 1 ? "separate" : "shared";
}

static void print_shape(const struct nacre_material *m)
{
    char bits[32] = "half floats";
    if (m->bits > 0) {
        (void)snprintf(bits, sizeof bits, "%d bits a value", m->bits);
    }
    printf("%-26s %s kernels; planes %s, %s\n", "shape", kernels_word(m),
           m->channels == 1         ? "of the one channel"
           : m->factor_channels > 1 ? "of each channel"
                                    : "shared by the channels",
           bits);
}

/* What was chosen of a kernel per term, into the result. */
static int add_shape(json_t *object, const struct nacre_material *m)
{
    return m->layout != NACRE_KERNEL_PER_TERM
               ? 0
               : json_object_update_new(object,
                                        json_pack("{s:s, s:s, s:i}", "kernels", kernels_word(m),
                                                  "planes", planes_word(m), "bits", m->bits));
}

static void print_text(const struct nacre_material *m, const struct factor_summary *s,
                       const struct opencl *opencl, const char *path)
{
    bool clustered = m->layout != NACRE_KERNEL_PER_TERM;
    if (chose(s)) {
        print_tries(s, clustered);
    }
    printf("%-26s %s on %s: %s, %d iterations\n", "method", m->method, opencl->name,
           size_words(m->terms, m->clusters).text, m->iterations);
    printf("%-26s %s\n", "stopped by", s->stopped_by);
    printf("%-26s %.2f s (reading %.2f s, %s %.2f s, iterating %.2f s, measuring %.2f s)\n", "time",
           s->seconds_reading + s->seconds_clustering + s->seconds_iterating + s->seconds_measuring,
           s->seconds_reading, clustered ? "clustering" : "preparing", s->seconds_clustering,
           s->seconds_iterating, s->seconds_measuring);
    printf("%-26s %.6g\n", "objective", s->objective);
    if (!clustered) {
        print_shape(m);
    }
    printf("%-26s %s, made of responses held as %s\n", "stored as",
           m->pixel == NACRE_HALF ? "half floats" : "floats",
           s->half_responses ? "half floats" : "floats");
    error_print(&s->error, m, path);
}

static void print_warnings(const struct nacre_material *m)
{
    for (size_t i = 0; i < m->warning_count; i++) {
        (void)fprintf(stderr, "nacre: warning: %s\n", m->warnings[i]);
    }
}

static json_t *warnings_to_json(const struct nacre_material *m)
{
    json_t *list = json_array();
    for (size_t i = 0; i < m->warning_count && list; i++) {
        if (json_array_append_new(list, json_string(m->warnings[i])) != 0) {
            json_decref(list);
            list = NULL;
        }
    }
    return list;
}

static json_t *tries_to_json(const struct factor_summary *s)
{
    json_t *list = json_array();
    for (int i = 0; i < s->search.count && list; i++) {
        const struct search_try *t = &s->search.tries[i];
        json_t *entry =
            json_pack("{s:i, s:i, s:i, s:f, s:b, s:f, s:f, s:s}", "terms", t->terms, "clusters",
                      t->clusters, "iterations", t->iterations, "error", t->error, "of_all_points",
                      t->verified, "bytes", t->bytes, "seconds", t->seconds, "ended_by", t->ended);
        if (json_array_append_new(list, entry) != 0) {
            json_decref(list);
            list = NULL;
        }
    }
    return list;
}

static json_t *to_json(const struct nacre_material *m, const struct factor_summary *s,
                       const struct opencl *opencl, const char *path, json_t *explained)
{
    json_t *object = error_to_json(&s->error, m, path);
    json_t *rest = json_pack(
        "{s:s, s:s, s:s, s:i, s:i, s:i, s:f, s:s, s:s, s:f, s:f, s:f, s:f, s:s, s:b, s:b, "
        "s:f, s:o, s:o, s:O?}",
        "output", path, "method", m->method, "device", opencl->name, "terms", m->terms, "clusters",
        m->clusters, "iterations", m->iterations, "objective", s->objective, "stored",
        m->pixel == NACRE_HALF ? "half" : "float", "responses",
        s->half_responses ? "half" : "float", "seconds_reading", s->seconds_reading,
        "seconds_clustering", s->seconds_clustering, "seconds_iterating", s->seconds_iterating,
        "seconds_measuring", s->seconds_measuring, "stopped_by", s->stopped_by, "error_held",
        s->error_held, "continued", s->continued, "seconds_per_iteration", s->seconds_step, "tried",
        tries_to_json(s), "warnings", warnings_to_json(m), "explained", explained);
    if (!object || !rest || json_object_update(rest, object) != 0 || add_shape(rest, m) != 0) {
        json_decref(rest);
        rest = NULL;
    }
    json_decref(object);
    if (rest && !explained) {
        (void)json_object_del(rest, "explained"); /* is there, as null */
    }
    return rest;
}

int factor_print(const struct nacre_material *m, const struct factor_summary *s,
                 const struct opencl *opencl, const char *path, bool json, json_t *explained,
                 struct nacre_error *error)
{
    if (json) {
        return json_print(to_json(m, s, opencl, path, explained), error);
    }
    print_text(m, s, opencl, path);
    print_warnings(m);
    return NACRE_OK;
}
