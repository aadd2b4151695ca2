/* The page of a study. */
#include "study/tradeoff_page.h"

#include "factor/words.h"
#include "study/page.h"
#include "study/palette.h"
#include "study/plot.h"
#include "study/tradeoff_front.h"

#include <math.h>
#include <stdlib.h>

/* What points are coloured by. */
static const struct kind {
    enum factor_model model;
    enum factor_method method;
    enum factor_weight weight;
    const char *name;
} kinds[] = {
    {FACTOR_MODEL_TERMS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_RESPONSE,
     "a kernel per term, weighted by responses"},
    {FACTOR_MODEL_TERMS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_KERNEL,
     "a kernel per term, weighted by the mean response"},
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_RESPONSE,
     "clusters, block coordinate descent, weighted by responses"},
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_HALS, FACTOR_WEIGHT_KERNEL,
     "clusters, block coordinate descent, weighted by kernels"},
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_MU, FACTOR_WEIGHT_RESPONSE,
     "clusters, multiplicative updates, weighted by responses"},
    {FACTOR_MODEL_CLUSTERS, FACTOR_METHOD_MU, FACTOR_WEIGHT_KERNEL,
     "clusters, multiplicative updates: the paper's method"},
};

enum { KINDS = sizeof kinds / sizeof *kinds, LABEL = 12 };

/* The rows of the table: points of both fronts, the most exact first. */
struct rows {
    int count, points[TRADEOFF_POINTS], number[TRADEOFF_POINTS]; /* number: by point, 0: no row */
};

static int kind_of(const struct tradeoff *t, const struct tradeoff_point *p)
{
    const struct tradeoff_setting *s = &t->runs[p->run].setting;
    for (int k = 0; k < KINDS; k++) {
        if (kinds[k].model == s->model && kinds[k].weight == s->weight &&
            (kinds[k].method == s->method || s->model == FACTOR_MODEL_TERMS)) {
            return k;
        }
    }
    return KINDS - 1;
}

static struct rows *list_rows(const struct tradeoff *t)
{
    struct rows *rows = calloc(1, sizeof *rows);
    for (int i = 0; rows && i < t->point_count; i++) {
        if (!t->points[i].quickest && !t->points[i].smallest) {
            continue;
        }
        int at = rows->count++;
        while (at > 0 && t->points[rows->points[at - 1]].error > t->points[i].error) {
            rows->points[at] = rows->points[at - 1];
            at--;
        }
        rows->points[at] = i;
    }
    for (int i = 0; rows && i < rows->count; i++) {
        rows->number[rows->points[i]] = i + 1;
    }
    return rows;
}

/* The numbers of one plot. */
struct drawing {
    double x[2 * TRADEOFF_POINTS + 2], y[2 * TRADEOFF_POINTS + 2];
    double all_x[TRADEOFF_POINTS], all_y[TRADEOFF_POINTS];
    char texts[TRADEOFF_POINTS][LABEL];
    const char *labels[TRADEOFF_POINTS];
    struct plot_series series[2 * KINDS + 1];
    size_t series_count;
};

/* The front as steps: what has been reached for this much. */
static void draw_front(struct drawing *d, const struct tradeoff *t, enum tradeoff_cost cost)
{
    int indices[TRADEOFF_POINTS];
    int count = tradeoff_front(t, cost, indices);
    size_t length = 0;
    for (int i = 0; i < count; i++) {
        const struct tradeoff_point *p = &t->points[indices[i]];
        double at = tradeoff_cost_of(p, cost) / (cost == TRADEOFF_BYTES ? 1024 : 1);
        if (i > 0) {
            d->x[length] = at;
            d->y[length] = d->y[length - 1];
            length++;
        }
        d->x[length] = at;
        d->y[length++] = 100 * p->error;
    }
    d->series[d->series_count++] =
        (struct plot_series){.x = d->x, .y = d->y, .count = length, .colour = "#8a929c"};
}

/* The points of a kind: those of the front large and numbered, or the others small. */
static void draw_kind(struct drawing *d, const struct tradeoff *t, const struct rows *rows,
                      enum tradeoff_cost cost, int kind, bool front, size_t *used)
{
    size_t first = *used;
    for (int i = 0; i < t->point_count; i++) {
        const struct tradeoff_point *p = &t->points[i];
        bool is_on = cost == TRADEOFF_SECONDS ? p->quickest : p->smallest;
        if (kind_of(t, p) != kind || is_on != front) {
            continue;
        }
        d->all_x[*used] = tradeoff_cost_of(p, cost) / (cost == TRADEOFF_BYTES ? 1024 : 1);
        d->all_y[*used] = 100 * p->error;
        (void)snprintf(d->texts[*used], LABEL, "%d", rows->number[i]);
        d->labels[*used] = d->texts[*used];
        (*used)++;
    }
    struct plot_series *series = &d->series[d->series_count];
    *series = (struct plot_series){.x = d->all_x + first,
                                   .y = d->all_y + first,
                                   .count = *used - first,
                                   .dots = true,
                                   .radius = front ? 4 : 1.6,
                                   .labels = front ? d->labels + first : NULL};
    palette_format(palette_group((size_t)kind, KINDS), series->colour);
    d->series_count += series->count > 0;
}

static int write_plot(FILE *page, const struct tradeoff *t, const struct rows *rows,
                      enum tradeoff_cost cost, struct nacre_error *error)
{
    struct drawing *d = calloc(1, sizeof *d);
    size_t used = 0;
    if (!d) {
        return nacre_fail_memory(error, "a plot");
    }
    draw_front(d, t, cost);
    for (int front = 0; front < 2; front++) {
        for (int kind = 0; kind < KINDS; kind++) {
            draw_kind(d, t, rows, cost, kind, front == 1, &used);
        }
    }
    struct plot plot = {.title = cost == TRADEOFF_SECONDS ? "Error against seconds"
                                                          : "Error against bytes",
                        .x_label = cost == TRADEOFF_SECONDS ? "seconds" : "KiB",
                        .y_label = "mean relative error, %",
                        .x_log = true,
                        .y_log = true,
                        .margin = 0.03,
                        .width = 420,
                        .height = 360,
                        .series = d->series,
                        .series_count = d->series_count};
    (void)fputs("<figure>\n", page);
    plot_write(page, &plot);
    (void)fputs("</figure>\n", page);
    free(d);
    return NACRE_OK;
}

static void write_legend(FILE *page, const struct tradeoff *t)
{
    (void)fputs("<div class=\"legend\">", page);
    for (int kind = 0; kind < KINDS; kind++) {
        char colour[8];
        bool used = false;
        for (int i = 0; i < t->point_count && !used; i++) {
            used = kind_of(t, &t->points[i]) == kind;
        }
        palette_format(palette_group((size_t)kind, KINDS), colour);
        if (used) {
            (void)fprintf(page, "<span><i style=\"background:%s\"></i>%s</span>", colour,
                          kinds[kind].name);
        }
    }
    (void)fputs("<span><i class=\"line\" style=\"background:#8a929c\"></i>the front: the least "
                "error for as much</span></div>\n",
                page);
}

/* The cheapest point whose error is at most `goal`; -1 where there is none. */
static int find_cheapest(const struct tradeoff *t, enum tradeoff_cost cost, double goal)
{
    int best = -1;
    for (int i = 0; i < t->point_count; i++) {
        const struct tradeoff_point *p = &t->points[i];
        bool is_on = cost == TRADEOFF_SECONDS ? p->quickest : p->smallest;
        if (is_on && p->error <= goal &&
            (best < 0 || tradeoff_cost_of(p, cost) < tradeoff_cost_of(&t->points[best], cost))) {
            best = i;
        }
    }
    return best;
}

/* The least error of a front. */
static double least_on(const struct tradeoff *t, enum tradeoff_cost cost)
{
    int indices[TRADEOFF_POINTS];
    int count = tradeoff_front(t, cost, indices);
    return count > 0 ? t->points[indices[count - 1]].error : INFINITY;
}

/* What an error of at most `goal` takes at least, if anything has it. */
static void write_goal(FILE *page, const struct tradeoff *t, const struct rows *rows, double goal,
                       const char *remark)
{
    int quick = find_cheapest(t, TRADEOFF_SECONDS, goal);
    int small = find_cheapest(t, TRADEOFF_BYTES, goal);
    if (quick < 0 || small < 0) {
        return;
    }
    (void)fprintf(
        page, "<tr><td>%.3g %%%s</td><td>%.3g</td><td>%d</td><td>%.4g KiB</td><td>%d</td></tr>\n",
        100 * goal, remark, t->points[quick].seconds, rows->number[quick],
        t->points[small].bytes / 1024, rows->number[small]);
}

/* What each step of exactness takes at least, down to the least error of the fronts. */
static void write_goals(FILE *page, const struct tradeoff *t, const struct rows *rows)
{
    static const double goals[] = {0.1,    0.05,   0.03,   0.02,   0.015,  0.01,
                                   0.007,  0.005,  0.003,  0.002,  0.0015, 0.001,
                                   0.0007, 0.0005, 0.0003, 0.0002, 0.0001};
    (void)fputs("<h2>What to choose</h2>\n<p>For an error of at most so much: the quickest command "
                "and the smallest material, by their numbers in the next table.</p>\n"
                "<div class=\"scroll short\"><table class=\"numbers\">\n<tr><th>Mean error at "
                "most</th><th>Seconds</th>"
                "<th>No.</th><th>Size</th><th>No.</th></tr>\n",
                page);
    for (size_t i = 0; i < sizeof goals / sizeof *goals; i++) {
        write_goal(page, t, rows, goals[i], "");
    }
    if (rows->count > 0) {
        /* Both fronts reach it but for the gain that is too small to stand on them. */
        double least = fmax(least_on(t, TRADEOFF_SECONDS), least_on(t, TRADEOFF_BYTES));
        write_goal(page, t, rows, least, ", the least");
    }
    (void)fputs("</table></div>\n", page);
}

/* What smaller windows would leave out. */
static void write_windows(FILE *page, const struct tradeoff *t)
{
    if (t->window_count < 2) {
        return;
    }
    (void)fputs("<p>A smaller window leaves out", page);
    for (int i = 1; i < t->window_count; i++) {
        (void)fprintf(page, "%s %.2g %% of a response with %d × %d", i == 1 ? "" : ",",
                      100 * t->windows[i].left_out, t->windows[i].window, t->windows[i].window);
    }
    (void)fputs(", on average. It is tried where that is at most half of the error, which it "
                "counts to.</p>\n",
                page);
}

static int write_row(FILE *page, const struct tradeoff *t, const struct tradeoff_request *request,
                     int number, const struct tradeoff_point *p, struct nacre_error *error)
{
    const struct tradeoff_setting *s = &t->runs[p->run].setting;
    char *command = tradeoff_command(t, request, p);
    if (!command) {
        return nacre_fail_memory(error, "the table");
    }
    (void)fprintf(page,
                  "<tr><td rowspan=\"2\">%d</td><td>%.3f %%</td><td>%.2f "
                  "%%</td><td>%.3g</td><td>%.4g KiB</td>"
                  "<td>%s</td><td>%s</td><td>%d</td><td>",
                  number, 100 * p->error, 100 * p->error_without_centre, p->seconds,
                  p->bytes / 1024, ratio_words(t->measured_bytes, p->bytes).text,
                  p->quickest && p->smallest ? "both"
                  : p->quickest              ? "seconds"
                                             : "bytes",
                  s->terms);
    (void)(s->clusters ? fprintf(page, "%d", s->clusters) : fputs("none", page));
    (void)fprintf(page, "</td><td>%d</td></tr>\n<tr><td class=\"command\" colspan=\"9\"><code>",
                  s->window);
    page_command(page, command);
    (void)fputs("</code></td></tr>\n", page);
    free(command);
    return NACRE_OK;
}

static int write_table(FILE *page, const struct tradeoff *t, const struct tradeoff_request *request,
                       const struct rows *rows, struct nacre_error *error)
{
    int status = NACRE_OK;
    (void)fputs("<h2>What nothing beats</h2>\n<p>The points of both fronts, the most exact first. "
                "Each command repeats its point: the same scan, device and version give the same "
                "material, bit for bit.",
                page);
    if (request->run_in) {
        (void)fputs(" They are to be run where the study was, in <code>", page);
        page_text(page, request->run_in);
        (void)fputs("</code>.", page);
    }
    (void)fputs("</p>\n<div class=\"scroll\"><table class=\"numbers\">\n<tr><th>No.</th>"
                "<th>Mean error</th><th>Without the centre</th><th>Seconds</th><th>Size</th>"
                "<th>Ratio</th><th>Front</th><th>Terms</th><th>Clusters</th><th>Window</th></tr>\n",
                page);
    for (int i = 0; i < rows->count && status == NACRE_OK; i++) {
        status = write_row(page, t, request, i + 1, &t->points[rows->points[i]], error);
    }
    (void)fputs("</table></div>\n", page);
    return status;
}

/* What no front holds, too: folded away until it is asked for. */
static int write_all(FILE *page, const struct tradeoff *t, const struct tradeoff_request *request,
                     struct nacre_error *error)
{
    (void)fprintf(
        page,
        "<details><summary>All %d points, in the order they were found</summary>\n"
        "<div class=\"scroll\"><table class=\"numbers\">\n<tr><th>Mean error</th><th>Seconds</th>"
        "<th>KiB</th><th>Command</th></tr>\n",
        t->point_count);
    for (int i = 0; i < t->point_count; i++) {
        const struct tradeoff_point *p = &t->points[i];
        char *command = tradeoff_command(t, request, p);
        if (!command) {
            return nacre_fail_memory(error, "the table");
        }
        (void)fprintf(page,
                      "<tr><td>%.3f %%</td><td>%.3g</td><td>%.4g</td><td class=\"command\"><code>",
                      100 * p->error, p->seconds, p->bytes / 1024);
        page_command(page, command);
        (void)fputs("</code></td></tr>\n", page);
        free(command);
    }
    (void)fputs("</table></div>\n</details>\n", page);
    return NACRE_OK;
}

static void write_runs(FILE *page, const struct tradeoff *t)
{
    (void)fputs(
        "<h2>What was run</h2>\n<p>In this order. A run is given up as dominated when twice "
        "what its iterations won last would leave it behind what others reached in as few "
        "bytes and as few seconds; settings that no front holds have no neighbours "
        "tried.</p>\n<div class=\"scroll\"><table>\n<tr><th>Run</th><th>From</th>"
        "<th>Method</th><th>Weight</th><th>Terms</th><th>Clusters</th><th>Window</th><th>ε</th>"
        "<th>Best error</th><th>Seconds of the budget</th><th>Ended by</th></tr>\n",
        page);
    for (int i = 0; i < t->run_count; i++) {
        const struct tradeoff_run *run = &t->runs[i];
        const struct tradeoff_setting *s = &run->setting;
        (void)fprintf(page, "<tr><td>%d</td><td>", i);
        (void)(s->parent < 0 ? fputs("random", page) : fprintf(page, "%d", s->parent));
        (void)fprintf(page, "</td><td>%s</td><td>%s</td><td>%d</td><td>", tradeoff_method_word(s),
                      tradeoff_weight_word(s), s->terms);
        (void)(s->clusters ? fprintf(page, "%d", s->clusters) : fputs("none", page));
        (void)fprintf(page, "</td><td>%d</td><td>%g</td><td>", s->window, s->epsilon);
        (void)(isfinite(run->best_error) ? fprintf(page, "%.3f %%", 100 * run->best_error)
                                         : fputs("none", page));
        (void)fprintf(page, "</td><td>%.3g</td><td>%s", run->seconds, run->ended);
        if (run->failed) {
            (void)fputs(": ", page);
            page_text(page, run->why.text);
        }
        (void)fputs("</td></tr>\n", page);
    }
    (void)fputs("</table></div>\n", page);
}

static void write_key(FILE *page, const char *value, const char *meaning)
{
    (void)fprintf(page, "<div><b>%s</b><span>%s</span></div>\n", value, meaning);
}

static void write_head(FILE *page, const struct tradeoff *t, const struct tradeoff_request *request)
{
    char value[64], meaning[64];
    double spent = t->seconds_reading;
    for (int i = 0; i < t->run_count; i++) {
        spent += t->runs[i].seconds;
    }
    (void)fputs(
        "<header>\n<h1>What accuracy costs</h1>\n<p class=\"muted\">factorizations of <code>",
        page);
    page_text(page, request->scan);
    (void)fputs("</code>", page);
    if (request->source && request->source[0]) {
        (void)fputs(" — ", page);
        page_text(page, request->source);
    }
    (void)fputs("</p>\n<div class=\"key\">\n", page);
    (void)snprintf(value, sizeof value, "%d × %d", t->width, t->height);
    write_key(page, value, "surface points");
    (void)snprintf(value, sizeof value, "%d × %d", t->window, t->window);
    write_key(page, value, "window");
    (void)snprintf(value, sizeof value, "%.4g MiB", t->measured_bytes * 0x1p-20);
    write_key(page, value, "of responses");
    (void)snprintf(value, sizeof value, "%d", t->point_count);
    (void)snprintf(meaning, sizeof meaning, "points of %d runs", t->run_count);
    write_key(page, value, meaning);
    (void)snprintf(value, sizeof value, "%.3g s", spent);
    (void)snprintf(meaning, sizeof meaning, "spent of a budget of %.3g s", request->budget);
    write_key(page, value, meaning);
    (void)fputs("</div>\n</header>\n", page);
}

int tradeoff_write_page(FILE *page, const struct tradeoff *t,
                        const struct tradeoff_request *request, struct nacre_error *error)
{
    struct rows *rows = list_rows(t);
    if (!rows) {
        return nacre_fail_memory(error, "the page");
    }
    page_begin(page, "What accuracy costs — nacre tradeoff");
    write_head(page, t, request);
    (void)fputs(
        "<p>Each dot is a factorization of the scan. Seconds are those of the whole command, "
        "from reading to the measured material, with kernels compiled before; bytes are "
        "those of the model as it is stored. Large dots stand on the front: nothing else is "
        "as exact and as quick, or as exact and as small. Their numbers are the "
        "table's, where there is room.</p>\n<div class=\"two\">\n",
        page);
    int status = write_plot(page, t, rows, TRADEOFF_SECONDS, error);
    if (status == NACRE_OK) {
        status = write_plot(page, t, rows, TRADEOFF_BYTES, error);
    }
    (void)fputs("</div>\n", page);
    write_legend(page, t);
    write_windows(page, t);
    write_goals(page, t, rows);
    if (status == NACRE_OK) {
        status = write_table(page, t, request, rows, error);
    }
    write_runs(page, t);
    if (status == NACRE_OK) {
        status = write_all(page, t, request, error);
    }
    (void)fputs(
        "<h2>Before and after factoring</h2>\n<p>What scanning costs is told by "
        "<code>nacre plan</code> and <code>nacre scan --dry-run</code>, what a picture costs "
        "by <code>nacre render --explain</code>; docs/accuracy.md has a table for each stage, "
        "from the grids' spacing to light samples.</p>\n",
        page);
    page_end(page);
    free(rows);
    return status;
}
