/* YAML settings read into C structs by tables that refuse what they do not know, with line and column. */
#ifndef BASE_SETTINGS_H
#define BASE_SETTINGS_H

#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>

enum settings_kind {
    SETTINGS_BOOL,    /* bool */
    SETTINGS_INT,     /* int */
    SETTINGS_REAL,    /* double */
    SETTINGS_STRING,  /* char *, heap */
    SETTINGS_PATH,    /* char *, heap: relative to the file's own folder; absolute when read */
    SETTINGS_CHOICE,  /* int, index into words */
    SETTINGS_REALS,   /* double[count], a sequence of `count` numbers; one number fills all */
    SETTINGS_STRUCT,  /* a struct inside the struct, by `schema` */
    SETTINGS_LIST,    /* heap array of structs by `schema`; its size_t length at `length_offset` */
    SETTINGS_NUMBERS, /* heap array of double; its size_t length at `length_offset` */
    SETTINGS_STRINGS, /* heap array of char *; its size_t length at `length_offset` */
};

struct settings_schema;

/* One key. A table ends with a zeroed entry. */
struct settings_field {
    const char *key;
    enum settings_kind kind;
    size_t offset;           /* of the value */
    size_t length_offset;    /* lists: of the length */
    size_t count;            /* SETTINGS_REALS */
    double minimum, maximum; /* inclusive; both 0: no limits. Lists: of each number */
    bool required;
    const char *fallback;     /* all but STRUCT and LIST: the default, in YAML; NULL: zero */
    const char *const *words; /* NULL-terminated; CHOICE: of one, STRINGS: of each, NULL: any */
    const struct settings_schema *schema;
    const char *sentence;              /* what it means, with its unit */
    size_t line_offset, column_offset; /* of ints that get the key's line and column (0: none) */
};

struct settings_schema {
    const char *what; /* "sample file", for messages */
    size_t size;      /* of the struct */
    const struct settings_field *fields;
    size_t line_offset, column_offset; /* of ints that get the mapping's place (0: none) */
};

/* Read `path` into *out (zeroed here first). On failure nothing is held. A message names file, line, column, key and
 * what would be right. Structs that are left out get their defaults, and what they require is not missed. */
int settings_read(const char *path, const struct settings_schema *schema, void *out,
                  struct nacre_error *error);

/* The same from text, named `name` in messages; relative paths are taken from `folder`. */
int settings_parse(const char *name, const char *folder, const char *text, size_t size,
                   const struct settings_schema *schema, void *out, struct nacre_error *error);

/* Write *in as YAML that settings_read takes back with equal values: the whole file or none. Values equal to their
 * default are written too, so that the file says everything. What was left out and has no default that could be written
 * is left out again. Relative paths, which hold from the working folder, are written as absolute ones. What
 * settings_read would refuse is refused here. */
int settings_write(const char *path, const struct settings_schema *schema, const void *in,
                   struct nacre_error *error);

/* The same text, but not checked; the caller frees *text, on failure too. */
int settings_text(const struct settings_schema *schema, const void *in, char **text, size_t *size,
                  struct nacre_error *error);

/* Whether two structs that were read say the same. Where they do not, `where` gets the key ("camera.bits", cut to
 * `size`) of the first difference. */
bool settings_same(const struct settings_schema *schema, const void *a, const void *b, char *where,
                   size_t size);

/* Free what settings_read allocated and zero the struct. */
void settings_finish(const struct settings_schema *schema, void *settings);

#endif
