/* Parsing, limiting and formatting numbers. */
#include "base/number.h"

#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* strtod would take blanks in front, "inf", "nan" and hexadecimal too. */
static bool starts_decimal(const char *text)
{
    text += *text == '-' || *text == '+';
    text += *text == '.';
    return isdigit((unsigned char)*text) && !(text[0] == '0' && (text[1] == 'x' || text[1] == 'X'));
}

enum number_status number_read(const char *text, double *value, const char **rest)
{
    char *end = NULL;
    if (!starts_decimal(text)) {
        return NUMBER_MALFORMED;
    }
    *value = strtod(text, &end);
    *rest = end;
    return isfinite(*value) ? NUMBER_OK : NUMBER_TOO_LARGE;
}

enum number_status number_parse(const char *text, double *value)
{
    const char *rest = NULL;
    enum number_status status = number_read(text, value, &rest);
    return status != NUMBER_MALFORMED && *rest ? NUMBER_MALFORMED : status;
}

enum number_status number_parse_int(const char *text, int *value)
{
    char *end = NULL;
    if (!starts_decimal(text)) {
        return NUMBER_MALFORMED;
    }
    errno = 0;
    long number = strtol(text, &end, 10);
    if (*end) {
        return NUMBER_MALFORMED;
    }
    if (errno || number < INT_MIN || number > INT_MAX) {
        return NUMBER_TOO_LARGE;
    }
    *value = (int)number;
    return NUMBER_OK;
}

bool number_is_within(double value, double minimum, double maximum)
{
    return (minimum == 0 && maximum == 0) || (value >= minimum && value <= maximum);
}

void number_describe_range(double minimum, double maximum, const char *unit, char *text,
                           size_t size)
{
    char low[32], high[32];
    bool has_low = isfinite(minimum) && minimum != INT_MIN;
    bool has_high = isfinite(maximum) && maximum != INT_MAX;
    const char *gap = unit ? " " : "";
    number_format(minimum, low, sizeof low);
    number_format(maximum, high, sizeof high);
    unit = unit ? unit : "";
    if ((minimum == 0 && maximum == 0) || (!has_low && !has_high)) {
        text[0] = '\0';
    } else if (!has_high) {
        (void)snprintf(text, size, "at least %s%s%s", low, gap, unit);
    } else if (!has_low) {
        (void)snprintf(text, size, "at most %s%s%s", high, gap, unit);
    } else {
        (void)snprintf(text, size, "%s to %s%s%s", low, high, gap, unit);
    }
}

void number_format(double value, char *text, size_t size)
{
    if (fabs(value) < 1e15 && value == floor(value) && !(value == 0 && signbit(value))) {
        (void)snprintf(text, size, "%.0f", value);
        return;
    }
    for (int digits = 1; digits <= 17; digits++) {
        (void)snprintf(text, size, "%.*g", digits, value);
        if (strtod(text, NULL) == value) {
            return;
        }
    }
}
