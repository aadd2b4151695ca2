/* nacre view: one frame of a station for framing and focus. */
#include "base/picture.h"
#include "cmd/json_print.h"
#include "cmd/stand.h"
#include "cmd/verbs.h"
#include "rig/camera_format.h"
#include "rig/develop/calibrate.h"
#include "rig/develop/framing.h"
#include "rig/exposer.h"
#include "rig/frame_compare.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const patterns[] = {"white", "dots", "grid", NULL};
enum { SHOW_WHITE, SHOW_DOTS, SHOW_GRID };

struct view_settings {
    const char *station, *output, *calibration;
    int pattern;
    double exposure_ms;
};

static const struct option_spec view_options[] = {
    {.name = "station",
     .letter = 's',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct view_settings, station),
     .sentence = "the station file"},
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "PICTURE",
     .required = true,
     .offset = offsetof(struct view_settings, output),
     .writes = true,
     .sentence = "the picture to write, .png or .exr"},
    {.name = "pattern",
     .kind = OPTION_CHOICE,
     .words = patterns,
     .fallback = "white",
     .offset = offsetof(struct view_settings, pattern),
     .sentence = "what the projector shows; dots are best for the focus"},
    {.name = "calibration",
     .letter = 'c',
     .kind = OPTION_STRING,
     .argument = "SESSION",
     .offset = offsetof(struct view_settings, calibration),
     .sentence = "draw the region where the calibration of this session has it, instead of where "
                 "light is found"},
    {.name = "exposure",
     .kind = OPTION_REAL,
     .argument = "MS",
     .unit = "ms",
     .minimum = 0,
     .maximum = 60000,
     .offset = offsetof(struct view_settings, exposure_ms),
     .sentence =
         "exposure, rounded to whole turns of the colour wheel; without it the longest that "
         "saturates next to nothing"},
    {0}};

/* Exposures that are tried, in turns: each twice as long as the one before. */
enum { EXPOSURES = 8 };
static const double saturated_share = 0.001;

enum { BLACK, WHITE, SHOWN, AGAIN, FRAMES };

/* Of black, which has no part in where the region lies. */
static const double confidence = 0.95;

struct view {
    struct station station;
    struct stand stand;
    struct exposer exposer;
    uint8_t *levels;
    uint16_t *raw; /* FRAMES of the camera's size */
    int64_t exposure_ns;
    struct framing framing;
};

static size_t pixels_of(const struct view *view)
{
    const struct camera *camera = view->stand.devices.camera;
    return (size_t)camera->width * (size_t)camera->height;
}

/* Look at the camera's whole frame, which the region is to be chosen from. */
static void widen(struct station *station)
{
    struct station_camera *camera = &station->camera;
    struct v4l2_settings *own = &camera->v4l2;
    if (camera->driver == CAMERA_DRIVER_V4L2) {
        camera->bayer = (int)camera_bayer_of_frame((enum bayer)camera->bayer, own->left, own->top);
        camera->width = own->frame_width ? own->frame_width : own->left + camera->width;
        camera->height = own->frame_height ? own->frame_height : own->top + camera->height;
        own->left = own->top = 0;
    }
}

/* Dots and grids as the plan has them, or ten points apart without a plan. */
static int draw(struct view *view, int pattern, struct nacre_error *error)
{
    const struct projector *projector = view->stand.devices.projector;
    struct plan plan = {.dot_spacing = 10, .dot_shift = 10, .dot_size = 2, .grid_spacing = 10};
    if (view->station.plan) {
        int status = session_read_plan(view->station.plan, &view->station, &plan, error);
        if (status != NACRE_OK) {
            return status;
        }
    }
    struct pattern first = {pattern == SHOW_DOTS ? PATTERN_DOTS : PATTERN_GRID, 0};
    plan_draw(&plan, first, projector->width, projector->height, view->levels);
    plan_finish(&plan);
    return NACRE_OK;
}

/* Show `pattern`, or black (-1). */
static int show(struct view *view, int pattern, int64_t *flip_ns, struct nacre_error *error)
{
    const struct projector *projector = view->stand.devices.projector;
    size_t points = (size_t)projector->width * (size_t)projector->height;
    memset(view->levels, pattern == SHOW_WHITE ? 255 : 0, points);
    int status = pattern > SHOW_WHITE ? draw(view, pattern, error) : NACRE_OK;
    return status == NACRE_OK ? exposer_show(&view->exposer, view->levels, flip_ns, error) : status;
}

static int expose(struct view *view, int frame, int64_t flip_ns, struct nacre_error *error)
{
    struct exposure exposure = {.exposure_ns = view->exposure_ns,
                                .flip_ns = flip_ns,
                                .raw = view->raw + (size_t)frame * pixels_of(view)};
    return exposer_expose(&view->exposer, &exposure, error);
}

/* The longest exposure that leaves the pattern unsaturated; the shortest where none does. */
static int find_exposure(struct view *view, int64_t flip_ns, struct nacre_error *error)
{
    const struct camera *camera = view->stand.devices.camera;
    int64_t turn_ns = view->stand.devices.projector->period_ns;
    int64_t good_ns = turn_ns;
    for (int i = 0; i < EXPOSURES; i++) {
        view->exposure_ns = turn_ns << i;
        int status = expose(view, SHOWN, flip_ns, error);
        if (status != NACRE_OK) {
            return status;
        }
        if (frame_saturation(view->raw + SHOWN * pixels_of(view), pixels_of(view),
                             (1 << camera->bits) - 1) > saturated_share) {
            break;
        }
        good_ns = view->exposure_ns;
    }
    view->exposure_ns = good_ns;
    return NACRE_OK;
}

static int take_frames(struct view *view, const struct view_settings *settings,
                       struct nacre_error *error)
{
    int64_t turn_ns = view->stand.devices.projector->period_ns;
    int64_t flip_ns = 0;
    int status = show(view, settings->pattern, &flip_ns, error);
    if (status == NACRE_OK && settings->exposure_ms > 0) {
        double turns = fmax(1, round(settings->exposure_ms * 1e6 / (double)turn_ns));
        view->exposure_ns = (int64_t)turns * turn_ns;
    } else if (status == NACRE_OK) {
        status = find_exposure(view, flip_ns, error);
    }
    for (int frame = SHOWN; frame <= AGAIN && status == NACRE_OK; frame++) {
        status = expose(view, frame, flip_ns, error);
    }
    for (int frame = BLACK; frame <= WHITE && status == NACRE_OK; frame++) {
        status = show(view, frame == WHITE ? SHOW_WHITE : -1, &flip_ns, error);
        if (status == NACRE_OK) {
            status = expose(view, frame, flip_ns, error);
        }
    }
    return status;
}

/* The corners of the sample's region by the calibration of a session, whose frames are part of what is seen here. */
static int place_by_calibration(struct view *view, const char *path, struct nacre_error *error)
{
    const struct calibrate_options options = {.black = BLACK_SUBTRACT, .confidence = confidence};
    const struct camera *camera = view->stand.devices.camera;
    struct session session = {0};
    struct calibration calibration = {.white_frames = 0};
    struct visit_progress progress = {.total = 1};
    int status = session_open(path, &session, error);
    if (status == NACRE_OK) {
        status = calibrate(&session, &options, &progress, &calibration, error);
    }
    if (status == NACRE_OK) {
        const struct station *station = &session.station;
        double right = station->sample.width;
        double bottom = station->sample.height;
        const struct point surface[4] = {{0, 0}, {right, 0}, {right, bottom}, {0, bottom}};
        struct point corners[4];
        for (int i = 0; i < 4; i++) {
            corners[i] = camera_map_apply(&calibration.map, surface[i]);
            corners[i].x += station->camera.v4l2.left;
            corners[i].y += station->camera.v4l2.top;
        }
        framing_place(&view->framing, corners, camera->width, camera->height);
    }
    calibration_finish(&calibration);
    session_finish(&session);
    return status;
}

static int look(struct view *view, const char *output, const char *calibration,
                struct nacre_error *error)
{
    const struct camera *camera = view->stand.devices.camera;
    size_t pixels = pixels_of(view);
    struct picture picture = {0};
    const struct framing_frames frames = {
        .black = view->raw + BLACK * pixels,
        .white = view->raw + WHITE * pixels,
        .shown = {view->raw + SHOWN * pixels, view->raw + AGAIN * pixels},
        .width = camera->width,
        .height = camera->height,
        .full_scale = (1 << camera->bits) - 1,
        .bayer = camera->bayer};
    int status = framing_look(&frames, &view->framing, error);
    if (status == NACRE_OK && calibration) {
        status = place_by_calibration(view, calibration, error);
    }
    if (status == NACRE_OK) {
        status = framing_draw(&frames, &view->framing, &picture, error);
    }
    if (status == NACRE_OK) {
        status = picture_write(output, &picture, NULL, error);
    }
    picture_finish(&picture);
    return status;
}

static int print_json(const struct view *view, const char *output, struct nacre_error *error)
{
    const struct framing *f = &view->framing;
    const struct framing_box *crop = &f->crop;
    json_t *region = json_null();
    if (f->found) {
        json_t *corners = json_array();
        for (int i = 0; i < 4; i++) {
            (void)json_array_append_new(corners,
                                        json_pack("[f, f]", f->corners[i].x, f->corners[i].y));
        }
        region = json_pack("{s:i, s:i, s:i, s:i, s:o}", "left", crop->left, "top", crop->top,
                           "width", crop->width, "height", crop->height, "corners", corners);
    }
    return json_print(json_pack("{s:s, s:f, s:f, s:o, s:o, s:s}", "output", output, "exposure_ms",
                                (double)view->exposure_ns * 1e-6, "saturated", f->saturated,
                                "focus", isfinite(f->focus) ? json_real(f->focus) : json_null(),
                                "region", region, "bayer",
                                bayer_names[view->stand.devices.camera->bayer]),
                      error);
}

static void print_text(const struct view *view, const char *output)
{
    const struct framing *f = &view->framing;
    const struct framing_box *crop = &f->crop;
    printf("%-10s %s, %g ms\n", "picture", output, (double)view->exposure_ns * 1e-6);
    printf("%-10s %.2f %% of pixels (magenta)%s\n", "saturated", 100 * f->saturated,
           f->saturated > 0.001 ? ": close the aperture or expose for less" : "");
    printf("%-10s %.4g; larger is sharper: compare pictures of the same pattern while turning the "
           "lens\n",
           "focus", f->focus);
    if (!f->found) {
        printf("%-10s not found: the projector's picture does not stand out, or is cut by the "
               "frame's edge\n",
               "region");
        return;
    }
    printf("%-10s corners", "region");
    for (int i = 0; i < 4; i++) {
        printf(" (%.1f, %.1f)", f->corners[i].x, f->corners[i].y);
    }
    printf(" (green)\n%-10s camera: {width: %d, height: %d, bayer: %s", "keep", crop->width,
           crop->height, bayer_names[view->stand.devices.camera->bayer]);
    if (!view->stand.simulated) {
        printf(", v4l2: {frame_width: %d, frame_height: %d, left: %d, top: %d}",
               view->stand.devices.camera->width, view->stand.devices.camera->height, crop->left,
               crop->top);
    } else {
        printf("} from (%d, %d) on", crop->left, crop->top);
    }
    printf("%s\n", view->stand.simulated ? "" : "}");
}

static int open_view(struct view *view, const char *path, struct nacre_error *error)
{
    int status = station_read(path, &view->station, error);
    if (status != NACRE_OK) {
        return status;
    }
    widen(&view->station);
    status = stand_open(&view->station, &view->stand, error);
    if (status != NACRE_OK) {
        return status;
    }
    const struct projector *projector = view->stand.devices.projector;
    view->exposer =
        (struct exposer){.devices = &view->stand.devices,
                         .retries = 3,
                         .tolerance_ns = llround(view->station.camera.tolerance_ms * 1e6)};
    view->levels = malloc((size_t)projector->width * (size_t)projector->height);
    view->raw = calloc(FRAMES * pixels_of(view), sizeof *view->raw);
    return view->levels && view->raw ? NACRE_OK : nacre_fail_memory(error, "frames");
}

static int run(const void *values, const struct invocation *invocation, struct nacre_error *error)
{
    const struct view_settings *settings = values;
    struct view view = {.levels = NULL};
    int status = open_view(&view, settings->station, error);
    if (status == NACRE_OK) {
        status = take_frames(&view, settings, error);
    }
    if (status == NACRE_OK) {
        status = look(&view, settings->output, settings->calibration, error);
    }
    if (status == NACRE_OK && invocation->json) {
        status = print_json(&view, settings->output, error);
    } else if (status == NACRE_OK) {
        print_text(&view, settings->output);
    }
    stand_close(&view.stand);
    station_finish(&view.station);
    free(view.levels);
    free(view.raw);
    return status;
}

const struct verb verb_view = {
    .name = "view",
    .operands = "--station FILE -o PICTURE",
    .summary = "take one frame of a station for framing and focus",
    .text =
        "Shows a pattern and writes what the camera sees of it, the whole frame in colour: "
        "saturated pixels are magenta, and the outline of what the projector lights, found from a "
        "white and a black frame, is green. Prints how much is saturated, a figure for the focus, "
        "and the keys of the station file that keep the part of the frame that the sample "
        "fills.\n\n"
        "Focus the projector first, on the white layer with --pattern dots, then the camera: the "
        "figure grows as edges get sharper.",
    .operand_maximum = 0,
    .options = view_options,
    .settings_size = sizeof(struct view_settings),
    .run = run,
};
