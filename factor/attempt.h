/* One factorization with given terms and clusters: its clusters, kernels, method, and what became of it so far. */
#ifndef FACTOR_ATTEMPT_H
#define FACTOR_ATTEMPT_H

#include "factor/factorize.h"
#include "factor/factors.h"
#include "factor/falloff.h"
#include "factor/prepared.h"

/* After each iteration; an entry is NaN until its value is known. */
struct history {
    int count, capacity;
    float *objective, *seconds, *error; /* error: mean relative, of a few points */
};

struct attempt {
    struct problem problem; /* its ids and kernels are these: */
    uint32_t *ids, *kinds;  /* kinds: with a kernel per term */
    float *kernels;
    struct method *method;  /* NULL when at rest */
    struct factors factors; /* as last read from the method */
    struct history history; /* with that of the attempt it started from */
    int inherited;          /* entries of the history that are that one's */
    int known;              /* entries whose objective is known */
    double objective;       /* the last known, in the responses' unit */
    double error;           /* by the probe ... */
    int probed_at;          /* ... after so many iterations; -1: never */
    double goal;            /* of the probe: where the error asked for is worth verifying */
    int verified;           /* times */
    double error_stored;    /* of all points as stored, when verified last */
    double
        noise; /* with a kernel per term: of the objective, what fitting noise would lower it by; 0: not known */
    bool held;              /* the error that was asked for */
    double seconds;         /* all of it; while it is open, to be added to the clock's */
    double opening_seconds; /* clusters, kernels and method */
    double shared_seconds;  /* that clusters took in another run */
    double first_seconds, step_seconds; /* the first iteration, which may compile; the last */
    double closing_seconds;             /* predicted, writing included; 0: not asked for */
};

/* The clusters of the measured points, spread to the others, and their kernels; without `prepared` there is only room
 * for them. Clusters that are found are kept there. With `data` the model is that of a kernel per term. attempt_finish
 * it, also after a failure. */
int attempt_begin(struct attempt *attempt, const struct responses *responses,
                  struct factor_prepared *prepared, const struct terms_data *data,
                  const struct factor_options *options, int terms, int clusters,
                  struct nacre_error *error);

/* One more entry of the history, not known yet. */
int attempt_extend_history(struct attempt *attempt, struct nacre_error *error);

/* Start with the history of another. */
int attempt_inherit(struct attempt *attempt, const struct attempt *from, struct nacre_error *error);

/* Iterations of its own. */
int attempt_iterations(const struct attempt *attempt);

/* All channels' objective in the responses' own unit, before a step (`step`) or as it is. */
int attempt_advance(struct attempt *attempt, bool step, double *objective,
                    struct nacre_error *error);

void attempt_finish(struct attempt *attempt); /* a zeroed one is allowed */

#endif
