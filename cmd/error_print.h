/* Printing how good and how large a material is, the same way after `factor` and by `error`. */
#ifndef CMD_ERROR_PRINT_H
#define CMD_ERROR_PRINT_H

#include "factor/error.h"

#include <jansson.h>

/* The relative error, the points counted apart, the sizes of the paper's Table 1 and of the file at `path`, on standard
 * output. */
void error_print(const struct error_report *report, const struct nacre_material *material,
                 const char *path);

/* The same as a JSON object, or NULL when memory runs out. */
json_t *error_to_json(const struct error_report *report, const struct nacre_material *material,
                      const char *path);

#endif
