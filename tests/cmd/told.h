/* What programs told on standard output, in tests that fail where it is not as it should be. */
#ifndef TESTS_CMD_TOLD_H
#define TESTS_CMD_TOLD_H

#include <jansson.h>

/* Run to a good end, saying nothing on standard error; the standard output, heap. */
char *told_well(const char *const *arguments);

/* A text that must be JSON; the caller releases. */
json_t *told_parse(const char *text);

/* What must be a number, by its path: "error.mean". */
double told_number(const json_t *told, const char *path);

/* The same, which must be whole, straight from the text. */
int told_count(const char *text, const char *path);

#endif
