/* The light of a stage's objects, as good as is asked for. */
#ifndef RENDER_STAGE_REFINE_H
#define RENDER_STAGE_REFINE_H

#include "render/stage.h"

/* How long it takes from the stage's light, which is there already, to the picture. */
typedef int stage_closing(void *context, double *seconds, struct nacre_error *error);

/* As stage_bake with samples that settings->goal chooses, and report->refine filled. */
int stage_bake_refined(struct stage *stage, const struct opencl *opencl, stage_closing *closing,
                       void *context, struct render_report *report, struct nacre_error *error);

#endif
