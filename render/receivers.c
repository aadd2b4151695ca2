/* Turning vertices into receivers, with the material interpolated between surface points. */
#include "render/receivers.h"

#include <math.h>
#include <stdlib.h>

enum { CORNERS = 4 };

/* The four surface points around a place and their bilinear weights. */
struct corners {
    size_t texels[CORNERS];
    double weights[CORNERS];
};

static struct corners corners_at(const struct mapping *mapping, double x, double y)
{
    struct corners corners;
    double x0 = floor(x - 0.5), y0 = floor(y - 0.5);
    double fx = x - 0.5 - x0, fy = y - 0.5 - y0;
    for (int k = 0; k < CORNERS; k++) {
        int column = mapping_wrap((int64_t)x0 + (k & 1), mapping->width, mapping->mirror);
        int row = mapping_wrap((int64_t)y0 + (k >> 1), mapping->height, mapping->mirror);
        corners.texels[k] = (size_t)row * (size_t)mapping->width + (size_t)column;
        corners.weights[k] = ((k & 1) ? fx : 1 - fx) * ((k >> 1) ? fy : 1 - fy);
    }
    return corners;
}

void receivers_lookup(const struct mesh *mesh, const struct mapping *mapping, size_t vertex,
                      const float *plane, double out[3])
{
    struct mapped charts[MAPPING_CHARTS_MAXIMUM];
    int count = mapping_vertex(mapping, mesh, vertex, charts);
    out[0] = out[1] = out[2] = 0;
    for (int i = 0; i < count; i++) {
        struct corners corners = corners_at(mapping, charts[i].x, charts[i].y);
        for (size_t k = 0; k < CORNERS; k++) {
            for (size_t c = 0; c < 3; c++) {
                out[c] += charts[i].weight * corners.weights[k] * plane[corners.texels[k] * 3 + c];
            }
        }
    }
}

/* Directions of equal scale, the longer of length 1; any frame where the mapping has none. */
static void set_directions(struct receiver *receiver, const struct mapped *chart,
                           struct vec3 normal)
{
    double scale = fmax(vec3_length(chart->along_x), vec3_length(chart->along_y));
    struct vec3 x = chart->along_x, y = chart->along_y;
    if (!(scale > 0) || !isfinite(scale)) {
        x = vec3_perpendicular(normal);
        y = vec3_cross(normal, x);
        scale = 1;
    }
    vec3_store(vec3_scale(x, 1 / scale), receiver->along_x);
    vec3_store(vec3_scale(y, 1 / scale), receiver->along_y);
}

static struct receiver receiver_at(const struct mesh *mesh, const struct mapping *mapping,
                                   size_t vertex, const struct mapped *chart)
{
    struct vec3 normal = vec3_from(mesh->normals[vertex]);
    bool mirror = mapping->mirror;
    struct receiver receiver = {
        .chart = chart->chart,
        .flip_x = mapping_mirrored((int64_t)floor(chart->x), mapping->width, mirror) ? -1 : 1,
        .flip_y = mapping_mirrored((int64_t)floor(chart->y), mapping->height, mirror) ? -1 : 1,
    };
    vec3_store(vec3_from(mesh->positions[vertex]), receiver.position);
    vec3_store(normal, receiver.normal);
    set_directions(&receiver, chart, normal);
    receiver.along_x[3] = (float)chart->x;
    receiver.along_y[3] = (float)chart->y;
    return receiver;
}

/* Distinct kernel columns among the corners. Only layout pair has more than the one column 0. */
static size_t columns_at(const struct appearance *appearance, const struct corners *corners,
                         uint32_t columns[], size_t capacity)
{
    size_t count = 0;
    columns[0] = 0;
    if (appearance->layout != NACRE_KERNEL_PAIR) {
        return 1;
    }
    for (size_t k = 0; k < CORNERS; k++) {
        for (size_t a = 0; a < (size_t)appearance->mixed; a++) {
            size_t place = corners->texels[k] * (size_t)appearance->mixed + a;
            size_t i = 0;
            while (i < count && columns[i] != appearance->ids[place]) {
                i++;
            }
            if (i == count && count < capacity && appearance->weights[place] > 0) {
                columns[count++] = appearance->ids[place];
            }
        }
    }
    return count;
}

/* How much of surface point `texel` belongs to a column. */
static double column_share(const struct appearance *appearance, size_t texel, uint32_t column)
{
    double share = 0;
    if (appearance->layout != NACRE_KERNEL_PAIR) {
        return 1;
    }
    for (size_t a = 0; a < (size_t)appearance->mixed; a++) {
        size_t place = texel * (size_t)appearance->mixed + a;
        share += appearance->ids[place] == column ? appearance->weights[place] : 0;
    }
    return share;
}

static void set_h(const struct appearance *appearance, const struct corners *corners, double weight,
                  uint32_t column, float *h)
{
    size_t size = (size_t)appearance->factor_channels * (size_t)appearance->terms;
    for (size_t k = 0; k < CORNERS; k++) {
        double share =
            weight * corners->weights[k] * column_share(appearance, corners->texels[k], column);
        const float *from = appearance->h + corners->texels[k] * size;
        for (size_t i = 0; i < size; i++) {
            h[i] += (float)(share * from[i]);
        }
    }
}

static int grow(struct receivers *receivers, size_t *capacity, size_t h_size,
                struct nacre_error *error)
{
    if (receivers->count < *capacity) {
        return NACRE_OK;
    }
    size_t wanted = *capacity + *capacity / 2;
    struct receiver *list = realloc(receivers->list, wanted * sizeof *list);
    receivers->list = list ? list : receivers->list;
    uint32_t *vertices = realloc(receivers->vertices, wanted * sizeof *vertices);
    receivers->vertices = vertices ? vertices : receivers->vertices;
    float *h = realloc(receivers->h, wanted * h_size * sizeof *h);
    receivers->h = h ? h : receivers->h;
    *capacity = wanted;
    return list && vertices && h ? NACRE_OK : nacre_fail_memory(error, "the mesh's receivers");
}

int receivers_make(struct receivers *receivers, const struct mesh *mesh,
                   const struct mapping *mapping, const struct appearance *appearance,
                   struct nacre_error *error)
{
    size_t h_size = (size_t)appearance->factor_channels * (size_t)appearance->terms;
    size_t capacity = mesh->vertex_count + 16;
    *receivers = (struct receivers){
        .list = calloc(capacity, sizeof *receivers->list),
        .vertices = calloc(capacity, sizeof *receivers->vertices),
        .h = calloc(capacity * h_size, sizeof *receivers->h),
    };
    if (!receivers->list || !receivers->vertices || !receivers->h) {
        receivers_finish(receivers);
        return nacre_fail_memory(error, "the mesh's receivers");
    }
    for (size_t vertex = 0; vertex < mesh->vertex_count; vertex++) {
        struct mapped charts[MAPPING_CHARTS_MAXIMUM];
        int count = mapping_vertex(mapping, mesh, vertex, charts);
        for (int i = 0; i < count; i++) {
            struct corners corners = corners_at(mapping, charts[i].x, charts[i].y);
            uint32_t columns[16];
            size_t column_count =
                columns_at(appearance, &corners, columns, sizeof columns / sizeof *columns);
            for (size_t j = 0; j < column_count; j++) {
                if (grow(receivers, &capacity, h_size, error) != NACRE_OK) {
                    receivers_finish(receivers);
                    return NACRE_FAILED;
                }
                float *h = receivers->h + receivers->count * h_size;
                for (size_t t = 0; t < h_size; t++) {
                    h[t] = 0;
                }
                set_h(appearance, &corners, charts[i].weight, columns[j], h);
                receivers->list[receivers->count] = receiver_at(mesh, mapping, vertex, &charts[i]);
                receivers->list[receivers->count].column = (int32_t)columns[j];
                receivers->vertices[receivers->count++] = (uint32_t)vertex;
            }
        }
    }
    return NACRE_OK;
}

void receivers_finish(struct receivers *receivers)
{
    free(receivers->list);
    free(receivers->vertices);
    free(receivers->h);
    *receivers = (struct receivers){0};
}
