/* The lit quadrilateral of a white frame: where in the camera's picture the projected region lies, roughly. */
#include "rig/develop/quad.h"

#include "rig/develop/flat.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* Lit is what has a quarter of the colour's upper level: vignetting takes less, the dark is far below. */
static const double lit_share = 0.25;

/* Label the 4-connected area that contains `start`; returns its size. `stack` holds width x height indices. */
static size_t flood(unsigned char *mask, unsigned char label, int width, int height, size_t start,
                    size_t *stack)
{
    size_t depth = 0;
    size_t size = 0;
    unsigned char from = mask[start];
    mask[start] = label;
    stack[depth++] = start;
    while (depth) {
        size_t at = stack[--depth];
        int x = (int)(at % (size_t)width);
        int y = (int)(at / (size_t)width);
        const int steps[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
        size++;
        for (int s = 0; s < 4; s++) {
            int nx = x + steps[s][0];
            int ny = y + steps[s][1];
            size_t next = (size_t)ny * (size_t)width + (size_t)nx;
            if (nx >= 0 && nx < width && ny >= 0 && ny < height && mask[next] == from) {
                mask[next] = label;
                stack[depth++] = next;
            }
        }
    }
    return size;
}

enum { DARK, LIT, SEEN, CHOSEN };

/* Leaves CHOSEN in the largest lit area of the mask and returns its size. */
static size_t choose_largest(unsigned char *mask, int width, int height, size_t *stack)
{
    size_t pixels = (size_t)width * (size_t)height;
    size_t largest = 0;
    size_t start = 0;
    for (size_t i = 0; i < pixels; i++) {
        if (mask[i] == LIT) {
            size_t size = flood(mask, SEEN, width, height, i, stack);
            if (size > largest) {
                largest = size;
                start = i;
            }
        }
    }
    return largest ? flood(mask, CHOSEN, width, height, start, stack) : 0;
}

/* The pixel corner of the chosen area that lies farthest along the distance from (x, y), or with a direction given,
 * along that direction. */
static struct point farthest(const unsigned char *mask, int width, int height, struct point from,
                             const struct point *direction)
{
    struct point best = from;
    double reached = -INFINITY;
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            for (int k = 0; mask[(size_t)y * (size_t)width + (size_t)x] == CHOSEN && k < 4; k++) {
                struct point p = {x + (k & 1), y + (k >> 1)};
                double dx = p.x - from.x;
                double dy = p.y - from.y;
                double reach =
                    direction ? dx * direction->x + dy * direction->y : dx * dx + dy * dy;
                if (reach > reached) {
                    reached = reach;
                    best = p;
                }
            }
        }
    }
    return best;
}

static double area_of(const struct point corners[4])
{
    double twice = 0;
    for (int i = 0; i < 4; i++) {
        const struct point *a = &corners[i];
        const struct point *b = &corners[(i + 1) % 4];
        twice += a->x * b->y - b->x * a->y;
    }
    return fabs(twice) / 2;
}

/* A corner is the point farthest from the middle, the next the one farthest from that, the others the farthest from
 * the line through both. */
static void find_corners(const unsigned char *mask, int width, int height, struct point corners[4])
{
    struct point middle = {0, 0};
    size_t count = 0;
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            if (mask[(size_t)y * (size_t)width + (size_t)x] == CHOSEN) {
                middle.x += x + 0.5;
                middle.y += y + 0.5;
                count++;
            }
        }
    }
    middle.x /= (double)count;
    middle.y /= (double)count;
    struct point found[4];
    found[0] = farthest(mask, width, height, middle, NULL);
    found[2] = farthest(mask, width, height, found[0], NULL);
    /* y points down, so turning the diagonal this way gives the corner that is clockwise on the screen. */
    struct point across = {found[0].y - found[2].y, found[2].x - found[0].x};
    struct point back = {-across.x, -across.y};
    found[3] = farthest(mask, width, height, found[0], &across);
    found[1] = farthest(mask, width, height, found[0], &back);
    int first = 0;
    for (int i = 1; i < 4; i++) {
        if (found[i].x + found[i].y < found[first].x + found[first].y) {
            first = i;
        }
    }
    for (int i = 0; i < 4; i++) {
        corners[i] = found[(first + i) % 4];
    }
}

/* Lit pixels in the quadrilateral, over what is lit or in it. */
static double agreement(const unsigned char *mask, int width, int height,
                        const struct point corners[4])
{
    double both = 0;
    double either = area_of(corners);
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            bool inside = mask[(size_t)y * (size_t)width + (size_t)x] == CHOSEN;
            either += inside ? 1 : 0;
            for (int i = 0; inside && i < 4; i++) {
                const struct point *a = &corners[i];
                const struct point *b = &corners[(i + 1) % 4];
                inside = (b->x - a->x) * (y + 0.5 - a->y) - (b->y - a->y) * (x + 0.5 - a->x) >= 0;
            }
            both += inside ? 1 : 0;
        }
    }
    return both / (either - both);
}

int quad_find(const float *white, int width, int height, enum bayer bayer, struct point corners[4],
              struct nacre_error *error)
{
    size_t pixels = (size_t)width * (size_t)height;
    double levels[3];
    int status = NACRE_OK;
    unsigned char *mask = calloc(pixels, 1);
    size_t *stack = malloc(pixels * sizeof *stack);
    if (!mask || !stack) {
        status = nacre_fail_memory(error, "the white frame's lit area");
        goto out;
    }
    status = flat_levels(white, width, height, bayer, levels, error);
    if (status != NACRE_OK) {
        goto out;
    }
    for (size_t i = 0; i < pixels; i++) {
        double level =
            levels[bayer_channel(bayer, (int)(i % (size_t)width), (int)(i / (size_t)width))];
        mask[i] = level > 0 && white[i] > lit_share * level ? LIT : DARK;
    }
    size_t area = choose_largest(mask, width, height, stack);
    if (area < 64) {
        status =
            nacre_fail(error, "no lit area is in the white frame; was the projector on, and the "
                              "lens uncovered?");
        goto out;
    }
    find_corners(mask, width, height, corners);
    /* Pixels at the border that are lit in part cost some per cent of a small frame; an L has 0.85. */
    if (agreement(mask, width, height, corners) < 0.9) {
        status =
            nacre_fail(error, "the lit area of the white frame is no quadrilateral; is the white "
                              "layer flat, and the view of the whole region free?");
    }
out:
    free(mask);
    free(stack);
    return status;
}
