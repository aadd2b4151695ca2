/* What factorizations of the same responses share whatever their settings. */
#ifndef FACTOR_PREPARED_H
#define FACTOR_PREPARED_H

#include "factor/falloff.h"
#include "factor/quality.h"

struct factor_prepared {
    bool ready;
    struct features features;
    struct quality quality;
    double seconds; /* that it took */
};

/* Free what the first run has filled in; zeroed ones are allowed. */
static inline void factor_prepared_finish(struct factor_prepared *prepared)
{
    features_finish(&prepared->features);
    *prepared = (struct factor_prepared){0};
}

#endif
