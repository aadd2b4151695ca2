/* What accuracy costs in time: light samples are added step by step until an error is held or time is up.
 *
 * Each step is made twice, with independent samples: half the root mean square of the difference between the two halves
 * is the error of their mean. Steps of a half are summed up, so that nothing is made twice. What summing up far light
 * changes is the same in both halves and does not show in their difference; the gather measures it. */
#ifndef RENDER_REFINE_H
#define RENDER_REFINE_H

#include "base/clock.h"
#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { REFINE_STEPS_MAXIMUM = 1000 };

struct refine_goal {
    double error;   /* root mean square, relative; 1 or more: any */
    double seconds; /* that all may take from begun_ns on; 0: any */
    struct clock *clock;
    int64_t begun_ns; /* by that clock: when the command began */
};

struct refine_step {
    double density;   /* samples to a surface point in each half */
    double before;    /* in the steps before */
    double tolerance; /* of the gather */
    int64_t until_ns; /* by the goal's clock: when it is no longer of use; 0: always is */
};

struct refine_outcome {
    size_t samples; /* in each half */
    size_t lit;     /* of them */
    double summed;  /* what summing up changes, relative */
    bool cut;       /* time was up; both halves are as they were before */
};

/* What the steps are made of. */
struct refine_work {
    void *context;
    /* Add a step to both halves. */
    int (*bake)(void *context, const struct refine_step *step, struct refine_outcome *outcome,
                struct nacre_error *error);
    /* The error of the mean of both halves as they are, relative. */
    double (*noise)(void *context);
    /* Find out how long it takes from light to picture. Asked once, after the first step, if there is time for it. */
    int (*closing)(void *context, double *seconds, struct nacre_error *error);
};

struct refine_try {
    double density;   /* samples to a surface point, all so far, both halves */
    double tolerance; /* of this step */
    double noise;     /* after it */
    double seconds;   /* it took */
};

struct refine_report {
    double error, noise, bias; /* reached: the root of the sum of the others' squares */
    const char *stopped_by;    /* "error", "time", "limit" */
    bool error_held;           /* or none was asked for: 1 or more */
    bool cut;                  /* one more step was begun, and given up as time was up */
    int count;                 /* of steps; 0: nothing was chosen */
    struct refine_try steps[REFINE_STEPS_MAXIMUM];
    double closing_seconds; /* foreseen for the picture; 0: was not looked at */
};

/* Take steps until the goal is met or cannot be. One step is always taken. */
int refine_run(const struct refine_goal *goal, const struct refine_work *work,
               struct refine_report *report, struct nacre_error *error);

/* Seconds since the command began. */
double refine_seconds(const struct refine_goal *goal);

#endif
