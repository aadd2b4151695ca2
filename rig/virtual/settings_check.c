/* Checks of the key `virtual`: colour wheel, contrast, view, distortion, names of effects. */
#include "rig/virtual/settings_check.h"

#include "base/nearest.h"
#include "rig/station.h"
#include "rig/virtual/effects.h"
#include "rig/virtual/lens.h"
#include "rig/virtual/wheel.h"

#include <math.h>
#include <string.h>

static int check_wheel(const char *path, const struct virtual_wheel *wheel,
                       struct nacre_error *error)
{
    static const char *const names[3] = {"red", "green", "blue"};
    double angle = 0;
    double light[3] = {0};
    if (wheel->segments_line > 0 && wheel->segment_count == 0) {
        return nacre_fail(error,
                          "%s:%d: virtual.projector.wheel.segments: there are none; give at least "
                          "one, or leave the wheel out",
                          path, wheel->segments_line);
    }
    if (wheel->segment_count > WHEEL_SEGMENTS) {
        return nacre_fail(error, "%s:%d: virtual.projector.wheel.segments: %zu; give at most %d",
                          path, wheel->segments_line, wheel->segment_count, WHEEL_SEGMENTS);
    }
    for (size_t i = 0; i < wheel->segment_count; i++) {
        angle += wheel->segments[i].angle_deg;
        for (int c = 0; c < 3; c++) {
            light[c] += wheel->segments[i].color[c] * wheel->segments[i].angle_deg;
        }
    }
    if (wheel->segment_count > 0 && fabs(angle - 360) > 1e-6) {
        return nacre_fail(error,
                          "%s:%d: virtual.projector.wheel.segments: take %g degrees together; make "
                          "them 360",
                          path, wheel->segments_line, angle);
    }
    for (int c = 0; c < 3; c++) {
        if (wheel->segment_count > 0 && light[c] < 1e-3) {
            return nacre_fail(error,
                              "%s:%d: virtual.projector.wheel.segments: none lets %s through, so "
                              "that white would have none; add it to a color",
                              path, wheel->segments_line, names[c]);
        }
    }
    return NACRE_OK;
}

static int check_contrast(const char *path, const struct virtual_projector_settings *projector,
                          struct nacre_error *error)
{
    if (projector->contrast > 0 && projector->contrast <= 1) {
        return nacre_fail(error,
                          "%s:%d: virtual.projector.contrast: with %g black is as bright as white; "
                          "give more than 1, or leave it out for a black that is dark",
                          path, projector->contrast_line, projector->contrast);
    }
    return NACRE_OK;
}

static double radians(double degrees)
{
    return degrees * (3.14159265358979323846 / 180);
}

/* The camera must be above the stage, and all of the sample before it; optics.h has the view itself. */
static int check_view(const char *path, const struct station *station, struct nacre_error *error)
{
    const struct virtual_settings *simulated = &station->simulated;
    const struct virtual_camera_settings *camera = &simulated->camera;
    const struct station_sample *sample = &station->sample;
    double sine = sin(radians(camera->elevation_deg));
    double cosine = cos(radians(camera->elevation_deg));
    double falls[2] = {tan(radians(simulated->tilt_deg[1])), tan(radians(simulated->tilt_deg[0]))};
    double facing = (cosine - sine * falls[1]) / hypot(hypot(falls[0], falls[1]), 1);
    double depth_mm = camera->distance_mm - 0.5 * sample->pitch_mm *
                                                (fabs(cosine * falls[0]) * sample->width +
                                                 fabs(sine + cosine * falls[1]) * sample->height);
    int line = camera->elevation_line ? camera->elevation_line : simulated->tilt_line;
    if (facing < 0.01) {
        return nacre_fail(error,
                          "%s:%d: virtual: the camera sees the stage from below; lessen "
                          "camera.elevation_deg or tilt_deg",
                          path, line);
    }
    if (depth_mm < 0.01 * camera->distance_mm) {
        return nacre_fail(error,
                          "%s:%d: virtual: part of the sample is behind the camera; enlarge "
                          "camera.distance_mm, or lessen camera.elevation_deg or tilt_deg",
                          path, line);
    }
    return NACRE_OK;
}

static int check_distortion(const char *path, const struct station *station,
                            struct nacre_error *error)
{
    const struct virtual_camera_settings *camera = &station->simulated.camera;
    double diagonal = hypot(station->camera.width, station->camera.height);
    if (!lens_distortion_is_sound(camera->distortion, 1 + camera->defocus_px / diagonal)) {
        return nacre_fail(
            error,
            "%s:%d: virtual.camera.distortion: [%g, %g] folds the picture or squeezes "
            "it into the middle; take smaller numbers",
            path, camera->distortion_line, camera->distortion[0], camera->distortion[1]);
    }
    return NACRE_OK;
}

int effects_check_names(const char *path, int line, char *const *without, size_t count,
                        const char *const *names, const char *const *more,
                        struct nacre_error *error)
{
    const char *const *lists[2] = {names, more};
    for (size_t i = 0; i < count; i++) {
        struct nearest nearest = nearest_begin(without[i]);
        bool known = false;
        for (int k = 0; k < 2; k++) {
            for (size_t n = 0; lists[k] && lists[k][n]; n++) {
                known = known || strcmp(lists[k][n], without[i]) == 0;
                nearest_offer(&nearest, lists[k][n]);
            }
        }
        if (!known) {
            return nacre_fail(error, "%s:%d: without: no effect is called '%s'%s%s%s", path, line,
                              without[i],
                              nearest.best ? "; did you mean '" : "; --explain lists them",
                              nearest.best ? nearest.best : "", nearest.best ? "'?" : "");
        }
    }
    return NACRE_OK;
}

/* A rig of glass and metal has all of its effects. */
static int check_forbidden(const char *path, const struct station *station,
                           struct nacre_error *error)
{
    if (station->without_count > 0 && station->camera.driver != CAMERA_DRIVER_VIRTUAL) {
        return nacre_fail(error,
                          "%s:%d: without: only a virtual station can leave effects out; remove it",
                          path, station->without_line);
    }
    return effects_check_names(path, station->without_line, station->without,
                               station->without_count, effect_names, NULL, error);
}

int virtual_settings_check(const char *path, const struct station *station,
                           struct nacre_error *error)
{
    const struct virtual_projector_settings *projector = &station->simulated.projector;
    int status = check_wheel(path, &projector->wheel, error);
    if (status == NACRE_OK) {
        status = check_contrast(path, projector, error);
    }
    if (status == NACRE_OK) {
        status = check_distortion(path, station, error);
    }
    if (status == NACRE_OK) {
        status = check_forbidden(path, station, error);
    }
    return status == NACRE_OK ? check_view(path, station, error) : status;
}
