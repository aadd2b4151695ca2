/* From camera pixels to surface points. */
#include "made.h"
#include "rig/develop/blur.h"
#include "rig/develop/fit.h"
#include "rig/develop/footprint.h"
#include "rig/develop/resample.h"
#include "unity.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct made_station station;
static struct camera_map map;
static struct nacre_error error;
static size_t points, pixels;
static float *radiosity, *frame, *reflected;
static struct flat flat;
static struct resampler *resampler;

static void choose(enum bayer bayer, double vignetting)
{
    station = made_station_usual();
    station.bayer = bayer;
    station.vignetting = vignetting;
    memcpy(map.plane.m, station.map, sizeof map.plane.m);
    points = (size_t)station.width * (size_t)station.height;
    pixels = (size_t)station.camera_width * (size_t)station.camera_height;
    radiosity = malloc(3 * points * sizeof *radiosity);
    reflected = malloc(3 * points * sizeof *reflected);
    frame = malloc(pixels * sizeof *frame);
}

void setUp(void)
{
    choose(BAYER_RGGB, 0.3);
}

void tearDown(void)
{
    free(radiosity);
    free(reflected);
    free(frame);
    flat_finish(&flat);
    resampler_free(resampler);
    resampler = NULL;
}

static void see(float *seen)
{
    double *signal = malloc(pixels * sizeof *signal);
    made_signal(&station, radiosity, signal);
    for (size_t i = 0; i < pixels; i++) {
        seen[i] = (float)signal[i];
    }
    free(signal);
}

static void make_flat(const bool *defect)
{
    bool *none = calloc(pixels, sizeof *none);
    for (size_t i = 0; i < 3 * points; i++) {
        radiosity[i] = (float)station.white[i / points];
    }
    see(frame);
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          flat_init(&flat, frame, defect ? defect : none, station.camera_width,
                                    station.camera_height, station.bayer, station.white, &error));
    free(none);
}

static void make_resampler(enum demosaic demosaic)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK,
        resampler_new(&flat, &map, station.width, station.height, demosaic, 0, &resampler, &error),
        error.text);
}

/* Every point sends out its own amount, with a few very bright ones: like a response, but worse. */
static void show_spots(void)
{
    struct made_random random = {23};
    for (size_t i = 0; i < 3 * points; i++) {
        double value = 0.001 + 0.004 * made_uniform(&random);
        radiosity[i] = (float)(i % 97 == 5 ? 0.3 : value);
    }
    see(frame);
}

/* Root mean square of what is off, over the points. */
static double rms_error(void)
{
    double sum = 0;
    size_t channels = resampler_size(resampler) / points;
    for (size_t i = 0; i < channels * points; i++) {
        double off = (double)reflected[i] - (double)radiosity[i];
        TEST_ASSERT_FALSE(isnan(reflected[i]));
        sum += off * off;
    }
    return sqrt(sum / (double)(channels * points));
}

static void footprints_share_out_every_pixel(void)
{
    struct footprints f;
    double seen = 0;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          footprints_init(&f, &map, station.camera_width, station.camera_height,
                                          station.width, station.height, &error));
    for (size_t i = 0; i < pixels; i++) {
        double sum = 0;
        for (size_t k = f.start[i]; k < f.start[i + 1]; k++) {
            sum += (double)f.share[k];
            TEST_ASSERT_TRUE(f.points[k] < points);
        }
        TEST_ASSERT_TRUE(f.start[i] == f.start[i + 1] || fabs(sum - 1) < 1e-6);
        seen += (double)f.inside[i];
    }
    /* All views of the sample together are its image: the quadrilateral between the images of its corners. */
    const struct point surface[4] = {
        {0, 0}, {station.width, 0}, {station.width, station.height}, {0, station.height}};
    double twice = 0;
    for (int i = 0; i < 4; i++) {
        struct point a = camera_map_apply(&map, surface[i]);
        struct point b = camera_map_apply(&map, surface[(i + 1) % 4]);
        twice += a.x * b.y - b.x * a.y;
    }
    /* `inside` is measured on the surface, where perspective makes a pixel's far half larger by 1 in a thousand. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4 * twice, twice / 2, seen);
    footprints_finish(&f);
}

static void footprints_of_a_plain_grid_are_known(void)
{
    /* 2.5 pixels a point: pixel 2 straddles points 0 and 1 in halves. */
    const struct camera_map plain = {.plane = {{2.5, 0, 0, 0, 2.5, 0, 0, 0, 1}}};
    struct footprints f;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, footprints_init(&f, &plain, 10, 10, 4, 4, &error));
    TEST_ASSERT_EQUAL_UINT(1, f.start[1] - f.start[0]);
    TEST_ASSERT_EQUAL_UINT(0, f.points[0]);
    TEST_ASSERT_EQUAL_UINT(2, f.start[3] - f.start[2]);
    TEST_ASSERT_FLOAT_WITHIN(1e-6F, 0.5F, f.share[f.start[2]]);
    /* Pixel (2, 2) sees four points in quarters. */
    TEST_ASSERT_EQUAL_UINT(4, f.start[23] - f.start[22]);
    TEST_ASSERT_FLOAT_WITHIN(1e-6F, 0.25F, f.share[f.start[22]]);
    TEST_ASSERT_EQUAL_UINT(5, f.points[f.start[23] - 1]);
    footprints_finish(&f);
}

/* Gauss elimination of the normal equations, dense. */
static void solve_dense(const struct footprints *f, const float *weight, size_t rows,
                        size_t unknowns, const double *right, double *x)
{
    double *a = calloc(unknowns * (unknowns + 1), sizeof *a);
    size_t width = unknowns + 1;
    for (size_t i = 0; i < rows; i++) {
        for (size_t k = f->start[i]; k < f->start[i + 1]; k++) {
            for (size_t l = f->start[i]; l < f->start[i + 1]; l++) {
                a[f->points[k] * width + f->points[l]] +=
                    (double)weight[i] * (double)f->share[k] * (double)f->share[l];
            }
        }
    }
    for (size_t p = 0; p < unknowns; p++) {
        a[p * width + unknowns] = right[p];
    }
    for (size_t p = 0; p < unknowns; p++) {
        for (size_t q = p + 1; q < unknowns; q++) {
            double factor = a[q * width + p] / a[p * width + p];
            for (size_t k = p; k < width; k++) {
                a[q * width + k] -= factor * a[p * width + k];
            }
        }
    }
    for (size_t p = unknowns; p-- > 0;) {
        x[p] = a[p * width + unknowns];
        for (size_t k = p + 1; k < unknowns; k++) {
            x[p] -= a[p * width + k] * x[k];
        }
        x[p] /= a[p * width + p];
    }
    free(a);
}

static void fit_agrees_with_dense_elimination(void)
{
    enum { SIDE = 8, CAMERA = 21 };
    const struct camera_map slanted = {.plane = {{2.3, 0.2, 1, -0.1, 2.4, 1.2, 0.003, 0.002, 1}}};
    struct made_random random = {5};
    struct footprints f;
    float weight[CAMERA * CAMERA];
    uint32_t list[CAMERA * CAMERA];
    double right[SIDE * SIDE] = {0};
    double exact[SIDE * SIDE];
    double x[SIDE * SIDE] = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          footprints_init(&f, &slanted, CAMERA, CAMERA, SIDE, SIDE, &error));
    for (uint32_t i = 0; i < CAMERA * CAMERA; i++) {
        list[i] = i;
        weight[i] = (float)(0.5 + made_uniform(&random));
        for (size_t k = f.start[i]; k < f.start[i + 1]; k++) {
            right[f.points[k]] += (double)f.share[k] * (1 + made_normal(&random));
        }
    }
    solve_dense(&f, weight, (size_t)CAMERA * CAMERA, (size_t)SIDE * SIDE, right, exact);
    struct fit_matrix matrix;
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          fit_matrix_init(&matrix, &f, SIDE, list, weight, (size_t)CAMERA * CAMERA,
                                          (size_t)SIDE * SIDE, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, fit_solve(&matrix, right, x, &error));
    fit_matrix_finish(&matrix);
    for (int p = 0; p < SIDE * SIDE; p++) {
        /* The residual is at most 10^-5 of a right-hand side of norm 45; the system's least eigenvalue is above 1. */
        TEST_ASSERT_DOUBLE_WITHIN(5e-4, exact[p], x[p]);
    }
    footprints_finish(&f);
}

static void even_surface_comes_out_even_under_vignetting(void)
{
    for (int demosaic = DEMOSAIC_FIT; demosaic <= DEMOSAIC_MALVAR; demosaic++) {
        make_flat(NULL);
        make_resampler((enum demosaic)demosaic);
        for (size_t i = 0; i < 3 * points; i++) {
            radiosity[i] = 0.3F;
        }
        see(frame);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, resampler_apply(resampler, frame, reflected, &error));
        /* All sums are ratios of the same sums; of Malvar's they mix colours whose whites differ by 12 %, which the
         * balance takes out but for vignetting within the filters' reach. */
        TEST_ASSERT_DOUBLE_WITHIN(demosaic == DEMOSAIC_MALVAR ? 1e-3 : 1e-5, 0, rms_error());
        flat_finish(&flat);
        resampler_free(resampler);
        resampler = NULL;
    }
}

/* Light is neither lost nor moved, and spreads as far as asked. */
static void a_blur_has_its_deviation(void)
{
    static const double wanted[] = {0, 0.05, 0.3, 0.7, 1, 1.5, BLUR_MOST};
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        double weights[2 * BLUR_REACH + 1], sum = 0, mean = 0, variance = 0;
        int reach = blur_weights(wanted[i], weights);
        TEST_ASSERT_TRUE(reach >= 0 && reach <= BLUR_REACH);
        for (int k = 0; k <= 2 * reach; k++) {
            TEST_ASSERT_TRUE(weights[k] >= 0);
            sum += weights[k];
            mean += weights[k] * (k - reach);
            variance += weights[k] * (k - reach) * (k - reach);
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1, sum);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0, mean);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, wanted[i] * wanted[i], variance);
    }
}

/* A row sums to 1 in the order of its points, and where the sample fills the view each point's light is seen as often as before:
 * sums over all pixels change by rounding alone. */
static void blurred_footprints_see_the_same_light(void)
{
    struct footprints sharp = {0}, blurred = {0};
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          footprints_init(&sharp, &map, station.camera_width, station.camera_height,
                                          station.width, station.height, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, footprints_init(&blurred, &map, station.camera_width,
                                                    station.camera_height, station.width,
                                                    station.height, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, blur_footprints(&blurred, station.camera_width, 0.8, &error));
    double *seen = calloc(2 * points, sizeof *seen);
    for (size_t i = 0; i < blurred.pixels; i++) {
        double sum = 0;
        for (size_t k = blurred.start[i]; k < blurred.start[i + 1]; k++) {
            TEST_ASSERT_TRUE(k == blurred.start[i] || blurred.points[k - 1] < blurred.points[k]);
            sum += (double)blurred.share[k];
            seen[blurred.points[k]] += (double)(blurred.share[k] * blurred.inside[i]);
        }
        TEST_ASSERT_TRUE(blurred.start[i] == blurred.start[i + 1] || fabs(sum - 1) < 1e-5);
        for (size_t k = sharp.start[i]; k < sharp.start[i + 1]; k++) {
            seen[points + sharp.points[k]] += (double)(sharp.share[k] * sharp.inside[i]);
        }
    }
    for (size_t p = 0; p < points; p++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-4 * seen[points + p], seen[points + p], seen[p]);
    }
    free(seen);
    footprints_finish(&sharp);
    footprints_finish(&blurred);
}

static void fit_recovers_what_area_blurs(void)
{
    double errors[DEMOSAIC_MALVAR + 1];
    for (int demosaic = DEMOSAIC_FIT; demosaic <= DEMOSAIC_MALVAR; demosaic++) {
        make_flat(NULL);
        make_resampler((enum demosaic)demosaic);
        show_spots();
        TEST_ASSERT_EQUAL_INT(NACRE_OK, resampler_apply(resampler, frame, reflected, &error));
        errors[demosaic] = rms_error();
        flat_finish(&flat);
        resampler_free(resampler);
        resampler = NULL;
    }
    /* A spot of 0.3 among 97 points has a root mean square of 0.03. The made camera samples views at 8 x 8 places, so
     * the shares of straddling pixels are off by up to 1/16, 0.04 on average; they are a third of the light. */
    TEST_ASSERT_TRUE(errors[DEMOSAIC_FIT] < 0.03 * 0.03);
    /* A quarter of a point's pixels straddle: area loses some 15 % of a spot to its neighbours. */
    TEST_ASSERT_TRUE(errors[DEMOSAIC_AREA] > 0.03 * 0.1);
    TEST_ASSERT_TRUE(errors[DEMOSAIC_MALVAR] > 0.03 * 0.1);
}

struct light {
    double blur; /* deviation, points, of the light of a lit point; the rest is a tail */
    double tail; /* share of it */
};

/* A square of light one point wide, blurred. */
static double blurred(double x, double blur)
{
    return 0.5 * (erf((x + 0.5) / blur / sqrt(2)) - erf((x - 0.5) / blur / sqrt(2)));
}

/* One lit point every 12. */
static double light_at(struct light light, double x, double y)
{
    double dx = fmod(x + 12, 12) - 6.5;
    double dy = fmod(y + 12, 12) - 6.5;
    return 0.2 * (1 - light.tail) * blurred(dx, light.blur) * blurred(dy, light.blur) +
           0.3 * light.tail * exp(-sqrt(dx * dx + dy * dy + 0.04) / 0.7);
}

/* Mean of the light over the image under `back` of the unit square at (x, y); NULL: over the square itself. */
static double mean_light(struct light light, const struct homography *back, int x, int y)
{
    enum { ACROSS = 12 };
    double sum = 0;
    for (int k = 0; k < ACROSS * ACROSS; k++) {
        int row = k / ACROSS;
        struct point p = {x + (k % ACROSS + 0.5) / ACROSS, y + (row + 0.5) / ACROSS};
        p = back ? homography_apply(back, p) : p;
        bool inside = p.x >= 0 && p.y >= 0 && p.x < station.width && p.y < station.height;
        sum += inside ? light_at(light, p.x, p.y) : 0;
    }
    return sum / (ACROSS * ACROSS);
}

/* The frame of that light, and in radiosity its means over the points. */
static void show_light(struct light light)
{
    struct homography back;
    TEST_ASSERT_TRUE(homography_invert(&map.plane, &back));
    for (size_t i = 0; i < pixels; i++) {
        int x = (int)i % station.camera_width;
        int y = (int)i / station.camera_width;
        double dx = 2 * (x + 0.5) / station.camera_width - 1;
        double dy = 2 * (y + 0.5) / station.camera_height - 1;
        frame[i] = (float)(mean_light(light, &back, x, y) *
                           station.gain[bayer_channel(station.bayer, x, y)] *
                           (1 - station.vignetting * (dx * dx + dy * dy) / 2));
    }
    for (size_t i = 0; i < 3 * points; i++) {
        int p = (int)(i % points);
        radiosity[i] = (float)mean_light(light, NULL, p % station.width, p / station.width);
    }
}

/* Relative errors of the three ways; returns the misfit. */
static double compare_ways(struct light light, double errors[3])
{
    struct misfit misfit = {0, 0};
    for (int way = 0; way < 3; way++) {
        make_flat(NULL);
        make_resampler((enum demosaic)(DEMOSAIC_FIT + way));
        show_light(light);
        TEST_ASSERT_EQUAL_INT(NACRE_OK, resampler_apply(resampler, frame, reflected, &error));
        double all = 0;
        for (size_t i = 0; i < 3 * points; i++) {
            all += (double)radiosity[i] * (double)radiosity[i];
        }
        errors[way] = rms_error() / sqrt(all / (double)(3 * points));
        if (way == 0) {
            float *variance = calloc(pixels, sizeof *variance);
            TEST_ASSERT_EQUAL_INT(
                NACRE_OK, resampler_add_misfit(resampler, frame, variance, &misfit, &error));
            free(variance);
        }
        flat_finish(&flat);
        resampler_free(resampler);
        resampler = NULL;
    }
    return sqrt(misfit.unexplained / misfit.all);
}

static void misfit_tells_where_the_fit_is_the_nearest(void)
{
    /* Even over the points but for a trace of blur: the fit is within a per cent, the means lose the sixth part. */
    double errors[3];
    double misfit = compare_ways((struct light){0.02, 0}, errors);
    TEST_ASSERT_TRUE(misfit < 0.02);
    TEST_ASSERT_TRUE(errors[0] < 0.02 && errors[1] > 0.1 && errors[2] > 0.1);
    /* Blurred by a third of a point, with a tail that falls within points: the opposite. */
    misfit = compare_ways((struct light){0.3, 0.3}, errors);
    TEST_ASSERT_TRUE(misfit > 0.2);
    TEST_ASSERT_TRUE(errors[2] < 0.02 && errors[0] > 0.1);
}

static void misfit_leaves_noise_out(void)
{
    struct made_random random = {41};
    struct misfit misfit = {0, 0};
    float *variance = calloc(pixels, sizeof *variance);
    make_flat(NULL);
    make_resampler(DEMOSAIC_FIT);
    show_spots();
    for (size_t i = 0; i < pixels; i++) {
        double deviation = 0.01 * station.gain[1];
        frame[i] += (float)(deviation * made_normal(&random));
        variance[i] = (float)(deviation * deviation);
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK,
                          resampler_add_misfit(resampler, frame, variance, &misfit, &error));
    /* The noise has a tenth of the energy of the spots; it is known to 1 % from 32,000 pixels. */
    TEST_ASSERT_TRUE(fabs(misfit.unexplained) < 0.01 * misfit.all);
    free(variance);
}

static void every_mosaic_is_understood(void)
{
    for (int bayer = BAYER_RGGB; bayer <= BAYER_MONO; bayer++) {
        tearDown();
        choose((enum bayer)bayer, 0.1);
        make_flat(NULL);
        make_resampler(DEMOSAIC_FIT);
        TEST_ASSERT_EQUAL_UINT((bayer == BAYER_MONO ? 1 : 3) * points, resampler_size(resampler));
        show_spots();
        if (bayer == BAYER_MONO) {
            /* Its one channel takes the first colour's light, and the white layer's green for it. */
            for (size_t i = 0; i < points; i++) {
                radiosity[i] *= (float)(station.white[1] / station.white[0]);
            }
        }
        TEST_ASSERT_EQUAL_INT(NACRE_OK, resampler_apply(resampler, frame, reflected, &error));
        TEST_ASSERT_TRUE(rms_error() < 0.03 * 0.03);
    }
}

static void unmeasured_pixels_do_not_spread(void)
{
    make_flat(NULL);
    make_resampler(DEMOSAIC_FIT);
    show_spots();
    /* All pixels around the image of point (20, 18)'s middle are lost: 4.4 x 4.4 is what it covers. */
    struct point middle = camera_map_apply(&map, (struct point){20.5, 18.5});
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            frame[((int)middle.y + y) * station.camera_width + (int)middle.x + x] = NAN;
        }
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, resampler_apply(resampler, frame, reflected, &error));
    size_t lost = 0;
    for (size_t i = 0; i < 3 * points; i++) {
        lost += isnan(reflected[i]) ? 1 : 0;
        if (!isnan(reflected[i])) {
            TEST_ASSERT_DOUBLE_WITHIN(0.3 * 0.05, (double)radiosity[i], (double)reflected[i]);
        }
    }
    TEST_ASSERT_TRUE(isnan(reflected[18 * 40 + 20]));
    /* The point itself in three colours; of its neighbours at most a colour that had few pixels there. */
    TEST_ASSERT_TRUE(lost >= 3 && lost <= 6);
}

static void defect_pixels_are_not_used(void)
{
    bool *defect = calloc(pixels, sizeof *defect);
    struct made_random random = {9};
    for (size_t i = 0; i < pixels; i++) {
        defect[i] = made_uniform(&random) < 0.01;
    }
    make_flat(defect);
    make_resampler(DEMOSAIC_FIT);
    show_spots();
    for (size_t i = 0; i < pixels; i++) {
        frame[i] = defect[i] ? 1e6F : frame[i];
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, resampler_apply(resampler, frame, reflected, &error));
    TEST_ASSERT_TRUE(rms_error() < 0.03 * 0.03);
    free(defect);
}

static void too_coarse_a_camera_is_refused(void)
{
    /* Less than a pixel a point: many points are seen by no red pixel. */
    for (int i = 0; i < 6; i++) {
        map.plane.m[i] /= 5;
    }
    memcpy(station.map, map.plane.m, sizeof map.plane.m);
    make_flat(NULL);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, resampler_new(&flat, &map, station.width, station.height,
                                                      DEMOSAIC_FIT, 0, &resampler, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "red pixel"));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(footprints_share_out_every_pixel);
    RUN_TEST(footprints_of_a_plain_grid_are_known);
    RUN_TEST(fit_agrees_with_dense_elimination);
    RUN_TEST(even_surface_comes_out_even_under_vignetting);
    RUN_TEST(a_blur_has_its_deviation);
    RUN_TEST(blurred_footprints_see_the_same_light);
    RUN_TEST(fit_recovers_what_area_blurs);
    RUN_TEST(misfit_tells_where_the_fit_is_the_nearest);
    RUN_TEST(misfit_leaves_noise_out);
    RUN_TEST(every_mosaic_is_understood);
    RUN_TEST(unmeasured_pixels_do_not_spread);
    RUN_TEST(defect_pixels_are_not_used);
    RUN_TEST(too_coarse_a_camera_is_refused);
    return UNITY_END();
}
