/* Numbers as people type them: decimal, whole texts only, never NaN or infinite. */
#ifndef BASE_NUMBER_H
#define BASE_NUMBER_H

#include <stdbool.h>
#include <stddef.h>

enum number_status { NUMBER_OK, NUMBER_MALFORMED, NUMBER_TOO_LARGE };

/* Read a decimal number from the front of `text`; *rest is what follows it. */
enum number_status number_read(const char *text, double *value, const char **rest);

/* The whole text as a number or as a whole number that fits in an int. */
enum number_status number_parse(const char *text, double *value);
enum number_status number_parse_int(const char *text, int *value);

/* Whether minimum <= value <= maximum; both 0: always. */
bool number_is_within(double value, double minimum, double maximum);

/* The limits in words: "1 to 512", "at least 0 mm", "at most 7"; empty without limits. Infinities and an int's own
 * limits count as none. `unit` may be NULL. */
void number_describe_range(double minimum, double maximum, const char *unit, char *text,
                           size_t size);

/* The shortest text that number_parse turns back into exactly `value`. 32 bytes are enough. */
void number_format(double value, char *text, size_t size);

#endif
