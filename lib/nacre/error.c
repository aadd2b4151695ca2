/* Writing error texts. */
#include "nacre/error.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

int nacre_fail(struct nacre_error *error, const char *format, ...)
{
    if (error) {
        va_list arguments;
        va_start(arguments, format);
        (void)vsnprintf(error->text, sizeof error->text, format,
                        arguments); /* a cut text still helps */
        va_end(arguments);
    }
    return NACRE_FAILED;
}

int nacre_fail_errno(struct nacre_error *error, int number, const char *format, ...)
{
    if (error) {
        char cause[128];
        va_list arguments;
        va_start(arguments, format);
        (void)vsnprintf(error->text, sizeof error->text, format, arguments);
        va_end(arguments);
        size_t used = strlen(error->text);
        (void)snprintf(error->text + used, sizeof error->text - used, ": %s",
                       strerror_r(number, cause, sizeof cause));
    }
    return NACRE_FAILED;
}

int nacre_fail_memory(struct nacre_error *error, const char *what)
{
    return nacre_fail(error, "out of memory for %s", what);
}

int nacre_fail_within(struct nacre_error *error, const char *format, ...)
{
    if (error) {
        char inner[sizeof error->text];
        memcpy(inner, error->text, sizeof inner);
        va_list arguments;
        va_start(arguments, format);
        (void)vsnprintf(error->text, sizeof error->text, format, arguments);
        va_end(arguments);
        size_t used = strlen(error->text);
        (void)snprintf(error->text + used, sizeof error->text - used, ": %.*s",
                       (int)(sizeof inner - 1), inner);
    }
    return NACRE_FAILED;
}
