/* The known word that a person most likely meant by an unknown one. */
#ifndef BASE_NEAREST_H
#define BASE_NEAREST_H

#include <stddef.h>

/* A search under way. */
struct nearest {
    const char *word;
    const char *best; /* NULL: nothing offered so far is near enough to be a slip of the fingers */
    size_t distance;
};

struct nearest nearest_begin(const char *word);
void nearest_offer(struct nearest *nearest, const char *candidate);

#endif
