/* The verbs of `nacre`, one file each. */
#ifndef CMD_VERBS_H
#define CMD_VERBS_H

#include "base/options.h"

extern const struct verb verb_scan, verb_devices, verb_doctor, verb_develop, verb_simulate,
    verb_factor, verb_error, verb_render, verb_report, verb_plan;

#endif
