/* Numbering of places: equal keys have the same number, numbers in the order in which they are first asked for. */
#ifndef RENDER_GROUPS_H
#define RENDER_GROUPS_H

#include <stddef.h>
#include <stdint.h>

struct group_key {
    int32_t kind, x, y;
    uint32_t part;
};

struct groups {
    size_t count, mask;
    struct group_slot *slots;
};

enum { GROUPS_FULL = 0x7fffffff };

/* Room for `expected` keys; grows. Returns 0, or -1 when memory ran out. */
int groups_begin(struct groups *groups, size_t expected);
void groups_end(struct groups *groups);

/* The key's number; GROUPS_FULL when memory ran out. */
uint32_t groups_number(struct groups *groups, struct group_key key);

/* Which cube of side `cube`, and which of six directions: what keeps places apart that the texture does not. */
uint32_t groups_part(const float position[3], const float normal[3], double cube);

#endif
