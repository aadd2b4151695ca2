/* The pitch of a station's surface points by a target of known size: a lattice of dots that lay where the sample lies. */
#include "rig/develop/target.h"

#include "rig/develop/calibrate.h"
#include "rig/develop/dots.h"
#include "rig/develop/lattice.h"

#include <math.h>
#include <stdlib.h>

/* A target whose dark is brighter than this share of its light shows no dots. */
static const double contrast_needed = 0.7;

/* Where the pitch is taken: the middles of the region's ninths. */
enum { PLACES = 3 };

struct looking {
    const struct calibration *calibration;
    struct point *dots; /* in surface points; heap */
    size_t count;
};

static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a;
    float y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Make the picture over white one in which dots are 1 on 0, and tell the share of it that they cover. */
static int find_contrast(float *picture, size_t pixels, double *share, struct nacre_error *error)
{
    size_t count = 0;
    size_t bright = 0;
    float *sorted = malloc((pixels + 1) * sizeof *sorted);
    if (!sorted) {
        return nacre_fail_memory(error, "the target's picture");
    }
    for (size_t i = 0; i < pixels; i++) {
        if (!isnan(picture[i])) {
            sorted[count++] = picture[i];
        }
    }
    qsort(sorted, count, sizeof *sorted, compare_floats);
    float low = count ? sorted[count / 50] : 0;
    float high = count ? sorted[count - 1 - count / 50] : 0;
    free(sorted);
    if (!(high > 0) || (double)low > contrast_needed * (double)high) {
        return nacre_fail(error,
                          "the target shows no dots: its dark places are %.2g times as "
                          "bright as its light ones; was it on the stage, and in the light?",
                          high > 0 ? (double)(low / high) : 0);
    }
    for (size_t i = 0; i < pixels; i++) {
        bright += picture[i] > (low + high) / 2 ? 1 : 0;
    }
    bool dark_dots = 2 * bright > count;
    float from = dark_dots ? high : low;
    float to = dark_dots ? low : high;
    for (size_t i = 0; i < pixels; i++) {
        picture[i] = (picture[i] - from) / (to - from);
    }
    *share = (double)(dark_dots ? count - bright : bright) / (double)count;
    return NACRE_OK;
}

/* The dots' centres as surface points. */
static int work_target(void *state, const struct merged *merged, float *result,
                       struct nacre_error *error)
{
    struct looking *looking = state;
    const struct calibration *calibration = looking->calibration;
    const struct flat *flat = &calibration->flat;
    size_t pixels = (size_t)flat->width * (size_t)flat->height;
    struct homography back;
    struct dots seen = {0};
    double share = 0;
    int status = NACRE_OK;
    if (!homography_invert(&calibration->map.plane, &back)) {
        return nacre_fail(error, "the camera sees the region from its edge");
    }
    black_level_subtract(&calibration->black, merged->radiance);
    for (size_t i = 0; i < pixels; i++) {
        int channel = bayer_channel(flat->bayer, (int)(i % (size_t)flat->width),
                                    (int)(i / (size_t)flat->width));
        bool enough = (double)flat->white[i] > calibrate_dots_share * flat->levels[channel];
        result[i] = enough ? merged->radiance[i] / flat->white[i] : NAN;
    }
    status = find_contrast(result, pixels, &share, error);
    if (status == NACRE_OK) {
        status = dots_find(result, flat->width, flat->height, share, &seen, error);
    }
    for (size_t i = 0; status == NACRE_OK && i < seen.count; i++) {
        seen.centres[i] =
            homography_apply(&back, lens_undistort(&calibration->map.lens, seen.centres[i]));
    }
    looking->dots = seen.centres;
    looking->count = seen.count;
    return status;
}

static int take_target(void *state, const struct merged *merged, const float *result,
                       struct nacre_error *error)
{
    (void)state;
    (void)merged;
    (void)result;
    (void)error;
    return NACRE_OK;
}

/* Lattice steps for each point across and down, and the root of the area, near a point. */
static void measure_at(const struct homography *back, struct point at, double steps[3])
{
    struct point left = homography_apply(back, (struct point){at.x - 0.5, at.y});
    struct point right = homography_apply(back, (struct point){at.x + 0.5, at.y});
    struct point above = homography_apply(back, (struct point){at.x, at.y - 0.5});
    struct point below = homography_apply(back, (struct point){at.x, at.y + 0.5});
    struct point x = {right.x - left.x, right.y - left.y};
    struct point y = {below.x - above.x, below.y - above.y};
    steps[0] = hypot(x.x, x.y);
    steps[1] = hypot(y.x, y.y);
    steps[2] = sqrt(fabs(x.x * y.y - x.y * y.x));
}

static int fill_report(const struct lattice *lattice, const struct station_sample *sample,
                       double spacing_mm, struct target_report *report, struct nacre_error *error)
{
    struct homography back;
    double sums[3] = {0};
    double least = INFINITY;
    double most = 0;
    if (!homography_invert(&lattice->map, &back)) {
        return nacre_fail(error, "the target's dots lie on a line");
    }
    for (int k = 0; k < PLACES * PLACES; k++) {
        double steps[3];
        int row = k / PLACES;
        struct point at = {(k % PLACES + 0.5) / PLACES * sample->width,
                           (row + 0.5) / PLACES * sample->height};
        measure_at(&back, at, steps);
        least = fmin(least, steps[2]);
        most = fmax(most, steps[2]);
        for (int i = 0; i < 3; i++) {
            sums[i] += steps[i] / (PLACES * PLACES);
        }
    }
    /* 2 n coordinates, of which the 8 of the map are used up. The scale of n places with this error in each axis is known to
     * the error over their spread. */
    double dots = (double)lattice->dots;
    double axis = lattice->rms / sqrt(2) * sqrt(2 * dots / (2 * dots - 8));
    *report = (struct target_report){.dots = lattice->dots,
                                     .pitch_mm = spacing_mm * sums[2],
                                     .across = spacing_mm * sums[0],
                                     .down = spacing_mm * sums[1],
                                     .uneven = most / least - 1,
                                     .doubt = axis / lattice->spread,
                                     .rms_points = lattice->rms,
                                     .station_pitch = sample->pitch_mm};
    return NACRE_OK;
}

static int measure(const struct session *session, double spacing_mm,
                   struct visit_progress *progress, struct target_report *report,
                   struct nacre_error *error)
{
    const struct station_camera *camera = &session->station.camera;
    const struct calibrate_options options = {.black = BLACK_SUBTRACT, .confidence = 0.99};
    struct calibration calibration = {0};
    struct looking looking = {.calibration = &calibration};
    struct visitor visitor = {.state = &looking,
                              .result_size = (size_t)camera->width * (size_t)camera->height,
                              .work = work_target,
                              .take = take_target};
    struct lattice lattice;
    int visited;
    int missing;
    int status = calibrate(session, &options, progress, &calibration, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = visit_patterns(session, PATTERN_GRID, 0, &calibration.noise, &visitor, progress,
                            &visited, &missing, error);
    if (status == NACRE_OK && visited == 0) {
        status = nacre_fail(error, "has no picture of the target in frames/; resume the scan");
    }
    if (status == NACRE_OK) {
        status = lattice_find(looking.dots, looking.count, &lattice, error);
    }
    if (status == NACRE_OK) {
        status = fill_report(&lattice, &session->station.sample, spacing_mm, report, error);
    }
out:
    free(looking.dots);
    calibration_finish(&calibration);
    return status;
}

int target_measure(const char *path, double spacing_mm, struct progress *progress,
                   struct target_report *report, struct nacre_error *error)
{
    struct session session = {0};
    struct visit_progress visits = {.progress = progress};
    int status = session_open(path, &session, error);
    if (status != NACRE_OK) {
        return status;
    }
    const struct plan *plan = &session.plan;
    for (int kind = 0; kind < PATTERN_KINDS; kind++) {
        visits.total += plan_shown_count(plan, (enum pattern_kind)kind);
    }
    status = plan->grid_spacing == 1
                 ? measure(&session, spacing_mm, &visits, report, error)
                 : nacre_fail(error,
                              "is no session of a target: its plan lights every %d-th point; scan "
                              "the target with grid_spacing: 1 and window: 1",
                              plan->grid_spacing);
    if (status == NACRE_FAILED) {
        status = nacre_fail_within(error, "%s", path);
    }
    session_finish(&session);
    return status;
}
