/* Comparing two structs of settings key by key. */
#include "base/settings.h"

#include <stdio.h>
#include <string.h>

static bool same_text(const char *a, const char *b)
{
    return a && b ? strcmp(a, b) == 0 : a == b;
}

static size_t length_of(const struct settings_field *field, const void *settings)
{
    size_t length;
    memcpy(&length, (const char *)settings + field->length_offset, sizeof length);
    return length;
}

static const void *pointer_at(const void *address)
{
    const void *pointer;
    memcpy(&pointer, address, sizeof pointer);
    return pointer;
}

static bool same_strings(const void *a, const void *b, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (!same_text(pointer_at((const char *)a + i * sizeof(char *)),
                       pointer_at((const char *)b + i * sizeof(char *)))) {
            return false;
        }
    }
    return true;
}

/* Put "KEY" or "KEY." before what is in `where`. */
static void put_before(const char *key, char *where, size_t size)
{
    char rest[256];
    (void)snprintf(rest, sizeof rest, "%s", where);
    (void)snprintf(where, size, "%s%s%s", key, *rest ? "." : "", rest); /* a cut key still helps */
}

static bool same_value(const struct settings_field *field, const void *a, const void *b,
                       char *where, size_t size)
{
    const void *va = (const char *)a + field->offset;
    const void *vb = (const char *)b + field->offset;
    switch (field->kind) {
    case SETTINGS_BOOL:
        return memcmp(va, vb, sizeof(bool)) == 0;
    case SETTINGS_INT:
    case SETTINGS_CHOICE:
        return memcmp(va, vb, sizeof(int)) == 0;
    case SETTINGS_REAL:
        return memcmp(va, vb, sizeof(double)) == 0;
    case SETTINGS_REALS:
        return memcmp(va, vb, field->count * sizeof(double)) == 0;
    case SETTINGS_STRING:
    case SETTINGS_PATH:
        return same_text(pointer_at(va), pointer_at(vb));
    case SETTINGS_STRUCT:
        return settings_same(field->schema, va, vb, where, size);
    case SETTINGS_LIST:
    case SETTINGS_NUMBERS:
    case SETTINGS_STRINGS:
        break;
    }
    size_t count = length_of(field, a);
    bool same = count == length_of(field, b);
    va = pointer_at(va);
    vb = pointer_at(vb);
    if (field->kind == SETTINGS_STRINGS) {
        return same && same_strings(va, vb, count);
    }
    if (field->kind == SETTINGS_NUMBERS) {
        return same && (count == 0 || memcmp(va, vb, count * sizeof(double)) == 0);
    }
    for (size_t i = 0; i < count && same; i++) {
        size_t offset = i * field->schema->size;
        same = settings_same(field->schema, (const char *)va + offset, (const char *)vb + offset,
                             where, size);
    }
    return same;
}

bool settings_same(const struct settings_schema *schema, const void *a, const void *b, char *where,
                   size_t size)
{
    if (size > 0) {
        *where = '\0';
    }
    for (const struct settings_field *field = schema->fields; field->key; field++) {
        if (!same_value(field, a, b, where, size)) {
            put_before(field->key, where, size);
            return false;
        }
        if (size > 0) {
            *where = '\0';
        }
    }
    return true;
}
