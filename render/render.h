/* From a scene to a picture. */
#ifndef RENDER_RENDER_H
#define RENDER_RENDER_H

#include "base/opencl.h"
#include "base/picture.h"
#include "nacre/error.h"
#include "render/bake.h"
#include "render/refine.h"
#include "render/scene.h"

#include <stddef.h>

struct render_settings {
    struct bake_settings bake;
    const struct refine_goal
        *goal;              /* that chooses bake.density and the tolerance; NULL: as they are */
    size_t triangle_limit;  /* that splitting edges does not pass */
    const char *pov_folder; /* where the POV-Ray files go and stay; NULL: a temporary folder */
    const char *material;   /* used in place of every material file of the scene, or NULL */
    bool albedo;            /* every material in mode albedo */
    bool povray_shadows;    /* area lights on plain objects are left to POV-Ray */
    bool turns;             /* the camera will go round: plain objects are split for all sides */
};

struct render_object_report {
    size_t vertices, triangles, degenerate;
    size_t open_edges,
        crowded_edges; /* of the mesh as it was: with one triangle, with more than two */
    bool translucent;
    bool
        limited; /* edges stayed longer than a surface point, or than a plain object's light needs */
    double stretch[3]; /* percentiles 5, 50, 95 of drawn over true size */
    double edge_on;    /* share of the surface that the mapping sees from the side */
    double point_mm;
    struct bake_counts counts;
};

struct render_report {
    double mesh_seconds, light_seconds, gather_seconds, export_seconds, povray_seconds;
    double preview_seconds, frame_seconds; /* OpenGL: to begin with, and for all frames */
    struct render_object_report *objects;  /* heap */
    struct refine_report refine;           /* where there was a goal */
    size_t object_count;
};

/* Render. `report` is filled as far as the work came; render_report_finish it. */
int render_scene(const struct scene *scene, const struct render_settings *settings,
                 const struct opencl *opencl, struct picture *picture, struct render_report *report,
                 struct nacre_error *error);

/* What becomes of frame `number`; a failure stops the turntable. */
typedef int render_frame_taker(void *context, int number, const struct picture *picture,
                               struct nacre_error *error);

/* The same by OpenGL, quicker and without a window system: `frames` pictures, evenly on a circle round what the camera
 * looks at, beginning at its own place. */
int render_preview(const struct scene *scene, const struct render_settings *settings,
                   const struct opencl *opencl, int frames, render_frame_taker *take, void *context,
                   struct render_report *report, struct nacre_error *error);
void render_report_finish(struct render_report *report);

#endif
