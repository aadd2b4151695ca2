/* Framing and focus from a few raw frames. */
#include "rig/develop/framing.h"

#include "rig/develop/demosaic.h"
#include "rig/develop/quad.h"

#include <math.h>
#include <stdlib.h>

/* Slopes are taken between pixels of the same colour. */
enum { STEP = 2, COLOURS = 3 };

const int framing_margin_px = 4;
const double framing_margin_share = 0.03;

static const float saturated_color[3] = {1, 0, 1};
static const float outline_color[3] = {0.1F, 1, 0.1F};

static size_t pixels_of(const struct framing_frames *frames)
{
    return (size_t)frames->width * (size_t)frames->height;
}

static int clamp(int value, int low, int high)
{
    return value < low ? low : value > high ? high : value;
}

/* The box around the corners with its margin, inside the frame. */
static struct framing_box box_around(const struct point corners[4], int width, int height)
{
    double left = corners[0].x, right = left, top = corners[0].y, bottom = top;
    for (int i = 1; i < 4; i++) {
        left = fmin(left, corners[i].x);
        right = fmax(right, corners[i].x);
        top = fmin(top, corners[i].y);
        bottom = fmax(bottom, corners[i].y);
    }
    double across = framing_margin_px + framing_margin_share * (right - left);
    double down = framing_margin_px + framing_margin_share * (bottom - top);
    struct framing_box box = {.left = clamp((int)floor(left - across), 0, width - 2) & ~1,
                              .top = clamp((int)floor(top - down), 0, height - 2) & ~1};
    box.width = (clamp((int)ceil(right + across), box.left + 2, width) - box.left) & ~1;
    box.height = (clamp((int)ceil(bottom + down), box.top + 2, height) - box.top) & ~1;
    return box;
}

static int find_region(const struct framing_frames *frames, struct framing *framing,
                       struct nacre_error *error)
{
    size_t pixels = pixels_of(frames);
    struct nacre_error reason;
    float *light = calloc(pixels + 1, sizeof *light); /* never of size 0 */
    if (!light) {
        return nacre_fail_memory(error, "a frame");
    }
    for (size_t i = 0; i < pixels; i++) {
        light[i] = (float)frames->white[i] - (float)frames->black[i];
    }
    /* That nothing stands out is an answer, too. */
    framing->found = quad_find(light, frames->width, frames->height, frames->bayer,
                               framing->corners, &reason) == NACRE_OK;
    framing->crop = framing->found
                        ? box_around(framing->corners, frames->width, frames->height)
                        : (struct framing_box){0, 0, frames->width & ~1, frames->height & ~1};
    free(light);
    return NACRE_OK;
}

void framing_place(struct framing *framing, const struct point corners[4], int width, int height)
{
    framing->found = true;
    for (int i = 0; i < 4; i++) {
        framing->corners[i] = corners[i];
    }
    framing->crop = box_around(corners, width, height);
}

/* Product of a slope in one frame with the same in the other: their noises are independent. */
static double slopes_at(const struct framing_frames *frames, size_t i, size_t stride)
{
    double slope[2];
    for (int k = 0; k < 2; k++) {
        const uint16_t *raw = frames->shown[k] + i;
        slope[k] = ((double)raw[STEP * stride] - raw[0]) / STEP;
    }
    return slope[0] * slope[1];
}

/* The sums of one colour inside the crop. */
static double measure_focus(const struct framing_frames *frames, const struct framing_box *box)
{
    double slopes = 0;
    double n[COLOURS] = {0}, a[COLOURS] = {0}, b[COLOURS] = {0}, ab[COLOURS] = {0};
    for (int y = box->top; y < box->top + box->height - STEP; y++) {
        for (int x = box->left; x < box->left + box->width - STEP; x++) {
            size_t i = (size_t)y * (size_t)frames->width + (size_t)x;
            int c = bayer_channel(frames->bayer, x, y);
            slopes += slopes_at(frames, i, 1) + slopes_at(frames, i, (size_t)frames->width);
            n[c]++;
            a[c] += frames->shown[0][i];
            b[c] += frames->shown[1][i];
            ab[c] += (double)frames->shown[0][i] * frames->shown[1][i];
        }
    }
    double deviation = 0;
    for (int c = 0; c < COLOURS; c++) {
        deviation += n[c] > 0 ? ab[c] - a[c] * b[c] / n[c] : 0;
    }
    return deviation > 0 && slopes > 0 ? slopes / deviation : NAN;
}

int framing_look(const struct framing_frames *frames, struct framing *framing,
                 struct nacre_error *error)
{
    size_t pixels = pixels_of(frames);
    size_t saturated = 0;
    *framing = (struct framing){.found = false};
    if (frames->width < 8 || frames->height < 8) {
        return nacre_fail(error, "frames of %d x %d pixels are too small to be looked at",
                          frames->width, frames->height);
    }
    for (size_t i = 0; i < pixels; i++) {
        saturated += frames->shown[0][i] >= frames->full_scale;
    }
    framing->saturated = (double)saturated / (double)pixels;
    int status = find_region(frames, framing, error);
    framing->focus = measure_focus(frames, &framing->crop);
    return status;
}

/* What makes the white frame grey inside the crop. */
static void find_gains(const struct framing_frames *frames, const struct framing_box *box,
                       double gains[COLOURS])
{
    double sums[COLOURS] = {0};
    double counts[COLOURS] = {0};
    double largest = 0;
    for (int y = box->top; y < box->top + box->height; y++) {
        for (int x = box->left; x < box->left + box->width; x++) {
            size_t i = (size_t)y * (size_t)frames->width + (size_t)x;
            int c = bayer_channel(frames->bayer, x, y);
            sums[c] += (double)frames->white[i] - frames->black[i];
            counts[c]++;
        }
    }
    for (int c = 0; c < COLOURS; c++) {
        gains[c] = counts[c] > 0 && sums[c] > 0 ? sums[c] / counts[c] : 0;
        largest = fmax(largest, gains[c]);
    }
    for (int c = 0; c < COLOURS; c++) {
        /* A colour that is hardly there is not blown up to noise. */
        gains[c] = gains[c] > 0.1 * largest ? largest / gains[c] : 1;
    }
}

static void mark(struct picture *picture, int x, int y, const float color[3])
{
    if (x >= 0 && y >= 0 && x < picture->width && y < picture->height) {
        float *pixel = picture->rgb + 3 * ((size_t)y * (size_t)picture->width + (size_t)x);
        for (int c = 0; c < 3; c++) {
            pixel[c] = color[c];
        }
    }
}

static void draw_outline(struct picture *picture, const struct point corners[4])
{
    for (int i = 0; i < 4; i++) {
        struct point from = corners[i];
        struct point to = corners[(i + 1) % 4];
        int steps = 1 + (int)(2 * hypot(to.x - from.x, to.y - from.y));
        for (int k = 0; k <= steps; k++) {
            double along = (double)k / steps;
            mark(picture, (int)floor(from.x + along * (to.x - from.x)),
                 (int)floor(from.y + along * (to.y - from.y)), outline_color);
        }
    }
}

/* The frame without its darkness, 1 where it would saturate. */
static void fill_mosaic(const struct framing_frames *frames, const double gains[COLOURS],
                        float *mosaic)
{
    for (int y = 0; y < frames->height; y++) {
        for (int x = 0; x < frames->width; x++) {
            size_t i = (size_t)y * (size_t)frames->width + (size_t)x;
            double gain = gains[bayer_channel(frames->bayer, x, y)];
            double value = (double)frames->shown[0][i] - frames->black[i];
            mosaic[i] = (float)(value * gain / frames->full_scale);
        }
    }
}

int framing_draw(const struct framing_frames *frames, const struct framing *framing,
                 struct picture *picture, struct nacre_error *error)
{
    size_t pixels = pixels_of(frames);
    double gains[COLOURS];
    int status = picture_allocate(picture, frames->width, frames->height, error);
    float *mosaic = calloc(pixels, 4 * sizeof *mosaic);
    if (status == NACRE_OK && !mosaic) {
        status = nacre_fail_memory(error, "a picture");
    }
    if (status != NACRE_OK || !mosaic) {
        goto out;
    }
    find_gains(frames, &framing->crop, gains);
    fill_mosaic(frames, gains, mosaic);
    float *planes = mosaic + pixels;
    if (frames->bayer != BAYER_MONO) {
        demosaic_malvar(mosaic, frames->width, frames->height, frames->bayer, planes);
    }
    for (size_t i = 0; i < pixels; i++) {
        bool full = frames->shown[0][i] >= frames->full_scale;
        for (size_t c = 0; c < 3; c++) {
            float value = frames->bayer == BAYER_MONO ? mosaic[i] : planes[c * pixels + i];
            picture->rgb[3 * i + c] = full ? saturated_color[c] : fmaxf(value, 0);
        }
    }
    if (framing->found) {
        draw_outline(picture, framing->corners);
    }
out:
    if (status != NACRE_OK) {
        picture_finish(picture);
    }
    free(mosaic);
    return status;
}
