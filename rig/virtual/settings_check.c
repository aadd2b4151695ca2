/* Checks of the key `virtual`: colour wheel, distortion, names of effects. */
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

int virtual_settings_check(const char *path, const struct station *station,
                           struct nacre_error *error)
{
    const struct virtual_settings *simulated = &station->simulated;
    const struct virtual_camera_settings *camera = &simulated->camera;
    int status = check_wheel(path, &simulated->projector.wheel, error);
    if (status == NACRE_OK && !lens_distortion_is_sound(camera->distortion)) {
        status =
            nacre_fail(error,
                       "%s:%d: virtual.camera.distortion: [%g, %g] folds the picture or squeezes "
                       "it into the middle; take smaller numbers",
                       path, camera->distortion_line, camera->distortion[0], camera->distortion[1]);
    }
    if (status == NACRE_OK) {
        status = effects_check_names(path, station->without_line, station->without,
                                     station->without_count, effect_names, NULL, error);
    }
    return status;
}
