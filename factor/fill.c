/* Spreading values from measured points outwards. */
#include "factor/fill.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

struct grid {
    int width, height;
    uint8_t *known; /* 1: has a value */
    uint8_t *next;
};

/* The known neighbours of point i: their indices into out[8]. Returns their number. */
static int find_known(const struct grid *g, int x, int y, size_t out[8])
{
    int count = 0;
    for (int dy = -1; dy <= 1; dy++) {
        for (int dx = -1; dx <= 1; dx++) {
            int nx = x + dx, ny = y + dy;
            bool inside = nx >= 0 && nx < g->width && ny >= 0 && ny < g->height;
            if (inside && g->known[ny * g->width + nx]) {
                out[count++] = (size_t)ny * (size_t)g->width + (size_t)nx;
            }
        }
    }
    return count;
}

/* Call `visit` for each unknown point that has known neighbours, ring by ring. */
static int spread(int width, int height, const uint8_t *known,
                  void (*visit)(void *data, size_t point, const size_t *neighbours, int count),
                  void *data, struct nacre_error *error)
{
    size_t points = (size_t)width * (size_t)height;
    struct grid g = {width, height, malloc(points), malloc(points)};
    int status = NACRE_FAILED;
    bool grew = true;
    if (!g.known || !g.next) {
        status = nacre_fail_memory(error, "the points that were not measured");
        goto out;
    }
    memcpy(g.known, known, points);
    while (grew) {
        grew = false;
        memcpy(g.next, g.known, points);
        for (int y = 0; y < height; y++) {
            for (int x = 0; x < width; x++) {
                size_t point = (size_t)y * (size_t)width + (size_t)x, neighbours[8];
                int count = g.known[point] ? 0 : find_known(&g, x, y, neighbours);
                if (count > 0) {
                    visit(data, point, neighbours, count);
                    g.next[point] = 1;
                    grew = true;
                }
            }
        }
        memcpy(g.known, g.next, points);
    }
    status = NACRE_OK;
out:
    free(g.known);
    free(g.next);
    return status;
}

static void choose_label(void *data, size_t point, const size_t *neighbours, int count)
{
    uint32_t *ids = data;
    int most = 0;
    for (int i = 0; i < count; i++) {
        uint32_t id = ids[neighbours[i]];
        int votes = 0;
        for (int j = 0; j < count; j++) {
            votes += ids[neighbours[j]] == id;
        }
        if (votes > most || (votes == most && id < ids[point])) {
            most = votes;
            ids[point] = id;
        }
    }
}

int fill_labels(int width, int height, const uint8_t *known, uint32_t *ids,
                struct nacre_error *error)
{
    return spread(width, height, known, choose_label, ids, error);
}

struct planes {
    const uint32_t *ids;
    float *values;
    size_t count, stride;
};

static void average(void *data, size_t point, const size_t *neighbours, int count)
{
    const struct planes *planes = data;
    size_t chosen[8];
    int same = 0;
    for (int i = 0; i < count; i++) {
        if (planes->ids[neighbours[i]] == planes->ids[point]) {
            chosen[same++] = neighbours[i];
        }
    }
    if (same == 0) {
        memcpy(chosen, neighbours, (size_t)count * sizeof *chosen);
        same = count;
    }
    for (size_t p = 0; p < planes->count; p++) {
        float *plane = planes->values + p * planes->stride;
        double sum = 0;
        for (int i = 0; i < same; i++) {
            sum += (double)plane[chosen[i]];
        }
        plane[point] = (float)(sum / same);
    }
}

int fill_planes(int width, int height, const uint8_t *known, const uint32_t *ids, float *planes,
                size_t count, size_t stride, struct nacre_error *error)
{
    struct planes data = {.ids = ids, .count = count, .stride = stride};
    data.values = planes;
    return spread(width, height, known, average, &data, error);
}
