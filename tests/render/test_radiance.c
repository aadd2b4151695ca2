/* Radiance for other renderers, read back by libraries that they use: PLY by Assimp, EXR by OpenEXR. */
#include "render/radiance.h"
#include "stand.h"
#include "tests/nacre/scratch.h"

#include <assimp/cimport.h>
#include <assimp/scene.h>
#include <math.h>
#include <openexr.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static const double pi = 3.14159265358979323846;

static struct nacre_error error;
static struct scene scene;
static struct stage stage;
static struct render_report report;
static struct radiance radiance;
static struct picture picture;
static struct texel_counts counts;
static const struct render_settings settings = {
    .bake = {.density = 4, .rays = 4, .seed = 1, .quiet = true},
    .triangle_limit = 100000,
    .povray_shadows = true};

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
}

void tearDown(void)
{
    picture_finish(&picture);
    radiance_finish(&radiance);
    stage_finish(&stage);
    render_report_finish(&report);
    scene_finish(&scene);
    scratch_remove();
}

static void bake(const char *text)
{
    struct nacre_material material = stand_even_material(20, 7, 1.5, 0.6);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          nacre_material_write(scratch_path("material.exr"), &material, &error));
    nacre_material_finish(&material);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, scene_parse("scene.yaml", scratch_path(""), text, strlen(text), &scene, &error),
        error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_prepare(&stage, &scene, &settings, &report, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_bake_object(&stage, 0, stand_opencl(), &report, &error), error.text);
}

#define HEAD "camera: {position_mm: [0, 0, 400], at_mm: [0, 0, 0], up: [0, 1, 0]}\n"
#define EVEN_LIGHT                                                                                 \
    "lights: [{kind: area, position_mm: [0, 0, 20000], size_mm: [900, 900], irradiance: [1, 2, "   \
    "4]}]\n"
#define KNOT                                                                                       \
    "objects: [{shape: knot, size_mm: 30, position_mm: [3, 4, 5], rotation_deg: [10, 20, 30], "    \
    "material: {file: material.exr, mapping: uv, point_mm: 1.5}}]\n"

static void a_ply_holds_every_vertex_and_its_radiance(void)
{
    bake(HEAD EVEN_LIGHT KNOT);
    const struct mesh *mesh = &stage.objects[0].mesh;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, radiance_take(&radiance, &stage, 0, false, &error));
    const char *const comments[] = {"scene=a\nb", NULL};
    const char *path = scratch_path("out.ply");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, radiance_write_ply(path, &radiance, comments, &error),
                                  error.text);
    const struct aiScene *read = aiImportFile(path, 0);
    TEST_ASSERT_NOT_NULL_MESSAGE(read, aiGetErrorString());
    TEST_ASSERT_EQUAL_UINT(1, read->mNumMeshes);
    const struct aiMesh *got = read->mMeshes[0];
    TEST_ASSERT_EQUAL_UINT(mesh->triangle_count, got->mNumFaces);
    TEST_ASSERT_NOT_NULL(got->mColors[0]);
    TEST_ASSERT_NOT_NULL(got->mNormals);
    TEST_ASSERT_NOT_NULL(got->mTextureCoords[0]);
    float brightest = 0;
    for (unsigned i = 0; i < got->mNumFaces; i++) {
        TEST_ASSERT_EQUAL_UINT(3, got->mFaces[i].mNumIndices);
        for (unsigned k = 0; k < 3; k++) {
            /* Assimp may number vertices anew, but keeps faces in order. */
            unsigned there = got->mFaces[i].mIndices[k];
            uint32_t here = mesh->triangles[i][k];
            const float *light = stage.objects[0].light[here];
            TEST_ASSERT_EQUAL_FLOAT(mesh->positions[here][0], got->mVertices[there].x);
            TEST_ASSERT_EQUAL_FLOAT(mesh->positions[here][2], got->mVertices[there].z);
            TEST_ASSERT_FLOAT_WITHIN(1e-6F, mesh->normals[here][1], got->mNormals[there].y);
            TEST_ASSERT_EQUAL_FLOAT(radiance.mesh.uv[here][1], got->mTextureCoords[0][there].y);
            TEST_ASSERT_FLOAT_WITHIN(1e-6F, (float)(light[0] / pi), got->mColors[0][there].r);
            TEST_ASSERT_FLOAT_WITHIN(1e-6F, (float)(light[2] / pi), got->mColors[0][there].b);
            brightest = fmaxf(brightest, got->mColors[0][there].b);
        }
    }
    TEST_ASSERT_TRUE_MESSAGE(brightest > 0.2F, "the knot is dark"); /* a plane would have 0.76 */
    aiReleaseImport(read);
}

/* A file's mesh of 2 units, scaled to 40 mm, turned and moved. */
static void vertices_can_be_as_in_the_mesh_s_file(void)
{
    static const char quad[] = "v 5 5 1\nv 7 5 1\nv 7 6 1\nv 5 6 1\nf 1 2 3 4\n";
    scratch_store("quad.obj", quad, sizeof quad - 1);
    bake(HEAD EVEN_LIGHT
         "objects: [{shape: mesh, file: quad.obj, size_mm: 40, position_mm: [9, 8, 7], "
         "rotation_deg: [0, 0, 90], material: {file: material.exr, mapping: planar, point_mm: "
         "4}}]\n");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, radiance_take(&radiance, &stage, 0, false, &error));
    struct vec3 low, high;
    mesh_bounds(&radiance.mesh, &low, &high);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -1, low.x); /* 20 mm wide after the turn, about 9 */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 28, high.y);
    radiance_finish(&radiance);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, radiance_take(&radiance, &stage, 0, true, &error));
    mesh_bounds(&radiance.mesh, &low, &high);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 5, low.x);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 7, high.x);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 5, low.y);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 6, high.y);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 1, high.z);
    TEST_ASSERT_FLOAT_WITHIN(1e-6F, 1, radiance.mesh.normals[0][2]);
}

/* A level square whose two halves lie in charts apart, one turned by 90 degrees, with a value that is linear over it. */
static double value_at(double x, double y, int c)
{
    return 0.2 + 0.5 * x + 0.3 * y + 0.1 * c;
}

enum { STEPS = 12 };

/* Chart `half` of point (x, y) of the unit square, x < 0.5 in the first. */
static void place_in_chart(int half, double x, double y, float uv[2])
{
    double s = half ? 0.57 + 0.37 * y : 0.043 + 0.74 * x;
    double t = half ? 0.06 + 0.74 * (x - 0.5) : 0.31 + 0.37 * y;
    uv[0] = (float)s;
    uv[1] = (float)t;
}

static void make_two_charts(void)
{
    size_t side = STEPS + 1, triangle = 0;
    struct mesh *mesh = &radiance.mesh;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mesh_allocate(mesh, 2 * side * side, 4 * STEPS * STEPS, true, &error));
    radiance.rgb = calloc(mesh->vertex_count, sizeof *radiance.rgb);
    radiance.aspect = 1;
    TEST_ASSERT_NOT_NULL(radiance.rgb);
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        int half = i >= side * side;
        double x = ((double)(i % side) / STEPS + half) / 2;
        double y = (double)(i / side % side) / STEPS;
        mesh->positions[i][0] = (float)x;
        mesh->positions[i][1] = (float)y;
        place_in_chart(half, x, y, mesh->uv[i]);
        for (int c = 0; c < 3; c++) {
            radiance.rgb[i][c] = (float)value_at(x, y, c);
        }
    }
    for (size_t i = 0; i < 2 * STEPS * STEPS; i++) {
        size_t in_half = i % (STEPS * STEPS);
        uint32_t a = (uint32_t)(i / (STEPS * STEPS) * side * side + in_half / STEPS * side +
                                in_half % STEPS);
        const uint32_t pair[2][3] = {{a, a + 1, a + 2 + STEPS}, {a, a + 2 + STEPS, a + 1 + STEPS}};
        memcpy(mesh->triangles[triangle], pair, sizeof pair);
        triangle += 2;
    }
}

/* A vertex x that begins with the byte of a line's end, which Assimp would take for part of the header. */
static void a_ply_can_begin_with_any_number(void)
{
    make_two_charts();
    radiance.mesh.positions[0][0] = 0.01F; /* 0a d7 23 3c */
    const char *path = scratch_path("out.ply");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, radiance_write_ply(path, &radiance, NULL, &error));
    const struct aiScene *read = aiImportFile(path, 0);
    TEST_ASSERT_NOT_NULL_MESSAGE(read, aiGetErrorString());
    const struct aiMesh *got = read->mMeshes[0];
    TEST_ASSERT_EQUAL_UINT(radiance.mesh.triangle_count, got->mNumFaces);
    for (unsigned i = 0; i < 3 * got->mNumFaces; i++) {
        unsigned there = got->mFaces[i / 3].mIndices[i % 3];
        uint32_t here = radiance.mesh.triangles[i / 3][i % 3];
        TEST_ASSERT_EQUAL_FLOAT(radiance.mesh.positions[here][0], got->mVertices[there].x);
        TEST_ASSERT_EQUAL_FLOAT(radiance.rgb[here][1], got->mColors[0][there].g);
    }
    aiReleaseImport(read);
}

/* As a renderer reads it: bilinear, v upwards. */
static double lookup(const float uv[2], int c)
{
    double x = (double)uv[0] * picture.width - 0.5, y = (1 - (double)uv[1]) * picture.height - 0.5;
    double sum = 0;
    for (int k = 0; k < 4; k++) {
        double xi = floor(x) + k % 2, yi = floor(y) + (k > 1);
        int column = (int)fmin(fmax(xi, 0), picture.width - 1);
        int row = (int)fmin(fmax(yi, 0), picture.height - 1);
        size_t index = (size_t)row * (size_t)picture.width + (size_t)column;
        sum += (1 - fabs(x - xi)) * (1 - fabs(y - yi)) * picture.rgb[3 * index + (size_t)c];
    }
    return sum;
}

/* The largest difference of bilinear lookups all over the square, borders included. */
static double worst_lookup(void)
{
    double worst = 0;
    for (int half = 0; half < 2; half++) {
        for (int i = 0; i < 101 * 101; i++) {
            double x = (i % 101 / 100.0 + half) / 2;
            double y = (i / 101) / 100.0; /* NOLINT(bugprone-integer-division): the row */
            float uv[2];
            place_in_chart(half, x, y, uv);
            for (int c = 0; c < 3; c++) {
                worst = fmax(worst, fabs(lookup(uv, c) - value_at(x, y, c)));
            }
        }
    }
    return worst;
}

static void lookups_near_borders_of_charts_show_no_seam(void)
{
    make_two_charts();
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, radiance_draw_texels(&radiance, 64, 2, &picture, &counts, &error), error.text);
    /* Charts of 0.37 x 0.37 of the picture; at the border a texel's middle is counted or not. */
    TEST_ASSERT_DOUBLE_WITHIN(4 * 0.37 * 64, 2 * 0.37 * 0.37 * 64 * 64, (double)counts.covered);
    TEST_ASSERT_EQUAL_UINT64(0, counts.overlapped);
    TEST_ASSERT_TRUE(counts.padded > 4 * 0.37 * 64);
    /* Inside, bilinear reading of a linear function is exact. Up to a texel outside, the padding has the value of the
     * nearest border in place of the function's: at a corner both ways. A texel is 1/64/0.74 wide in x and 1/64/0.37
     * high in y. */
    double texel = 0.5 / 64 / 0.74 + 0.3 / 64 / 0.37;
    TEST_ASSERT_TRUE(worst_lookup() <= texel);
    TEST_ASSERT_EQUAL_FLOAT(0, picture.rgb[0]); /* far from both charts */
}

static void without_padding_the_same_lookups_show_seams(void)
{
    make_two_charts();
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          radiance_draw_texels(&radiance, 64, 0, &picture, &counts, &error));
    TEST_ASSERT_EQUAL_UINT64(0, counts.padded);
    TEST_ASSERT_TRUE(worst_lookup() > 0.1);
}

static void triangles_that_share_texels_are_counted(void)
{
    make_two_charts();
    for (size_t i = radiance.mesh.vertex_count / 2; i < radiance.mesh.vertex_count; i++) {
        memcpy(radiance.mesh.uv[i], radiance.mesh.uv[i - radiance.mesh.vertex_count / 2],
               sizeof *radiance.mesh.uv);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          radiance_draw_texels(&radiance, 64, 2, &picture, &counts, &error));
    /* All but those on edges. */
    TEST_ASSERT_TRUE(counts.overlapped > counts.covered * 8 / 10);
    TEST_ASSERT_TRUE(counts.overlapped <= counts.covered);
}

/* A square on which radiance grows with the texture coordinates: each texel has what its middle has, to float's rounding;
 * half a texel off would be 1/16. */
static void texels_hold_what_their_middles_have(void)
{
    enum { WIDTH = 8 };
    static const uint32_t triangles[2][3] = {{0, 1, 3}, {0, 3, 2}};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_allocate(&radiance.mesh, 4, 2, true, &error));
    memcpy(radiance.mesh.triangles, triangles, sizeof triangles);
    radiance.aspect = 1;
    radiance.rgb = calloc(4, sizeof *radiance.rgb);
    TEST_ASSERT_NOT_NULL(radiance.rgb);
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < 2; k++) {
            radiance.mesh.uv[i][k] = radiance.rgb[i][k] = (float)(i >> k & 1);
        }
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          radiance_draw_texels(&radiance, WIDTH, 0, &picture, &counts, &error));
    TEST_ASSERT_EQUAL_INT(WIDTH, picture.height);
    for (int i = 0; i < WIDTH * WIDTH; i++) {
        const float *texel = picture.rgb + 3 * (size_t)i;
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, (i % WIDTH + 0.5) / WIDTH, texel[0]);
        /* NOLINTNEXTLINE(bugprone-integer-division): the row */
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1 - (i / WIDTH + 0.5) / WIDTH, texel[1]);
    }
}

static void texture_coordinates_that_make_no_picture_are_refused(void)
{
    make_two_charts();
    radiance.mesh.uv[7][1] = 1.5F;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          radiance_draw_texels(&radiance, 64, 2, &picture, &counts, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "1.5, outside 0 to 1"), error.text);
    TEST_ASSERT_NULL(picture.rgb);
    free(radiance.mesh.uv);
    radiance.mesh.uv = NULL;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          radiance_draw_texels(&radiance, 64, 2, &picture, &counts, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "no texture coordinates"), error.text);
}

/* Channel `name` of a file as OpenEXR's own library decodes it; heap, width * height floats. */
static float *read_channel(const char *path, const char *name, int width, int height)
{
    exr_context_t file = NULL;
    exr_attr_box2i_t window;
    exr_decode_pipeline_t decode = EXR_DECODE_PIPELINE_INITIALIZER;
    int32_t rows = 0;
    float *values = calloc((size_t)width * (size_t)height, sizeof *values);
    TEST_ASSERT_NOT_NULL(values);
    TEST_ASSERT_EQUAL_INT(EXR_ERR_SUCCESS, exr_start_read(&file, path, NULL));
    TEST_ASSERT_EQUAL_INT(EXR_ERR_SUCCESS, exr_get_data_window(file, 0, &window));
    TEST_ASSERT_EQUAL_INT(width, window.max.x + 1);
    TEST_ASSERT_EQUAL_INT(height, window.max.y + 1);
    TEST_ASSERT_EQUAL_INT(EXR_ERR_SUCCESS, exr_get_scanlines_per_chunk(file, 0, &rows));
    for (int y = 0; y < height; y += rows) {
        exr_chunk_info_t chunk;
        TEST_ASSERT_EQUAL_INT(EXR_ERR_SUCCESS, exr_read_scanline_chunk_info(file, 0, y, &chunk));
        TEST_ASSERT_EQUAL_INT(EXR_ERR_SUCCESS,
                              y == 0 ? exr_decoding_initialize(file, 0, &chunk, &decode)
                                     : exr_decoding_update(file, 0, &chunk, &decode));
        for (int16_t i = 0; i < decode.channel_count; i++) {
            exr_coding_channel_info_t *channel = &decode.channels[i];
            bool wanted = strcmp(channel->channel_name, name) == 0;
            TEST_ASSERT_EQUAL_INT(EXR_PIXEL_FLOAT, channel->data_type);
            channel->decode_to_ptr =
                wanted ? (uint8_t *)(values + (size_t)y * (size_t)width) : NULL;
            channel->user_bytes_per_element = 4;
            channel->user_data_type = EXR_PIXEL_FLOAT;
            channel->user_pixel_stride = 4;
            channel->user_line_stride = 4 * width;
        }
        if (y == 0) {
            TEST_ASSERT_EQUAL_INT(EXR_ERR_SUCCESS,
                                  exr_decoding_choose_default_routines(file, 0, &decode));
        }
        TEST_ASSERT_EQUAL_INT(EXR_ERR_SUCCESS, exr_decoding_run(file, 0, &decode));
    }
    (void)exr_decoding_destroy(file, &decode);
    (void)exr_finish(&file);
    return values;
}

static void an_exr_holds_the_radiance_of_the_surface_under_each_texel(void)
{
    bake(HEAD EVEN_LIGHT
         "objects: [{shape: quad, size_mm: [60, 30, 1], material: {file: material.exr, mapping: "
         "uv, point_mm: 1.5}}]\n");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, radiance_take(&radiance, &stage, 0, false, &error));
    TEST_ASSERT_EQUAL_INT(64,
                          radiance_texel_width(&radiance)); /* 40 points wide; 64 is the least */
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          radiance_draw_texels(&radiance, 64, 2, &picture, &counts, &error));
    TEST_ASSERT_EQUAL_INT(32, picture.height);
    TEST_ASSERT_EQUAL_UINT64(64 * 32, counts.covered);
    /* Something to tell texels apart: beyond what HALF holds, and finer than it resolves. */
    picture.rgb[0] = 70000;
    picture.rgb[3 * (31 * 64 + 5)] = 1.0001F;
    const char *const attributes[] = {"scene=mine", NULL};
    const char *path = scratch_path("out.exr");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, radiance_write_exr(path, &picture, attributes, &error),
                                  error.text);
    float *red = read_channel(path, "R", 64, 32), *blue = read_channel(path, "B", 64, 32);
    TEST_ASSERT_EQUAL_FLOAT(70000, red[0]);
    TEST_ASSERT_EQUAL_FLOAT(1.0001F, red[31 * 64 + 5]);
    for (int y = 8; y < 24; y++) {
        for (int x = 8; x < 56; x++) {
            /* Two samples to a triangle, whose legs h are 0.88 points long: placed at random in it they would scatter by
             * sqrt(a h^2 / 18 / (r^2 A 2)) = 1.1 % of the light, where a = h^2 / 2, the kernel exp(-d / r) falls off by
             * 1 / r = 1 / 1.5 a point, and A = (sum g)^2 / sum g^2 = 30 points add up. 4.5 times that, as the most of
             * 768 texels counts. */
            TEST_ASSERT_FLOAT_WITHIN(0.05F * 0.6F * 4 / (float)pi, 0.6F * 4 / (float)pi,
                                     blue[y * 64 + x]);
        }
    }
    free(red);
    free(blue);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(a_ply_holds_every_vertex_and_its_radiance);
    RUN_TEST(a_ply_can_begin_with_any_number);
    RUN_TEST(vertices_can_be_as_in_the_mesh_s_file);
    RUN_TEST(lookups_near_borders_of_charts_show_no_seam);
    RUN_TEST(without_padding_the_same_lookups_show_seams);
    RUN_TEST(triangles_that_share_texels_are_counted);
    RUN_TEST(texels_hold_what_their_middles_have);
    RUN_TEST(texture_coordinates_that_make_no_picture_are_refused);
    RUN_TEST(an_exr_holds_the_radiance_of_the_surface_under_each_texel);
    return UNITY_END();
}
