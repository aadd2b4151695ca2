/* What factorizations of the same responses share whatever their terms, clusters and iterations. */
#ifndef FACTOR_PREPARED_H
#define FACTOR_PREPARED_H

#include "factor/falloff.h"
#include "factor/quality.h"
#include "factor/terms_data.h"

#include <stdlib.h>

/* One for each weight; numbers of clusters that labels are kept of, a later one in place of the first. */
enum { PREPARED_DATA = 2, PREPARED_LABELS = 12 };

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
    struct prepared_labels {
        int clusters, seed;
        uint32_t *labels; /* [features.count], or NULL */
        double seconds;   /* that it took */
    } labels[PREPARED_LABELS];
    int labels_next;
};

/* Free what runs have filled in; zeroed ones are allowed. */
static inline void factor_prepared_finish(struct factor_prepared *prepared)
{
    features_finish(&prepared->features);
    for (int i = 0; i < PREPARED_DATA; i++) {
        terms_data_finish(&prepared->data[i].data);
    }
    for (int i = 0; i < PREPARED_LABELS; i++) {
        free(prepared->labels[i].labels);
    }
    *prepared = (struct factor_prepared){0};
}

#endif
