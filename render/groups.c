/* A table of keys with linear probing. */
#include "render/groups.h"

#include "render/random.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

struct group_slot {
    struct group_key key;
    uint32_t number_plus_1; /* 0: empty */
};

int groups_begin(struct groups *groups, size_t expected)
{
    *groups = (struct groups){.mask = 63};
    while (groups->mask < 2 * expected) {
        groups->mask = 2 * groups->mask + 1;
    }
    groups->slots = calloc(groups->mask + 1, sizeof *groups->slots);
    return groups->slots ? 0 : -1;
}

void groups_end(struct groups *groups)
{
    free(groups->slots);
    *groups = (struct groups){0};
}

static bool same(struct group_key a, struct group_key b)
{
    return a.x == b.x && a.y == b.y && a.kind == b.kind && a.part == b.part;
}

static struct group_slot *slot_for(const struct groups *groups, struct group_key key)
{
    uint64_t place = (uint64_t)(uint32_t)key.x << 32 | (uint32_t)key.y;
    uint64_t which = (uint64_t)(uint32_t)key.kind << 32 | key.part;
    size_t i = (size_t)random_mix(place ^ which * UINT64_C(0x9e3779b97f4a7c15)) & groups->mask;
    /* NOLINTNEXTLINE(clang-analyzer-unix.Malloc): a grown table's slots are its own */
    while (groups->slots[i].number_plus_1 && !same(groups->slots[i].key, key)) {
        i = (i + 1) & groups->mask;
    }
    return &groups->slots[i];
}

static bool grow(struct groups *groups)
{
    struct groups larger;
    if (groups->count >= GROUPS_FULL - 1 || groups_begin(&larger, groups->mask + 1) != 0) {
        return false;
    }
    larger.count = groups->count;
    for (size_t i = 0; i <= groups->mask; i++) {
        if (groups->slots[i].number_plus_1) {
            *slot_for(&larger, groups->slots[i].key) = groups->slots[i];
        }
    }
    struct group_slot *old = groups->slots;
    *groups = larger;
    free(old);
    return true;
}

uint32_t groups_number(struct groups *groups, struct group_key key)
{
    struct group_slot *slot = slot_for(groups, key);
    if (!slot->number_plus_1) {
        if (4 * groups->count > 3 * groups->mask) {
            if (!grow(groups)) {
                return GROUPS_FULL;
            }
            slot = slot_for(groups, key);
        }
        slot->key = key;
        slot->number_plus_1 = (uint32_t)++groups->count;
    }
    return slot->number_plus_1 - 1;
}

uint32_t groups_part(const float position[3], const float normal[3], double cube)
{
    uint64_t place = 0;
    int axis = 0;
    for (int k = 0; k < 3; k++) {
        axis = fabsf(normal[k]) > fabsf(normal[axis]) ? k : axis;
        place = place << 21 | ((uint64_t)(int64_t)floor((double)position[k] / cube) & 0x1fffff);
    }
    place = random_mix(random_mix(place) + (uint64_t)(2 * axis + (normal[axis] < 0)));
    return (uint32_t)(place >> 32) | 1; /* 0 is for groups that are not parted */
}
