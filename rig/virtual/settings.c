/* The table of keys below `virtual` in a station file. */
#include "rig/virtual/settings.h"

#include <limits.h>

static const struct settings_field projector_fields[] = {
    {.key = "contrast",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_projector_settings, contrast),
     .maximum = 1e9,
     .sentence = "irradiance of white over that of black (2000); without it black is dark"},
    {.key = "vignetting",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_projector_settings, vignetting),
     .maximum = 0.9,
     .sentence = "fraction of the centre's irradiance that the farthest corner lacks"},
    {.key = "latency_ms",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_projector_settings, latency_ms),
     .maximum = 10000,
     .sentence = "from the refresh that takes a pattern until it is on the glass"},
    {0}};

static const struct settings_schema projector_schema = {
    .what = "virtual projector",
    .size = sizeof(struct virtual_projector_settings),
    .fields = projector_fields};

static const struct settings_field camera_fields[] = {
    {.key = "distance_mm",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_camera_settings, distance_mm),
     .minimum = 1,
     .maximum = 1e6,
     .fallback = "500",
     .sentence = "from the lens to the centre of the sample"},
    {.key = "elevation_deg",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_camera_settings, elevation_deg),
     .minimum = -80,
     .maximum = 80,
     .sentence = "of the optical axis above the projector's, which is the sample's normal"},
    {.key = "roll_deg",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_camera_settings, roll_deg),
     .minimum = -180,
     .maximum = 180,
     .sentence = "of the camera about its optical axis, clockwise as the camera looks"},
    {.key = "pixels_per_point",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_camera_settings, pixels_per_point),
     .minimum = 0.1,
     .maximum = 100,
     .fallback = "4",
     .sentence = "raw pixels that a surface point in the centre is wide"},
    {.key = "vignetting",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_camera_settings, vignetting),
     .maximum = 0.9,
     .sentence = "fraction of light lost in the corners of the frame"},
    {.key = "full_scale_s",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_camera_settings, full_scale_s),
     .minimum = 1e-6,
     .maximum = 1e6,
     .fallback = "0.04",
     .sentence = "exposure at which a white Lambertian surface, fully lit, just saturates"},
    {.key = "response",
     .kind = SETTINGS_REALS,
     .offset = offsetof(struct virtual_camera_settings, response),
     .count = 3,
     .minimum = 1e-6,
     .maximum = 1,
     .fallback = "1",
     .sentence = "R G B, of the colour filters to the projector's white"},
    {.key = "readout_ms",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct virtual_camera_settings, readout_ms),
     .maximum = 10000,
     .sentence = "time to read a frame out after its exposure"},
    {0}};

static const struct settings_schema camera_schema = {
    .what = "virtual camera",
    .size = sizeof(struct virtual_camera_settings),
    .fields = camera_fields};

static const struct settings_field fields[] = {
    {.key = "sample",
     .kind = SETTINGS_PATH,
     .offset = offsetof(struct virtual_settings, sample),
     .sentence = "sample file; without it a bare white board lies on the stage"},
    {.key = "seed",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct virtual_settings, seed),
     .maximum = INT_MAX,
     .sentence = "of the noise"},
    {.key = "projector",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct virtual_settings, projector),
     .schema = &projector_schema,
     .sentence = "the simulated projector"},
    {.key = "camera",
     .kind = SETTINGS_STRUCT,
     .offset = offsetof(struct virtual_settings, camera),
     .schema = &camera_schema,
     .sentence = "the simulated camera"},
    {0}};

const struct settings_schema virtual_settings_schema = {
    .what = "virtual station", .size = sizeof(struct virtual_settings), .fields = fields};
