/* Drawing radiance into a picture by texture coordinates, with padding round the charts. */
#include "render/radiance.h"

#include <stdlib.h>
#include <string.h>

/* A picture on its way. Texel (x, y) has its middle at (x + 0.5, y + 0.5); rows run down. */
struct canvas {
    const struct radiance *radiance;
    struct picture *picture;
    float *
        distance; /* of each texel to where its value is from, in texels; 0: covered; HUGE_VALF: no value */
    struct texel_counts *counts;
};

struct point2 {
    double x, y;
};

static struct point2 corner(const struct canvas *canvas, uint32_t vertex)
{
    const float *uv = canvas->radiance->mesh.uv[vertex];
    return (struct point2){(double)uv[0] * canvas->picture->width,
                           (1 - (double)uv[1]) * canvas->picture->height};
}

/* Texels between `from` and `to` whose middle can lie between two coordinates. */
static void texel_range(double low, double high, int size, int *from, int *to)
{
    *from = (int)fmin(fmax(ceil(low - 0.5 - 1e-6), 0), size);
    *to = (int)fmin(fmax(floor(high - 0.5 + 1e-6) + 1, 0), size);
}

static void set_texel(struct canvas *canvas, size_t index, const uint32_t *vertices,
                      const double *weights, int count)
{
    for (int c = 0; c < 3; c++) {
        double sum = 0;
        for (int k = 0; k < count; k++) {
            sum += weights[k] * canvas->radiance->rgb[vertices[k]][c];
        }
        canvas->picture->rgb[3 * index + (size_t)c] = (float)sum;
    }
}

static void draw_triangle(struct canvas *canvas, const uint32_t t[3])
{
    /* Middles on a common edge belong to both neighbours, which is no overlap. */
    const double edge = 1e-9, inner = 1e-4;
    struct point2 a = corner(canvas, t[0]), b = corner(canvas, t[1]), c = corner(canvas, t[2]);
    double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    int left, right, top, bottom, width = canvas->picture->width;
    texel_range(fmin(a.x, fmin(b.x, c.x)), fmax(a.x, fmax(b.x, c.x)), width, &left, &right);
    texel_range(fmin(a.y, fmin(b.y, c.y)), fmax(a.y, fmax(b.y, c.y)), canvas->picture->height, &top,
                &bottom);
    for (int y = top; y < bottom && area != 0; y++) {
        for (int x = left; x < right; x++) {
            double px = x + 0.5 - a.x, py = y + 0.5 - a.y;
            double w[3];
            w[1] = (px * (c.y - a.y) - py * (c.x - a.x)) / area;
            w[2] = ((b.x - a.x) * py - (b.y - a.y) * px) / area;
            w[0] = 1 - w[1] - w[2];
            double least = fmin(w[0], fmin(w[1], w[2]));
            size_t index = (size_t)y * (size_t)width + (size_t)x;
            if (least < -edge) {
                continue;
            }
            if (canvas->distance[index] > 0) {
                canvas->distance[index] = 0;
                canvas->counts->covered++;
                set_texel(canvas, index, t, w, 3);
            } else if (least > inner) {
                canvas->counts->overlapped++;
            }
        }
    }
}

/* Texels outside that lie nearer to this edge than to those before. */
static void pad_edge(struct canvas *canvas, uint32_t first, uint32_t second, int padding)
{
    const uint32_t vertices[2] = {first, second};
    struct point2 a = corner(canvas, first), b = corner(canvas, second);
    double dx = b.x - a.x, dy = b.y - a.y, square = dx * dx + dy * dy;
    int left, right, top, bottom, width = canvas->picture->width;
    texel_range(fmin(a.x, b.x) - padding, fmax(a.x, b.x) + padding, width, &left, &right);
    texel_range(fmin(a.y, b.y) - padding, fmax(a.y, b.y) + padding, canvas->picture->height, &top,
                &bottom);
    for (int y = top; y < bottom; y++) {
        for (int x = left; x < right; x++) {
            double px = x + 0.5 - a.x, py = y + 0.5 - a.y;
            double along = square > 0 ? fmin(fmax((px * dx + py * dy) / square, 0), 1) : 0;
            double away = hypot(px - along * dx, py - along * dy);
            size_t index = (size_t)y * (size_t)width + (size_t)x;
            if (away <= padding && away < canvas->distance[index]) {
                const double w[2] = {1 - along, along};
                canvas->counts->padded += !isfinite(canvas->distance[index]);
                canvas->distance[index] = (float)away;
                set_texel(canvas, index, vertices, w, 2);
            }
        }
    }
}

static int compare_edges(const void *a, const void *b)
{
    uint64_t one = *(const uint64_t *)a, two = *(const uint64_t *)b;
    return (one > two) - (one < two);
}

/* Edges of one triangle alone bound a chart. */
static int pad(struct canvas *canvas, int padding, struct nacre_error *error)
{
    const struct mesh *mesh = &canvas->radiance->mesh;
    size_t count = 3 * mesh->triangle_count;
    uint64_t *edges = calloc(count + 1, sizeof *edges);
    if (!edges) {
        return nacre_fail_memory(error, "the borders of the texture's charts");
    }
    for (size_t i = 0; i < count; i++) {
        uint32_t a = mesh->triangles[i / 3][i % 3], b = mesh->triangles[i / 3][(i + 1) % 3];
        edges[i] = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    }
    qsort(edges, count, sizeof *edges, compare_edges);
    for (size_t i = 0; i < count; i++) {
        bool shared =
            (i > 0 && edges[i - 1] == edges[i]) || (i + 1 < count && edges[i + 1] == edges[i]);
        if (!shared) {
            pad_edge(canvas, (uint32_t)(edges[i] >> 32), (uint32_t)edges[i], padding);
        }
    }
    free(edges);
    return NACRE_OK;
}

static int check_coordinates(const struct mesh *mesh, struct nacre_error *error)
{
    const float slack = 1e-4F; /* of rounding in modelling programs */
    if (!mesh->uv) {
        return nacre_fail(error, "the mesh has no texture coordinates, which a picture of its "
                                 "radiance needs; write a .ply, which has it per vertex");
    }
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (int k = 0; k < 2; k++) {
            if (mesh->uv[i][k] < -slack || mesh->uv[i][k] > 1 + slack) {
                return nacre_fail(error,
                                  "the mesh has a texture coordinate of %g, outside 0 to 1: a "
                                  "picture cannot hold tiles; write a .ply, or unwrap the mesh",
                                  mesh->uv[i][k]);
            }
        }
    }
    return NACRE_OK;
}

int radiance_draw_texels(const struct radiance *radiance, int width, int padding,
                         struct picture *picture, struct texel_counts *counts,
                         struct nacre_error *error)
{
    const struct mesh *mesh = &radiance->mesh;
    struct canvas canvas = {.radiance = radiance, .picture = picture, .counts = counts};
    *picture = (struct picture){0};
    *counts = (struct texel_counts){0};
    if (check_coordinates(mesh, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    double height = fmax(round(width / radiance->aspect), 1);
    if (picture_allocate(picture, width, (int)fmin(height, 1 << 20), error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    size_t count = (size_t)picture->width * (size_t)picture->height;
    int status = NACRE_OK;
    canvas.distance = calloc(count, sizeof *canvas.distance);
    if (!canvas.distance) {
        status = nacre_fail_memory(error, "a picture of radiance");
        goto out;
    }
    for (size_t i = 0; i < count; i++) {
        canvas.distance[i] = HUGE_VALF;
    }
    for (size_t i = 0; i < mesh->triangle_count; i++) {
        draw_triangle(&canvas, mesh->triangles[i]);
    }
    status = pad(&canvas, padding, error);
out:
    free(canvas.distance);
    if (status != NACRE_OK) {
        picture_finish(picture);
    }
    return status;
}
