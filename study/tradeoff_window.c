/* Which windows factorizations of a study may have. */
#include "study/tradeoff_window.h"

#include "factor/window.h"

#include <math.h>
#include <stdlib.h>

/* Shares of the scan's window, and the least. */
static const double shares[TRADEOFF_WINDOWS] = {1, 0.7, 0.5, 0.35};

enum { LEAST = 5 };

static void choose(struct tradeoff *t)
{
    t->window_count = 0;
    for (int i = 0; i < TRADEOFF_WINDOWS; i++) {
        int window = (int)(shares[i] * t->window) | 1;
        if (i == 0 || (window >= LEAST && window < t->windows[t->window_count - 1].window)) {
            t->windows[t->window_count++] = (struct tradeoff_window){.window = window};
        }
    }
}

/* Add to sums[window] the relative norm of what each window leaves out of a point's response, which is used up; returns
 * whether the point has one. */
static bool add_point(const struct tradeoff *t, const struct responses *r, int x, int y,
                      float *response, double *sums)
{
    double beyond[TRADEOFF_WINDOWS] = {0}, centre = 0;
    struct window_cut cut = {
        .width = r->width, .height = r->height, .channels = r->channels, .from = r->window};
    responses_read(r, x, y, response);
    for (int i = 1; i < t->window_count; i++) {
        cut.to = t->windows[i].window;
        beyond[i] = beyond[i - 1] + window_cut(&cut, x, y, response, response);
        cut.from = cut.to;
    }
    cut.to = 1;
    double norm = beyond[t->window_count - 1] + window_cut(&cut, x, y, response, response);
    for (int c = 0; c < r->channels; c++) {
        centre += isfinite(response[c]) ? (double)response[c] * (double)response[c] : 0;
    }
    norm += centre;
    for (int i = 0; i < t->window_count && norm > 0; i++) {
        sums[i] += sqrt(beyond[i] / norm);
    }
    return norm > 0;
}

int tradeoff_list_windows(const struct responses *r, struct tradeoff *t, struct nacre_error *error)
{
    const struct nacre_scan_info info = {
        .width = r->width, .height = r->height, .channels = r->channels, .window = r->window};
    size_t floats = nacre_scan_response_size(&info);
    double *sums = calloc((size_t)r->height, TRADEOFF_WINDOWS * sizeof *sums);
    bool room = sums != NULL;
    size_t points = 0;
    choose(t);
#pragma omp parallel for schedule(dynamic) reduction(&& : room) reduction(+ : points)
    for (int y = 0; y < (sums ? r->height : 0); y++) {
        float *response = malloc(floats * sizeof *response);
        room = room && response;
        for (int x = 0; response && x < r->width; x++) {
            points += add_point(t, r, x, y, response, sums + (size_t)y * TRADEOFF_WINDOWS);
        }
        free(response);
    }
    for (int i = 0; room && points > 0 && i < t->window_count; i++) {
        double sum = 0;
        for (int y = 0; y < r->height; y++) {
            sum += sums[y * TRADEOFF_WINDOWS + i];
        }
        t->windows[i].left_out = sum / (double)points;
    }
    free(sums);
    return room ? NACRE_OK : nacre_fail_memory(error, "the windows");
}
