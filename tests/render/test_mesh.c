/* Meshes: built-in shapes, loading, checking, splitting. */
#include "render/mesh.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

static struct mesh mesh;
static struct nacre_error error;
static const double pi = 3.14159265358979323846;

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
}

void tearDown(void)
{
    mesh_finish(&mesh);
    scratch_remove();
}

/* Volume enclosed, positive where triangles run counter-clockwise seen from outside. */
static double volume(void)
{
    double sum = 0;
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        const uint32_t *t = mesh.triangles[i];
        sum +=
            vec3_dot(vec3_from(mesh.positions[t[0]]),
                     vec3_cross(vec3_from(mesh.positions[t[1]]), vec3_from(mesh.positions[t[2]]))) /
            6;
    }
    return sum;
}

/* Triangles whose own normal points away from the normals of their corners. */
static int disagreeing(void)
{
    int count = 0;
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        const uint32_t *t = mesh.triangles[i];
        struct vec3 a = vec3_from(mesh.positions[t[0]]);
        struct vec3 cross = vec3_cross(vec3_subtract(vec3_from(mesh.positions[t[1]]), a),
                                       vec3_subtract(vec3_from(mesh.positions[t[2]]), a));
        for (int k = 0; k < 3; k++) {
            count += vec3_dot(cross, vec3_from(mesh.normals[t[k]])) <= 0;
        }
    }
    return count;
}

static double largest_extent(void)
{
    struct vec3 low, high;
    mesh_bounds(&mesh, &low, &high);
    return fmax(high.x - low.x, fmax(high.y - low.y, high.z - low.z));
}

static void shapes_have_their_size_and_face_outwards(void)
{
    const double sides[3] = {3, 4, 5};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 60, volume());
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 94, mesh_area_mm2(&mesh));
    TEST_ASSERT_EQUAL_INT(0, disagreeing());
    mesh_finish(&mesh);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_sphere(&mesh, 2, 0.05, &error));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 4.0 / 3 * pi * 8, volume()); /* facets of 1/40 radius: 2e-4 */
    TEST_ASSERT_EQUAL_INT(0, disagreeing());
    mesh_finish(&mesh);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_knot(&mesh, 50, 0.6, 0.5, &error));
    /* The curve is 5.6565 units wide along y, the tube adds its radius of 0.6 at both ends, and the size of 50 is that of a
     * ring 2 (3 + 0.6) units wide. Facets take away e^2 / (8 r) at each end, 0.0075 for 0.5 on a radius of 4.17. */
    TEST_ASSERT_DOUBLE_WITHIN(0.02, (5.6565 + 1.2) * 50 / 7.2, largest_extent());
    TEST_ASSERT_EQUAL_INT(0, disagreeing());
    TEST_ASSERT_TRUE(volume() > 0);
    mesh_finish(&mesh);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 3, 2, &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 6, mesh_area_mm2(&mesh));
    TEST_ASSERT_EQUAL_INT(0, disagreeing());
}

/* The texture coordinates of built-in shapes are mm: they cover the area of the surface. */
static void texture_coordinates_of_shapes_are_in_mm(void)
{
    double area = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_knot(&mesh, 50, 0.5, 0.4, &error));
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        const uint32_t *t = mesh.triangles[i];
        const float *a = mesh.uv[t[0]], *b = mesh.uv[t[1]], *c = mesh.uv[t[2]];
        area += fabs(((double)b[0] - a[0]) * ((double)c[1] - a[1]) -
                     ((double)b[1] - a[1]) * ((double)c[0] - a[0])) /
                2;
    }
    /* A bent tube has the area of a straight one (Pappus). Chords of 0.4 on its radius of 3.57 are shorter than their arcs
     * by (0.4 / 3.57)^2 / 24 = 0.05 %; along the tube, which bends less, by less. */
    TEST_ASSERT_DOUBLE_WITHIN(0.001 * area, area, mesh_area_mm2(&mesh));
}

static bool same_place(const float a[3], const float b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* Edges of a closed mesh have two triangles; vertices at the same place count as one. */
static int open_edges(void)
{
    int open = 0;
    for (size_t i = 0; i < mesh.triangle_count; i++) {
        for (int k = 0; k < 3; k++) {
            const float *a = mesh.positions[mesh.triangles[i][k]];
            const float *b = mesh.positions[mesh.triangles[i][(k + 1) % 3]];
            bool found = false;
            for (size_t j = 0; j < mesh.triangle_count * 3 && !found; j++) {
                const float *c = mesh.positions[mesh.triangles[j / 3][j % 3]];
                const float *d = mesh.positions[mesh.triangles[j / 3][(j + 1) % 3]];
                found = same_place(a, d) && same_place(b, c);
            }
            open += !found;
        }
    }
    return open;
}

static double longest_edge(void)
{
    double longest = 0;
    for (size_t i = 0; i < mesh.triangle_count * 3; i++) {
        struct vec3 a = vec3_from(mesh.positions[mesh.triangles[i / 3][i % 3]]);
        struct vec3 b = vec3_from(mesh.positions[mesh.triangles[i / 3][(i + 1) % 3]]);
        longest = fmax(longest, vec3_length(vec3_subtract(a, b)));
    }
    return longest;
}

static double allowed_by_height(const void *context, const struct mesh *split, uint32_t a,
                                uint32_t b)
{
    (void)context;
    return split->positions[a][2] + split->positions[b][2] > 0 ? 0.3 : 10;
}

static void splitting_leaves_no_long_edge_no_crack_and_the_same_surface(void)
{
    const double sides[3] = {3, 4, 5}, edge = 0.9;
    bool limited = true;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mesh_subdivide(&mesh, mesh_edge_even, &edge, 10000, &limited, &error));
    TEST_ASSERT_FALSE(limited);
    TEST_ASSERT_TRUE(longest_edge() <= edge * 1.00001);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 94, mesh_area_mm2(&mesh));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 60, volume());
    TEST_ASSERT_EQUAL_INT(0, disagreeing());
    TEST_ASSERT_EQUAL_INT(0, open_edges());
    mesh_finish(&mesh);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mesh_subdivide(&mesh, allowed_by_height, NULL, 100000, &limited, &error));
    TEST_ASSERT_TRUE(mesh.triangle_count > 500);
    TEST_ASSERT_EQUAL_INT(0, open_edges());
}

static void splitting_stops_at_the_limit(void)
{
    const double sides[3] = {3, 4, 5}, edge = 1e-3;
    bool limited = false;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mesh_subdivide(&mesh, mesh_edge_even, &edge, 1000, &limited, &error));
    TEST_ASSERT_TRUE(limited);
    TEST_ASSERT_TRUE(mesh.triangle_count <= 1000 && mesh.triangle_count > 200);
}

static double allowed_off_the_ground(const void *context, const struct mesh *split, uint32_t a,
                                     uint32_t b)
{
    (void)context;
    float one = split->positions[a][2], other = split->positions[b][2];
    return fminf(one, other) <= 0 && fmaxf(one, other) > 0 ? 0 : 10;
}

/* Each round leaves edges that begin on the ground, as many as the one before; they would be halved for ever. */
static void splitting_ends_where_a_rule_cannot_be_met(void)
{
    const double sides[3] = {3, 4, 5};
    bool limited = false;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
    struct motion stand = mesh_placement(&mesh, (const double[3]){0, 0, 0}, (struct vec3){0, 0, 0});
    mesh_move(&mesh, &stand);
    TEST_ASSERT_EQUAL_INT(
        NACRE_OK, mesh_subdivide(&mesh, allowed_off_the_ground, NULL, 10000000, &limited, &error));
    TEST_ASSERT_TRUE(limited);
    TEST_ASSERT_TRUE(mesh.triangle_count < 100000); /* long before the limit */
}

static int load(const char *text)
{
    scratch_store("mesh.obj", text, strlen(text));
    return mesh_load(scratch_path("mesh.obj"), &mesh, &error);
}

static void a_mesh_file_is_loaded_and_scaled(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK,
        load("v 0 0 0\nv 4 0 0\nv 4 2 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 1 0.5\n"
             "vt 0 0.5\nf 1/1 2/2 3/3 4/4\n"),
        error.text);
    TEST_ASSERT_EQUAL_UINT64(2, mesh.triangle_count);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_scale(&mesh, 20, "mesh", &error));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 20, largest_extent());
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 200, mesh_area_mm2(&mesh));
    /* The texture's 1 x 0.5 has become the surface's 20 x 10 mm. */
    float high = 0;
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        high = fmaxf(high, mesh.uv[i][0]);
        TEST_ASSERT_FLOAT_WITHIN(1e-6F, 1, mesh.normals[i][2]);
    }
    TEST_ASSERT_FLOAT_WITHIN(1e-3F, 20, high);
}

static void a_mesh_that_is_missing_is_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_load(scratch_path("absent.ply"), &mesh, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "absent.ply"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "No such file"), error.text);
}

static void a_mesh_without_triangles_is_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, load("v 0 0 0\nv 1 0 0\nl 1 2\n"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mesh.obj"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no triangles"), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, load("rubbish\n"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mesh.obj"), error.text);
}

static void a_file_that_promises_more_than_it_holds_is_refused_before_it_takes_memory(void)
{
    static const char ply[] =
        "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\nabc";
    scratch_store("mesh.ply", ply, sizeof ply - 1);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_load(scratch_path("mesh.ply"), &mesh, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "vertex 0 of the 2000000000"), error.text);
}

#define PLY_HEADER(format)                                                                         \
    "ply\nformat " format " 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"           \
    "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"

static int load_ply(const char *bytes, size_t size)
{
    scratch_store("mesh.ply", bytes, size);
    return mesh_load(scratch_path("mesh.ply"), &mesh, &error);
}

/* Wherever it is cut: Assimp would take zeros for what is missing, wait for ever for the header's end, or abort. */
static void a_ply_that_is_cut_off_is_refused(void)
{
    static const char text[] = PLY_HEADER("ascii") "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
    static const char header[] = PLY_HEADER("binary_little_endian");
    static const float places[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    static const char faces[] = "\3\0\0\0\0\1\0\0\0\2\0\0\0\3\0\0\0\0\2\0\0\0\3\0\0\0";
    char binary[sizeof header + sizeof places + sizeof faces];
    size_t size = 0;
    memcpy(binary, header, sizeof header - 1);
    size += sizeof header - 1;
    memcpy(binary + size, places, sizeof places); /* on a machine whose first byte is the least */
    size += sizeof places;
    memcpy(binary + size, faces, sizeof faces - 1);
    size += sizeof faces - 1;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, load_ply(text, sizeof text - 1), error.text);
    TEST_ASSERT_EQUAL_UINT64(2, mesh.triangle_count);
    mesh_finish(&mesh);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, load_ply(binary, size), error.text);
    TEST_ASSERT_EQUAL_UINT64(2, mesh.triangle_count);
    mesh_finish(&mesh);
    for (size_t i = 4; i < size; i += i < sizeof header ? 7 : 1) {
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, load_ply(binary, i));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "cut off"), error.text);
    }
    for (size_t i = 4; i < sizeof text - 3; i += 3) { /* the last digit and newline may go */
        TEST_ASSERT_EQUAL_INT(NACRE_FAILED, load_ply(text, i));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mesh.ply"), error.text);
    }
}

static void a_ply_with_a_short_line_or_an_empty_face_is_refused(void)
{
    static const char brief[] = PLY_HEADER("ascii") "0 0 0\n1 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
    static const char none[] = PLY_HEADER("ascii") "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n0\n";
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, load_ply(brief, sizeof brief - 1));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mesh.ply:11: "), error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, load_ply(none, sizeof none - 1));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no corners"), error.text);
}

static void an_empty_or_enormous_file_is_refused(void)
{
    scratch_store("mesh.ply", "", 0);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_load(scratch_path("mesh.ply"), &mesh, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mesh.ply: the mesh's file is empty"),
                                 error.text);
    scratch_store("mesh.obj", "v 0 0 0\n", 8);
    /* Holes take no room on the disk. */
    TEST_ASSERT_EQUAL_INT(0, truncate(scratch_path("mesh.obj"), INT64_C(5) << 30));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_load(scratch_path("mesh.obj"), &mesh, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "5.4 GB is larger than the limit of 4.3 GB"),
                                 error.text);
}

static void a_folder_is_no_mesh(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_load(scratch_path(""), &mesh, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no regular file"), error.text);
}

static void open_and_crowded_edges_are_counted(void)
{
    const double sides[3] = {3, 4, 5};
    size_t open = 9, crowded = 9;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_count_edges(&mesh, &open, &crowded, &error));
    TEST_ASSERT_EQUAL_UINT64(0, open); /* though each face has vertices of its own */
    TEST_ASSERT_EQUAL_UINT64(0, crowded);
    mesh.triangle_count -= 2;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_count_edges(&mesh, &open, &crowded, &error));
    TEST_ASSERT_EQUAL_UINT64(4, open);
    TEST_ASSERT_EQUAL_UINT64(0, crowded);
    mesh_finish(&mesh);
    /* Three triangles on one edge, as a book's pages. */
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, load("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n"),
        error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_count_edges(&mesh, &open, &crowded, &error));
    TEST_ASSERT_EQUAL_UINT64(6, open);
    TEST_ASSERT_EQUAL_UINT64(1, crowded);
}

/* Assimp itself crashes on such a file. */
static void a_file_with_indices_past_its_vertices_is_refused(void)
{
    static const char ply[] =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 2000000000\n";
    scratch_store("mesh.ply", ply, sizeof ply - 1);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_load(scratch_path("mesh.ply"), &mesh, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mesh.ply"), error.text);
}

static void a_mesh_of_no_area_is_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, load("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "area"), error.text);
}

static void triangles_of_no_area_are_left_out(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, load("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 4\n"), error.text);
    TEST_ASSERT_EQUAL_UINT64(1, mesh.triangle_count);
    TEST_ASSERT_EQUAL_UINT64(1, mesh.degenerate_count);
}

static void coordinates_that_are_no_place_are_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 1, 1, &error));
    mesh.positions[2][1] = NAN;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_check(&mesh, "mine", &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mine: vertex 2"), error.text);
    mesh.positions[2][1] = 1e30F;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_check(&mesh, "mine", &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "mine: vertex 2"), error.text);
}

static void an_index_past_the_vertices_is_refused(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 1, 1, &error));
    mesh.triangles[1][0] = 4;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, mesh_check(&mesh, "mine", &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "triangle 1"), error.text);
}

static void too_large_a_mesh_is_refused_before_it_takes_memory(void)
{
    TEST_ASSERT_EQUAL_INT(
        NACRE_FAILED, mesh_allocate(&mesh, 3, (size_t)MESH_TRIANGLES_MAXIMUM + 1, false, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          mesh_allocate(&mesh, (size_t)UINT32_MAX + 1, 1, false, &error));
}

static void a_placed_mesh_stands_on_its_position(void)
{
    const double sides[3] = {2, 4, 6}, turn[3] = {90, 0, 30};
    struct vec3 low, high;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
    struct motion motion = mesh_placement(&mesh, turn, (struct vec3){10, 20, 30});
    mesh_move(&mesh, &motion);
    mesh_bounds(&mesh, &low, &high);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 30, low.z);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 34, high.z); /* turned about x, the depth of 4 stands up */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 10, (low.x + high.x) / 2);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 20, (low.y + high.y) / 2);
    TEST_ASSERT_EQUAL_INT(0, disagreeing());
    struct vec3 there = motion_move(&motion, (struct vec3){1, 2, 3});
    struct vec3 back = motion_move_back(&motion, there);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 2, back.y);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(shapes_have_their_size_and_face_outwards);
    RUN_TEST(texture_coordinates_of_shapes_are_in_mm);
    RUN_TEST(splitting_leaves_no_long_edge_no_crack_and_the_same_surface);
    RUN_TEST(splitting_stops_at_the_limit);
    RUN_TEST(splitting_ends_where_a_rule_cannot_be_met);
    RUN_TEST(a_mesh_file_is_loaded_and_scaled);
    RUN_TEST(a_mesh_that_is_missing_is_refused);
    RUN_TEST(a_mesh_without_triangles_is_refused);
    RUN_TEST(a_file_that_promises_more_than_it_holds_is_refused_before_it_takes_memory);
    RUN_TEST(a_ply_that_is_cut_off_is_refused);
    RUN_TEST(a_ply_with_a_short_line_or_an_empty_face_is_refused);
    RUN_TEST(an_empty_or_enormous_file_is_refused);
    RUN_TEST(a_folder_is_no_mesh);
    RUN_TEST(open_and_crowded_edges_are_counted);
    RUN_TEST(a_file_with_indices_past_its_vertices_is_refused);
    RUN_TEST(a_mesh_of_no_area_is_refused);
    RUN_TEST(triangles_of_no_area_are_left_out);
    RUN_TEST(coordinates_that_are_no_place_are_refused);
    RUN_TEST(an_index_past_the_vertices_is_refused);
    RUN_TEST(too_large_a_mesh_is_refused_before_it_takes_memory);
    RUN_TEST(a_placed_mesh_stands_on_its_position);
    return UNITY_END();
}
