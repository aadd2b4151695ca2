/* The command that repeats a point of a study. */
#include "study/tradeoff.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One argument as a shell takes it. */
static void write_argument(FILE *line, const char *text)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                "_./,:=+-";
    if (text[0] && text[strspn(text, plain)] == '\0') {
        (void)fputs(text, line);
        return;
    }
    (void)putc('\'', line);
    for (; *text; text++) {
        if (*text == '\'') {
            (void)fputs("'\\''", line);
        } else {
            (void)putc(*text, line);
        }
    }
    (void)putc('\'', line);
}

static void write_stages(FILE *line, const struct tradeoff *t, int run)
{
    struct factor_stage stages[FACTOR_STAGES];
    int count = tradeoff_stages(t, run, stages);
    for (int i = 0; i < count; i++) {
        (void)fprintf(line, "%s%d/%d/%d", i ? "," : " --from ", stages[i].terms, stages[i].clusters,
                      stages[i].iterations);
    }
}

char *tradeoff_command(const struct tradeoff *t, const struct tradeoff_request *request,
                       const struct tradeoff_point *point)
{
    const struct tradeoff_setting *s = &t->runs[point->run].setting;
    char *text = NULL;
    size_t size = 0;
    FILE *line = open_memstream(&text, &size);
    if (!line) {
        return NULL;
    }
    (void)fputs("nacre factor ", line);
    write_argument(line, request->scan);
    (void)fputs(" -o material.exr", line);
    if (s->model == FACTOR_MODEL_TERMS) {
        (void)fprintf(line, " --model terms --terms %d --kernels radial --planes shared --bits %d",
                      s->terms, point->bits);
    } else {
        (void)fprintf(line, " --model clusters --method %s --terms %d --clusters %d",
                      s->method == FACTOR_METHOD_MU ? "mu" : "hals", s->terms, s->clusters);
    }
    (void)fprintf(line, " --weight %s",
                  s->weight == FACTOR_WEIGHT_RESPONSE ? "response" : "kernel");
    if (s->window != t->window) {
        (void)fprintf(line, " --window %d", s->window);
    }
    write_stages(line, t, point->run);
    (void)fprintf(line, " --iterations %d --tolerance 0 --epsilon %g", point->iterations,
                  s->epsilon);
    if (s->model == FACTOR_MODEL_CLUSTERS) {
        (void)fprintf(line, " --store %s", point->store == FACTOR_STORE_FLOAT ? "float" : "half");
    }
    if (request->seed != 0) {
        (void)fprintf(line, " --seed %d", request->seed);
    }
    if (request->device) {
        (void)fputs(" --device ", line);
        write_argument(line, request->device);
    }
    bool written = !ferror(line);
    if (fclose(line) != 0 || !written) {
        free(text);
        return NULL;
    }
    return text;
}
