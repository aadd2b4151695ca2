/* What factorizations of the same responses share whatever their terms, clusters and iterations. */
#ifndef FACTOR_PREPARED_H
#define FACTOR_PREPARED_H

#include "factor/falloff.h"
#include "factor/quality.h"
#include "factor/terms_data.h"

/* One for each weight. */
enum { PREPARED_DATA = 2 };

struct factor_prepared {
    bool ready; /* the next three */
    struct features features;
    struct quality quality;
    double seconds; /* that it took */
    struct prepared_data {
        bool ready;
        struct terms_options options; /* as asked for */
        double epsilon, seconds;
        struct terms_data data;
    } data[PREPARED_DATA];
};

/* Free what runs have filled in; zeroed ones are allowed. */
static inline void factor_prepared_finish(struct factor_prepared *prepared)
{
    features_finish(&prepared->features);
    for (int i = 0; i < PREPARED_DATA; i++) {
        terms_data_finish(&prepared->data[i].data);
    }
    *prepared = (struct factor_prepared){0};
}

#endif
