/* Walking through the elements of a PLY file. */
#include "render/mesh_ply.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { ELEMENTS = 16, PROPERTIES = 64, LINE = 256 };

struct property {
    int count_bytes; /* of a list's length; 0: no list */
    int bytes;
};

struct element {
    char name[32];
    uint64_t count;
    int properties;
    struct property list[PROPERTIES];
};

struct ply {
    const char *path, *at, *end;
    bool ascii, big_endian;
    size_t line; /* number of the line before `at`, where it is text */
    int elements;
    struct element list[ELEMENTS];
};

static int size_of(const char *type)
{
    static const struct {
        const char *name;
        int bytes;
    } types[] = {{"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},
                 {"short", 2}, {"ushort", 2},  {"int16", 2},  {"uint16", 2},
                 {"int", 4},   {"uint", 4},    {"int32", 4},  {"uint32", 4},
                 {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
    for (size_t i = 0; i < sizeof types / sizeof *types; i++) {
        if (strcmp(type, types[i].name) == 0) {
            return types[i].bytes;
        }
    }
    return 0;
}

/* The next line and its end; false where there is none. */
static bool next_line(struct ply *ply, const char **begin, const char **end)
{
    if (ply->at == ply->end) {
        return false;
    }
    const char *newline = memchr(ply->at, '\n', (size_t)(ply->end - ply->at));
    *begin = ply->at;
    *end = newline ? newline : ply->end;
    ply->at = newline ? newline + 1 : ply->end;
    ply->line++;
    return true;
}

static bool add_property(struct element *element, char *words)
{
    char *rest = NULL, *type = strtok_r(words, " \t\r", &rest);
    if (!type || element->properties == PROPERTIES) {
        return false;
    }
    struct property *property = &element->list[element->properties++];
    *property = (struct property){0};
    if (strcmp(type, "list") == 0) {
        const char *count = strtok_r(NULL, " \t\r", &rest);
        type = strtok_r(NULL, " \t\r", &rest);
        property->count_bytes =
            count && strncmp(count, "float", 5) != 0 && size_of(count) < 8 ? size_of(count) : 0;
        if (property->count_bytes == 0 || !type) {
            return false;
        }
    }
    property->bytes = size_of(type);
    return property->bytes > 0;
}

static bool add_element(struct ply *ply, char *words)
{
    char *rest = NULL;
    const char *name = strtok_r(words, " \t\r", &rest), *count = strtok_r(NULL, " \t\r", &rest);
    if (!name || !count || strlen(name) >= sizeof ply->list->name || ply->elements == ELEMENTS) {
        return false;
    }
    struct element *element = &ply->list[ply->elements++];
    *element = (struct element){.count = strtoull(count, NULL, 10)};
    memcpy(element->name, name, strlen(name) + 1);
    return true;
}

/* Up to end_header; false where it cannot be followed. */
static bool read_header(struct ply *ply)
{
    const char *begin, *end;
    char line[LINE];
    bool known = false;
    while (next_line(ply, &begin, &end)) {
        if ((size_t)(end - begin) >= sizeof line) {
            return false;
        }
        memcpy(line, begin, (size_t)(end - begin));
        line[end - begin] = '\0';
        if (strncmp(line, "end_header", 10) == 0) {
            return known;
        }
        if (strncmp(line, "format ", 7) == 0) {
            ply->ascii = strncmp(line + 7, "ascii", 5) == 0;
            ply->big_endian = strncmp(line + 7, "binary_big", 10) == 0;
            known = ply->ascii || ply->big_endian || strncmp(line + 7, "binary_little", 13) == 0;
        } else if (strncmp(line, "element ", 8) == 0) {
            if (!add_element(ply, line + 8)) {
                return false;
            }
        } else if (strncmp(line, "property ", 9) == 0 &&
                   (ply->elements == 0 || !add_property(&ply->list[ply->elements - 1], line + 9))) {
            return false;
        }
    }
    return false;
}

/* The next number of a line, or NULL. */
static const char *next_word(const char **at, const char *end)
{
    while (*at < end && strchr(" \t\r", **at)) {
        (*at)++;
    }
    const char *word = *at;
    while (*at < end && !strchr(" \t\r", **at)) {
        (*at)++;
    }
    return word < *at ? word : NULL;
}

static bool skip_words(const char **at, const char *end, uint64_t count)
{
    while (count > 0 && next_word(at, end)) {
        count--;
    }
    return count == 0;
}

/* A line of numbers; those that are empty or a comment are passed over. */
static bool skip_line(struct ply *ply, const struct element *element)
{
    const char *begin, *end, *word;
    do {
        if (!next_line(ply, &begin, &end)) {
            return false;
        }
        const char *at = begin;
        word = next_word(&at, end);
    } while (!word || (end - word >= 7 && strncmp(word, "comment", 7) == 0));
    for (int i = 0; i < element->properties; i++) {
        uint64_t count = 1;
        if (element->list[i].count_bytes > 0) {
            const char *number = next_word(&begin, end);
            count = number ? strtoull(number, NULL, 10) : UINT64_MAX;
        }
        if (!skip_words(&begin, end, count)) {
            return false;
        }
    }
    return true;
}

static bool skip_bytes(struct ply *ply, uint64_t count)
{
    if (count > (uint64_t)(ply->end - ply->at)) {
        return false;
    }
    ply->at += count;
    return true;
}

static bool skip_binary(struct ply *ply, const struct element *element)
{
    for (int i = 0; i < element->properties; i++) {
        const struct property *property = &element->list[i];
        uint64_t count = 1;
        if (property->count_bytes > 0) {
            const unsigned char *bytes = (const unsigned char *)ply->at;
            if (!skip_bytes(ply, (uint64_t)property->count_bytes)) {
                return false;
            }
            count = 0;
            for (int k = 0; k < property->count_bytes; k++) {
                int from = ply->big_endian ? k : property->count_bytes - 1 - k;
                count = count << 8 | bytes[from];
            }
        }
        if (!skip_bytes(ply, count * (uint64_t)property->bytes)) {
            return false;
        }
    }
    return true;
}

static int fail_short(const struct ply *ply, const struct element *element, uint64_t index,
                      struct nacre_error *error)
{
    if (ply->ascii && ply->at != ply->end) {
        return nacre_fail(error,
                          "%s:%zu: the line has too few numbers for %s %llu; mend the file or make "
                          "it again",
                          ply->path, ply->line, element->name, (unsigned long long)index);
    }
    return nacre_fail(error,
                      "%s: ends at %s %llu of the %llu that its header announces: it is cut off; "
                      "make it again",
                      ply->path, element->name, (unsigned long long)index,
                      (unsigned long long)element->count);
}

int mesh_ply_check(const char *path, const char *text, size_t size, struct nacre_error *error)
{
    int status = NACRE_OK;
    if (!memmem(text, size, "\nend_header", 11)) { /* which Assimp would look for, for ever */
        return nacre_fail(error, "%s: the header has no end_header: it is damaged or cut off",
                          path);
    }
    struct ply *ply = calloc(1, sizeof *ply);
    if (!ply) {
        return nacre_fail_memory(error, "the header of a mesh");
    }
    ply->path = path;
    ply->at = text;
    ply->end = text + size;
    bool followed = read_header(ply);
    for (int i = 0; followed && status == NACRE_OK && i < ply->elements; i++) {
        const struct element *element = &ply->list[i];
        for (uint64_t k = 0; element->properties > 0 && status == NACRE_OK && k < element->count;
             k++) {
            if (!(ply->ascii ? skip_line(ply, element) : skip_binary(ply, element))) {
                status = fail_short(ply, element, k, error);
            }
        }
    }
    free(ply);
    return status;
}
