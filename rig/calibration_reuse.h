/* Taking the white and dots frames of one session over into another. */
#ifndef RIG_CALIBRATION_REUSE_H
#define RIG_CALIBRATION_REUSE_H

#include "nacre/error.h"
#include "rig/session.h"

#include <stddef.h>

/* Whether the calibration frames of `old` would be those of `session` if nothing has moved: the same devices, region and
 * exposures, the same dots, and every white and dots pattern measured. Refused otherwise, naming what differs. */
int calibration_fits(const struct session *old, const struct session *session,
                     struct nacre_error *error);

/* Write `old`'s white and dots frames into `session`, each with the attribute nacre.calibration that says where it is
 * from. *count is how many. */
int calibration_take_over(const struct session *old, const struct session *session, size_t *count,
                          struct nacre_error *error);

#endif
