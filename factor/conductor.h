/* A factorization while it runs: what its parts (factorize.c, conductor.c, iterate.c, resume.c) share. Private to them. */
#ifndef FACTOR_CONDUCTOR_H
#define FACTOR_CONDUCTOR_H

#include "factor/attempt.h"
#include "factor/closing.h"
#include "factor/factorize.h"
#include "factor/probe.h"
#include "factor/quality.h"
#include "factor/search.h"
#include "factor/words.h"

/* Why an attempt ended. */
enum ending {
    ENDING_NONE,
    ENDING_ITERATIONS, /* as many as were allowed */
    ENDING_TOLERANCE,  /* little more to win */
    ENDING_ERROR,      /* the error is held */
    ENDING_HOPELESS,   /* the error will not be held with these settings */
    ENDING_GROWTH,     /* larger settings will bring more */
    ENDING_TIME,
    ENDING_REQUEST,
    ENDING_WATCHER,
};

/* Iterations that an attempt must have time for to be worth opening. */
enum { CONDUCTOR_ITERATIONS = 4 };

struct conductor {
    const struct responses *responses;
    double pitch_mm;
    const struct factor_options *options; /* without auto kernels and planes */
    int shaped_terms;                     /* with a kernel per term, where they are not given */
    const struct opencl *opencl;
    struct progress *progress;
    struct clock *clock;
    int64_t begun_ns;

    const struct terms_data *data;         /* of prepared, with a kernel per term; else NULL */
    struct factor_prepared own, *prepared; /* prepared: the options' or own */
    struct probe probe;
    struct search search;
    struct attempt now, best; /* best: at rest; its ids are NULL while there is none */
    bool now_is_open;
    enum ending ending; /* of the last attempt */

    struct nacre_material made; /* of `best`, where its error was verified */
    struct error_report made_report;

    const struct factor_stage *stage; /* that runs now, or NULL */
    double looking_seconds;           /* of the watcher */
    double shared_seconds;            /* that prepared took in another run */
    double iterating_since;           /* seconds by conductor_seconds */
    double iterated_before;           /* before the checkpoint that was loaded */
    double closing_pace;              /* measured seconds by closing cost, the slowest so far */
    double probed_at, probe_seconds;
    double checkpoint_at;
    char *identity; /* for checkpoints: scan and options */
    bool continued;
    double seconds_clustering, seconds_measuring;
};

/* Seconds since the command began. */
double conductor_seconds(const struct conductor *conductor);

/* What was asked for. */
static inline bool conductor_wants_error(const struct conductor *c)
{
    return c->options->error < 1;
}

static inline bool conductor_has_deadline(const struct conductor *c)
{
    return c->options->seconds > 0;
}

/* Settings in words: a kernel per term has no clusters. */
static inline struct size_words conductor_size(const struct conductor *c, int terms, int clusters)
{
    return size_words(terms, c->options->model == FACTOR_MODEL_CLUSTERS ? clusters : 0);
}

/* Whether settings of so many terms and clusters can be opened and iterated a little in time. */
bool conductor_has_time_for(const struct conductor *conductor, int terms, int clusters);

/* Go through what is to be tried. NACRE_CANCELLED leaves the best so far in `best`. */
int conductor_run(struct conductor *conductor, struct nacre_error *error);

/* Iterate `now` until one of the criteria ends it. */
int conductor_iterate(struct conductor *conductor, enum ending *ending, struct nacre_error *error);

/* Read the factors of `now` and measure the error of a few points. */
int conductor_probe(struct conductor *conductor, struct nacre_error *error);

/* The search with `now` noted as a try that ended so. */
void conductor_note(const struct conductor *conductor, enum ending ending, struct search *search);

/* The file of options->checkpoint: write it; go on from it, where there is one. */
int conductor_save(struct conductor *conductor, struct nacre_error *error);
int conductor_resume(struct conductor *conductor, struct nacre_error *error);

/* What the attempts of this run are fitted to, or NULL with clusters. */
static inline const struct terms_data *conductor_data(const struct conductor *c)
{
    return c->data;
}

/* The material of an attempt, of as many bits as its planes need where that is auto. */
int conductor_make_material(const struct conductor *conductor, const struct attempt *attempt,
                            struct nacre_material *material, struct error_report *report,
                            struct nacre_error *error);

/* Make the method of `now`. */
int conductor_make_method(struct conductor *conductor, struct nacre_error *error);

void conductor_finish(struct conductor *conductor);

#endif
