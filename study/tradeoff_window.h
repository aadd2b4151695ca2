/* Which windows factorizations of a study may have. */
#ifndef STUDY_TRADEOFF_WINDOW_H
#define STUDY_TRADEOFF_WINDOW_H

#include "study/tradeoff.h"

/* List the scan's own and smaller ones, each with what it leaves out of the responses. */
int tradeoff_list_windows(const struct responses *responses, struct tradeoff *tradeoff,
                          struct nacre_error *error);

#endif
