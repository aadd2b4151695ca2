/* Printing what a factorization found and what it took, as text or JSON on standard output, warnings on standard error. */
#ifndef CMD_FACTOR_PRINT_H
#define CMD_FACTOR_PRINT_H

#include "factor/factorize.h"

#include <jansson.h>
#include <stdbool.h>

/* The material was written to `path`; `explained` is what --explain told, for JSON, or NULL. */
int factor_print(const struct nacre_material *material, const struct factor_summary *summary,
                 const struct opencl *opencl, const char *path, bool json, json_t *explained,
                 struct nacre_error *error);

#endif
