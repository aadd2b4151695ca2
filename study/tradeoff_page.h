/* The page of a study. Private to study. */
#ifndef STUDY_TRADEOFF_PAGE_H
#define STUDY_TRADEOFF_PAGE_H

#include "study/tradeoff.h"

#include <stdio.h>

/* Write it: what was studied, error against seconds and against bytes, the fronts' points with their commands, and how
 * each run ended. */
int tradeoff_write_page(FILE *page, const struct tradeoff *tradeoff,
                        const struct tradeoff_request *request, struct nacre_error *error);

/* As options have them, except that the method of a kernel per term is "terms". */
const char *tradeoff_model_word(const struct tradeoff_setting *setting);
const char *tradeoff_method_word(const struct tradeoff_setting *setting);
const char *tradeoff_weight_word(const struct tradeoff_setting *setting);

#endif
