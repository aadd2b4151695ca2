/* Splitting plain meshes by how long their edges look, and where shadows end. */
#include "render/plain.h"
#include "render/view.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct mesh mesh, box; /* what is split, and what else there is */
static struct world *world;
static struct nacre_error error;
static const double pi = 3.14159265358979323846;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
    mesh_finish(&mesh);
    mesh_finish(&box);
    world_free(world);
    world = NULL;
}

static struct scene camera_scene(void)
{
    return (struct scene){
        .camera = {.position_mm = {30, -150, 90}, .up = {0, 0, 1}, .angle_deg = 20},
        .image = {.width = 200, .height = 150}};
}

static double edge_length(size_t i, struct vec3 *a, struct vec3 *b)
{
    *a = vec3_from(mesh.positions[mesh.triangles[i / 3][i % 3]]);
    *b = vec3_from(mesh.positions[mesh.triangles[i / 3][(i + 1) % 3]]);
    return vec3_length(vec3_subtract(*b, *a));
}

/* A box of side 20, its bottom's middle there. */
static void make_box(struct mesh *made, double x, double z)
{
    const double sides[3] = {20, 20, 20};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(made, sides, &error));
    struct motion stand = mesh_placement(made, (const double[3]){0, 0, 0}, (struct vec3){x, 0, z});
    mesh_move(made, &stand);
}

/* A light 300 mm from the middle, above the camera's right. */
static struct light make_light(enum scene_light_kind kind, double size_mm)
{
    const struct scene_light settings = {.kind = kind,
                                         .position_mm = {150, -100, 240},
                                         .up = {0, 0, 1},
                                         .size_mm = {size_mm, size_mm},
                                         .irradiance = {1, 0.5, 0.25}};
    struct light light;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, light_make(&light, &settings, &error), error.text);
    return light;
}

/* What lights the mesh: a light, shadowed by it and by the box, if that is there. */
static struct lighting light_world(const struct light *light)
{
    const struct mesh *meshes[2] = {&mesh, &box};
    world_free(world);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, world_new(meshes, box.vertex_count ? 2 : 1, &world, &error));
    return (struct lighting){.world = world, .lights = light, .light_count = 1, .shadows = true};
}

static void split_seen(const struct plain_split *split)
{
    bool limited;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plain_split_seen(&mesh, split, &limited, &error));
    TEST_ASSERT_FALSE(limited);
}

/* Whether the limit came first. */
static bool split_lit(const struct plain_split *split, const struct lighting *lighting)
{
    struct progress progress = progress_begin("", true);
    struct light_work work = {0};
    bool limited;
    TEST_ASSERT_EQUAL_INT(
        NACRE_OK, plain_split_lit(&mesh, split, lighting, &progress, &limited, &work, &error));
    progress_end(&progress);
    TEST_ASSERT_TRUE(work.shadow_rays > 0);
    return limited;
}

/* How long an edge looks, in pixels at its near end, or a third of its length there; 0 where its middle is not seen. */
static double looks(const struct scene *scene, const struct view *view, struct vec3 a,
                    struct vec3 b)
{
    double pixel = 2 * tan(scene->camera.angle_deg / 2 * pi / 180) / scene->image.width;
    struct vec3 middle = vec3_scale(vec3_add(a, b), 0.5);
    struct vec3 way = vec3_subtract(middle, view->position);
    double away = vec3_length(way), length = vec3_length(vec3_subtract(b, a));
    double across = vec3_length(vec3_cross(vec3_subtract(b, a), way)) / away;
    return view_meets(view, middle, 0)
               ? fmax(across, length / 3) / fmax(away - length / 2, away / 4) / pixel
               : 0;
}

/* The most by which light differs along an edge that looks longer than three quarters of a pixel, beyond three tenths
 * of the lighter end's. */
static double largest_change(const struct scene *scene, const struct lighting *lighting,
                             enum plain_light which)
{
    struct progress progress = progress_begin("", true);
    struct light_work work = {0};
    struct view view = view_make(scene, 0);
    float(*lit)[3] = calloc(mesh.vertex_count, sizeof *lit);
    double largest = 0;
    TEST_ASSERT_NOT_NULL(lit);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          plain_light(&mesh, 0, lighting, which, &progress, lit, &work, &error));
    for (size_t i = 0; i < 3 * mesh.triangle_count; i++) {
        struct vec3 a, b;
        (void)edge_length(i, &a, &b);
        double one = (double)lit[mesh.triangles[i / 3][i % 3]][0];
        double other = (double)lit[mesh.triangles[i / 3][(i + 1) % 3]][0];
        if (looks(scene, &view, a, b) > 0.75 * 1.00001) {
            largest = fmax(largest, fabs(one - other) - 0.3 * fmax(one, other));
        }
    }
    free(lit);
    return largest;
}

/* No edge from light to dark that looks longer than three quarters of a pixel is seen: from under the box, or across a
 * shadow's end, also where the box hangs in the air; of an area light, and of a point where none is soft. Light is 0.8,
 * the cosine, in the open; a twenty-fifth of it may be left over, and 36 well spread rays leave a straight edge off by
 * up to 1.5 of them at either end: 0.032 + 2 * 0.033. Before, edges have up to all of it, or what an 8 pixels' part of
 * the widest penumbra has. */
static void edges_end_where_shadows_end(void)
{
    static const struct {
        enum scene_light_kind kind;
        double size_mm, height_mm;
    } cases[] = {
        {LIGHT_AREA, 40, 0}, {LIGHT_AREA, 150, 0}, {LIGHT_AREA, 40, 1}, {LIGHT_POINT, 0, 0}};
    const struct scene scene = camera_scene();
    const struct plain_split split = {&scene, false, false, 200000};
    for (int k = 0; k < 4; k++) {
        enum plain_light which = cases[k].kind == LIGHT_AREA ? PLAIN_SOFT : PLAIN_HARD;
        struct light light = make_light(cases[k].kind, cases[k].size_mm);
        mesh_finish(&mesh);
        mesh_finish(&box);
        make_box(&box, 0, cases[k].height_mm);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 200, 200, &error));
        const struct lighting lighting = light_world(&light);
        split_seen(&split);
        TEST_ASSERT_TRUE(largest_change(&scene, &lighting, which) > 0.4);
        TEST_ASSERT_FALSE(split_lit(&split, &lighting));
        TEST_ASSERT_TRUE(largest_change(&scene, &lighting, which) < 0.098);
        light_finish(&light);
    }
}

/* A ground in the open has no shadow on it; nor has a box that stands on a ground. Set into it, it is dark below: the two
 * sides in the light are cut along 40 mm, 120 pixels of a third of a millimetre, in 240 pieces with some triangles each. */
static void nothing_is_split_where_no_shadow_ends(void)
{
    const struct scene scene = camera_scene();
    const struct plain_split split = {&scene, false, false, 200000};
    const double heights[] = {0, -1};
    struct light light = make_light(LIGHT_AREA, 40);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 200, 200, &error));
    struct lighting lighting = light_world(&light);
    split_seen(&split);
    size_t seen = mesh.triangle_count;
    TEST_ASSERT_FALSE(split_lit(&split, &lighting));
    TEST_ASSERT_EQUAL_UINT64(seen, mesh.triangle_count);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&box, 200, 200, &error)); /* the ground */
    for (int k = 0; k < 2; k++) {
        mesh_finish(&mesh);
        make_box(&mesh, 0, heights[k]);
        lighting = light_world(&light);
        split_seen(&split);
        seen = mesh.triangle_count;
        TEST_ASSERT_FALSE(split_lit(&split, &lighting));
        if (k == 0) {
            TEST_ASSERT_EQUAL_UINT64(seen, mesh.triangle_count);
        } else {
            TEST_ASSERT_TRUE(mesh.triangle_count > seen + 480);
        }
    }
    light_finish(&light);
}

static void splitting_stops_at_the_limit(void)
{
    const struct scene scene = camera_scene();
    struct plain_split split = {&scene, false, false, 200000};
    struct light light = make_light(LIGHT_AREA, 40);
    make_box(&box, 0, 0);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 200, 200, &error));
    const struct lighting lighting = light_world(&light);
    split_seen(&split);
    split.limit = mesh.triangle_count + 500;
    TEST_ASSERT_TRUE(split_lit(&split, &lighting));
    TEST_ASSERT_TRUE(mesh.triangle_count <= split.limit);
    light_finish(&light);
}

/* Where an edge touches the camera nothing is short enough. */
static void splitting_ends_before_a_camera_in_a_shadow_s_end(void)
{
    struct scene scene = camera_scene();
    struct light light = make_light(LIGHT_POINT, 0);
    const struct plain_split split = {&scene, false, false, 10000000};
    make_box(&box, 0, 0);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 200, 200, &error));
    memcpy(scene.camera.position_mm, (double[3]){-10, -10, 0}, sizeof scene.camera.position_mm);
    memcpy(scene.camera.at_mm, (double[3]){-50, 0, 0}, sizeof scene.camera.at_mm);
    const struct lighting lighting = light_world(&light);
    (void)plain_split_seen(&mesh, &split, &(bool){false}, &error);
    size_t seen = mesh.triangle_count;
    TEST_ASSERT_FALSE(split_lit(&split, &lighting));
    TEST_ASSERT_TRUE(mesh.triangle_count < 2 * seen);
    light_finish(&light);
}

/* The longest edge with its middle in the picture of some of the turns, in pixels at its near end (a quarter of the
 * distance at least) there; with one turn as it looks, or a third of its length. */
static double longest_seen(const struct scene *scene, int turns)
{
    double pixel = 2 * tan(scene->camera.angle_deg / 2 * pi / 180) / scene->image.width, most = 0;
    for (int turn = 0; turn < turns; turn++) {
        struct view view = view_make(scene, turn * 360.0 / turns);
        for (size_t i = 0; i < 3 * mesh.triangle_count; i++) {
            struct vec3 a, b;
            double length = edge_length(i, &a, &b);
            struct vec3 middle = vec3_scale(vec3_add(a, b), 0.5);
            if (view_meets(&view, middle, 0)) {
                struct vec3 way = vec3_subtract(middle, view.position);
                double away = vec3_length(way);
                double across = vec3_length(vec3_cross(vec3_subtract(b, a), way)) / away;
                double looks = turns > 1 ? length : fmax(across, length / 3);
                most = fmax(most, looks / fmax(away - length / 2, away / 4) / pixel);
            }
        }
    }
    return most;
}

/* What is split for a camera that goes round is fine enough from everywhere, and where no turn sees it as coarse as what is
 * out of a picture. Cameras that look down, up, along the ground and rolled to a side. */
static void a_ground_is_split_for_each_turn_that_sees_it(void)
{
    static const double places[][3] = {
        {30, -150, 90}, {30, -150, -40}, {60, -140, 40}, {30, -150, 90}, {0, 0, 120}};
    for (int k = 0; k < 5; k++) {
        struct scene scene = camera_scene();
        bool limited = true;
        memcpy(scene.camera.position_mm, places[k], sizeof places[k]);
        scene.image = (struct scene_image){.width = 80, .height = 60};
        scene.camera.up[0] = k == 3 ? 0.5 : 0;
        scene.camera.up[1] = k == 4;
        mesh_finish(&mesh);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 900, 900, &error));
        struct plain_split split = {&scene, true, false, 1000000};
        TEST_ASSERT_EQUAL_INT(NACRE_OK, plain_split_seen(&mesh, &split, &limited, &error));
        TEST_ASSERT_FALSE(limited);
        double seen = longest_seen(&scene, 60);
        TEST_ASSERT_TRUE(seen > 6 && seen <= 12 * 1.00001);
        /* Corners are 636 mm away, behind every camera that looks down on the middle. */
        double longest = 0;
        for (size_t i = 0; i < 3 * mesh.triangle_count; i++) {
            struct vec3 a, b;
            double length = edge_length(i, &a, &b);
            longest = fmax(longest, fmin(fabs(a.x), fabs(a.y)) > 400 ? length : 0);
        }
        TEST_ASSERT_TRUE(longest > 900 * sqrt(2) / 48 / 2);
    }
}

static void a_ground_is_split_by_how_long_its_edges_look(void)
{
    struct scene scene = camera_scene();
    bool limited = true;
    scene.camera.position_mm[2] = 30;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 900, 900, &error));
    struct plain_split split = {&scene, false, false, 1000000};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plain_split_seen(&mesh, &split, &limited, &error));
    double seen = longest_seen(&scene, 1);
    TEST_ASSERT_TRUE(seen > 4 && seen <= 8 * 1.00001);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(edges_end_where_shadows_end);
    RUN_TEST(nothing_is_split_where_no_shadow_ends);
    RUN_TEST(splitting_stops_at_the_limit);
    RUN_TEST(splitting_ends_before_a_camera_in_a_shadow_s_end);
    RUN_TEST(a_ground_is_split_for_each_turn_that_sees_it);
    RUN_TEST(a_ground_is_split_by_how_long_its_edges_look);
    return UNITY_END();
}
