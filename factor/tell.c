/* Telling whoever listens what was chosen and why. */
#include "factor/tell.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>

bool tell_is_heard(const struct listener *to)
{
    return to && to->hear;
}

void tell(const struct listener *to, const char *key, const char *format, ...)
{
    char text[512];
    va_list arguments;
    if (!tell_is_heard(to)) {
        return;
    }
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    to->hear(to->data, key, text);
}
