/* The key `virtual` of a station file: what a simulated rig is made of. Data only. */
#ifndef RIG_VIRTUAL_SETTINGS_H
#define RIG_VIRTUAL_SETTINGS_H

#include "base/settings.h"

/* Every member is a thing of the rig; one that is 0 does not exist and is not simulated. */
struct virtual_projector_settings {
    double contrast;   /* irradiance of white over that of black; 0: black is dark */
    double vignetting; /* fraction of the centre's irradiance that the farthest corner lacks */
    double latency_ms; /* from the refresh that takes a pattern until it is on the glass */
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
    double response[3]; /* R G B, of the colour filters to the projector's white */
    double readout_ms;  /* time to read a frame out after its exposure */
};

struct virtual_settings {
    char *sample; /* sample file; NULL: a bare white board lies on the stage */
    int seed;     /* of the noise */
    struct virtual_projector_settings projector;
    struct virtual_camera_settings camera;
};

extern const struct settings_schema virtual_settings_schema;

#endif
