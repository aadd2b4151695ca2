/* Taking radiance from a baked object, and writing it as PLY. */
#include "render/radiance.h"

#include "nacre/exr_file.h"
#include "render/output_file.h"

#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { WIDTH_MINIMUM = 64, WIDTH_MAXIMUM = 8192 };

static void uv_bounds(const struct mesh *mesh, double low[2], double high[2])
{
    for (int k = 0; k < 2; k++) {
        low[k] = HUGE_VAL;
        high[k] = -HUGE_VAL;
        for (size_t i = 0; i < mesh->vertex_count; i++) {
            low[k] = fmin(low[k], mesh->uv[i][k]);
            high[k] = fmax(high[k], mesh->uv[i][k]);
        }
    }
}

/* From mm to the picture: as the file had them, or so that a shape's fill it. */
static void place_in_picture(struct radiance *radiance, bool from_file)
{
    struct mesh *mesh = &radiance->mesh;
    double low[2] = {0, 0}, high[2] = {mesh->uv_mm, mesh->uv_mm};
    if (!from_file) {
        uv_bounds(mesh, low, high);
    }
    radiance->aspect = (high[0] - low[0]) / (high[1] - low[1]);
    radiance->picture_mm = high[0] - low[0];
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (int k = 0; k < 2; k++) {
            mesh->uv[i][k] = (float)((mesh->uv[i][k] - low[k]) / (high[k] - low[k]));
        }
    }
}

static void move_back(struct mesh *mesh, const struct motion *motion)
{
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        struct vec3 p = motion_move_back(motion, vec3_from(mesh->positions[i]));
        vec3_store(vec3_along(mesh->middle, 1 / mesh->scale, p), mesh->positions[i]);
        vec3_store(motion_turn_back(motion, vec3_from(mesh->normals[i])), mesh->normals[i]);
    }
}

int radiance_take(struct radiance *radiance, const struct stage *stage, size_t object,
                  bool own_frame, struct nacre_error *error)
{
    const struct stage_object *source = &stage->objects[object];
    const struct mesh *mesh = &source->mesh;
    *radiance = (struct radiance){.aspect = 1, .point_mm = source->mapping.point_mm};
    if (mesh_allocate(&radiance->mesh, mesh->vertex_count, mesh->triangle_count, mesh->uv != NULL,
                      error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    radiance->rgb = calloc(mesh->vertex_count + 1, sizeof *radiance->rgb);
    if (!radiance->rgb) {
        return nacre_fail_memory(error, "the radiance of a mesh");
    }
    struct mesh *copy = &radiance->mesh;
    copy->middle = mesh->middle;
    copy->scale = mesh->scale;
    copy->uv_mm = mesh->uv_mm;
    memcpy(copy->positions, mesh->positions, mesh->vertex_count * sizeof *mesh->positions);
    memcpy(copy->normals, mesh->normals, mesh->vertex_count * sizeof *mesh->normals);
    memcpy(copy->triangles, mesh->triangles, mesh->triangle_count * sizeof *mesh->triangles);
    if (mesh->uv) {
        memcpy(copy->uv, mesh->uv, mesh->vertex_count * sizeof *mesh->uv);
        place_in_picture(radiance, stage->scene->objects[object].shape == SHAPE_MESH);
    }
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (int c = 0; c < 3; c++) {
            radiance->rgb[i][c] = (float)(source->light[i][c] / pi);
        }
    }
    if (own_frame) {
        move_back(copy, &source->mapping.motion);
    }
    return NACRE_OK;
}

void radiance_finish(struct radiance *radiance)
{
    mesh_finish(&radiance->mesh);
    free(radiance->rgb);
    *radiance = (struct radiance){0};
}

static void put_header(FILE *file, const struct radiance *radiance, const char *const *comments)
{
    static const char *const names[] = {"x", "y", "z", "nx", "ny", "nz"};
    (void)fprintf(file, "ply\nformat binary_little_endian 1.0\n");
    for (; comments && *comments; comments++) {
        /* A comment ends with its line. */
        (void)fprintf(file, "comment %.*s\n", (int)strcspn(*comments, "\r\n"), *comments);
    }
    (void)fprintf(file, "element vertex %zu\n", radiance->mesh.vertex_count);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        (void)fprintf(file, "property float %s\n", names[i]);
    }
    if (radiance->mesh.uv) {
        (void)fprintf(file, "property float s\nproperty float t\n");
    }
    (void)fprintf(file,
                  "property float red\nproperty float green\nproperty float blue\n"
                  "element face %zu\nproperty list uchar int vertex_indices\nend_header\n",
                  radiance->mesh.triangle_count);
}

/* The bytes of 32-bit values, the least first. */
static void put_words(FILE *file, const void *values, size_t count)
{
    const unsigned char *from = values;
    for (size_t i = 0; i < count; i++) {
        uint32_t word;
        memcpy(&word, from + 4 * i, 4);
        const unsigned char bytes[4] = {(unsigned char)word, (unsigned char)(word >> 8),
                                        (unsigned char)(word >> 16), (unsigned char)(word >> 24)};
        (void)fwrite(bytes, 1, sizeof bytes, file);
    }
}

/* Readers there are (Assimp) that take a first byte for more of the header's white space. */
static bool looks_like_space(float value)
{
    uint32_t word;
    memcpy(&word, &value, 4);
    return (word & 255) == ' ' || ((word & 255) >= '\t' && (word & 255) <= '\r');
}

/* The vertex to write first; the first one takes its place. */
static size_t choose_first(const struct mesh *mesh)
{
    size_t first = 0;
    while (first + 1 < mesh->vertex_count && looks_like_space(mesh->positions[first][0])) {
        first++;
    }
    return looks_like_space(mesh->positions[first][0]) ? 0 : first;
}

static uint32_t swapped(uint32_t vertex, uint32_t first)
{
    return vertex == first ? 0 : vertex == 0 ? first : vertex;
}

int radiance_write_ply(const char *path, const struct radiance *radiance,
                       const char *const *comments, struct nacre_error *error)
{
    const struct mesh *mesh = &radiance->mesh;
    struct output_file output;
    int status = output_file_open(&output, strdup(path), error);
    if (status == NACRE_OK) {
        uint32_t first = (uint32_t)choose_first(mesh);
        put_header(output.file, radiance, comments);
        for (size_t k = 0; k < mesh->vertex_count; k++) {
            size_t i = swapped((uint32_t)k, first);
            put_words(output.file, mesh->positions[i], 3);
            put_words(output.file, mesh->normals[i], 3);
            if (mesh->uv) {
                put_words(output.file, mesh->uv[i], 2);
            }
            put_words(output.file, radiance->rgb[i], 3);
        }
        for (size_t i = 0; i < mesh->triangle_count; i++) {
            (void)fputc(3, output.file);
            const uint32_t *t = mesh->triangles[i];
            const uint32_t corners[3] = {swapped(t[0], first), swapped(t[1], first),
                                         swapped(t[2], first)};
            put_words(output.file, corners, 3);
        }
    }
    return output_file_close(&output, status, error);
}

int radiance_texel_width(const struct radiance *radiance)
{
    double texels = ceil(radiance->picture_mm / radiance->point_mm / 4) * 4;
    return (int)fmin(fmax(texels, WIDTH_MINIMUM), WIDTH_MAXIMUM);
}

int radiance_write_exr(const char *path, const struct picture *picture,
                       const char *const *attributes, struct nacre_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    struct exr_file file = {0};
    size_t count = (size_t)picture->width * (size_t)picture->height;
    struct exr_part *part = exr_file_add_part(&file, "", picture->width, picture->height);
    int status = part ? NACRE_OK : nacre_fail_memory(error, path);
    for (size_t c = 0; c < 3 && status == NACRE_OK; c++) {
        struct exr_plane *plane = exr_part_add_plane(part, names[c], NACRE_FLOAT);
        if (!plane) {
            status = nacre_fail_memory(error, path);
            break;
        }
        for (size_t i = 0; i < count; i++) {
            plane->values[i] = picture->rgb[3 * i + c];
        }
    }
    for (; attributes && *attributes && status == NACRE_OK; attributes++) {
        char name[64];
        const char *equals = strchr(*attributes, '=');
        int length = equals ? (int)(equals - *attributes) : 0;
        (void)snprintf(name, sizeof name, "nacre.%.*s", length, *attributes);
        if (exr_part_add_string(part, name, equals ? equals + 1 : "") != NACRE_OK) {
            status = nacre_fail_memory(error, path);
        }
    }
    if (status == NACRE_OK) {
        status = exr_file_write(path, &file, EXR_ZIP, error);
    }
    exr_file_finish(&file);
    return status;
}
