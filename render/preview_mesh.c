/* Handing meshes to OpenGL in pieces, and drawing those in view. */
#include "render/preview_mesh.h"

#include "render/bundles.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A piece's vertices fit a core's cache, and its test costs nothing beside them. */
enum { PIECE_TRIANGLES = 2048 };

/* One attribute of three floats a vertex; NULL: zeros. */
static int upload_attribute(const struct osmesa *gl, GLuint location, const float (*values)[3],
                            size_t count, struct nacre_error *error)
{
    GLuint buffer;
    float(*zeros)[3] = values ? NULL : calloc(count, sizeof *zeros);
    if (!values && !zeros) {
        return nacre_fail_memory(error, "a preview");
    }
    gl->GenBuffers(1, &buffer);
    gl->BindBuffer(GL_ARRAY_BUFFER, buffer);
    gl->BufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(count * sizeof *values),
                   values ? (const void *)values : zeros, GL_STATIC_DRAW);
    gl->EnableVertexAttribArray(location);
    gl->VertexAttribPointer(location, 3, GL_FLOAT, GL_FALSE, 0, NULL);
    free(zeros);
    return NACRE_OK;
}

/* Triangles in the order of a curve that fills space. */
static int sort_triangles(const struct mesh *mesh, uint32_t (*sorted)[3])
{
    size_t count = mesh->triangle_count;
    float(*middles)[3] = calloc(count + 1, sizeof *middles);
    uint32_t *order = calloc(count + 1, sizeof *order);
    int status = middles && order ? 0 : -1;
    for (size_t i = 0; status == 0 && i < count; i++) {
        for (int k = 0; k < 9; k++) {
            middles[i][k % 3] += mesh->positions[mesh->triangles[i][k / 3]][k % 3] / 3;
        }
        order[i] = (uint32_t)i;
    }
    if (status == 0) {
        status = bundles_order(middles[0], 3, order, count);
    }
    for (size_t i = 0; status == 0 && i < count; i++) {
        memcpy(sorted[i], mesh->triangles[order[i]], sizeof sorted[i]);
    }
    free(middles);
    free(order);
    return status;
}

static struct preview_piece piece_of(const struct mesh *mesh, const uint32_t (*sorted)[3],
                                     size_t first, size_t end)
{
    const uint32_t *corners = sorted[first];
    struct preview_piece piece = {.first = 3 * first, .count = 3 * (end - first)};
    struct bundle_box box = bundles_box(mesh->positions[0], 3, corners, piece.count);
    struct vec3 low = vec3_from(box.low), high = vec3_from(box.high);
    piece.middle = vec3_scale(vec3_add(low, high), 0.5);
    piece.radius_mm = vec3_length(vec3_subtract(high, low)) / 2;
    return piece;
}

int preview_mesh_make(struct preview_mesh *made, const struct osmesa *gl, const struct mesh *mesh,
                      const float (*light)[3], struct nacre_error *error)
{
    GLuint indices;
    size_t count = mesh->triangle_count;
    uint32_t(*sorted)[3] = calloc(count + 1, sizeof *sorted);
    *made = (struct preview_mesh){0};
    made->pieces = calloc(count / PIECE_TRIANGLES + 1, sizeof *made->pieces);
    if (!sorted || !made->pieces || sort_triangles(mesh, sorted) != 0) {
        free(sorted);
        return nacre_fail_memory(error, "a preview");
    }
    for (size_t first = 0; first < count; first += PIECE_TRIANGLES) {
        size_t end = count - first < PIECE_TRIANGLES ? count : first + PIECE_TRIANGLES;
        made->pieces[made->piece_count++] =
            piece_of(mesh, (const uint32_t(*)[3])sorted, first, end);
    }
    gl->GenVertexArrays(1, &made->array);
    gl->BindVertexArray(made->array);
    int status =
        upload_attribute(gl, 0, (const float(*)[3])mesh->positions, mesh->vertex_count, error);
    if (status == NACRE_OK) {
        status =
            upload_attribute(gl, 1, (const float(*)[3])mesh->normals, mesh->vertex_count, error);
    }
    if (status == NACRE_OK) {
        status = upload_attribute(gl, 2, light, mesh->vertex_count, error);
    }
    gl->GenBuffers(1, &indices);
    gl->BindBuffer(GL_ELEMENT_ARRAY_BUFFER, indices);
    gl->BufferData(GL_ELEMENT_ARRAY_BUFFER, (GLsizeiptr)(count * sizeof *sorted), sorted,
                   GL_STATIC_DRAW);
    free(sorted);
    return status;
}

void preview_mesh_finish(struct preview_mesh *made)
{
    free(made->pieces);
    *made = (struct preview_mesh){0};
}

void preview_mesh_draw(const struct preview_mesh *made, const struct osmesa *gl,
                       const struct view *view)
{
    gl->BindVertexArray(made->array);
    for (size_t i = 0; i < made->piece_count;) {
        size_t first = i, count = 0;
        while (i < made->piece_count &&
               view_meets(view, made->pieces[i].middle, made->pieces[i].radius_mm)) {
            count += made->pieces[i++].count; /* neighbours in one go */
        }
        if (count > 0) {
            gl->DrawElements(GL_TRIANGLES, (GLsizei)count, GL_UNSIGNED_INT,
                             (const void *)(made->pieces[first].first * sizeof(uint32_t)));
        } else {
            i++;
        }
    }
}
