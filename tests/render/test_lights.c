/* Lights and mappings, against closed forms and against each other. */
#include "render/irradiance.h"
#include "render/lights.h"
#include "render/mapping.h"
#include "tests/nacre/scratch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct light light;
static struct mesh mesh;
static struct mapping mapping;
static struct nacre_error error;

void setUp(void)
{
    scratch_make();
    error.text[0] = '\0';
}

void tearDown(void)
{
    light_finish(&light);
    mesh_finish(&mesh);
    mapping_finish(&mapping);
    scratch_remove();
}

static const struct scene_light settings[] = {
    {.kind = LIGHT_AREA,
     .position_mm = {30, 20, 90},
     .at_mm = {1, 2, 3},
     .up = {0, 1, 0},
     .size_mm = {60, 40},
     .irradiance = {1, 2, 3}},
    {.kind = LIGHT_POINT, .position_mm = {30, 20, 90}, .at_mm = {1, 2, 3}, .irradiance = {1, 2, 3}},
    {.kind = LIGHT_SPOT,
     .position_mm = {30, 20, 90},
     .at_mm = {1, 2, 3},
     .angle_deg = 20,
     .soft_deg = 4,
     .irradiance = {1, 2, 3}},
    {.kind = LIGHT_PROJECTOR,
     .position_mm = {30, 20, 90},
     .at_mm = {1, 2, 3},
     .up = {0, 1, 0},
     .angle_deg = 20,
     .irradiance = {1, 2, 3},
     .texture = {.pattern = PATTERN_CHECKS, .count = 1, .bright = {1, 1, 1}}},
};

enum { SETTINGS = sizeof settings / sizeof *settings };

/* Unshadowed irradiance by many samples. */
static void unshadowed(struct vec3 point, struct vec3 normal, double sum[3])
{
    sum[0] = sum[1] = sum[2] = 0;
    for (int i = 0; i < 64 * 64; i++) {
        const double u[2] = {(i % 64 + 0.5) / 64,
                             (i / 64 + 0.5) / 64}; /* NOLINT(bugprone-integer-division) */
        struct light_arrival arrival = light_arrive(&light, point, normal, u);
        for (int c = 0; c < 3; c++) {
            sum[c] += arrival.irradiance[c] / (64 * 64);
        }
    }
}

static void lights_make_the_irradiance_they_state(void)
{
    for (size_t i = 0; i < SETTINGS; i++) {
        double sum[3];
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, light_make(&light, &settings[i], &error),
                                      error.text);
        unshadowed(vec3_from_doubles(settings[i].at_mm), vec3_scale(light.forward, -1), sum);
        for (int c = 0; c < 3; c++) {
            /* The midpoint rule with 64 x 64 points: 1e-4. */
            TEST_ASSERT_DOUBLE_WITHIN(3e-4 * (c + 1), c + 1, sum[c]);
        }
        light_finish(&light);
    }
}

static void light_falls_off_with_distance_and_slant(void)
{
    const double u[2] = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, light_make(&light, &settings[1], &error));
    struct vec3 twice = vec3_along(light.position, 2 * light.distance_mm, light.forward);
    struct vec3 slanted =
        vec3_unit(vec3_along(vec3_scale(light.forward, -1), sqrt(3), light.right));
    struct light_arrival arrival = light_arrive(&light, twice, slanted, u);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.0 / 4 / 2, arrival.irradiance[0]);
    arrival = light_arrive(&light, twice, light.forward, u);
    TEST_ASSERT_EQUAL_DOUBLE(0, arrival.irradiance[0]); /* from behind */
}

/* Photons sent towards a ball bring each disc in it the irradiance that shadow rays find there. */
static void photons_bring_what_arrives(void)
{
    const struct vec3 middle = {4, 0, 2}, normal = vec3_unit((struct vec3){0.3, -0.1, 1});
    const double radius = 6;
    for (size_t i = 0; i < SETTINGS; i++) {
        double flux = 0, square = 0, expected = 0;
        const int count = 200000;
        TEST_ASSERT_EQUAL_INT(NACRE_OK, light_make(&light, &settings[i], &error));
        for (int k = 0; k < count; k++) {
            /* R4 sequence: four-dimensional analogue of the golden ratio. */
            double u[4];
            for (int d = 0; d < 4; d++) {
                u[d] = fmod(0.5 + (k + 1) * pow(0.8566748838545029, d + 1), 1);
            }
            struct photon photon = light_emit(&light, middle, radius, u);
            double slope = vec3_dot(photon.direction, normal);
            double t = vec3_dot(vec3_subtract(middle, photon.origin), normal) / slope;
            struct vec3 hit = vec3_along(photon.origin, t, photon.direction);
            if (slope < 0 && t > 0 && vec3_length(vec3_subtract(hit, middle)) < radius) {
                flux += photon.flux[1] / count;
                square += photon.flux[1] * photon.flux[1] / count;
            }
        }
        /* Mean irradiance over the disc, on rings of equal area. */
        struct vec3 side = vec3_perpendicular(normal), other = vec3_cross(normal, side);
        for (int k = 0; k < 400; k++) {
            double r = radius * sqrt((k / 20 + 0.5) / 20), a = k % 20 * 0.31415926535; /* NOLINT */
            double sum[3];
            struct vec3 p = vec3_along(vec3_along(middle, r * cos(a), side), r * sin(a), other);
            unshadowed(p, normal, sum);
            expected += sum[1] / 400;
        }
        expected *= acos(-1.0) * radius * radius;
        double deviation = sqrt((square - flux * flux) / count);
        TEST_ASSERT_TRUE(expected > 10 && deviation < 0.02 * expected);
        TEST_ASSERT_DOUBLE_WITHIN(4 * deviation + 2e-3 * expected, expected, flux);
        light_finish(&light);
    }
}

static void a_slide_is_seen_upright_and_not_mirrored(void)
{
    /* Left half red; top right green; bottom right blue. */
    struct picture picture;
    struct scene_light projector = settings[3];
    const double u[2] = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&picture, 40, 20, &error));
    for (int i = 0; i < 800; i++) {
        int channel = i % 40 < 20 ? 0 : i / 40 < 10 ? 1 : 2;
        picture.rgb[i * 3 + channel] = 1;
    }
    char *path = strdup(scratch_path("slide.exr"));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_write(path, &picture, NULL, &error),
                                  error.text);
    picture_finish(&picture);
    projector.texture = (struct scene_texture){.image = path};
    projector.position_mm[0] = projector.at_mm[0] = 0;
    projector.position_mm[1] = projector.at_mm[1] = 0;
    projector.at_mm[2] = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, light_make(&light, &projector, &error), error.text);
    free(path);
    /* Looking down with y up, right is x. Half the picture's width is 90 tan 10 = 15.9 mm, its height half that. */
    const struct {
        double x, y;
        int channel;
    } places[] = {{-8, 4, 0}, {-8, -4, 0}, {8, 4, 1}, {8, -4, 2}, {17, 0, -1}, {0.5, 9, -1}};
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        struct light_arrival arrival = light_arrive(
            &light, (struct vec3){places[i].x, places[i].y, 0}, (struct vec3){0, 0, 1}, u);
        for (int c = 0; c < 3; c++) {
            TEST_ASSERT_EQUAL_INT(c == places[i].channel, arrival.irradiance[c] > 0.5);
            TEST_ASSERT_TRUE(c == places[i].channel || arrival.irradiance[c] == 0);
        }
    }
}

/* Wherever its light falls; what is negative is dark. */
static void a_slide_that_is_not_finite_is_refused(void)
{
    struct picture slide;
    char *path = strdup(scratch_path("slide.exr"));
    struct scene_light showing = {.kind = LIGHT_PROJECTOR,
                                  .position_mm = {0, 0, 100},
                                  .up = {0, 1, 0},
                                  .irradiance = {1, 1, 1},
                                  .angle_deg = 20,
                                  .texture = {.image = path}};
    struct light projector;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&slide, 4, 2, &error));
    slide.rgb[3 * 5] = -1;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(path, &slide, NULL, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, light_make(&projector, &showing, &error), error.text);
    TEST_ASSERT_EQUAL_FLOAT(0, projector.slide.rgb[3 * 5]);
    light_finish(&projector);
    slide.rgb[3 * 5] = NAN;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(path, &slide, NULL, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, light_make(&projector, &showing, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "(1, 1)"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
    light_finish(&projector);
    picture_finish(&slide);
    free(path);
}

static void a_slide_that_is_missing_is_refused(void)
{
    struct scene_light projector = settings[3];
    char path[] = "/nowhere/slide.png";
    projector.texture = (struct scene_texture){.image = path};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, light_make(&light, &projector, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
}

/* A disc-like screen half-way between light and point: the umbra is dark, far outside is bright, and the penumbra of
 * a square light behind a straight edge grows linearly. */
static void area_lights_cast_penumbras(void)
{
    struct world *world = NULL;
    struct motion lift = motion_make((const double[3]){0, 0, 0}, (struct vec3){-50, 0, 50});
    const struct mesh *meshes[1] = {&mesh};
    const struct scene_light square = {.kind = LIGHT_AREA,
                                       .position_mm = {0, 0, 100},
                                       .up = {0, 1, 0},
                                       .size_mm = {4, 4},
                                       .irradiance = {1, 1, 1}};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 100, 100, &error)); /* x from -100 to 0 */
    mesh_move(&mesh, &lift);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, world_new(meshes, 1, &world, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, light_make(&light, &square, &error));
    const struct lighting lighting = {.world = world,
                                      .lights = &light,
                                      .light_count = 1,
                                      .shadows = true,
                                      .rays = 400,
                                      .seed = 1};
    const double places[] = {-3, -1, 0, 1, 3};
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        double expected = fmin(fmax(0.5 + places[i] / 4, 0), 1), whole[3], quick[3];
        const struct lit_point point = {{places[i], 0, 0}, {0, 0, 1}, 1, i};
        struct light_work work = {0};
        irradiance_at(&lighting, &point, whole, &work);
        TEST_ASSERT_EQUAL_UINT64(400, work.shadow_rays);
        irradiance_penumbra(&lighting, &light, &point, quick, &work);
        /* 400 well spread points against an edge: better than 1 %. */
        TEST_ASSERT_DOUBLE_WITHIN(0.012, expected, whole[0]);
        TEST_ASSERT_DOUBLE_WITHIN(0.012, expected, quick[0]);
    }
    world_free(world);
}

static void wrapping_mirrors_or_repeats(void)
{
    const int mirrored[] = {2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0, 0},
              repeated[] = {1, 2, 3, 0, 1, 2, 3, 0};
    for (int i = 0; i < 12; i++) {
        TEST_ASSERT_EQUAL_INT(mirrored[i], mapping_wrap(i - 3, 4, true));
    }
    for (int i = 0; i < 8; i++) {
        TEST_ASSERT_EQUAL_INT(repeated[i], mapping_wrap(i - 3, 4, false));
    }
    TEST_ASSERT_TRUE(mapping_mirrored(-1, 4, true));
    TEST_ASSERT_TRUE(mapping_mirrored(-4, 4, true));
    TEST_ASSERT_FALSE(mapping_mirrored(-5, 4, true));
    TEST_ASSERT_TRUE(mapping_mirrored(4, 4, true));
    TEST_ASSERT_FALSE(mapping_mirrored(3, 4, true));
    TEST_ASSERT_FALSE(mapping_mirrored(4, 4, false));
}

static void map_sphere(int kind)
{
    const struct scene_material how = {.mapping = kind, .axis = 2, .point_mm = 0.5};
    struct motion still = motion_make((const double[3]){0, 0, 0}, (struct vec3){0, 0, 0});
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_sphere(&mesh, 10, 0.3, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mapping_make(&mapping, &how, 20, 20, 1, &mesh, &still, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mapping_follow(&mapping, &mesh, &error));
}

/* On the equator all round mappings are true to scale: a step of 0.1 mm is 0.2 surface points in its direction. */
static void round_mappings_are_true_on_the_equator(void)
{
    const int kinds[] = {MAPPING_SPHERE, MAPPING_CYLINDER};
    for (size_t k = 0; k < 2; k++) {
        struct mapped here[3], east[3], north[3];
        map_sphere(kinds[k]);
        /* The cylinder's radius is the mean distance from the axis: pi / 4 of the sphere's, about. */
        double scale = kinds[k] == MAPPING_SPHERE ? 1 : mapping.radius_mm / 10;
        struct vec3 p = {6, 8, 0}, n = {0.6, 0.8, 0}, zero = {0, 0, 0}, e = {-0.8, 0.6, 0},
                    up = {0, 0, 1};
        const double uv[2] = {0};
        (void)mapping_charts(&mapping, p, n, uv, zero, zero, here);
        (void)mapping_charts(&mapping, vec3_along(p, 0.1, e), n, uv, zero, zero, east);
        (void)mapping_charts(&mapping, vec3_along(p, 0.1, up), n, uv, zero, zero, north);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0.2 * scale, east[0].x - here[0].x);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, east[0].y - here[0].y);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, -0.2, north[0].y - here[0].y); /* rows run down */
        TEST_ASSERT_TRUE(vec3_dot(here[0].along_x, e) > 0.3 &&
                         fabs(vec3_dot(here[0].along_x, up)) < 1e-9);
        TEST_ASSERT_TRUE(vec3_dot(here[0].along_y, up) < -0.9);
        mesh_finish(&mesh);
        mapping_finish(&mapping);
    }
}

/* Looking along an axis shows the material as it is, not mirrored, and one surface point for each point_mm. */
static void planar_mapping_is_true_to_scale_and_not_mirrored(void)
{
    static const struct vec3 towards_viewer[3] = {{1, 0, 0}, {0, -1, 0}, {0, 0, 1}};
    const double uv[2] = {0}, sides[3] = {4, 5, 6}, none[3] = {0};
    const struct vec3 zero = {0, 0, 0}, p = {1, 2, 3};
    struct motion still = motion_make(none, zero);
    for (int axis = 0; axis < 3; axis++) {
        const struct scene_material how = {
            .mapping = MAPPING_PLANAR, .axis = axis, .point_mm = 0.25, .offset = {7, 9}};
        struct mapped here[MAPPING_CHARTS_MAXIMUM], there[MAPPING_CHARTS_MAXIMUM];
        TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_box(&mesh, sides, &error));
        TEST_ASSERT_EQUAL_INT(NACRE_OK,
                              mapping_make(&mapping, &how, 20, 20, 1, &mesh, &still, &error));
        TEST_ASSERT_EQUAL_INT(
            1, mapping_charts(&mapping, p, towards_viewer[axis], uv, zero, zero, here));
        struct vec3 out = vec3_cross(here[0].along_x, vec3_scale(here[0].along_y, -1));
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1, vec3_dot(out, towards_viewer[axis]));
        (void)mapping_charts(&mapping, zero, towards_viewer[axis], uv, zero, zero, there);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 7, there[0].x);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 9, there[0].y);
        (void)mapping_charts(&mapping, vec3_along(p, 0.5, here[0].along_x), towards_viewer[axis],
                             uv, zero, zero, there);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 2, there[0].x - here[0].x);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0, there[0].y - here[0].y);
        mapping_finish(&mapping);
        mesh_finish(&mesh);
    }
}

static void box_mapping_blends_between_faces(void)
{
    struct mapped charts[3];
    const double uv[2] = {0};
    const struct vec3 zero = {0, 0, 0};
    map_sphere(MAPPING_BOX);
    TEST_ASSERT_EQUAL_INT(1, mapping_charts(&mapping, (struct vec3){0, 0, 10},
                                            (struct vec3){0, 0, 1}, uv, zero, zero, charts));
    TEST_ASSERT_EQUAL_INT(2, charts[0].chart);
    struct vec3 edge = vec3_unit((struct vec3){1, 0, 1.01});
    TEST_ASSERT_EQUAL_INT(
        2, mapping_charts(&mapping, vec3_scale(edge, 10), edge, uv, zero, zero, charts));
    TEST_ASSERT_EQUAL_INT(2, charts[0].chart);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1, charts[0].weight + charts[1].weight);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 0.5, charts[1].weight);
}

static void stretch_is_told(void)
{
    double percentiles[3], edge_on;
    map_sphere(MAPPING_UV);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mapping_stretch(&mapping, &mesh, percentiles, &edge_on, &error));
    TEST_ASSERT_EQUAL_DOUBLE(0, edge_on);
    /* Along meridians the scale is true; along circles of latitude l the material shrinks to cos l, whose 10th
     * percentile over the area (both stretches count half) is where sin l = 0.9: 0.436. */
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 0.436, percentiles[0]);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 1, percentiles[1]);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 1, percentiles[2]);
}

/* A cube whose corners have one normal each, as files of eight vertices make it: near them normals lie between the axes, and
 * the nearest may be that of another side. What is drawn as streaks there is told apart from what is drawn well. */
static void sides_that_a_mapping_sees_from_the_side_are_told_apart(void)
{
    static const uint32_t sides[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    const struct scene_material how = {.mapping = MAPPING_BOX, .point_mm = 1};
    struct motion still = motion_make((const double[3]){0, 0, 0}, (struct vec3){0, 0, 0});
    double percentiles[3], edge_on, edge_mm = 1;
    bool limited;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_allocate(&mesh, 8, 12, false, &error));
    for (int i = 0; i < 8; i++) {
        struct vec3 p = {i & 1 ? 10 : -10, i & 2 ? 10 : -10, i & 4 ? 10 : -10};
        vec3_store(p, mesh.positions[i]);
        vec3_store((struct vec3){0, 0, 0}, mesh.normals[i]);
    }
    for (int i = 0; i < 12; i++) {
        const uint32_t *s = sides[i / 2];
        const uint32_t t[3] = {s[0], s[i % 2 + 1], s[i % 2 + 2]};
        memcpy(mesh.triangles[i], t, sizeof t);
        for (int k = 0; k < 3;
             k++) { /* sums by area, so a corner leans to the side of which it has two triangles */
            float *n = mesh.normals[t[k]];
            vec3_store(vec3_add(vec3_from(n), mesh_triangle_cross(&mesh, (size_t)i)), n);
        }
    }
    for (int i = 0; i < 8; i++) {
        vec3_store(vec3_unit(vec3_from(mesh.normals[i])), mesh.normals[i]);
    }
    TEST_ASSERT_EQUAL_INT(
        NACRE_OK, mesh_subdivide(&mesh, mesh_edge_even, &edge_mm, 100000, &limited, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mapping_make(&mapping, &how, 20, 20, 1, &mesh, &still, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          mapping_stretch(&mapping, &mesh, percentiles, &edge_on, &error));
    /* Flat sides seen straight on are true to scale, and the rest is counted. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1, percentiles[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1, percentiles[2]);
    TEST_ASSERT_TRUE(edge_on > 0 && edge_on < 0.5);
}

static void texture_coordinates_that_are_missing_are_refused(void)
{
    const struct scene_material how = {.mapping = MAPPING_UV};
    struct motion still = motion_make((const double[3]){0, 0, 0}, (struct vec3){0, 0, 0});
    TEST_ASSERT_EQUAL_INT(NACRE_OK, mesh_make_quad(&mesh, 1, 1, &error));
    free(mesh.uv);
    mesh.uv = NULL;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          mapping_make(&mapping, &how, 20, 20, 1, &mesh, &still, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "texture coordinates"), error.text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(lights_make_the_irradiance_they_state);
    RUN_TEST(light_falls_off_with_distance_and_slant);
    RUN_TEST(photons_bring_what_arrives);
    RUN_TEST(a_slide_is_seen_upright_and_not_mirrored);
    RUN_TEST(a_slide_that_is_not_finite_is_refused);
    RUN_TEST(a_slide_that_is_missing_is_refused);
    RUN_TEST(area_lights_cast_penumbras);
    RUN_TEST(wrapping_mirrors_or_repeats);
    RUN_TEST(round_mappings_are_true_on_the_equator);
    RUN_TEST(planar_mapping_is_true_to_scale_and_not_mirrored);
    RUN_TEST(box_mapping_blends_between_faces);
    RUN_TEST(stretch_is_told);
    RUN_TEST(sides_that_a_mapping_sees_from_the_side_are_told_apart);
    RUN_TEST(texture_coordinates_that_are_missing_are_refused);
    return UNITY_END();
}
