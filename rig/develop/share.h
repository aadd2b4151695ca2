/* Light of a grid shared out among its lit points where their windows overlap. */
#ifndef RIG_DEVELOP_SHARE_H
#define RIG_DEVELOP_SHARE_H

#include "nacre/error.h"
#include "nacre/scan.h"
#include "rig/plan.h"

/* What a thread needs to share one grid after the other. */
struct share;

/* NULL in *share where the plan has no profile: windows do not overlap then. The plan is laid and outlives the share. */
int share_new(const struct nacre_scan_info *info, const struct plan *plan, struct share **share,
              struct nacre_error *error);
void share_free(struct share *share);

/* See how the lit points of `grid` divide its light, reflected[channels][height][width]. The picture is the sum of all
 * responses: at x, lit point j has the part A_j g(|x - x_j|) / sum_k A_k g(|x - x_k|), g the plan's profile. What x
 * itself reflects is in all of them alike and falls out. A_j is what j's light is of the profile between a quarter and
 * half of the way to the next lit point, found in a few rounds, or a tenth of what it is nearer by where that is more.
 * Parts of one place sum to 1: no light is lost. */
void share_begin(struct share *share, int grid, const float *reflected);

/* Take their parts out of the window of the grid's lit point number `index`, response[channels][K][K]. */
void share_apply(const struct share *share, size_t index, float *response);

#endif
