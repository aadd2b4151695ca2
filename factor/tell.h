/* Telling whoever listens what was chosen and why: lines of a key and a text, as --explain prints them. */
#ifndef FACTOR_TELL_H
#define FACTOR_TELL_H

#include <stdbool.h>

/* Who listens. Zeroed: nobody. */
struct listener {
    void (*hear)(void *data, const char *key, const char *text);
    void *data;
};

/* Tell one line; `to` may be NULL. */
void tell(const struct listener *to, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Whether anybody listens, where finding out what to tell costs something. */
bool tell_is_heard(const struct listener *to);

#endif
