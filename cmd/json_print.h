/* Printing a verb's result as JSON. */
#ifndef CMD_JSON_PRINT_H
#define CMD_JSON_PRINT_H

#include "nacre/error.h"

#include <jansson.h>

/* Print an object on standard output and release it; NULL is memory that ran out while it was made. */
int json_print(json_t *object, struct nacre_error *error);

#endif
