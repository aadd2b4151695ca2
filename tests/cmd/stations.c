/* Settings files of a small virtual station, and a small scene. */
#include "tests/cmd/stations.h"

#include "tests/cmd/spawn.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char sample[] = "width: 20\n"
                             "height: 16\n"
                             "pitch_mm: 0.4\n"
                             "thickness_mm: 4\n"
                             "margin_points: 3\n"
                             "base: light\n"
                             "materials:\n"
                             "  - name: light\n"
                             "    scattering_per_mm: [2.4, 2.3, 2.1]\n"
                             "    absorption_per_mm: [0.2, 0.3, 0.6]\n"
                             "  - name: red\n"
                             "    scattering_per_mm: [2.9, 2.7, 2.6]\n"
                             "    absorption_per_mm: [0.4, 1.0, 1.4]\n"
                             "inclusions:\n"
                             "  - material: red\n"
                             "    bands: {angle_deg: 35, period_mm: 4, fraction: 0.5}\n";

static const char plan[] = "seed: 5\n"
                           "black_frames: 16\n"
                           "white_frames: 2\n"
                           "dot_spacing: 6\n"
                           "dot_shift: 3\n"
                           "grid_spacing: 11\n"
                           "window: 11\n"
                           "exposure_turns: [1, 8, 60]\n";

/* Takes what else projector and camera do. */
static const char station[] =
    "sample: {width: 20, height: 16, pitch_mm: 0.4}\n"
    "camera: {driver: virtual, width: 96, height: 80, bits: 10, bayer: RGGB, pedestal: 16,\n"
    "         read_noise: 0.5}\n"
    "projector: {driver: virtual, wheel_hz: 30}\n"
    "trigger: {driver: virtual}\n"
    "white_reflectance: 0.9\n"
    "plan: plan.yaml\n"
    "virtual:\n"
    "  sample: sample.yaml\n"
    "  seed: 11\n"
    "  projector: {contrast: 2000, vignetting: 0.1%s}\n"
    "  camera: {elevation_deg: 12, pixels_per_point: 4%s}\n";

static void write_into(const char *folder, const char *name, const char *text)
{
    char *path = path_join(folder, name);
    text_write(path, text);
    free(path);
}

static void write_station(const char *folder, const char *projector, const char *camera)
{
    char *text = NULL;
    if (asprintf(&text, station, projector, camera) < 0) {
        abort();
    }
    write_into(folder, "station.yaml", text);
    write_into(folder, "plan.yaml", plan);
    write_into(folder, "sample.yaml", sample);
    free(text);
}

void stations_write(const char *folder)
{
    write_station(folder, "", "");
}

void stations_write_restless(const char *folder)
{
    write_station(folder,
                  ", lamp: {drift: 0.05, drift_hours: 0.02, flicker: 0.01, flicker_hz: 100}",
                  ", readout_ms: 15, dropped_frames: 0.02, late_frames: 0.02");
}

void stations_write_scene(const char *path, const char *material)
{
    char *text = NULL;
    if (asprintf(&text,
                 "image: {width: 32, height: 24}\n"
                 "camera: {position_mm: [0, -40, 30], at_mm: [0, 0, 0], angle_deg: 30}\n"
                 "lights:\n"
                 "  - {kind: point, position_mm: [-20, -20, 40], at_mm: [0, 0, 0], irradiance: 1}\n"
                 "objects:\n"
                 "  - shape: quad\n"
                 "    size_mm: [10, 7, 1]\n"
                 "    material: {file: %s, mapping: planar}\n",
                 material) < 0) {
        abort();
    }
    text_write(path, text);
    free(text);
}

void stations_change(const char *path, const char *from, const char *to)
{
    size_t size = 0;
    char *text = (char *)file_read(path, &size);
    char *place = text ? strstr(text, from) : NULL;
    char *changed = NULL;
    if (!place ||
        asprintf(&changed, "%.*s%s%s", (int)(place - text), text, to, place + strlen(from)) < 0) {
        (void)fprintf(stderr, "%s: cannot be read, or has no \"%s\"\n", path, from);
        abort(); /* a test that cannot set itself up must not go on */
    }
    text_write(path, changed);
    free(changed);
    free(text);
}
