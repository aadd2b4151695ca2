/* What the user should know of a result that was made all the same. */
#include "rig/develop/warnings.h"

#include <stdarg.h>
#include <stdio.h>

void warnings_add(struct warnings *warnings, const char *format, ...)
{
    int room = (int)(sizeof warnings->texts / sizeof *warnings->texts);
    if (warnings->count < room) {
        va_list arguments;
        va_start(arguments, format);
        (void)vsnprintf(warnings->texts[warnings->count], sizeof *warnings->texts, format,
                        arguments);
        va_end(arguments);
        warnings->count++;
    }
}
