/* The files of a study: CSV, JSON and the page, all or none. */
#include "nacre/whole_file.h"
#include "study/tradeoff_page.h"

#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

enum { FILES = 3 };

static const char *const names[FILES] = {"tradeoff.csv", "tradeoff.json", "tradeoff.html"};

const char *tradeoff_model_word(const struct tradeoff_setting *s)
{
    return s->model == FACTOR_MODEL_TERMS ? "terms" : "clusters";
}

const char *tradeoff_method_word(const struct tradeoff_setting *s)
{
    return s->model == FACTOR_MODEL_TERMS ? "terms" : s->method == FACTOR_METHOD_MU ? "mu" : "hals";
}

const char *tradeoff_weight_word(const struct tradeoff_setting *s)
{
    return s->weight == FACTOR_WEIGHT_RESPONSE ? "response" : "kernel";
}

static const char *store_word(const struct tradeoff_point *p)
{
    return p->bits > 0 ? "planes" : p->store == FACTOR_STORE_FLOAT ? "float" : "half";
}

/* A field between quotes, in which quotes are doubled. */
static void write_quoted(FILE *file, const char *text)
{
    (void)putc('"', file);
    for (; *text; text++) {
        if (*text == '"') {
            (void)putc('"', file);
        }
        (void)putc(*text, file);
    }
    (void)putc('"', file);
}

static int write_csv(FILE *file, const struct tradeoff *t, const struct tradeoff_request *request,
                     struct nacre_error *error)
{
    (void)fputs("run,from_run,model,method,weight,terms,clusters,window,epsilon,iterations,store,"
                "bits,error,error_min,error_max,error_without_centre,seconds,bytes,ratio,"
                "quickest,smallest,run_ended_by,command\n",
                file);
    for (int i = 0; i < t->point_count; i++) {
        const struct tradeoff_point *p = &t->points[i];
        const struct tradeoff_run *run = &t->runs[p->run];
        const struct tradeoff_setting *s = &run->setting;
        char *command = tradeoff_command(t, request, p);
        if (!command) {
            return nacre_fail_memory(error, "the table");
        }
        (void)fprintf(file, "%d,", p->run);
        if (s->parent >= 0) {
            (void)fprintf(file, "%d", s->parent);
        }
        (void)fprintf(file, ",%s,%s,%s,%d,%d,%d,%g,%d,%s,%d,", tradeoff_model_word(s),
                      tradeoff_method_word(s), tradeoff_weight_word(s), s->terms, s->clusters,
                      s->window, s->epsilon, p->iterations, store_word(p), p->bits);
        (void)fprintf(file, "%.9g,%.9g,%.9g,%.9g,%.6g,%.0f,%.6g,%d,%d,%s,", p->error,
                      p->error_minimum, p->error_maximum, p->error_without_centre, p->seconds,
                      p->bytes, t->measured_bytes / p->bytes, p->quickest, p->smallest, run->ended);
        write_quoted(file, command);
        (void)putc('\n', file);
        free(command);
    }
    return NACRE_OK;
}

static json_t *point_to_json(const struct tradeoff *t, const struct tradeoff_request *request,
                             const struct tradeoff_point *p)
{
    const struct tradeoff_setting *s = &t->runs[p->run].setting;
    char *command = tradeoff_command(t, request, p);
    json_t *object =
        command
            ? json_pack("{s:i, s:s, s:s, s:s, s:i, s:i, s:i, s:f, s:i, s:s, s:i, s:f, s:f, s:f, "
                        "s:f, s:f, s:f, s:f, s:b, s:b, s:s}",
                        "run", p->run, "model", tradeoff_model_word(s), "method",
                        tradeoff_method_word(s), "weight", tradeoff_weight_word(s), "terms",
                        s->terms, "clusters", s->clusters, "window", s->window, "epsilon",
                        s->epsilon, "iterations", p->iterations, "store", store_word(p), "bits",
                        p->bits, "error", p->error, "error_min", p->error_minimum, "error_max",
                        p->error_maximum, "error_without_centre",
                        isnan(p->error_without_centre) ? 0 : p->error_without_centre, "seconds",
                        p->seconds, "bytes", p->bytes, "ratio", t->measured_bytes / p->bytes,
                        "quickest", p->quickest, "smallest", p->smallest, "command", command)
            : NULL;
    free(command);
    return object;
}

static json_t *run_to_json(const struct tradeoff_run *run)
{
    const struct tradeoff_setting *s = &run->setting;
    json_t *object =
        json_pack("{s:s, s:s, s:s, s:i, s:i, s:i, s:f, s:i, s:f, s:f, s:o, s:s}", "model",
                  tradeoff_model_word(s), "method", tradeoff_method_word(s), "weight",
                  tradeoff_weight_word(s), "terms", s->terms, "clusters", s->clusters, "window",
                  s->window, "epsilon", s->epsilon, "from_run", s->parent, "seconds", run->seconds,
                  "seconds_predicted", run->predicted, "error",
                  isfinite(run->best_error) ? json_real(run->best_error) : json_null(), "ended_by",
                  run->ended);
    if (object && run->failed) {
        (void)json_object_set_new(object, "why", json_string(run->why.text));
    }
    return object;
}

struct json_t *tradeoff_to_json(const struct tradeoff *t, const struct tradeoff_request *request)
{
    json_t *points = json_array(), *runs = json_array();
    bool whole = points && runs;
    for (int i = 0; i < t->point_count && whole; i++) {
        whole = json_array_append_new(points, point_to_json(t, request, &t->points[i])) == 0;
    }
    for (int i = 0; i < t->run_count && whole; i++) {
        whole = json_array_append_new(runs, run_to_json(&t->runs[i])) == 0;
    }
    if (!whole) {
        json_decref(points);
        json_decref(runs);
        return NULL;
    }
    return json_pack("{s:s, s:s*, s:i, s:i, s:i, s:i, s:f, s:f, s:f, s:o, s:o}", "scan",
                     request->scan, "run_in", request->run_in, "width", t->width, "height",
                     t->height, "channels", t->channels, "window", t->window, "bytes_measured",
                     t->measured_bytes, "budget", request->budget, "seconds_reading",
                     t->seconds_reading, "runs", runs, "points", points);
}

static int write_json(FILE *file, const struct tradeoff *t, const struct tradeoff_request *request,
                      struct nacre_error *error)
{
    json_t *object = tradeoff_to_json(t, request);
    char *text = object ? json_dumps(object, JSON_INDENT(2)) : NULL;
    int status = text ? NACRE_OK : nacre_fail_memory(error, "the study as JSON");
    (void)(text && fputs(text, file) >= 0 && putc('\n', file)); /* the caller asks ferror */
    free(text);
    json_decref(object);
    return status;
}

static char *join(const char *folder, const char *name)
{
    char *path = NULL;
    return asprintf(&path, "%s/%s", folder, name) < 0 ? NULL : path;
}

static int make_folder(const char *folder, struct nacre_error *error)
{
    struct stat status;
    if (mkdir(folder, 0777) == 0 ||
        (errno == EEXIST && stat(folder, &status) == 0 && S_ISDIR(status.st_mode))) {
        return NACRE_OK;
    }
    if (errno == EEXIST) {
        return nacre_fail(error, "%s: is a file; name a folder, which is made if need be", folder);
    }
    if (errno == ENOENT) {
        return nacre_fail(error,
                          "%s: cannot make the folder, as the one that it is to lie in does "
                          "not exist; make that first",
                          folder);
    }
    return nacre_fail_errno(error, errno, "%s: cannot make the folder", folder);
}

int tradeoff_prepare_folder(const char *folder, struct nacre_error *error)
{
    int status = make_folder(folder, error);
    for (int i = 0; i < FILES && status == NACRE_OK; i++) {
        struct whole_file file = {0};
        char *path = join(folder, names[i]);
        status = path ? whole_file_create(&file, path, error) : nacre_fail_memory(error, folder);
        whole_file_discard(&file);
        free(path);
    }
    return status;
}

/* Write one file beside its place. */
static int write_part(struct whole_file *part, const char *path, int index,
                      const struct tradeoff *t, const struct tradeoff_request *request,
                      struct nacre_error *error)
{
    static int (*const writers[FILES])(FILE *, const struct tradeoff *,
                                       const struct tradeoff_request *, struct nacre_error *) = {
        write_csv, write_json, tradeoff_write_page};
    int status = whole_file_create(part, path, error);
    FILE *file = status == NACRE_OK ? fopen(part->temporary, "we") : NULL;
    if (status == NACRE_OK && !file) {
        status = nacre_fail_errno(error, errno, "%s: cannot write it", path);
    }
    if (file) {
        status = writers[index](file, t, request, error);
        bool written = !ferror(file);
        if ((fclose(file) != 0 || !written) && status == NACRE_OK) {
            status = nacre_fail_errno(error, errno, "%s: cannot write it", path);
        }
    }
    return status;
}

int tradeoff_write(const struct tradeoff *t, const struct tradeoff_request *request,
                   struct nacre_error *error)
{
    struct whole_file parts[FILES] = {{0}};
    int status = NACRE_OK;
    /* One study at a time takes its files' places, so that the three are of one. Where a folder cannot be locked, as on
     * some network file systems, that is left to chance. */
    int folder = open(request->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    (void)(folder >= 0 && flock(folder, LOCK_EX));
    for (int i = 0; i < FILES && status == NACRE_OK; i++) {
        char *path = join(request->folder, names[i]);
        status = path ? write_part(&parts[i], path, i, t, request, error)
                      : nacre_fail_memory(error, request->folder);
        free(path);
    }
    for (int i = 0; i < FILES && status == NACRE_OK; i++) {
        status = whole_file_commit(&parts[i], error);
    }
    for (int i = 0; i < FILES; i++) {
        whole_file_discard(&parts[i]);
    }
    if (folder >= 0) {
        (void)close(folder); /* which unlocks it */
    }
    return status;
}
