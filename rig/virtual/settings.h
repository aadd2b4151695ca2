/* The key `virtual` of a station file: what a simulated rig is made of. Data only. */
#ifndef RIG_VIRTUAL_SETTINGS_H
#define RIG_VIRTUAL_SETTINGS_H

#include "base/settings.h"

/* Every member is a thing of the rig; one that is 0 does not exist and is not simulated. Members that end in _line hold
 * where the file says so. */
struct virtual_segment {
    double color[3];  /* R G B, what it lets through */
    double angle_deg; /* of the wheel that it takes */
};

struct virtual_wheel {
    struct virtual_segment *segments; /* in the order in which they pass the lamp; heap */
    size_t segment_count;             /* 0: the projector's light is white at all times */
    double phase_deg;                 /* of the first segment's beginning, at the clock's zero */
    int segments_line;
};

struct virtual_lamp {
    double drift;       /* standard deviation of its slow wandering, relative */
    double drift_hours; /* over which it wanders */
    double flicker;     /* standard deviation from one flicker to the next, relative */
    double flicker_hz;
    int drift_line, flicker_line;
};

struct virtual_projector_settings {
    double contrast;        /* irradiance of white over that of black; 0: black is dark */
    double vignetting;      /* fraction of the centre's irradiance that the farthest corner lacks */
    double latency_ms;      /* from the refresh that takes a pattern until it is on the glass */
    double defocus_points;  /* diameter of the circle of confusion, in surface points */
    double shift_points[2]; /* of the projector's pixels on the sample, x and y */
    struct virtual_wheel wheel;
    struct virtual_lamp lamp;
    int contrast_line, vignetting_line, latency_line, defocus_line, shift_line;
};

struct virtual_camera_settings {
    double distance_mm; /* from the pinhole to the centre of the sample */
    double
        elevation_deg; /* of the optical axis above the projector's, which is the sample's normal */
    double roll_deg;   /* of the camera about its optical axis, clockwise as the camera looks */
    double pixels_per_point; /* raw pixels that a surface point in the centre is wide */
    double vignetting;       /* fraction of light lost in the corners of the frame */
    double
        full_scale_s; /* exposure at which a white Lambertian surface, fully lit, just saturates */
    double response[3];    /* R G B, of the colour filters to the projector's white */
    double readout_ms;     /* time to read a frame out after its exposure */
    double distortion[2];  /* k1 and k2 of a radius that is 1 in the frame's corners */
    double defocus_px;     /* diameter of the circle of confusion, in raw pixels */
    double dark_per_s;     /* dark current, raw units a second */
    double nonuniformity;  /* standard deviation of the pixels' sensitivities, relative */
    double hot_pixels;     /* fraction of all pixels */
    double hot_per_s;      /* their mean dark current, raw units a second */
    double dead_pixels;    /* fraction of all pixels, which see no light */
    double dropped_frames; /* fraction of frames that are counted and never come */
    double late_frames;    /* fraction of frames that begin late */
    double late_ms;        /* by how much */
    int elevation_line, vignetting_line, response_line, readout_line, distortion_line, defocus_line,
        dark_line, nonuniformity_line, hot_line, dead_line, dropped_line, late_line;
};

struct virtual_trigger_settings {
    double stray; /* fraction of exposures that something else started before the trigger did */
    int stray_line;
};

struct virtual_settings {
    char *sample;       /* sample file; NULL: a bare white board lies on the stage */
    int seed;           /* of the noise and of all that is accidental in the devices */
    double tilt_deg[2]; /* of the stage about the axes x and y */
    struct virtual_projector_settings projector;
    struct virtual_camera_settings camera;
    struct virtual_trigger_settings trigger;
    int sample_line, tilt_line;
};

extern const struct settings_schema virtual_settings_schema;

#endif
