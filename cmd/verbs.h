/* The verbs of `nacre`, one file each. */
#ifndef CMD_VERBS_H
#define CMD_VERBS_H

#include "base/options.h"

extern const struct verb verb_scan, verb_devices, verb_develop, verb_simulate, verb_factor,
    verb_error, verb_render, verb_report, verb_doctor, verb_view, verb_plan, verb_start,
    verb_status, verb_pause, verb_resume, verb_cancel, verb_confirm, verb_bake, verb_tradeoff;

#endif
