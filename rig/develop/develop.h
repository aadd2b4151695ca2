/* A session's frames made into a scan: calibration, then every grid pattern merged, cleaned, resampled and cut up. */
#ifndef RIG_DEVELOP_DEVELOP_H
#define RIG_DEVELOP_DEVELOP_H

#include "base/progress.h"
#include "nacre/error.h"
#include "nacre/pixel.h"
#include "rig/develop/align.h"
#include "rig/develop/black.h"
#include "rig/develop/linearity.h"
#include "rig/develop/resample.h"
#include "rig/develop/target.h"
#include "rig/develop/warnings.h"

#include <stdbool.h>

enum flat_mode {
    FLAT_SEPARATE, /* divide by the camera's vignetting at x_o and the projector's light at x_i (falloff.h) */
    FLAT_PAPER, /* divide by white, which takes the projector's light at x_o */
};

/* Words for the modes in the order of the enum, NULL-terminated. */
extern const char *const flat_mode_names[];

struct develop_options {
    enum black_mode black;
    double confidence; /* of BLACK_CLIP, one-sided */
    enum demosaic demosaic;
    enum nacre_pixel store; /* NACRE_FLOAT or NACRE_HALF */
    enum flat_mode flat;
    bool once;   /* keep no work file, whatever happens: nobody will go on with it */
    bool resume; /* go on with what a stopped development of the same output left beside it */
    const char *pixels;       /* where the map of pixels is written; may be NULL */
    const char *known_pixels; /* a map of pixels that are not to be trusted either; may be NULL */
    const char
        *target; /* session that shows a target of dots in place of the sample; may be NULL */
    double target_spacing_mm; /* between those dots */
};

struct develop_report {
    int width, height, window, channels;
    int patterns, missing_patterns; /* grids */
    int taken_over;                 /* of them, from the development that was stopped */
    int white_frames, black_frames, dots_frames;
    size_t responses;        /* measured */
    size_t missing_entries;  /* inside the sample, of measured responses: NaN */
    double saturated_share;  /* of the grid frames' pixels, at every exposure */
    double black_level;      /* median, raw units a second */
    double frame_noise;      /* median deviation of one merged black frame, raw units a second */
    double white[3];         /* by channel, of what reflects all light: raw units a second */
    double noise;            /* deviation of an entry of a response without light: of R_d */
    double channel_noise[3]; /* the same by channel */
    double centre;           /* mean entry of the lit points themselves */
    double rim_share;        /* of a response's energy, on the rim of its window */
    double overlap;          /* of a response's energy, estimated to fall outside its window */
    enum demosaic demosaic;  /* that was used */
    double
        misfit; /* of frames and the fit's premise, relative, 0 to 1; NaN where it was not asked */
    double
        blur_px; /* deviation by which the camera is out of focus, which the fit takes into account */
    double pixels_per_point; /* camera pixels along a surface point in the middle */
    size_t falloff_pairs;    /* that told the projector's fall-off; 0: none was taken out */
    double falloff;       /* most of the projector's light in the region over the least, less 1 */
    double falloff_doubt; /* standard error of the logarithm of that */
    double pulse_turns;   /* of the trigger pulse that the wheel makes the most wrong */
    double pulse_error;   /* its colour error; 0: none was measured, or none is wrong */
    struct linearity_report linearity;
    struct align_report align;
    double pitch_mm; /* between surface points, as the scan has it */
    struct target_report target;
    double white_seconds, black_seconds, dots_seconds, map_seconds, grid_seconds, total_seconds;
    struct warnings warnings;
};

/* Develop the session at `session_path` into the scan `output`, which appears whole or not at all. `report` may be
 * NULL. The scan is the same for any number of threads.
 * Responses wait in the file `output`.work, which is removed at the end, and stays where the process is killed, is asked to
 * stop, or fails for a damaged frame or a full disk: `resume` then goes on with it, to the same scan. */
int develop_session(const char *session_path, const struct develop_options *options,
                    const char *output, struct progress *progress, struct develop_report *report,
                    struct nacre_error *error);

#endif
